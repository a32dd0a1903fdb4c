"""A tree of segments as a cluster tree, which H-matrix and wavelet codes take."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from os import PathLike
from typing import Literal, get_args

import numpy as np
from scipy.sparse import coo_array

from ..arrays import Floats, Ints
from ..saved_arrays import write_arrays
from ..surface import Surface
from .tree import SegmentTree, children, front

__all__ = ["ClusterTree", "Clustered", "cluster_tree"]

Clustered = Literal["faces", "vertices"]


@dataclass(frozen=True, eq=False)
class ClusterTree:
    """Clusters of the faces or vertices of a surface: a binary tree, each node a range.

    Nodes are those of the `SegmentTree`, level by level, on each from left to right; node 0 is the
    root. Leaves are numbered from left to right, as the labels of the tree.

    Attributes
    ----------
    of : {"faces", "vertices"}
        What is clustered: the elements of piecewise constant functions, or the nodes of continuous
        piecewise linear ones.
    permutation : (n,) array of int
        All faces or vertices, leaf by leaf, within a leaf by number.
    ranges : (k, 2) array of int
        Node i holds ``permutation[ranges[i, 0] : ranges[i, 1]]``. Children follow each other and
        fill the range of their parent. A leaf of very few faces may hold no vertex.
    parents : (k,) array of int
        Parent of each node, -1 for the root.
    children : (k, 2) array of int
        Children of each node, -1 for a leaf.
    levels : (k,) array of int
        Level of each node, 0 for the root.
    leaves : (l,) array of int
        The node of each leaf.
    boxes : (k, 2, 3) array
        Least and largest coordinates of the supports in each node: of its faces, or of all faces
        around its vertices. An empty node has infinite ones, the least above the largest.
    areas : (k,) array
        Area of the faces of each node, or lumped mass of its vertices.
    neighbours : (p, 2) array of int
        Pairs of leaves that share edges, the smaller one first, sorted.
    lengths : (p,) array
        Length of the edges that each pair shares, in the units of the surface.
    """

    of: Clustered
    permutation: Ints
    ranges: Ints
    parents: Ints
    children: Ints
    levels: Ints
    leaves: Ints
    boxes: Floats
    areas: Floats
    neighbours: Ints
    lengths: Floats

    def members(self, node: int) -> Ints:
        """Faces or vertices of a node."""
        first, last = self.ranges[node]
        return self.permutation[first:last]

    def save(self, path: str | PathLike[str]) -> None:
        """Write all attributes under their names to an `.npz` file, whole or not at all."""
        write_arrays(path, asdict(self))


def cluster_tree(tree: SegmentTree, of: Clustered = "faces") -> ClusterTree:
    """Return the clusters of a tree of segments.

    A vertex belongs to the leaf that has most area around it, of several to the first.

    Parameters
    ----------
    tree : SegmentTree
    of : {"faces", "vertices"}, default "faces"
        What to cluster.

    Returns
    -------
    ClusterTree

    Raises
    ------
    ValueError
        For an unknown `of`.
    """
    if of not in get_args(Clustered):
        raise ValueError(f"of: {of!r} must be one of {get_args(Clustered)}")
    surface, k = tree.surface, len(tree.nodes)
    leaves = np.array(front(tree.nodes, tree.levels))
    if of == "faces":
        leaf, weights = tree.labels, surface.face_areas
        corners = surface.vertices[surface.faces]
        lows, highs = corners.min(axis=1), corners.max(axis=1)
    else:
        leaf, weights = _leaf_of_vertices(tree, len(leaves)), surface.mass
        lows, highs = _stars(surface)
    counts = np.bincount(leaf, minlength=len(leaves))
    ends = np.cumsum(counts)
    ranges = np.zeros((k, 2), dtype=np.int64)
    ranges[leaves] = np.column_stack([ends - counts, ends])
    boxes = np.empty((k, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    np.minimum.at(boxes[:, 0], leaves[leaf], lows)
    np.maximum.at(boxes[:, 1], leaves[leaf], highs)
    areas = np.zeros(k)
    areas[leaves] = np.bincount(leaf, weights, minlength=len(leaves))
    parents = np.array([node.parent for node in tree.nodes])
    pairs = np.full((k, 2), -1)
    levels = np.zeros(k, dtype=np.int64)
    for node, both in children(tree.nodes).items():
        pairs[node] = both
        levels[list(both)] = levels[node] + 1
    # Children come after their parents.
    for node in np.flatnonzero(pairs[:, 0] >= 0)[::-1]:
        first, second = pairs[node]
        ranges[node] = ranges[first, 0], ranges[second, 1]
        areas[node] = areas[first] + areas[second]
        boxes[node, 0] = np.minimum(boxes[first, 0], boxes[second, 0])
        boxes[node, 1] = np.maximum(boxes[first, 1], boxes[second, 1])
    neighbours, lengths = _neighbours(tree)
    return ClusterTree(
        of=of,
        permutation=np.argsort(leaf, kind="stable"),
        ranges=ranges,
        parents=parents,
        children=pairs,
        levels=levels,
        leaves=leaves,
        boxes=boxes,
        areas=areas,
        neighbours=neighbours,
        lengths=lengths,
    )


def _leaf_of_vertices(tree: SegmentTree, n_leaves: int) -> Ints:
    """The leaf that has most area around each vertex; of several the first."""
    surface = tree.surface
    shape = (surface.n_vertices, n_leaves)
    at = surface.faces.reshape(-1), np.repeat(tree.labels, 3)
    around = coo_array((np.repeat(surface.face_areas, 3), at), shape=shape).tocsr().tocoo()
    vertex, leaf = around.coords
    # Rounding does not decide between leaves that have half each.
    part = np.round(around.data / (3 * surface.mass[vertex]), 9)
    order = np.lexsort((leaf, -part, vertex))
    _, first = np.unique(vertex[order], return_index=True)
    found: Ints = leaf[order][first].astype(np.int64)
    return found


def _stars(surface: Surface) -> tuple[Floats, Floats]:
    """Least and largest coordinates of the faces around each vertex."""
    corners = surface.vertices[surface.faces]
    lows = np.full((surface.n_vertices, 3), np.inf)
    highs = -lows
    for k in range(3):
        np.minimum.at(lows, surface.faces[:, k], corners.min(axis=1))
        np.maximum.at(highs, surface.faces[:, k], corners.max(axis=1))
    return lows, highs


def _neighbours(tree: SegmentTree) -> tuple[Ints, Floats]:
    """Pairs of leaves that share edges, and the lengths of these."""
    surface, labels = tree.surface, tree.labels
    across = surface.face_neighbours
    f, k = np.nonzero((across >= 0) & (labels[across] > labels[:, None]))
    pairs = np.column_stack([labels[f], labels[across[f, k]]])
    starts, ends = surface.faces[f, k], surface.faces[f, (k + 1) % 3]
    lengths = np.linalg.norm(surface.vertices[ends] - surface.vertices[starts], axis=1)
    unique, pair = np.unique(pairs, axis=0, return_inverse=True)
    return unique, np.bincount(pair.reshape(-1), lengths, minlength=len(unique)).astype(np.float64)
