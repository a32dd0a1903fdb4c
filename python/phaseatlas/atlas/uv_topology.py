"""A surface cut open along the seams of its texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Bools, Floats, Ints
from ..surface import Surface

__all__ = ["UvTopology", "uv_topology"]

# Two UVs further apart than this share of the layout's side are different.
_UV_TOLERANCE = 1e-9


@dataclass(frozen=True)
class UvTopology:
    """The surface cut open along the seams of a UV layout.

    Attributes
    ----------
    chart
        (m,) chart of each face.
    n_charts
        Number of charts.
    corner
        (m, 3) vertex of each corner on the cut surface; vertices on a seam appear once per side.
    n_vertices
        Number of vertices of the cut surface.
    open_edges
        (m, 3) bool, whether edge (k, k + 1 mod 3) of a face lies on the boundary of its chart.
    seams
        (m, 3) bool, those open edges that have a face on their other side.
    """

    chart: Ints
    n_charts: int
    corner: Ints
    n_vertices: int
    open_edges: Bools
    seams: Bools


def uv_topology(surface: Surface, uv: Floats) -> UvTopology:
    """Cut a surface open along the edges whose two sides carry different UVs.

    Parameters
    ----------
    surface
        The surface, with m faces.
    uv
        (m, 3, 2) UV of every corner of every face.

    Returns
    -------
    UvTopology
        Charts, split vertices and boundary edges.
    """
    m = surface.n_faces
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    key, twin_key = start * surface.n_vertices + end, end * surface.n_vertices + start
    order = np.argsort(key)
    slot = np.minimum(np.searchsorted(key[order], twin_key), 3 * m - 1)
    twin = order[slot]
    inner = key[twin] == twin_key

    corners = np.arange(3 * m)
    following = np.roll(corners.reshape(m, 3), -1, axis=1).ravel()
    flat = uv.reshape(-1, 2)
    tolerance = _UV_TOLERANCE * float(np.ptp(flat, axis=0).max())
    apart = np.maximum(
        np.abs(flat[corners] - flat[following[twin]]).max(axis=1),
        np.abs(flat[following] - flat[twin]).max(axis=1),
    )
    joined = inner & (apart <= tolerance)

    n_charts, chart = _components(m, corners[joined] // 3, twin[joined] // 3)
    pairs = np.concatenate([corners[joined], following[joined]])
    mates = np.concatenate([following[twin[joined]], twin[joined]])
    n_vertices, corner = _components(3 * m, pairs, mates)
    return UvTopology(
        chart=chart,
        n_charts=n_charts,
        corner=corner.reshape(m, 3),
        n_vertices=n_vertices,
        open_edges=~joined.reshape(m, 3),
        seams=(inner & ~joined).reshape(m, 3),
    )


def _components(n: int, a: Ints, b: Ints) -> tuple[int, Ints]:
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int64)
