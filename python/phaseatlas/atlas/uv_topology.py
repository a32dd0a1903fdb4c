"""A surface cut open along the seams of its texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _core
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
    layout
        The same in the core.
    """

    chart: Ints
    n_charts: int
    corner: Ints
    n_vertices: int
    open_edges: Bools
    seams: Bools
    layout: _core.Layout


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
    flat = np.ascontiguousarray(uv.reshape(-1, 2))
    tolerance = _UV_TOLERANCE * float(np.ptp(flat, axis=0).max())
    layout = _core.Layout(surface._mesh, flat, tolerance)
    joined = layout.joined()
    return UvTopology(
        chart=layout.charts(),
        n_charts=layout.n_charts,
        corner=layout.corners(),
        n_vertices=layout.n_vertices,
        open_edges=~joined,
        seams=(surface.face_neighbours >= 0) & ~joined,
        layout=layout,
    )
