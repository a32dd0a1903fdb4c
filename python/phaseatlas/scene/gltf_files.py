"""glTF documents as bytes of files."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from urllib.parse import quote, unquote

from .accessors import Json, resource
from .mesh import Contents

__all__ = ["copy_beside", "glb_bytes", "gltf_files"]


def glb_bytes(document: Json, buffer: bytes) -> bytes:
    """Return a binary file of a document with at most one buffer."""
    text = _text(document)
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    if buffer:
        buffer += bytes(-len(buffer) % 4)
        chunks += struct.pack("<2I", len(buffer), 0x004E4942) + buffer
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf_files(
    path: Path, document: Json, buffer: bytes, folder: Path, *, embedded: bool
) -> Contents:
    """Return a `.glb` or `.gltf` file and what belongs beside it.

    Parameters
    ----------
    path : Path
        Of the file. A `.gltf` file has its buffer in it, or beside it as a `.bin` file.
    document, buffer : dict, bytes
        The document and its one buffer.
    folder : Path
        Where files are that its images name. Those in or below it are copied beside `path`.
    embedded : bool
        Whether the buffer of a `.gltf` file is a data URI.
    """
    files: dict[Path, bytes] = {}
    notes = []
    for entry in document.get("images", []):
        uri = entry.get("uri", "data:")
        if uri.startswith("data:"):
            continue
        data = resource(folder, uri)
        if data is None:
            notes.append(f"the texture {uri} is missing")
            continue
        copies, said = copy_beside(path.parent, folder, unquote(uri), data)
        files |= copies
        notes += said
    if path.suffix.lower() == ".glb":
        return Contents({**files, path: glb_bytes(document, buffer)}, tuple(notes))
    if buffer and embedded:
        uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
        document["buffers"][0] = {"uri": uri, **document["buffers"][0]}
    elif buffer:
        beside = path.with_suffix(".bin")
        document["buffers"][0] = {"uri": quote(beside.name), **document["buffers"][0]}
        files[beside] = buffer
    return Contents({**files, path: _text(document)}, tuple(notes))


def copy_beside(
    target: Path, folder: Path, name: str, data: bytes
) -> tuple[dict[Path, bytes], list[str]]:
    """Return a file of one folder, to be written to the same place of another.

    Files that are there already are left as they are, and so is what lies outside of the folder.
    """
    relative = Path(name.replace("\\", "/"))
    if target.resolve() == folder.resolve() or relative.is_absolute():
        return {}, []
    if ".." in relative.parts:
        return {}, [f"{name} lies outside of the file's folder and was not copied"]
    place = target / relative
    if not place.exists():
        return {place: data}, []
    if place.read_bytes() != data:
        return {}, [f"{place} was there, differs from {folder / relative}, and was left"]
    return {}, []


def _text(document: Json) -> bytes:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
