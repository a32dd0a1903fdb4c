"""STL files: triangles without vertices in common, in text or binary."""

from __future__ import annotations

import re

import numpy as np

from ..arrays import Floats, Ints
from .mesh import Mesh

__all__ = ["read_stl"]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_SOLID = re.compile(rb"^[ \t]*solid\b[ \t]*([^\r\n]*)", re.IGNORECASE | re.MULTILINE)


def read_stl(data: bytes) -> tuple[Mesh, ...]:
    """Read the solids of a file; corners at equal positions within a solid become one vertex.

    Parameters
    ----------
    data : bytes
        Of the file. A text may hold several solids, each of which is a mesh.

    Raises
    ------
    ValueError
        For a file that is cut short and for coordinates that are no numbers.
    """
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    binary = len(data) >= _HEADER and len(data) == _HEADER + _FACET.itemsize * count
    # A name may be long.
    start = data.find(b"\n") if data.lstrip()[:5].lower() == b"solid" else 0
    if not binary and _VERTEX.search(data, max(start, 0), max(start, 0) + 4096) is not None:
        return _solids(data)
    if len(data) < _HEADER or len(data) < _HEADER + _FACET.itemsize * count:
        if data.lstrip()[:5].lower() == b"solid":
            return ()
        raise ValueError("the file is cut short")
    facets = np.frombuffer(data, dtype=_FACET, count=count, offset=_HEADER)
    return (_solid("", facets["corners"].reshape(-1, 3).astype(np.float64)),) if count else ()


def _solids(data: bytes) -> tuple[Mesh, ...]:
    names = [(match.start(), match.group(1)) for match in _SOLID.finditer(data)]
    vertices = list(_VERTEX.finditer(data))
    try:
        points = np.array([match.groups() for match in vertices]).astype(np.float64)
    except ValueError as error:
        raise ValueError("a coordinate is no number") from error
    if len(points) % 3:
        raise ValueError("a facet has other than three vertices")
    places = np.array([match.start() for match in vertices])
    ends = [*np.searchsorted(places, [start for start, _ in names[1:]]).tolist(), len(points)]
    solids, begin = [], 0
    for (_, name), end in zip(names or [(0, b"")], ends, strict=True):
        if end > begin:
            solids.append(_solid(name.decode("utf-8", "replace").strip(), points[begin:end]))
        begin = end
    return tuple(solids)


def _solid(name: str, points: Floats) -> Mesh:
    # Negative zero is zero.
    positions, first, place = np.unique(
        points + 0.0, axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank: Ints = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return Mesh(
        name=name,
        positions=positions[order],
        corners=rank[place.reshape(-1)],
        sizes=np.full(len(points) // 3, 3),
        material_of=np.full(len(points) // 3, -1),
    )
