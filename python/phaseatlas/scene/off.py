"""OFF files: vertices and polygons, in text or binary, with colours and normals of vertices."""

from __future__ import annotations

import re

import numpy as np

from ..arrays import Floats, Ints
from .mesh import Corners, Mesh
from .polygons import outside, walk

__all__ = ["read_off"]

_HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF$")


def read_off(data: bytes) -> tuple[Mesh, Corners]:
    """Read a file of polygons.

    Parameters
    ----------
    data : bytes
        Of the file: OFF, COFF, NOFF, STOFF and their combinations in text, and OFF BINARY of
        either byte order. Colours of faces are not read.

    Raises
    ------
    ValueError
        For what is no such file, and one that is cut short.
    """
    first, _, rest = data.partition(b"\n")
    if first.split() == [b"OFF", b"BINARY"]:
        return _binary(rest)
    lines = [line for line in (raw.partition(b"#")[0].split() for raw in data.splitlines()) if line]
    match = _HEADER.match(lines[0][0]) if lines else None
    if match is None or match.group(4) or match.group(5):
        raise ValueError("the first word must be OFF, or with ST, C and N before it")
    lines[0] = lines[0][1:]
    lines = lines if lines[0] else lines[1:]
    try:
        n, m = int(lines[0][0]), int(lines[0][1])
        rows, polygons = lines[1 : n + 1], lines[n + 1 : n + 1 + m]
        if len(polygons) < m:
            raise ValueError("the file is cut short")
        if len({len(row) for row in rows}) > 1:
            # Only some vertices have a colour.
            rows = [row[:3] for row in rows]
        values = np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(n, -1)
        sizes = np.array([int(line[0]) for line in polygons], dtype=np.int64)
        words = [
            word for line, size in zip(polygons, sizes, strict=True) for word in line[1:][:size]
        ]
        corners = np.array(words, dtype=np.bytes_).astype(np.int64)
    except (IndexError, ValueError) as error:
        raise ValueError("the file is cut short, or a number in it is none") from error
    if sizes.sum() != len(corners):
        raise ValueError("a face has fewer corners than it says")
    return _mesh(
        values, corners, sizes, texture=bool(match[1]), colour=bool(match[2]), normal=bool(match[3])
    )


def _binary(data: bytes) -> tuple[Mesh, Corners]:
    for order in "<>":
        n, m, _ = (int(k) for k in np.frombuffer(data, f"{order}i4", 3))
        if 0 <= n < len(data) and 0 <= m < len(data):
            break
    else:
        raise ValueError("the numbers of vertices and faces are none")
    if len(data) < 12 + 12 * n:
        raise ValueError("the file is cut short")
    values = np.frombuffer(data, f"{order}f4", 3 * n, 12).reshape(n, 3).astype(np.float64)
    words = np.frombuffer(data[12 + 12 * n :][: (len(data) - 12 - 12 * n) // 4 * 4], f"{order}i4")
    # Geomview says after each face how many numbers its colour has; others end there.
    for colours in (0, 1):
        try:
            places = np.array(walk(words.tolist(), m, 0, 0, colours, 1))
        except IndexError:
            continue
        if places[-1] == len(words):
            sizes = words[places[:-1]].astype(np.int64)
            inside = np.repeat(places[:-1] + 1, sizes) + _within(sizes)
            return _mesh(values, words[inside].astype(np.int64), sizes)
    raise ValueError("the file is cut short, or its faces are coloured")


def _within(sizes: Ints) -> Ints:
    within: Ints = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return within


def _mesh(
    values: Floats,
    corners: Ints,
    sizes: Ints,
    *,
    texture: bool = False,
    colour: bool = False,
    normal: bool = False,
) -> tuple[Mesh, Corners]:
    # Two corners enclose nothing.
    kept = sizes > 2
    corners, sizes = corners[np.repeat(kept, sizes)], sizes[kept]
    if len(corners) and (corners.min() < 0 or corners.max() >= len(values)):
        raise ValueError(f"a face names vertex {outside(corners, len(values))} among {len(values)}")
    width, at = values.shape[1] if values.size else 3, 3
    normals = colours = uv = None
    if normal and width >= at + 3:
        normals, at = values[corners, at : at + 3], at + 3
    # Many files have colours without saying so.
    rest = width - at - 2 * texture
    if rest in (3, 4) and (colour or not normal):
        colours = np.ones((len(values), 4))
        colours[:, :rest] = values[:, at : at + rest]
        if colours[:, :3].max(initial=0.0) > 1:
            colours[:, :rest] /= 255.0
        at += rest
        colours = colours[corners]
    if texture and width >= at + 2:
        uv = values[corners, at : at + 2]
    mesh = Mesh(
        name="",
        positions=np.ascontiguousarray(values[:, :3]) if values.size else np.zeros((0, 3)),
        corners=corners,
        sizes=sizes,
        material_of=np.full(len(sizes), -1),
        uv_sets=int(uv is not None),
        vertex_colours=colours is not None,
    )
    return mesh, Corners(() if uv is None else (uv,), normals, colours)
