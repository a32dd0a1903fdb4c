"""A segmentation of several pieces of surface."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from ..saved_arrays import read_arrays, write_arrays
from ..scene.scene import Scene
from .scene_file import FORMAT, parts_of_arrays, segmentation_arrays
from .segmentation import Segmentation
from .tree import SegmentTree
from .whole import n_units

if TYPE_CHECKING:
    from ..scene.components import Component
    from ..surface import Surface

__all__ = ["SceneSegmentation", "leaves_of_pieces"]


class SceneSegmentation(Segmentation):
    """A segmentation of each piece of a scene, the segments numbered piece by piece.

    Parameters
    ----------
    scene : Scene
        With the pieces.
    parts : sequence of Segmentation
        One of each piece.
    trees : sequence of SegmentTree or None
        The trees whose leaves the parts are; None for a piece that is one segment.
    """

    pieces: tuple[Component, ...]
    parts: tuple[Segmentation, ...]
    trees: tuple[SegmentTree | None, ...]

    def __init__(
        self,
        scene: Scene,
        parts: Sequence[Segmentation],
        trees: Sequence[SegmentTree | None] = (),
    ) -> None:
        labels = np.empty(scene.n_faces, dtype=np.int64)
        first = 0
        for piece, part in zip(scene.pieces, parts, strict=True):
            labels[piece.faces] = part.labels + first
            first += part.n_segments
        super().__init__(scene, labels)
        object.__setattr__(self, "pieces", scene.pieces)
        object.__setattr__(self, "parts", tuple(parts))
        object.__setattr__(self, "trees", tuple(trees))

    @classmethod
    def of_trees(cls, scene: Scene, trees: Sequence[SegmentTree | None]) -> SceneSegmentation:
        """Take the leaves of a tree of each piece, or the piece as one segment."""
        parts = [
            Segmentation(piece.surface, np.zeros(piece.surface.n_faces, dtype=np.int64))
            if tree is None
            else tree.at(tree.levels)
            for piece, tree in zip(scene.pieces, trees, strict=True)
        ]
        return cls(scene, parts, trees)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the segments and their scene to an `.npz` file, whole or not at all.

        The keys are vertices, faces and labels of all pieces, piece (of each face), segments and
        epsilon (of each piece), source and sha256 (path and digest of the file that the scene was
        read from, empty where it was not), and format, 2. For each piece k that was cut by a tree
        there are its arrays, those that `SegmentTree.save` writes, as tree_k_fields and so on. The
        way back to the corners of the file is under names that start with ``mesh_``. Factors on the
        length of seams, where there are some, are seam_costs and vertex_seam_costs.
        """
        if not isinstance(self.surface, Scene):
            raise TypeError("surface: must be a Scene")
        arrays = segmentation_arrays(self.surface, self.labels, self.parts, self.trees)
        write_arrays(path, arrays)

    @staticmethod
    def load(path: str | PathLike[str]) -> SceneSegmentation:
        """Read what `save` wrote.

        Parts without a tree come back as their labels, with weights made of these.

        Raises
        ------
        ValueError
            For a file that is no segmentation of a scene.
        FileNotFoundError
            For a missing file.
        """
        return SceneSegmentation(*read_arrays(path, FORMAT, parts_of_arrays))


def leaves_of_pieces(surfaces: Sequence[Surface], count: int) -> list[int]:
    """Give `count` segments out to pieces, at least one each, to keep the largest one small.

    A piece never gets more segments than it has polygons.
    """
    counts = [1] * len(surfaces)
    most: dict[int, int] = {}
    room = [(-surface.area, k) for k, surface in enumerate(surfaces) if surface.n_faces > 1]
    heapq.heapify(room)
    left = count - len(surfaces)
    while left > 0 and room:
        _, k = heapq.heappop(room)
        if k not in most:
            most[k] = n_units(surfaces[k], count)
        if counts[k] < most[k]:
            counts[k] += 1
            left -= 1
            heapq.heappush(room, (-surfaces[k].area / counts[k], k))
    return counts
