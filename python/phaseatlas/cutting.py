"""Surfaces whose faces are cut along straightened seams."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from .arrays import Floats, Ints
from .partitioning import Partition
from .seams import Seams, pattern, straighten
from .segmentation import Segmentation
from .surface import Surface
from .transfer import Transfer

__all__ = ["cut_along_seams"]

# Of partitions of eight real meshes seams get 2.5 to 6 % shorter, and on each the energy falls, but
# for its cuts, which jump. With 20 a chart came to overlap itself; with 0 seams get 3 to 12 %
# shorter, but on three meshes the energy rises.
_CURVATURE = 30.0


def cut_along_seams(
    segmentation: Segmentation, *, curvature: float = _CURVATURE
) -> tuple[Transfer, Segmentation]:
    """Straighten the seams between segments, and cut the faces that they then pass through.

    Seams stay within half an edge of where they were; vertices where more than two segments meet,
    or a seam ends at the boundary of the surface, stay where they are. The surface keeps its
    shape, and each segment its topology.

    Parameters
    ----------
    segmentation : Segmentation
        The labels, such as those of a partition.
    curvature : float, default 30
        A seam leaves a vertex at which it turns by more than so many times the curvature there,
        both in radians, as curvature on the boundary of a chart distorts nothing. With 0 seams are
        as short as they can be, but charts are more distorted, and may come to overlap
        themselves.

    Returns
    -------
    Transfer
        To the cut surface, whose seam costs are at its vertices. Its `forward` has the two vertices
        of the edge of each new vertex, its `origin_face` the face that each face is a part of, and
        its `corners` interpolate what has values at the corners of the source's faces.
    Segmentation or Partition
        The labels of the cut surface; of a partition, with its diagnostics of before. Weights that
        were given are interpolated, others are made anew.

    Raises
    ------
    ValueError
        For a curvature that is negative or not finite.
    """
    if not 0 <= curvature < np.inf:
        raise ValueError(f"curvature: {curvature} must be a finite number of at least 0")
    surface = segmentation.surface
    seams = straighten(surface, segmentation.labels, curvature)
    n, p = surface.n_vertices, len(seams.place)
    forward = scipy.sparse.csr_array(
        (
            np.concatenate([np.ones(n), 1 - seams.place, seams.place]),
            (
                np.concatenate([np.arange(n + p), n + np.arange(p)]),
                np.concatenate([np.arange(n), seams.ends[:, 0], seams.ends[:, 1]]),
            ),
        ),
        shape=(n + p, n),
    )
    positions = forward @ surface.vertices
    faces, origin, labels = _pieces(surface, segmentation.labels, seams, positions)
    target = Surface(positions, faces)
    if surface.diffuse_seam_costs is not None:
        target = target.with_seam_costs(None, forward @ surface.diffuse_seam_costs)
    backward = scipy.sparse.eye_array(n, n + p, format="csr")
    weights = None
    if segmentation.weights_given:
        # Means of values up to 1 may round to more.
        weights = np.minimum((forward @ segmentation.weights.T).T, 1.0)
    made = (
        Partition(target, labels, weights, segmentation.diagnostics, epsilon=segmentation.epsilon)
        if isinstance(segmentation, Partition)
        else Segmentation(target, labels, weights, epsilon=segmentation.epsilon)
    )
    return Transfer(surface, target, forward, backward, origin), made


def _pieces(
    surface: Surface, labels: Ints, seams: Seams, positions: Floats
) -> tuple[Ints, Ints, Ints]:
    """All faces, the face that each is a part of, and its label, in the order of these faces."""
    whole = np.flatnonzero(seams.keys == 0)
    faces, origins, of = [surface.faces[whole]], [whole], [labels[whole]]
    for key in np.unique(seams.keys[seams.keys > 0]):
        found = np.flatnonzero(seams.keys == key)
        for polygon, corner in pattern(int(key)).pieces:
            triangles = _triangulated(positions, seams.points[found][:, polygon])
            label = labels[found] if corner < 0 else seams.side[surface.faces[found, corner]]
            faces.append(triangles.reshape(-1, 3))
            origins.append(np.repeat(found, triangles.shape[1]))
            of.append(np.repeat(label, triangles.shape[1]))
    origin = np.concatenate(origins)
    order = np.argsort(origin, kind="stable")
    return np.concatenate(faces)[order], origin[order], np.concatenate(of)[order]


def _triangulated(positions: Floats, polygons: Ints) -> Ints:
    """Cut convex polygons, (k, c), into fans, (k, c - 2, 3), each from its best corner."""
    count = polygons.shape[1]
    steps = np.arange(1, count - 1)
    fans = np.stack([np.zeros_like(steps), steps, steps + 1], axis=1)
    # Several corners may lie on one edge of the face, where a fan from one has faces without area.
    choices = np.stack([polygons[:, (fans + first) % count] for first in range(count)], axis=1)
    quality = _quality(positions[choices]).min(axis=2)
    best = quality.argmax(axis=1)
    triangles: Ints = choices[np.arange(len(polygons)), best]
    return triangles


def _quality(corners: Floats) -> Floats:
    """Twice the area over the sum of squared edges of triangles, (..., 3, 3)."""
    sides = np.roll(corners, -1, axis=-2) - corners
    area = np.linalg.norm(np.cross(sides[..., 0, :], sides[..., 1, :]), axis=-1)
    quality: Floats = area / (sides**2).sum(axis=(-1, -2))
    return quality
