"""Tangent frames of meshes, in which normal maps are written."""

from __future__ import annotations

import numpy as np

from ..arrays import Floats, Ints
from .polygons import split_corners

__all__ = ["corner_tangents", "frames", "in_frame", "unit"]


def corner_tangents(points: Floats, normals: Floats, uv: Floats) -> Floats:
    """Tangents at the corners of triangles, as a viewer makes them where a file has none.

    Directions of u of the faces around a vertex, weighted by their angles there: the rule of
    MikkTSpace (Mikkelsen 2008), which glTF refers to. Corners are of one vertex where position,
    normal, texture coordinates and their orientation are equal.

    Parameters
    ----------
    points, normals : (m, 3, 3) array
    uv : (m, 3, 2) array
        v up.

    Returns
    -------
    (m, 3, 4) array
        Unit tangents, and 1 or -1: the binormal is that times the normal times the tangent.
    """
    side, across = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    (u1, v1), (u2, v2) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    sign = np.where(u1 * v2 - u2 * v1 < 0, -1.0, 1.0)
    along = unit(sign[:, None] * (v2[:, None] * side - v1[:, None] * across))
    ends = np.roll(points, -1, axis=1) - points, np.roll(points, 1, axis=1) - points
    a, b = unit(ends[0]), unit(ends[1])
    angle = np.arccos(np.clip(np.vecdot(a, b), -1.0, 1.0))
    # Each within the plane of the vertex.
    flat = along[:, None] - np.vecdot(along[:, None], normals)[..., None] * normals
    flat = angle[..., None] * unit(flat)
    keys: Floats = np.concatenate(
        [points, normals, uv, np.broadcast_to(sign[:, None, None], (len(uv), 3, 1))], axis=2
    ).reshape(-1, 9)
    first, vertex, _ = split_corners(np.zeros(len(keys), dtype=np.int64), keys)
    total: Floats = np.stack(
        [np.bincount(vertex, flat[..., k].reshape(-1), len(first)) for k in range(3)], axis=1
    )
    tangents = unit(total)[vertex].reshape(-1, 3, 3)
    lost = np.linalg.norm(tangents, axis=2) < 0.5
    tangents[lost] = _any_across(normals[lost])
    return np.concatenate([tangents, np.broadcast_to(sign[:, None, None], (len(uv), 3, 1))], axis=2)


def frames(
    tangents: Floats, normals: Floats, faces: Ints, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Tangent, binormal and normal at points of triangles, (k, 3) each, as viewers have them."""
    normal = unit(np.einsum("kcd,kc->kd", normals[faces], weights))
    tangent = unit(np.einsum("kcd,kc->kd", tangents[faces][..., :3], weights))
    sign = np.where(tangents[faces, 0, 3] < 0, -1.0, 1.0)
    return tangent, sign[:, None] * np.cross(normal, tangent), normal


def in_frame(vectors: Floats, frame: tuple[Floats, Floats, Floats]) -> Floats:
    """Components of vectors along three directions that need not be perpendicular, (k, 3)."""
    tangent, binormal, normal = frame
    crossed = np.cross(binormal, normal), np.cross(normal, tangent), np.cross(tangent, binormal)
    volume = np.vecdot(tangent, crossed[0])
    volume = np.where(np.abs(volume) < 1e-12, 1.0, volume)
    return np.stack([np.vecdot(vectors, each) / volume for each in crossed], axis=1)


def unit(vectors: Floats) -> Floats:
    """Vectors of length 1; 0 stays 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    found: Floats = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return found


def _any_across(normals: Floats) -> Floats:
    """Unit vectors perpendicular to others."""
    axis: Floats = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return unit(np.cross(normals, axis))
