"""One surface made of another, and the maps between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .arrays import Floats, Ints
from .points import SurfacePoints
from .surface import Surface

__all__ = ["NORMALS", "Transfer"]

# Weight of the unit normals against the centroids, in roots of the area, where the nearest face is
# sought: the two sides of a thin part are apart.
NORMALS = 0.05


@dataclass(frozen=True, eq=False)
class Transfer:
    """A surface made of another one, such as a simplified or a cut one, and the maps between them.

    Attributes
    ----------
    source : Surface
        What the other was made of, with n vertices and m faces.
    target : Surface
        What was made of it, with k vertices and l faces.
    forward : (k, n) sparse array
        From values at the vertices of the source to those of the target. Its rows sum to 1, and
        no entry is negative.
    backward : (n, k) sparse array
        The other way, likewise.
    origin_face : (l,) array of int or None
        Face of the source that each face of the target is a part of, where each is one.
    """

    source: Surface
    target: Surface
    forward: Any
    backward: Any
    origin_face: Ints | None = None

    @cached_property
    def parent_face(self) -> Ints:
        """Face of the target for each face of the source, (m,): the way of labels back.

        The largest part of the face where faces were cut, else the face whose centroid and normal
        are nearest.
        """
        if self.origin_face is not None:
            # The last of equals is kept, so that the first of the largest is.
            order = np.lexsort((-np.arange(self.target.n_faces), self.target.face_areas))
            parts = np.empty(self.source.n_faces, dtype=np.int64)
            parts[self.origin_face[order]] = order
            return parts
        from scipy.spatial import cKDTree

        scale = self.source.area**-0.5
        made, given = (_places(surface, scale) for surface in (self.target, self.source))
        _, nearest = cKDTree(made).query(given)
        return np.asarray(nearest, dtype=np.int64)

    @cached_property
    def corners(self) -> SurfacePoints:
        """The corners of the target's faces as points of the source, face by face, (3 l,).

        What is linear in each face of the source, such as texture coordinates at its corners, is
        interpolated with them.

        Raises
        ------
        ValueError
            Where faces of the target are no parts of faces of the source.
        """
        if self.origin_face is None:
            raise ValueError("corners: the target must be made of parts of the source's faces")
        face = np.repeat(self.origin_face, 3)
        rows = np.repeat(self.target.faces.reshape(-1), 3)
        weights = self.forward[rows, self.source.faces[face].reshape(-1)]
        return SurfacePoints(face, np.asarray(weights, dtype=np.float64).reshape(-1, 3))

    def then(self, other: Transfer) -> Transfer:
        """Return the transfer from this source to the target of `other`, made of this target.

        Raises
        ------
        ValueError
            Where `other` starts from another surface.
        """
        if other.source is not self.target:
            raise ValueError("other: its source must be the target of this transfer")
        origin = None
        if self.origin_face is not None and other.origin_face is not None:
            origin = self.origin_face[other.origin_face]
        return Transfer(
            self.source,
            other.target,
            other.forward @ self.forward,
            self.backward @ other.backward,
            origin,
        )


def _places(surface: Surface, scale: float) -> Floats:
    """Centroids and unit normals of the faces, side by side, (m, 6)."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + np.finfo(float).tiny
    return np.hstack([scale * corners.mean(axis=1), NORMALS * normals])
