"""glTF 2.0 documents: the JSON as it is, its buffers, and the arrays that accessors name."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats

__all__ = ["Gltf", "decoded", "read_gltf", "resource", "rows", "view_bytes"]

# What cannot be read, or edited, without a decoder.
COMPRESSIONS = (
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
)
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_JSON, _BIN = 0x4E4F534A, 0x004E4942
Json = dict[str, Any]
Rows = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Gltf:
    """A glTF document.

    Attributes
    ----------
    json : dict
        As in the file.
    buffers : tuple of bytes
        Of the binary chunk, of data URIs and of files.
    folder : Path
        What its relative URIs are relative to.
    embedded : bool
        Whether no buffer is a file of its own.
    """

    json: Json
    buffers: tuple[bytes, ...]
    folder: Path
    embedded: bool


def read_gltf(path: Path) -> Gltf:
    """Read a `.glb` or `.gltf` file and its buffers.

    Raises
    ------
    ValueError
        For a file that is none, a missing buffer, and a compression that cannot be read; the
        message does not name the file.
    """
    data = path.read_bytes()
    binary = None
    if data[:4] == b"glTF":
        text, binary = _chunks(data)
    else:
        text = data
    try:
        document = json.loads(text)
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError("its JSON cannot be read") from error
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise ValueError("its JSON is no glTF: there is no asset")
    if not str(document["asset"].get("version", "")).startswith("2"):
        raise ValueError(f"version {document['asset'].get('version')} of glTF is not supported")
    _refuse_compressions(document)
    buffers, embedded = [], True
    for index, entry in enumerate(document.get("buffers", [])):
        uri = entry.get("uri")
        if uri is None:
            content = binary if index == 0 else None
            name = f"buffer {index}"
        else:
            content = resource(path.parent, uri)
            name = "a data URI" if uri.startswith("data:") else f"the buffer {uri}"
            embedded &= uri.startswith("data:")
        if content is None:
            raise ValueError(f"{name} is missing")
        if len(content) < entry.get("byteLength", 0):
            raise ValueError(f"{name} is cut short")
        buffers.append(content)
    gltf = Gltf(document, tuple(buffers), path.parent, embedded)
    for index in range(len(document.get("bufferViews", []))):
        view_bytes(gltf, index)
    return gltf


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON and the binary chunk of a GLB file."""
    try:
        version, _ = struct.unpack_from("<2I", data, 4)
        if version != 2:
            raise ValueError(f"version {version} of glTF is not supported")
        found: dict[int, bytes] = {}
        place = 12
        while place + 8 <= len(data):
            size, kind = struct.unpack_from("<2I", data, place)
            if place + 8 + size > len(data):
                raise ValueError("the file is cut short")
            found.setdefault(kind, data[place + 8 : place + 8 + size])
            place += 8 + size
    except struct.error as error:
        raise ValueError("the file is cut short") from error
    if _JSON not in found:
        raise ValueError("there is no JSON chunk")
    return found[_JSON], found.get(_BIN)


def _refuse_compressions(document: Json) -> None:
    primitives = [p for mesh in document.get("meshes", []) for p in mesh.get("primitives", [])]
    holders = [*primitives, *document.get("bufferViews", []), *document.get("buffers", [])]
    used = {name for holder in holders for name in holder.get("extensions", {})}
    used |= set(document.get("extensionsRequired", []))
    for name in COMPRESSIONS:
        if name in used:
            raise ValueError(f"its compression, the glTF extension {name}, cannot be read")


def resource(folder: Path, uri: str) -> bytes | None:
    """What a URI names, from the text itself or a file; None where there is none."""
    if uri.startswith("data:"):
        head, _, body = uri.partition(",")
        try:
            return base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body)
        except binascii.Error:
            return None
    try:
        return (folder / unquote(uri)).read_bytes()
    except (OSError, ValueError):
        return None


def view_bytes(gltf: Gltf, index: int) -> memoryview:
    """Bytes of a buffer view, not copied."""
    view = gltf.json["bufferViews"][index]
    start = view.get("byteOffset", 0)
    data = memoryview(gltf.buffers[view["buffer"]])[start : start + view["byteLength"]]
    if len(data) < view["byteLength"]:
        raise ValueError(f"buffer view {index} reaches past its buffer")
    return data


def rows(gltf: Gltf, index: int) -> Rows:
    """Components of an accessor as they are, (count, width), sparse ones filled in."""
    accessor = gltf.json["accessors"][index]
    kind, width = _COMPONENTS[accessor["componentType"]], _WIDTHS[accessor["type"]]
    count = accessor["count"]
    if "bufferView" in accessor:
        start = accessor.get("byteOffset", 0)
        values = _strided(gltf, accessor["bufferView"], start, kind, count, width)
    else:
        values = np.zeros((count, width), dtype=kind)
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        places, new = sparse["indices"], sparse["values"]
        which = _strided(
            gltf,
            places["bufferView"],
            places.get("byteOffset", 0),
            _COMPONENTS[places["componentType"]],
            sparse["count"],
            1,
        )
        values = values.copy()
        values[which[:, 0].astype(np.int64)] = _strided(
            gltf, new["bufferView"], new.get("byteOffset", 0), kind, sparse["count"], width
        )
    return values


def _strided(gltf: Gltf, view: int, start: int, kind: str, count: int, width: int) -> Rows:
    data = view_bytes(gltf, view)
    size = np.dtype(kind).itemsize
    stride = gltf.json["bufferViews"][view].get("byteStride") or size * width
    if count and start + stride * (count - 1) + size * width > len(data):
        raise ValueError(f"an accessor reaches past buffer view {view}")
    return np.ndarray((count, width), kind, data, start, (stride, size))


def decoded(gltf: Gltf, index: int) -> Floats:
    """Values of an accessor in double precision; normalised integers as they are meant."""
    raw = rows(gltf, index)
    values = raw.astype(np.float64)
    if gltf.json["accessors"][index].get("normalized") and raw.dtype.kind in "iu":
        values = np.maximum(values / np.iinfo(raw.dtype).max, -1.0)
    return values
