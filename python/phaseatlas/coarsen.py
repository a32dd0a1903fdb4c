"""Simplified surfaces: for the wide interfaces of a continuation, and for the first charts.

The simplification is that of fast-simplification (quadric error metrics, Garland and Heckbert
1997). Around it, this module drops what it leaves folded flat, checks that what remains is a
surface, and makes the maps between the vertices of both.
"""

from __future__ import annotations

import threading
from typing import Any

import fast_simplification
import numpy as np
import scipy.sparse

from . import _core
from .arrays import Floats, Ints
from .surface import Surface
from .transfer import NORMALS, Transfer

__all__ = ["coarsen", "collapsed", "reduced"]

# Faces to keep, relative to what is asked for, whether to leave the boundary alone, and how eagerly
# to collapse: what is tried until it gives a surface. Handles thinner than the new edges break it.
_ATTEMPTS = ((1.0, False, 7), (1.0, True, 7), (1.4, True, 7))
_PERSISTENT = tuple((kept, False, eager) for kept in (1.0, 1.5, 2.0, 3.0) for eager in (7, 4))
# A quarter of the faces makes edges twice as long.
_QUARTER = 0.25
# Below so many faces a step saves nothing, nor does one that keeps more than this part of them.
_FEWEST_FACES = 200
_CLEARLY_FEWER = 0.6
# So many of the faces asked for are few enough to stay.
_ENOUGH = 1.3
# The library keeps its mesh in variables of the process.
_LOCK = threading.Lock()


def coarsen(surface: Surface, n_faces: int | None = None) -> Transfer | None:
    """Simplify a surface.

    Parameters
    ----------
    surface : Surface
    n_faces : int, optional
        Faces to keep, up to three times as many where fewer leave no surface; a quarter by
        default, and then hardly more.

    Returns
    -------
    Transfer or None
        To the simplified surface, whose seam costs are at its vertices. Values go forward as the
        mean over the vertices that have collapsed to one, and backward as the value of the vertex
        that a vertex has collapsed to, averaged over the vertex and its neighbours. None where
        that leaves no surface, such as where handles are thinner than the new edges, where it
        leaves about as many faces, or where there are few faces already.
    """
    if surface.n_faces < _FEWEST_FACES:
        return None
    asked = _QUARTER * surface.n_faces if n_faces is None else n_faces
    for kept, preserve_border, eagerness in _ATTEMPTS if n_faces is None else _PERSISTENT:
        count = int(kept * asked)
        if surface.n_faces <= _ENOUGH * count:
            break
        vertices, faces, collapsed_to = collapsed(
            surface.vertices, surface.faces, count, preserve_border, eagerness
        )
        if n_faces is None and len(faces) > _CLEARLY_FEWER * surface.n_faces:
            continue
        used, corners = np.unique(faces, return_inverse=True)
        try:
            coarse = Surface(vertices[used], corners.reshape(-1, 3))
        except ValueError:
            continue
        return _transfer(surface, coarse, used, collapsed_to)
    return None


def reduced(surface: Surface, n_faces: int) -> tuple[Surface, Ints]:
    """Simplify a fine surface to one of the same topology, in time that is linear in its size.

    Edges collapse, the cheapest first, where the links of their ends allow it; more faces are left
    where too few edges can.

    Parameters
    ----------
    surface : Surface
        With m faces.
    n_faces : int
        Faces to keep.

    Returns
    -------
    simplified : Surface
        Its seam costs are at the vertices, the means over those that have collapsed to one.
    parents : (m,) array of int
        Its face for each face of the given one, as `Transfer.parent_face`, sought nearby.
    """
    simplified, collapsed_to = surface.simplified(n_faces)
    if surface.diffuse_seam_costs is not None:
        n = simplified.n_vertices
        sums = np.bincount(collapsed_to, surface.diffuse_seam_costs, minlength=n)
        simplified = simplified.with_seam_costs(None, sums / np.bincount(collapsed_to, minlength=n))
    return simplified, _core.parents(surface._mesh, simplified._mesh, collapsed_to, NORMALS)


def _transfer(surface: Surface, coarse: Surface, used: Ints, collapsed_to: Ints) -> Transfer:
    """Means over what has collapsed, and back."""
    position, found = _positions(used, collapsed_to)
    injection = scipy.sparse.csr_array(
        (np.ones(len(found)), (found, position)), shape=(surface.n_vertices, len(used))
    )
    forward = _with_row_sums_1(scipy.sparse.csr_array(injection.T))
    if surface.diffuse_seam_costs is not None:
        coarse = coarse.with_seam_costs(None, forward @ surface.diffuse_seam_costs)
    with_neighbours = surface.adjacency + scipy.sparse.eye_array(surface.n_vertices, format="csr")
    prolongation = with_neighbours @ injection
    while np.any(np.diff(prolongation.indptr) == 0):
        prolongation = with_neighbours @ prolongation
    return Transfer(
        surface,
        coarse,
        forward=forward,
        backward=_with_row_sums_1(prolongation),
    )


def collapsed(
    given: Floats, triangles: Ints, count: int, preserve_border: bool, eagerness: int
) -> tuple[Any, Any, Any]:
    """Vertices, faces but those folded flat, and the vertex that each has collapsed to, or -1."""
    with _LOCK:
        vertices, faces, collapses = fast_simplification.simplify(
            given.copy(),
            triangles.astype(np.int32),
            target_count=count,
            agg=eagerness,
            return_collapses=True,
            preserve_border=preserve_border,
        )
    target = np.arange(len(given))
    target[collapses[:, 1]] = collapses[:, 0]
    # Each pass doubles the steps that are followed; the library's collapses have no circle.
    for _ in range(len(given).bit_length()):
        further = target[target]
        if np.array_equal(further, target):
            break
        target = further
    # The library keeps the order of the vertices, less those without a face.
    corners = target[triangles]
    survivors = np.unique(corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)])
    if len(survivors) != len(vertices):
        raise RuntimeError(
            f"fast-simplification left {len(vertices)} vertices, its collapses {len(survivors)}"
        )
    position, found = _positions(survivors, target)
    collapsed_to = np.full(len(given), -1)
    collapsed_to[found] = position
    # Two faces on the same three vertices are what is left of a spike.
    _, face, copies = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return vertices, faces[copies[face.reshape(-1)] == 1], collapsed_to


def _positions(sorted_values: Ints, values: Ints) -> tuple[Ints, Ints]:
    """Positions of those values that are among the sorted ones, and where they are in `values`."""
    position = np.searchsorted(sorted_values, values).clip(max=len(sorted_values) - 1)
    found = np.flatnonzero(sorted_values[position] == values)
    return position[found], found


def _with_row_sums_1(matrix: Any) -> Any:
    return scipy.sparse.diags_array(1 / matrix.sum(axis=1)) @ matrix
