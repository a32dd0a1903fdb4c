"""A binary tree of phase fields, section 4, and its file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..functionals import indicator
from ..notebook import Pictured
from ..saved_arrays import read_arrays, write_arrays
from ..scene.scene import SceneFile
from ..seam_costs import cost_arrays, with_costs
from ..surface import Surface
from .node import Diagnostics
from .segmentation import Segmentation, spread_of

if TYPE_CHECKING:
    from .clusters import Clustered, ClusterTree

__all__ = [
    "MAX_LEVELS",
    "SegmentTree",
    "TreeNode",
    "children",
    "front",
    "outline",
    "paths",
    "tree_arrays",
    "tree_of",
]


_FORMAT = 1
#: Deepest tree that is made: 65,536 segments where all are halves.
MAX_LEVELS = 16


@dataclass(frozen=True, eq=False)
class TreeNode:
    """A node of the tree: a split one with its field, or a leaf.

    Attributes
    ----------
    parent : int
        Place of the parent among the nodes; -1 for the root.
    positive : bool
        Whether it is the child with u > 0 of its parent; true for the root.
    share : float
        Part of the surface's area that it is to have.
    field : (n,) array or None
        The phase field that splits it; None for a leaf.
    diagnostics : Diagnostics or None
        How it was split; None for a leaf.
    """

    parent: int
    positive: bool
    share: float
    field: Floats | None = None
    diagnostics: Diagnostics | None = None


def outline(shares: Sequence[float]) -> list[TreeNode]:
    """Nodes of a tree whose leaves have these shares in their order, without fields.

    Each node cuts its run of leaves in two whose sums are as even as can be. Nodes come level by
    level, on each from left to right, positive children first.

    Parameters
    ----------
    shares : sequence of float
        Positive; 2**k equal ones give the complete tree of k levels.
    """
    total = float(np.sum(shares))
    nodes = [TreeNode(-1, True, 1.0)]
    runs = [np.asarray(shares, dtype=np.float64)]
    k = 0
    while k < len(nodes):
        run = runs[k]
        if len(run) > 1:
            sums = np.cumsum(run)
            first = 1 + int(np.argmin(np.abs(2 * sums[:-1] - sums[-1])))
            for positive, part in ((True, run[:first]), (False, run[first:])):
                nodes.append(TreeNode(k, positive, float(part.sum()) / total))
                runs.append(part)
        k += 1
    return nodes


def children(nodes: Sequence[TreeNode]) -> dict[int, tuple[int, int]]:
    """The two children of each split node, the positive one first, level by level."""
    pairs: dict[int, tuple[int, ...]] = {}
    for k, node in enumerate(nodes[1:], start=1):
        pairs[node.parent] = (*pairs.get(node.parent, ()), k)
    return {k: (first, second) for k, (first, second) in pairs.items()}


def paths(nodes: Sequence[TreeNode]) -> list[tuple[bool, ...]]:
    """For each node, from the root down, whether each step goes to the positive child."""
    result: list[tuple[bool, ...]] = []
    for node in nodes:
        result.append(() if node.parent < 0 else (*result[node.parent], node.positive))
    return result


def front(nodes: Sequence[TreeNode], level: int) -> list[int]:
    """The nodes of a level and the leaves above it, from left to right."""
    split, ways = children(nodes), paths(nodes)
    chosen = [
        k
        for k, way in enumerate(ways)
        if len(way) == level or (len(way) < level and k not in split)
    ]
    return sorted(chosen, key=lambda k: [not positive for positive in ways[k]])


@dataclass(frozen=True, eq=False)
class SegmentTree(Pictured):
    """A binary tree of phase fields and the segments at its leaves.

    A node has two children, first the positive one, where u > 0. In a tree of halves node `i` of
    level `k` has the children `2 i` and `2 i + 1` on level `k + 1`.

    Attributes
    ----------
    surface : Surface
        The surface as given, with n vertices and m faces.
    epsilon : float
        Interface width in the units of the surface.
    delta : float
        Half width of the plateaus of the indicator chi.
    nodes : tuple of TreeNode
        Split nodes and leaves, level by level, on each from left to right.
    labels : (m,) array of int
        Leaf of each face, numbered from left to right. Labels descend the tree, so that those of
        a level are unions of those of the next: at each node a face goes to the child of larger
        weight, up to the `level_set` of the node that meets the shares and its relabelled faces.
    """

    surface: Surface
    epsilon: float
    delta: float
    nodes: tuple[TreeNode, ...]
    labels: Ints

    def __repr__(self) -> str:
        leaves = f"{self.levels} levels, {len(self.areas)} segments"
        return f"SegmentTree({leaves}, {spread_of(self.areas)},\n  of {self.surface!r})"

    @cached_property
    def levels(self) -> int:
        """Number of levels; a tree of halves has 2**levels leaves."""
        return max(map(len, paths(self.nodes)))

    @cached_property
    def fields(self) -> Floats:
        """Phase fields of the split nodes, level by level, (leaves - 1, n)."""
        return np.stack([node.field for node in self.nodes if node.field is not None])

    @cached_property
    def diagnostics(self) -> tuple[Diagnostics, ...]:
        """How each split node was split, level by level."""
        return tuple(node.diagnostics for node in self.nodes if node.diagnostics is not None)

    @cached_property
    def weights(self) -> Floats:
        """Diffuse indicators of the leaves, (leaves, n): a partition of unity."""
        return self.weights_at(self.levels)

    def weights_at(self, level: int) -> Floats:
        """Diffuse indicators chi^alpha of a level, section 4 of the paper.

        Parameters
        ----------
        level : int
            0 is the root, `levels` the leaves. Leaves above the level belong to it.

        Returns
        -------
        (k, n) array
            One row a node of the level, from left to right; 2**level in a tree of halves.

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        nodes = self._front(level)
        weights: dict[int, Floats] = {0: np.ones(self.surface.n_vertices)}
        for k, (first, second) in children(self.nodes).items():
            field = self.nodes[k].field
            if k in weights and k not in nodes and field is not None:
                weight, positive = weights.pop(k), indicator(field, self.delta)
                weights[first], weights[second] = weight * positive, weight * (1 - positive)
        return np.stack([weights[k] for k in nodes])

    def labels_at(self, level: int) -> Ints:
        """Node of each face on a level, (m,), numbered from left to right.

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        place = {k: number for number, k in enumerate(self._front(level))}
        above = []
        for leaf in self._front(self.levels):
            k = leaf
            while k not in place:
                k = self.nodes[k].parent
            above.append(place[k])
        return np.array(above, dtype=np.int64)[self.labels]

    def at(self, level: int) -> Segmentation:
        """Return the segments of a level, with its `weights_at` and `labels_at`.

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        return Segmentation(
            self.surface, self.labels_at(level), self.weights_at(level), epsilon=self.epsilon
        )

    @cached_property
    def _leaves(self) -> Segmentation:
        return Segmentation(self.surface, self.labels, self.weights, epsilon=self.epsilon)

    @property
    def shares(self) -> Floats:
        """Parts of the surface's area that the leaves were to have, (leaves,)."""
        return np.array([self.nodes[k].share for k in self._front(self.levels)])

    @property
    def areas(self) -> Floats:
        """Areas of the sharp leaves, (leaves,), in the units of the surface squared."""
        return self._leaves.areas

    @property
    def components(self) -> Ints:
        """Number of connected components of each sharp leaf, (leaves,)."""
        return self._leaves.components

    @property
    def interface_length(self) -> float:
        """Length of the edges between different leaves, in the units of the surface."""
        return self._leaves.length

    def _front(self, level: int) -> list[int]:
        if level not in range(self.levels + 1):
            raise ValueError(f"level: {level!r} must be a whole number in 0..{self.levels}")
        return front(self.nodes, level)

    def cluster_tree(self, of: Clustered = "faces") -> ClusterTree:
        """Return the faces or vertices as clusters; see `clusters.cluster_tree`."""
        from .clusters import cluster_tree

        return cluster_tree(self, of)

    def save(self, path: str | PathLike[str], *, source: SceneFile | None = None) -> None:
        """Write the tree to an `.npz` file, whole or not at all.

        The keys are vertices, faces, fields, weights, labels, levels, epsilon, delta,
        diagnostics (JSON) and format, and for each node parents, positive and shares; source and
        sha256 (path and digest of the file that the surface was read from, empty where it was not);
        seam_costs and vertex_seam_costs where the surface has them.

        Parameters
        ----------
        path : str or PathLike
        source : SceneFile, optional
            The file that the surface was read from, `Scene.file`.
        """
        arrays = {
            "vertices": self.surface.vertices,
            "faces": self.surface.faces,
            "weights": self.weights,
            "format": _FORMAT,
            "source": "" if source is None else source.path,
            "sha256": "" if source is None else source.sha256,
            **tree_arrays(self),
            **cost_arrays(self.surface),
        }
        write_arrays(path, arrays)

    @staticmethod
    def load(path: str | PathLike[str]) -> SegmentTree:
        """Read a tree that `save` wrote.

        Raises
        ------
        ValueError
            For a file that is no segmentation, or of a newer format.
        FileNotFoundError
            For a missing file.
        """
        return read_arrays(
            path,
            _FORMAT,
            lambda arrays: tree_of(
                arrays, with_costs(Surface(arrays["vertices"], arrays["faces"]), arrays)
            ),
        )


def tree_arrays(tree: SegmentTree) -> dict[str, Any]:
    """What a file holds of a tree, its surface aside, by the names there."""
    return {
        "fields": tree.fields,
        "labels": tree.labels,
        "levels": tree.levels,
        "epsilon": tree.epsilon,
        "delta": tree.delta,
        "diagnostics": json.dumps([asdict(d) for d in tree.diagnostics]),
        "parents": np.array([node.parent for node in tree.nodes]),
        "positive": np.array([node.positive for node in tree.nodes]),
        "shares": np.array([node.share for node in tree.nodes]),
    }


def tree_of(arrays: dict[str, Any], surface: Surface) -> SegmentTree:
    """Tree of the arrays of a file, checked for what a damaged or foreign one may hold."""
    records = json.loads(str(arrays["diagnostics"]))
    for record in records:
        record["components"] = tuple(record["components"])
    levels, labels = int(arrays["levels"]), arrays["labels"]
    if not 1 <= levels <= MAX_LEVELS:
        raise ValueError(f"levels: {levels} must be in 1..{MAX_LEVELS}")
    nodes = _nodes(arrays) if "parents" in arrays else outline(np.ones(2**levels).tolist())
    if (deepest := max(map(len, paths(nodes)))) != levels:
        raise ValueError(f"levels: {levels}, but the deepest node is on level {deepest}")
    inner = list(children(nodes))
    shapes = {
        "fields": (len(inner), surface.n_vertices),
        "labels": (surface.n_faces,),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name}: shape {arrays[name].shape} must be {shape}")
    if len(records) != len(inner):
        raise ValueError(f"diagnostics: {len(records)} records must be {len(inner)}")
    if not np.issubdtype(labels.dtype, np.integer):
        raise ValueError(f"labels: dtype {labels.dtype} must be an integer type")
    if not np.isfinite(arrays["fields"]).all():
        raise ValueError("fields: not all finite")
    if not 0 <= float(arrays["delta"]) < 1:
        raise ValueError(f"delta: {float(arrays['delta'])} must be in [0, 1)")
    if labels.min() < 0 or labels.max() > len(inner):
        raise ValueError(f"labels: outside 0..{len(inner)}")
    for k, field, record in zip(inner, arrays["fields"], records, strict=True):
        node = nodes[k]
        nodes[k] = TreeNode(node.parent, node.positive, node.share, field, Diagnostics(**record))
    return SegmentTree(
        surface, float(arrays["epsilon"]), float(arrays["delta"]), tuple(nodes), labels
    )


def _nodes(arrays: dict[str, Any]) -> list[TreeNode]:
    """Nodes of the arrays of a file: a binary tree, parents first, two children or none each."""
    parents, positive, shares = (arrays[name] for name in ("parents", "positive", "shares"))
    if not len(parents) == len(positive) == len(shares):
        raise ValueError("parents, positive and shares: must have one entry a node each")
    if not len(parents) or parents[0] != -1 or (parents[1:] >= np.arange(1, len(parents))).any():
        raise ValueError("parents: every node but the first must come after its parent")
    if (parents[1:] < 0).any() or not _in_pairs(parents[1:], positive[1:]):
        raise ValueError("parents: every node must have two children, the positive one first")
    return [
        TreeNode(int(parent), bool(sign), float(share))
        for parent, sign, share in zip(parents, positive, shares, strict=True)
    ]


def _in_pairs(parents: Ints, positive: Bools) -> bool:
    """Whether children come in pairs of one parent, the positive one first."""
    return (
        len(parents) % 2 == 0
        and bool((parents[::2] == parents[1::2]).all())
        and len(np.unique(parents[::2])) == len(parents) // 2
        and bool(positive[::2].all())
        and not positive[1::2].any()
    )
