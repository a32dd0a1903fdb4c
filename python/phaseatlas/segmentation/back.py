"""A tree of segments on a working surface, carried back to the surface as given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..functionals import Area
from ..surface import Surface
from ..transfer import Transfer
from ..working import carry_labels
from . import sharp
from .grids import Grid
from .options import Options
from .tree import SegmentTree, TreeNode, children, front, paths
from .whole import coverage, share_out, splits_units

__all__ = ["carried_back", "with_whole_polygons"]

# Steps of averaging over neighbours for each vertex that has collapsed into one: a random walk
# gets as far as the edges that the field comes from.
_SMOOTHING = 1.0


def carried_back(tree: SegmentTree, steps: Sequence[Transfer], options: Options) -> SegmentTree:
    """Carry fields and labels back from the working surface.

    Parameters
    ----------
    tree : SegmentTree
        On the target of the last transfer.
    steps : sequence of Transfer
        From the surface as given to the working surface.
    options : Options
        How the tree was made.
    """
    surface = steps[0].source
    fields = tree.fields.T
    for step in reversed(steps):
        fields = step.backward @ fields
    simplified = steps[0].origin_face is None
    if simplified:
        fields = _smoothed(surface, fields, steps[0].target.n_vertices)
    nodes = _with_fields(tree.nodes, np.ascontiguousarray(fields.T))
    back = replace(tree, surface=surface, nodes=nodes)
    if simplified:
        return with_whole_polygons(_from_fields(back, options))
    labels = carry_labels(tuple(steps[1:]), tree.labels)
    covered = coverage(steps[0], labels, surface, len(tree.shares))
    return _relabelled(back, share_out(surface, covered, tree.shares, _splits(tree)))


def with_whole_polygons(tree: SegmentTree) -> SegmentTree:
    """Give polygons that are in several segments to one of them."""
    if not splits_units(tree.surface, tree.labels):
        return tree
    covered = coverage(None, tree.labels, tree.surface, len(tree.shares))
    return _relabelled(tree, share_out(tree.surface, covered, tree.shares, _splits(tree)))


def _smoothed(surface: Surface, fields: Floats, n_coarse: int) -> Floats:
    """Average fields over neighbours, as far as the steps between collapsed vertices are."""
    import scipy.sparse

    steps = int(_SMOOTHING * surface.n_vertices / n_coarse)
    mean = surface.adjacency + scipy.sparse.eye_array(surface.n_vertices, format="csr")
    mean = scipy.sparse.csr_array(scipy.sparse.diags_array(1 / mean.sum(axis=1)) @ mean)
    for _ in range(steps):
        fields = mean @ fields
    return fields


def _with_fields(nodes: Sequence[TreeNode], fields: Floats) -> tuple[TreeNode, ...]:
    """Nodes with other fields, in the order of the split ones."""
    rows = iter(fields)
    return tuple(
        node if node.field is None else replace(node, field=np.ascontiguousarray(next(rows)))
        for node in nodes
    )


def _splits(tree: SegmentTree) -> Ints:
    """First leaf of each split node, first of its second child, and one past its last."""
    ways = paths(tree.nodes)
    leaves = [ways[k] for k in front(tree.nodes, tree.levels)]
    rows = []
    for k, (_, second) in children(tree.nodes).items():
        mine = [i for i, way in enumerate(leaves) if way[: len(ways[k])] == ways[k]]
        after = [i for i in mine if leaves[i][: len(ways[second])] == ways[second]]
        rows.append((mine[0], after[0], mine[-1] + 1))
    return np.array(rows, dtype=np.int64)


def _relabelled(tree: SegmentTree, labels: Ints) -> SegmentTree:
    """The tree with other labels, and the shares that they give to the children."""
    areas = np.bincount(labels, weights=tree.surface.face_areas, minlength=len(tree.shares))
    nodes = list(tree.nodes)
    for k, (start, middle, end) in zip(children(tree.nodes), _splits(tree), strict=True):
        found = nodes[k].diagnostics
        assert found is not None, "a split node has diagnostics"
        share = float(areas[start:middle].sum() / areas[start:end].sum())
        nodes[k] = replace(nodes[k], diagnostics=replace(found, sharp_share=share))
    return replace(tree, nodes=tuple(nodes), labels=labels)


def _from_fields(tree: SegmentTree, options: Options) -> SegmentTree:
    """Labels by the fields, at the thresholds that meet the shares; islands are relabelled."""
    surface = tree.surface
    owner = np.zeros(surface.n_faces, dtype=np.int64)
    nodes = list(tree.nodes)
    area = Area(surface, tree.epsilon, delta=tree.delta)
    for k, (first, second) in children(tree.nodes).items():
        node, mine = nodes[k], owner == k
        assert node.field is not None, "a split node has a field"
        assert node.diagnostics is not None, "a split node has diagnostics"
        grid = Grid(surface, None, mine, area)
        positive, threshold = sharp.cut(grid, node.field, node.diagnostics.share, options)
        moved: Bools = np.zeros_like(positive)
        if options.connected:
            moved = sharp.islands(grid, positive)
            positive = positive ^ moved
        owner[mine] = np.where(positive[mine], first, second)
        diagnostics = replace(
            node.diagnostics,
            level_set=threshold,
            relabelled_faces=int(moved.sum()),
            relabelled_area=sharp.part_of_area(grid, moved),
            sharp_share=sharp.part_of_area(grid, positive),
        )
        nodes[k] = replace(node, diagnostics=diagnostics)
    number = np.zeros(len(nodes), dtype=np.int64)
    leaves = front(nodes, len(nodes))
    number[leaves] = np.arange(len(leaves))
    return replace(tree, nodes=tuple(nodes), labels=number[owner])
