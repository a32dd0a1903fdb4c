"""A segmentation: what an atlas is made of, whoever made the labels."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Floats, Ints
from ..notebook import Pictured
from ..surface import Surface
from ..transfer import Transfer

if TYPE_CHECKING:
    from .._core import Screened

__all__ = ["MergeTree", "Segmentation", "spread_of"]

# Interface width in mean edge lengths: that of `segment`.
_EPSILON = 2.0
# Roots of areas relative to epsilon below which it is narrowed: in the middle of a disk of this
# size a weight is 0.77.
_NARROWEST = 4.0
# Rows of weights that are solved for at once, so that the solver's copies stay small.
_BATCH = 16
# Entries of all weights, 512 MB, above which they are not kept for the sake of a row.
_MANY = 2**26


@dataclass(frozen=True, eq=False, init=False)
class Segmentation(Pictured):
    """Segments of a surface: a label for each face and a blending weight for each vertex.

    Parameters
    ----------
    surface : Surface
        The surface, with n vertices and m faces.
    labels : (m,) array_like of int
        Segment of each face, in 0..k-1.
    weights : (k, n) array_like of float, optional
        Diffuse indicators of the segments at the vertices: in [0, 1], with sum 1 at every vertex.
        By default they are made of the labels when they are first asked for, and k is the largest
        label plus 1.
    epsilon : float, optional
        Width of the weights that are made of the labels, in the units of the surface: across a
        straight boundary they fall like exp(-d / epsilon) / 2 with the distance d. Twice the mean
        edge length by default. In a segment with an area below (4 epsilon)^2 the width is a
        quarter of the root of its area.

    Raises
    ------
    ValueError
        For arrays of other shapes, labels that are no integers in 0..k-1, a weight outside
        [0, 1], or a width that is no positive number.
    """

    surface: Surface
    labels: Ints
    epsilon: float
    _given: Floats | None = field(repr=False)

    def __init__(
        self,
        surface: Surface,
        labels: ArrayLike,
        weights: ArrayLike | None = None,
        *,
        epsilon: float | None = None,
    ) -> None:
        array = np.asarray(labels)
        if array.shape != (surface.n_faces,):
            raise ValueError(f"labels: shape {array.shape} must be ({surface.n_faces},)")
        if not np.issubdtype(array.dtype, np.integer):
            raise ValueError(f"labels: dtype {array.dtype} must be an integer type")
        given = None if weights is None else _checked(weights, surface)
        # Without weights no more segments than faces make sense.
        most = surface.n_faces if given is None else len(given)
        outside = (array < 0) | (array >= most)
        if outside.any():
            face = int(np.argmax(outside))
            raise ValueError(f"labels[{face}]: {array[face]} must be in 0..{most - 1}")
        if epsilon is None:
            epsilon = _EPSILON * surface.mean_edge_length
        elif not (np.isfinite(epsilon) and epsilon > 0):
            raise ValueError(f"epsilon: {epsilon} must be a positive number")
        object.__setattr__(self, "surface", surface)
        object.__setattr__(self, "labels", array.astype(np.int64, copy=False))
        object.__setattr__(self, "epsilon", float(epsilon))
        object.__setattr__(self, "_given", given)

    def __repr__(self) -> str:
        name, of = type(self).__name__, repr(self.surface)
        return f"{name}({self.n_segments} segments, {spread_of(self.areas)},\n  of {of})"

    def __getstate__(self) -> dict[str, Any]:
        # A factor cannot be pickled, and is soon made again.
        return {name: value for name, value in vars(self).items() if name != "_spreading"}

    @cached_property
    def n_segments(self) -> int:
        """Number of segments, k."""
        return int(self.labels.max()) + 1 if self._given is None else len(self._given)

    @cached_property
    def weights(self) -> Floats:
        """Diffuse indicators of the segments at the vertices, (k, n): a partition of unity.

        Those of the labels are positive wherever a face around the vertex has the label.
        """
        if self._given is not None:
            return self._given
        segments = np.arange(self.n_segments)
        weights = np.empty((self.n_segments, self.surface.n_vertices))
        for first in range(0, self.n_segments, _BATCH):
            batch = slice(first, first + _BATCH)
            weights[batch] = self._spreading.spread(self.labels, segments[batch])
        return weights

    @property
    def weights_given(self) -> bool:
        """Whether the weights were given; others are made of the labels."""
        return self._given is not None

    def weight(self, segment: int) -> Floats:
        """Return the weights of one segment, (n,), without room for those of thousands.

        Raises
        ------
        ValueError
            For a segment outside 0..k-1.
        """
        if segment not in range(self.n_segments):
            raise ValueError(f"segment: {segment!r} must be in 0..{self.n_segments - 1}")
        if self._given is not None or self.n_segments * self.surface.n_vertices <= _MANY:
            row: Floats = self.weights[segment]
        else:
            row = self._spreading.spread(self.labels, np.array([segment]))[0]
        return row

    @cached_property
    def _spreading(self) -> Screened:
        narrow = np.sqrt(self.areas) / _NARROWEST
        return self.surface.screened(np.minimum(self.epsilon, narrow)[self.labels])

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

        Faces take the labels of their parent faces. Weights that were given go back as values at
        the vertices; others are made of the labels anew.

        Raises
        ------
        ValueError
            For a transfer to another surface.
        """
        if transfer.target is not self.surface:
            raise ValueError("transfer: its target must be the surface of this segmentation")
        labels = self.labels[transfer.parent_face]
        weights = None
        if self._given is not None:
            # Means of values up to 1 may round to more.
            weights = np.minimum((transfer.backward @ self._given.T).T, 1.0)
        return Segmentation(transfer.source, labels, weights, epsilon=self.epsilon)

    def merge_tree(self, distortion: float = 600.0) -> MergeTree:
        """Merge neighbouring segments, the pair that costs least first, until none are left.

        The costs are exact differences of the energy of `partition`: the length of seams and cuts
        in roots of the area, `distortion` times the mean squared log scale of the boundary-first
        maps, and a tenth for each chart. A chart whose map overlaps itself is not refused; it costs
        what it would take to repair. So charts high in the tree may overlap themselves.

        Parameters
        ----------
        distortion : float, default 600
            Weight of the distortion.

        Returns
        -------
        MergeTree
            Its leaves are the connected pieces of the segments, in the order of the segments.

        Raises
        ------
        ValueError
            For a weight that is not positive.
        """
        if not (np.isfinite(distortion) and distortion > 0):
            raise ValueError(f"distortion: {distortion} must be a positive number")
        core = self.surface.one_chart(distortion)
        core.set_labels(self.labels, 0.0)
        pieces = core.labels()
        _, first = np.unique(pieces, return_index=True)
        number = np.empty(len(first), dtype=np.int64)
        number[np.argsort(self.labels[first], kind="stable")] = np.arange(len(first))
        pairs, energies = core.merges()
        # Charts that were merged keep their numbers.
        everyone = np.concatenate([number, np.arange(len(first), len(first) + len(pairs))])
        return MergeTree(
            surface=self.surface,
            labels=number[pieces],
            merges=np.sort(everyone[pairs].reshape(-1, 2), axis=1),
            energies=np.concatenate([[core.figures()[0]], energies]),
            epsilon=self.epsilon,
        )


@dataclass(frozen=True, eq=False)
class MergeTree:
    """A hierarchy of charts: the order in which neighbours are merged until none are left.

    Attributes
    ----------
    surface : Surface
        With m faces.
    labels : (m,) array of int
        Leaf of each face, in 0..k-1.
    merges : (k - 1, 2) array of int
        The two charts of each merge. Leaves have the numbers below k, the chart of merge i has the
        number k + i.
    energies : (k,) array
        The energy of the leaves, then that after each merge; infinite where a closed surface of
        few faces has become one chart that no cut opens.
    epsilon : float
        Width of the weights, in the units of the surface.
    """

    surface: Surface
    labels: Ints
    merges: Ints
    energies: Floats
    epsilon: float

    def __repr__(self) -> str:
        return (
            f"MergeTree({self.n_leaves} leaves, epsilon {self.epsilon:.4g},\n  of {self.surface!r})"
        )

    @property
    def n_leaves(self) -> int:
        """Number of leaves, k."""
        return len(self.energies)

    def at(self, n_charts: int) -> Segmentation:
        """Return the segmentation into so many charts, numbered by their first leaves.

        Parameters
        ----------
        n_charts : int
            From 1 to the number of leaves. Few, large charts may overlap themselves in the plane.

        Raises
        ------
        ValueError
            For another number.
        """
        k = self.n_leaves
        if n_charts not in range(1, k + 1):
            raise ValueError(f"n_charts: {n_charts!r} must be a whole number in 1..{k}")
        chart = np.arange(k)
        for i, (a, b) in enumerate(self.merges[: k - n_charts]):
            chart[(chart == a) | (chart == b)] = k + i
        _, first, inverse = np.unique(chart, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        return Segmentation(self.surface, rank[inverse][self.labels], epsilon=self.epsilon)


def spread_of(areas: Floats) -> str:
    """The range of the areas as parts of their sum, in words."""
    shares = 100 * areas / areas.sum()
    return f"{shares.min():.3g} to {shares.max():.3g} % of the area each"


def _checked(weights: ArrayLike, surface: Surface) -> Floats:
    """Weights as an array of the right shape, all of them in [0, 1]."""
    array = np.asarray(weights, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != surface.n_vertices:
        raise ValueError(f"weights: shape {array.shape} must be (k, {surface.n_vertices})")
    # Written so that NaN is outside.
    outside = ~((array >= 0) & (array <= 1))
    if outside.any():
        k, vertex = np.argwhere(outside)[0]
        raise ValueError(f"weights[{k}, {vertex}]: {array[k, vertex]} must be in [0, 1]")
    return array
