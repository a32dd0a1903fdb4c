"""Points of triangles: barycentric coordinates, interpolation, areas in the plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Floats

__all__ = ["SurfacePoints", "barycentric", "flat_areas", "interpolate"]


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on a surface.

    Attributes
    ----------
    face : (k,) array of int
        Face of each point.
    barycentric : (k, 3) array
        Its barycentric coordinates there, with sum 1.
    """

    face: NDArray[Any]
    barycentric: Floats

    def interpolate(self, corners: Floats) -> Floats:
        """Return values at the points of what is linear in each face.

        Parameters
        ----------
        corners : (m, 3) or (m, 3, d) array
            Values at the corners of each face.

        Returns
        -------
        (k,) or (k, d) array
        """
        return interpolate(corners[self.face], self.barycentric)


def interpolate(corners: Floats, weights: Floats) -> Floats:
    """Values at points of triangles, linear in each, from those at the corners.

    Parameters
    ----------
    corners : (k, 3) or (k, 3, d) array
        Values at the corners of the triangle of each point.
    weights : (k, 3) array
        Barycentric coordinates.
    """
    values: Floats = np.einsum("kc...,kc->k...", corners, weights)
    return values


def barycentric(corners: Floats, points: Floats, *, clip: bool = True) -> Floats:
    """Barycentric coordinates of points of the plane, (k, 3).

    Parameters
    ----------
    corners : (k, 3, 2) array
        Triangle of each point; not degenerate.
    points : (k, 2) array
        The points.
    clip : bool, default True
        Move points that lie outside by rounding, which a sliver's small area magnifies, inside.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    second = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / area
    third = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / area
    weights = np.stack([1.0 - second - third, second, third], axis=1)
    if not clip:
        return weights
    weights = np.clip(weights, 0.0, 1.0)
    inside: Floats = weights / weights.sum(axis=1, keepdims=True)
    return inside


def flat_areas(corners: Floats, *, signed: bool = False) -> Floats:
    """Areas of triangles of the plane, (k,), with corners (k, 3, 2).

    They are positive whatever the orientation, or with `signed` only where it is anticlockwise.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas: Floats = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return areas if signed else np.abs(areas)
