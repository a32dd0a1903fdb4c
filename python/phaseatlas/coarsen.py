"""A hierarchy of simplified surfaces for the wide interfaces of a continuation.

The simplification is that of fast-simplification (quadric error metrics, Garland and Heckbert
1997). Around it, this module drops what it leaves folded flat, checks that what remains is a
surface, and makes the maps between the vertices of both.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import fast_simplification
import numpy as np
import scipy.sparse

from .surface import Surface

__all__ = ["Coarse", "coarsen"]

# Part of the faces to keep, and whether to leave the border alone: what is tried until it gives a
# surface. A quarter makes edges twice as long.
_ATTEMPTS = ((0.25, False), (0.25, True), (0.35, True))
# Below so many faces a step saves nothing.
_FEWEST_FACES = 200
# The library keeps its mesh in variables of the process.
_LOCK = threading.Lock()


@dataclass(frozen=True, eq=False)
class Coarse:
    """A simplified surface and the maps from and to the surface that it was made of.

    Attributes
    ----------
    surface : Surface
        With about a quarter of the faces.
    prolongation : (n, k) sparse array
        From values at its k vertices to the n of the finer surface: the value of the vertex that
        a vertex has collapsed to, averaged over the vertex and its neighbours.
    restriction : (k, n) sparse array
        The mean over the vertices that have collapsed to one.
    """

    surface: Surface
    prolongation: Any
    restriction: Any


def coarsen(surface: Surface) -> Coarse | None:
    """Simplify a surface to a quarter of its faces.

    Parameters
    ----------
    surface : Surface

    Returns
    -------
    Coarse or None
        None where that leaves no surface, such as where handles are thinner than the new edges,
        or where there are few faces already.
    """
    if surface.n_faces < _FEWEST_FACES:
        return None
    for kept, preserve_border in _ATTEMPTS:
        vertices, faces, collapsed_to = _simplified(surface, kept, preserve_border)
        used, corners = np.unique(faces, return_inverse=True)
        try:
            coarse = Surface(vertices[used], corners.reshape(-1, 3))
            break
        except ValueError:
            continue
    else:
        return None
    index = np.full(len(vertices), -1)
    index[used] = np.arange(len(used))
    target = index[collapsed_to]
    mapped = np.flatnonzero(target >= 0)
    injection = scipy.sparse.csr_array(
        (np.ones(len(mapped)), (mapped, target[mapped])), shape=(surface.n_vertices, len(used))
    )
    prolongation = _with_neighbours(surface) @ injection
    while np.any(np.diff(prolongation.indptr) == 0):
        prolongation = _with_neighbours(surface) @ prolongation
    return Coarse(
        coarse,
        _with_row_sums_1(prolongation),
        _with_row_sums_1(scipy.sparse.csr_array(injection.T)),
    )


def _simplified(surface: Surface, kept: float, preserve_border: bool) -> tuple[Any, Any, Any]:
    """Vertices, faces without those folded flat, and the vertex that each has collapsed to."""
    faces = surface.faces.astype(np.int32)
    with _LOCK:
        _, _, collapses = fast_simplification.simplify(
            surface.vertices.copy(),
            faces,
            target_count=int(kept * surface.n_faces),
            return_collapses=True,
            preserve_border=preserve_border,
        )
        vertices, faces, collapsed_to = fast_simplification.replay_simplification(
            surface.vertices.copy(), faces, collapses
        )
    # Two faces on the same three vertices are what is left of a spike.
    _, face, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return vertices, faces[count[face.reshape(-1)] == 1], collapsed_to


def _with_neighbours(surface: Surface) -> Any:
    a, b = surface.edges.T
    loops = np.arange(surface.n_vertices)
    rows, columns = np.concatenate([a, b, loops]), np.concatenate([b, a, loops])
    shape = (surface.n_vertices, surface.n_vertices)
    return scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)


def _with_row_sums_1(matrix: Any) -> Any:
    return scipy.sparse.diags_array(1 / matrix.sum(axis=1)) @ matrix
