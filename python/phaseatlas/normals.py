"""Normals of faces and vertices."""

from __future__ import annotations

import numpy as np

from .arrays import Floats, Ints

__all__ = ["face_normals", "vertex_normals"]


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals of (m, 3) faces, (m, 3)."""
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    normals: Floats = np.cross(sides[:, 0], sides[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + np.finfo(float).tiny
    return normals


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals of (n, 3) vertices, the mean of their faces by area, (n, 3)."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums: Floats = np.stack(
        [
            np.bincount(faces.reshape(-1), weights, minlength=len(vertices))
            for weights in np.repeat(normals, 3, axis=0).T
        ],
        axis=1,
    ).astype(np.float64)
    # A spike may have no mean normal.
    sums /= np.linalg.norm(sums, axis=1, keepdims=True) + np.finfo(float).tiny
    return sums
