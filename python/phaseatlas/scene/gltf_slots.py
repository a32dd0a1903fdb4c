"""Places of new accessors and buffer views in a glTF document, and its one buffer.

Other parts of the JSON, extensions among them, name accessors and views by their numbers. So these
never move: what is no longer named gives its number to something new.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .accessors import Gltf, Json, Rows
from .gltf import APPEARANCE

__all__ = ["NewAccessor", "NewView", "attribute", "indices", "integers", "settle"]

_TARGETS = {"vertices": 34962, "indices": 34963}


@dataclass(frozen=True, eq=False)
class NewView:
    """Bytes that stand in the JSON in place of the number of a buffer view."""

    data: bytes


@dataclass(frozen=True, eq=False)
class NewAccessor:
    """Values that stand in the JSON in place of the number of an accessor.

    Attributes
    ----------
    entry : dict
        Its type and what else the JSON says of it.
    values : (count, width) array, optional
        None for zeros that take no room.
    use : {"vertices", "indices"}
        What it is for.
    """

    entry: Json
    values: Rows | None
    use: str


def attribute(kind: str, values: Rows, **more: list[float]) -> NewAccessor:
    """Values at vertices in single precision; `kind` is their type in glTF."""
    entry = {"componentType": 5126, "type": kind, **more}
    return NewAccessor(entry, values.astype("<f4"), "vertices")


def indices(corners: Rows) -> NewAccessor:
    """Vertices of the corners of triangles, one after the other, in as few bytes as will do."""
    # 65535 restarts a strip.
    small = int(corners.max(initial=0)) < 65535
    return NewAccessor(
        {"componentType": 5123 if small else 5125, "type": "SCALAR"},
        corners.reshape(-1, 1).astype("<u2" if small else "<u4"),
        "indices",
    )


def settle(gltf: Gltf, document: Json) -> tuple[Json, bytes]:
    """Number what is new, drop what it replaces, and gather all in one buffer.

    Parameters
    ----------
    gltf : Gltf
        What was read.
    document : dict
        Its JSON with new accessors and views in place of numbers; it is completed.

    Returns
    -------
    json : dict
    buffer : bytes
    """
    before = gltf.json
    accessors = document.setdefault("accessors", [])
    views = document.setdefault("bufferViews", [])
    free = _Slots(accessors, _named(before, _accessors) - _named(document, _accessors))
    numbers: dict[int, int] = {}
    fresh: set[int] = set()
    for holder, key in _accessors(document):
        value = holder[key]
        if isinstance(value, NewAccessor):
            if id(value) not in numbers:
                numbers[id(value)] = free.put(_entry(value))
                fresh.add(numbers[id(value)])
            holder[key] = numbers[id(value)]
    free.close({"componentType": 5126, "type": "SCALAR", "count": 1})
    gone = _named(before, _views) - _named(document, _views)
    spare = _Slots(views, gone)
    new: dict[int, bytes] = {}
    for holder, key in _views(document):
        value = holder[key]
        if isinstance(value, _View | NewView):
            entry = dict(value.entry) if isinstance(value, _View) else {}
            number = spare.put(entry)
            new[number] = value.data
            holder[key] = number
    for number in spare.close({}):
        new[number] = bytes(4)
    return document, _buffer(gltf, document, new)


@dataclass(frozen=True, eq=False)
class _View:
    data: bytes
    entry: Json


class _Slots:
    """Members of a list of the JSON, of which some may be replaced."""

    def __init__(self, members: list[Json], free: set[int]) -> None:
        self._members = members
        self._free = sorted(free, reverse=True)

    def put(self, member: Json) -> int:
        """Place a member and return its number."""
        if self._free:
            number = self._free.pop()
            self._members[number] = member
            return number
        self._members.append(member)
        return len(self._members) - 1

    def close(self, filler: Json) -> list[int]:
        """Drop free members at the end, fill those that others follow, and return these."""
        free = set(self._free)
        while self._members and len(self._members) - 1 in free:
            free.discard(len(self._members) - 1)
            self._members.pop()
        for number in free:
            self._members[number] = dict(filler)
        return sorted(free)


def _entry(new: NewAccessor) -> Json:
    if new.values is None:
        return new.entry
    values = np.ascontiguousarray(new.values)
    size = values.shape[1] * values.dtype.itemsize
    view: Json = {"target": _TARGETS[new.use]}
    raw = values.view(np.uint8).reshape(len(values), size)
    if new.use == "vertices" and size % 4:
        # Attributes of vertices start at multiples of four.
        raw = np.pad(raw, [(0, 0), (0, -size % 4)])
        view["byteStride"] = raw.shape[1]
    return {
        "bufferView": _View(raw.tobytes(), view),
        **new.entry,
        "count": len(values),
    }


def _accessors(document: Json) -> Iterator[tuple[Any, Any]]:
    """All places of the JSON that name an accessor, as holders and keys."""
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            for holder in (primitive.get("attributes", {}), *primitive.get("targets", [])):
                yield from ((holder, key) for key in holder)
            if "indices" in primitive:
                yield primitive, "indices"
    for animation in document.get("animations", []):
        for sampler in animation.get("samplers", []):
            yield from ((sampler, key) for key in ("input", "output") if key in sampler)
    for skin in document.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin, "inverseBindMatrices"


def _views(document: Json) -> Iterator[tuple[Any, Any]]:
    """All places of the JSON that name a buffer view, as holders and keys."""
    for accessor in document.get("accessors", []):
        sparse = accessor.get("sparse", {})
        for holder in (accessor, sparse.get("indices", {}), sparse.get("values", {})):
            if "bufferView" in holder:
                yield holder, "bufferView"
    for image in document.get("images", []):
        if "bufferView" in image:
            yield image, "bufferView"


def _named(document: Json, places: Any) -> set[int]:
    """Numbers that are named, and all that an extension might name."""
    numbers = {holder[key] for holder, key in places(document) if isinstance(holder[key], int)}
    return numbers | set(integers(document, inside=False))


def integers(value: Any, *, inside: bool) -> Iterator[int]:
    """Integers in extensions, wherever they stand."""
    if isinstance(value, dict):
        for key, member in value.items():
            if not key.startswith(APPEARANCE):
                yield from integers(member, inside=inside or key == "extensions")
    elif isinstance(value, list):
        for member in value:
            yield from integers(member, inside=inside)
    elif inside and isinstance(value, int) and not isinstance(value, bool):
        yield value


def _buffer(gltf: Gltf, document: Json, new: dict[int, bytes]) -> bytes:
    """Gather the bytes of all views, those that overlap once, and point the views there."""
    views = document["bufferViews"]
    old = [k for k in range(len(views)) if k not in new]
    spans = sorted(
        (view["buffer"], view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"])
        for view in (views[k] for k in old)
    )
    runs: list[tuple[int, int, int]] = []
    for buffer, start, end in spans:
        if runs and runs[-1][0] == buffer and start < runs[-1][2]:
            runs[-1] = (buffer, runs[-1][1], max(end, runs[-1][2]))
        else:
            runs.append((buffer, start, end))
    out = bytearray()
    places = []
    for buffer, start, end in runs:
        # Alignments within the run stay.
        out += bytes((start - len(out)) % 8)
        places.append(len(out))
        out += gltf.buffers[buffer][start:end]
    for k in old:
        start = views[k].get("byteOffset", 0)
        run = bisect.bisect_right(runs, (views[k]["buffer"], start, math.inf)) - 1
        views[k] |= {"buffer": 0, "byteOffset": places[run] + start - runs[run][1]}
    for k, data in new.items():
        out += bytes(-len(out) % 4)
        views[k] = {"buffer": 0, "byteOffset": len(out), "byteLength": len(data), **views[k]}
        out += data
    out += bytes(-len(out) % 4)
    for name in ("accessors", "bufferViews"):
        if not document[name]:
            del document[name]
    if out:
        kept = {k: v for k, v in (document.get("buffers") or [{}])[0].items() if k != "uri"}
        document["buffers"] = [{**kept, "byteLength": len(out)}]
    else:
        document.pop("buffers", None)
    return bytes(out)
