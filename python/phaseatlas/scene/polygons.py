"""Polygons: lists of varying length in a row, corners that differ, cuts into triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats, Ints

__all__ = ["split_corners", "split_vertices", "starts_of", "triangulate", "walk"]

Singles = NDArray[np.float32]


def starts_of(sizes: Ints) -> Ints:
    """Where each of the lists of these sizes starts."""
    starts: Ints = np.cumsum(sizes) - sizes
    return starts


def walk(
    counts: Sequence[int], rows: int, start: int, before: int, after: int, step: int
) -> list[int]:
    """Starts of rows that follow each other, each with a list whose length it says itself.

    Parameters
    ----------
    counts : list or bytes of int
        What stands at each place, read as a length.
    rows : int
        Number of rows.
    start : int
        Place of the first row.
    before, after, step : int
        Places before the length, after the list, and of each member of the list.

    Returns
    -------
    list of int
        The starts, and the end of the last row.

    Raises
    ------
    IndexError
        Where the rows reach past the end.
    """
    # Each row says where the next one starts: nothing but a loop can follow that.
    places = [start]
    place = start
    fixed = before + 1 + after
    for _ in range(rows):
        place += fixed + step * counts[place + before]
        places.append(place)
    return places


def split_vertices(n: int, vertices: Ints, uv: Singles) -> tuple[Ints, Ints, Singles]:
    """Repeat vertices where their corners differ; all stay in their place, repeats follow.

    Parameters
    ----------
    n : int
        Number of vertices.
    vertices : (c,) array of int
        Vertices of the corners.
    uv : (c, 2) array of float32
        Values at the corners.

    Returns
    -------
    origin : (m,) array of int
        The vertex that each of the new ones repeats; the first n are the old ones.
    new : (c,) array of int
        New vertices of the corners.
    values : (m, 2) array of float32
        Values of the new vertices, 0 at those that have no corner.
    """
    representative, split, distinct = split_corners(vertices, uv)
    origin = vertices[representative]
    place = np.concatenate([origin[:distinct], n + np.arange(len(origin) - distinct)])
    values = np.zeros((n + len(origin) - distinct, 2), dtype=np.float32)
    values[place] = uv[representative]
    return np.concatenate([np.arange(n), origin[distinct:]]), place[split], values


def split_corners(vertices: Ints, *columns: Floats | Singles) -> tuple[Ints, Ints, int]:
    """Make a vertex for each set of values that the corners of a vertex have.

    Parameters
    ----------
    vertices : (c,) array of int
        Vertices of the corners.
    *columns : (c, k) array of float32 or float64
        Values at the corners; NaN equals NaN.

    Returns
    -------
    representative : (m,) array of int
        A corner of each new vertex. The first that belongs to a vertex stand in the order of the
        vertices, then the further ones.
    new : (c,) array of int
        New vertices of the corners.
    distinct : int
        How many of the new vertices are the first that belong to a vertex.
    """
    bits = [column for values in columns for column in _bits(values)]
    order = np.lexsort([*bits[::-1], vertices])
    fresh = np.zeros(len(order), dtype=np.bool_)
    fresh[:1] = True
    of_vertex = fresh.copy()
    of_vertex[1:] = vertices[order[1:]] != vertices[order[:-1]]
    fresh |= of_vertex
    for column in bits:
        fresh[1:] |= column[order[1:]] != column[order[:-1]]
    first = of_vertex[fresh]
    distinct = int(np.count_nonzero(first))
    place = np.empty(len(first), dtype=np.int64)
    place[first] = np.arange(distinct)
    place[~first] = np.arange(distinct, len(first))
    representative = np.empty(len(first), dtype=np.int64)
    representative[place] = order[fresh]
    new = np.empty(len(order), dtype=np.int64)
    new[order] = place[np.cumsum(fresh) - 1]
    return representative, new, distinct


def _bits(values: NDArray[Any]) -> list[Ints]:
    """The bits of rows as integers, two numbers of single precision in one."""
    # Negative zero is zero.
    plain = values + values.dtype.type(0)
    if plain.dtype == np.float32:
        odd = np.zeros((len(plain), plain.shape[1] % 2), dtype=np.float32)
        plain = np.concatenate([plain, odd], axis=1)
    return list(np.ascontiguousarray(plain).view(np.int64).T)


def triangulate(positions: Floats, corners: Ints, sizes: Ints) -> tuple[Ints, Ints]:
    """Cut polygons into triangles without new vertices.

    Quads are cut along the diagonal that folds them less, convex polygons into fans, others ear by
    ear.

    Parameters
    ----------
    positions : (n, 3) array
        Of the vertices.
    corners : (c,) array of int
        Vertices of all polygons.
    sizes : (p,) array of int
        Corners of each, three or more.

    Returns
    -------
    triangles : (t, 3) array of int
        Places in `corners`, in the order of the polygons.
    polygon : (t,) array of int
        Polygon of each triangle.
    """
    starts = starts_of(sizes)
    polygon = np.repeat(np.arange(len(sizes)), sizes - 2)
    step = np.arange(len(polygon)) - np.repeat(starts_of(sizes - 2), sizes - 2)
    first = starts[polygon]
    triangles = np.stack([first, first + step + 1, first + step + 2], axis=1)
    if sizes.max(initial=3) == 3:
        return triangles, polygon
    points = positions[corners]
    folded = _folded(points, triangles, polygon, sizes)
    quads = np.flatnonzero((sizes == 4) & folded)
    if len(quads):
        other = starts[quads][:, None] + np.array([1, 2, 3, 1, 3, 0])
        at = starts_of(sizes - 2)[quads]
        triangles[at], triangles[at + 1] = other[:, :3], other[:, 3:]
    for index in np.flatnonzero((sizes > 4) & folded):
        at = starts_of(sizes - 2)[index]
        ears = _ears(points[starts[index] : starts[index] + sizes[index]])
        triangles[at : at + len(ears)] = starts[index] + ears
    return triangles, polygon


def _folded(points: Floats, triangles: Ints, polygon: Ints, sizes: Ints) -> Bools:
    """Polygons whose fan has a triangle that looks away from the polygon."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    whole = np.add.reduceat(normals, starts_of(sizes - 2), axis=0)
    away = np.einsum("ij,ij->i", normals, whole[polygon]) <= 0
    folded: Bools = np.logical_or.reduceat(away, starts_of(sizes - 2))
    return folded


def _ears(points: Floats) -> Ints:
    """Triangles (n - 2, 3) of one polygon, seen along its normal."""
    n = len(points)
    centred = points - points.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    u, v = (axis + 1) % 3, (axis + 2) % 3
    flat = centred[:, [u, v]] if normal[axis] >= 0 else centred[:, [v, u]]
    left = list(range(n))
    ears = []
    while len(left) > 3:
        ears.append(_ear(flat, left))
    ears.append((left[0], left[1], left[2]))
    return np.array(ears, dtype=np.int64)


def _ear(flat: Floats, left: list[int]) -> tuple[int, int, int]:
    """Cut the fattest ear off; a corner of a polygon without ears, which crosses itself."""
    ring = np.array(left)
    a, b, c = flat[np.roll(ring, 1)], flat[ring], flat[np.roll(ring, -1)]
    area = _cross(b - a, c - b)
    size = np.sqrt(((c - a) ** 2).sum(axis=1)) + 1e-300
    # No other corner inside.
    p = flat[ring][None]
    inside = np.ones((len(ring), len(ring)), dtype=np.bool_)
    for s, e in ((a, b), (b, c), (c, a)):
        inside &= _cross((e - s)[:, None], p - s[:, None]) >= 0
    k = np.arange(len(ring))
    for shift in (-1, 0, 1):
        inside[k, (k + shift) % len(ring)] = False
    legal = (area > 0) & ~inside.any(axis=1)
    score = np.where(legal, area / size, -np.inf if legal.any() else area / size)
    at = int(np.argmax(score))
    ear = (int(ring[at - 1]), int(ring[at]), int(ring[(at + 1) % len(ring)]))
    left.pop(at)
    return ear


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
