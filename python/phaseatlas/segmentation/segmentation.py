"""A segmentation: what an atlas is made of, whoever made the labels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Floats, Ints
from ..surface import Surface
from ..transfer import Transfer

__all__ = ["Segmentation"]


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Segments of a surface: a label for each face and a blending weight for each vertex.

    Parameters
    ----------
    surface : Surface
        The surface, with n vertices and m faces.
    labels : (m,) array of int
        Segment of each face, in 0..k-1.
    weights : (k, n) array of float
        Diffuse indicators of the segments at the vertices: in [0, 1], with sum 1 at every vertex.

    Raises
    ------
    ValueError
        For arrays of other shapes, labels that are no integers in 0..k-1, or a weight outside
        [0, 1].
    """

    surface: Surface
    labels: Ints
    weights: Floats

    def __post_init__(self) -> None:
        m, n = self.surface.n_faces, self.surface.n_vertices
        if np.shape(self.labels) != (m,):
            raise ValueError(f"labels: shape {np.shape(self.labels)}, expected ({m},)")
        if np.ndim(self.weights) != 2 or np.shape(self.weights)[1] != n:
            raise ValueError(f"weights: shape {np.shape(self.weights)}, expected (k, {n})")
        labels, weights = np.asarray(self.labels), np.asarray(self.weights, dtype=np.float64)
        if not np.issubdtype(labels.dtype, np.integer):
            raise ValueError(f"labels: dtype {labels.dtype} must be an integer type")
        object.__setattr__(self, "labels", labels.astype(np.int64, copy=False))
        object.__setattr__(self, "weights", weights)
        outside = (self.labels < 0) | (self.labels >= self.n_segments)
        if outside.any():
            face = int(np.argmax(outside))
            raise ValueError(
                f"labels[{face}]: {self.labels[face]} must be in 0..{self.n_segments - 1}"
            )
        # Written so that NaN is outside.
        outside = ~((weights >= 0) & (weights <= 1))
        if outside.any():
            k, vertex = np.argwhere(outside)[0]
            raise ValueError(f"weights[{k}, {vertex}]: {weights[k, vertex]} must be in [0, 1]")

    @property
    def n_segments(self) -> int:
        """Number of segments, k."""
        return len(self.weights)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the segments, (k,), in the units of the surface squared."""
        return np.bincount(
            self.labels, weights=self.surface.face_areas, minlength=self.n_segments
        ).astype(np.float64)

    @cached_property
    def components(self) -> Ints:
        """Number of connected components of each segment, (k,)."""
        parts = self.surface.label_components(self.labels)
        _, first = np.unique(parts, return_index=True)
        return np.bincount(self.labels[first], minlength=self.n_segments)

    @cached_property
    def length(self) -> float:
        """Length of the edges between different segments, in the units of the surface."""
        f, k = np.nonzero(self.surface.face_neighbours >= 0)
        g = self.surface.face_neighbours[f, k]
        seam = (f < g) & (self.labels[f] != self.labels[g])
        f, k = f[seam], k[seam]
        ends = self.surface.vertices[
            np.stack([self.surface.faces[f, k], self.surface.faces[f, (k + 1) % 3]])
        ]
        return float(np.linalg.norm(ends[0] - ends[1], axis=1).sum())

    def back(self, transfer: Transfer) -> Segmentation:
        """Return the segmentation of the source of a transfer whose target this one is of.

        Faces take the label of the nearest face, weights go back as values at the vertices.

        Raises
        ------
        ValueError
            For a transfer to another surface.
        """
        if transfer.target is not self.surface:
            raise ValueError("transfer: its target must be the surface of this segmentation")
        # Means of values up to 1 may round to more.
        weights = np.minimum((transfer.backward @ self.weights.T).T, 1.0)
        return Segmentation(transfer.source, self.labels[transfer.parent_face], weights)
