"""Polygons: lists of varying length in a row, corners that differ, cuts into triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..arrays import Floats, Ints

__all__ = ["outside", "split_corners", "split_vertices", "starts_of", "triangulate", "walk"]

Singles = NDArray[np.float32]


def starts_of(sizes: Ints) -> Ints:
    """Where each of the lists of these sizes starts."""
    starts: Ints = np.cumsum(sizes) - sizes
    return starts


def outside(corners: Ints, count: int) -> int:
    """The first corner that names none of so many vertices."""
    return int(corners[(corners < 0) | (corners >= count)][0])


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
    """Cut polygons into triangles without new vertices, as `repair` does.

    Parameters
    ----------
    positions : (n, 3) array
        Of the vertices.
    corners : (c,) array of int
        Vertices of all polygons.
    sizes : (p,) array of int
        Corners of each.

    Returns
    -------
    triangles : (t, 3) array of int
        Places in `corners`, in the order of the polygons.
    polygon : (t,) array of int
        Polygon of each triangle.
    """
    polygon, triangles = _core.triangulate(
        np.ascontiguousarray(positions), np.ascontiguousarray(corners), np.ascontiguousarray(sizes)
    )
    return triangles, polygon
