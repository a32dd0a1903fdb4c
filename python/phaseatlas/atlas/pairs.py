"""Charts that lie over those that they are the mirror images of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Ints
from ..partitioning.symmetry import Axis, mirror, stacked_corners
from ..quality import warn
from ..surface import Surface
from .charts import Chart, charts_of_faces

__all__ = ["corners_of_pairs"]


def corners_of_pairs(surface: Surface, charts: Sequence[Chart], axis: Axis) -> Ints:
    """For each corner of a chart that is the image of another one the corner whose place it takes.

    Parameters
    ----------
    surface : Surface or Scene
    charts : sequence of Chart
        Of the surface.
    axis : {"x", "y", "z"}
        Across the plane of symmetry.

    Returns
    -------
    (m, 3) array of int
        As `Layout.stack`. A chart that is the image of no single chart keeps a place of its own.

    Raises
    ------
    ValueError
        Where the surface is not symmetric.

    Warns
    -----
    QualityWarning
        Where no chart is the image of another one.
    """
    stack = stacked_corners(surface, mirror(surface, axis))
    of_face = charts_of_faces(charts, surface.n_faces)
    for chart in charts:
        faces = chart.faces[chart.labelled]
        corners = stack[faces]
        if (corners < 0).any() or len(np.unique(of_face[corners // 3])) > 1:
            stack[faces] = -1
    if (stack < 0).all():
        warn("stack: no chart is the mirror image of another one; symmetry makes them so")
    return stack
