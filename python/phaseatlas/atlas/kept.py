"""Regions to keep, in a layout."""

from __future__ import annotations

import numpy as np

from .. import quality
from ..arrays import Floats
from ..scene.scene import Scene
from ..surface import Surface
from .metrics import uv_topology

__all__ = ["warn_of_cuts"]


def warn_of_cuts(surface: Surface, uv: Floats) -> None:
    """Say where a layout has seams along which none may run, diagonals of polygons aside.

    Parameters
    ----------
    surface : Surface
        With m faces.
    uv : (m, 3, 2) array
        Texture coordinates at the corners of the faces.
    """
    if surface.seam_costs is None:
        return
    forbidden = np.isinf(surface.seam_costs)
    if isinstance(surface, Scene):
        forbidden &= ~np.concatenate([mesh.repaired.inner for mesh in surface.meshes])
    if not forbidden.any():
        return
    count = np.count_nonzero(uv_topology(surface, uv).seams & forbidden) // 2
    if count:
        quality.warn(
            f"keep: {count} edges of regions to keep are cut, for they could not be flattened "
            "otherwise; smaller regions stay whole"
        )
