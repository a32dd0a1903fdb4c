"""Factors on the length of seams: of edges and at vertices, and both together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats, Ints
from .checks import positive

__all__ = ["at_edges", "at_interfaces", "check_factors", "of_both_sides"]


def at_edges(faces: Ints, of_edges: Floats | None, at_vertices: Floats | None) -> Floats | None:
    """Factor of each edge all in all: its own times the mean of its ends.

    Parameters
    ----------
    faces : (m, 3) array of int
        Vertices of the faces.
    of_edges : (m, 3) array or None
        Factor of edge (f[k], f[(k + 1) % 3]) of each face f; None for 1.
    at_vertices : (n,) array or None
        Factor at the vertices; None for 1.

    Returns
    -------
    (m, 3) array or None
    """
    if at_vertices is None:
        return of_edges
    at_corners = at_vertices[faces]
    means: Floats = 0.5 * (at_corners + np.roll(at_corners, -1, axis=1))
    return means if of_edges is None else means * of_edges


def at_interfaces(
    faces: Ints, of_edges: Floats | None, at_vertices: Floats | None, n: int
) -> Floats | None:
    """Factor of a diffuse interface at each of n vertices, with the arguments of `at_edges`.

    Of the edges that end in a vertex the cheapest counts, as an interface has many ways past it,
    and none along which no seam may run.

    Returns
    -------
    (n,) array or None
    """
    if of_edges is None:
        return at_vertices
    finite = np.isfinite(of_edges)
    cheapest = np.full(n, np.inf)
    for k in (0, 1):
        np.minimum.at(cheapest, np.roll(faces, -k, axis=1)[finite], of_edges[finite])
    cheapest[np.isinf(cheapest)] = 1.0
    if at_vertices is not None:
        cheapest *= at_vertices
        return cheapest
    return None if (cheapest == 1).all() else cheapest


def of_both_sides(faces: Ints, neighbours: Ints, of_edges: Floats) -> Floats:
    """Give both sides of each edge the larger of their factors.

    Parameters
    ----------
    faces : (m, 3) array of int
        Vertices of the faces, all in one orientation.
    neighbours : (m, 3) array of int
        Face across edge (f[k], f[(k + 1) % 3]) of each face f, -1 at the boundary.
    of_edges : (m, 3) array
        Factor of the edge from each side.

    Returns
    -------
    (m, 3) array
    """
    ends = np.roll(faces, -1, axis=1)
    larger = of_edges.copy()
    for k in range(3):
        # The other side of an edge starts where this one ends.
        across = (neighbours >= 0) & (faces[neighbours, k] == ends)
        larger[across] = np.maximum(larger[across], of_edges[neighbours[across], k])
    return larger


def check_factors(
    seam_costs: ArrayLike | None, vertex_seam_costs: ArrayLike | None, n_faces: int, n_vertices: int
) -> tuple[Floats | None, Floats | None]:
    """Check and convert positive factors of the edges, which may be infinite, and at vertices."""
    at_vertices = None
    if vertex_seam_costs is not None:
        at_vertices = positive("vertex_seam_costs", vertex_seam_costs, n_vertices)
    if seam_costs is None:
        return None, at_vertices
    costs = np.ascontiguousarray(seam_costs, dtype=np.float64)
    if costs.shape != (n_faces, 3):
        raise ValueError(f"seam_costs: shape {costs.shape} must be ({n_faces}, 3)")
    if not (costs > 0).all():
        f, k = np.argwhere(~(costs > 0))[0]
        raise ValueError(f"seam_costs[{f}, {k}]: {costs[f, k]} must be a positive number")
    return costs, at_vertices
