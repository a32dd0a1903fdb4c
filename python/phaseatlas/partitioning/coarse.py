"""A simplified surface for the first phases, and the way of labels back to the surface."""

from __future__ import annotations

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Floats, Ints
from ..coarsen import LOCK
from ..surface import Surface

__all__ = ["labels_from", "simplified"]

# Faces to keep, relative to what is asked for, and how eagerly to collapse: tried one after the
# other until what is left is a surface. Handles thinner than the new edges may break it.
_ATTEMPTS = tuple((kept, eagerness) for kept in (1.0, 1.5, 2.0, 3.0) for eagerness in (7, 4))
# Weight of the unit normals against the centroids, in roots of the area, where the nearest face is
# sought: the two sides of a thin part are apart.
_NORMALS = 0.05


def simplified(surface: Surface, n_faces: int) -> Surface:
    """Simplify a surface to about `n_faces` faces.

    Parameters
    ----------
    surface : Surface
    n_faces : int

    Returns
    -------
    Surface
        The surface itself where it has few faces or cannot be simplified.
    """
    for kept, eagerness in _ATTEMPTS:
        target = int(kept * n_faces)
        if surface.n_faces <= 1.3 * target:
            break
        with LOCK:
            vertices, faces = fast_simplification.simplify(
                surface.vertices.copy(),
                surface.faces.astype(np.int32),
                target_count=target,
                agg=eagerness,
            )
        used, corners = np.unique(faces, return_inverse=True)
        try:
            return Surface(vertices[used].astype(np.float64), corners.reshape(-1, 3))
        except ValueError:
            continue
    return surface


def labels_from(coarse: Surface, labels: Ints, surface: Surface) -> Ints:
    """Take each face's label from the nearest face of a simplified surface.

    Parameters
    ----------
    coarse : Surface
        The simplified surface, with k faces.
    labels : (k,) array of int
    surface : Surface
        The surface, with m faces.

    Returns
    -------
    (m,) array of int
    """
    if coarse is surface:
        return labels
    scale = surface.area**-0.5
    _, nearest = cKDTree(_places(coarse, scale)).query(_places(surface, scale))
    found: Ints = labels[nearest]
    return found


def _places(surface: Surface, scale: float) -> Floats:
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.hstack([scale * corners.mean(axis=1), _NORMALS * normals])
