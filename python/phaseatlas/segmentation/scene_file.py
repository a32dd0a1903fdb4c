"""The file of a segmentation of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Ints
from ..scene.arrays import scene_arrays, scene_of_arrays
from ..scene.scene import Scene
from .segmentation import Segmentation
from .tree import SegmentTree, tree_arrays, tree_of

__all__ = ["FORMAT", "parts_of_arrays", "segmentation_arrays"]

FORMAT = 2


def segmentation_arrays(
    scene: Scene, labels: Ints, parts: Sequence[Segmentation], trees: Sequence[SegmentTree | None]
) -> dict[str, Any]:
    """Return what a file holds of the segments of a scene; see `SceneSegmentation.save`."""
    piece = np.empty(scene.n_faces, dtype=np.int64)
    for k, part in enumerate(scene.pieces):
        piece[part.faces] = k
    arrays: dict[str, Any] = {
        "format": FORMAT,
        **scene_arrays(scene),
        "labels": labels,
        "piece": piece,
        "segments": np.array([part.n_segments for part in parts]),
        "epsilon": np.array([part.epsilon for part in parts]),
    }
    for k, tree in enumerate(trees):
        if tree is not None:
            arrays |= {f"tree_{k}_{key}": value for key, value in tree_arrays(tree).items()}
    return arrays


def parts_of_arrays(
    arrays: dict[str, Any],
) -> tuple[Scene, list[Segmentation], list[SegmentTree | None]]:
    """Return the scene of the arrays of a file, the segmentation and the tree of each piece."""
    scene = scene_of_arrays(arrays)
    labels, piece, epsilon = arrays["labels"], arrays["piece"], arrays["epsilon"]
    counts = arrays["segments"].tolist()
    if labels.shape != (scene.n_faces,) or piece.shape != (scene.n_faces,):
        raise ValueError(f"labels and piece: must have {scene.n_faces} entries, one a face")
    if not np.issubdtype(labels.dtype, np.integer):
        raise ValueError(f"labels: dtype {labels.dtype} must be an integer type")
    if not len(epsilon) == len(counts) == len(scene.pieces):
        raise ValueError(
            f"epsilon and segments: must have {len(scene.pieces)} entries, one a piece"
        )
    parts: list[Segmentation] = []
    trees: list[SegmentTree | None] = []
    first = 0
    for k, part in enumerate(scene.pieces):
        if (piece[part.faces] != k).any():
            raise ValueError(f"piece: faces of piece {k} do not hang together")
        own = labels[part.faces] - first
        if own.min() < 0 or own.max() >= counts[k]:
            raise ValueError(
                f"labels: those of piece {k} must be in {first}..{first + counts[k] - 1}"
            )
        tree = None
        start = f"tree_{k}_"
        found = {key[len(start) :]: value for key, value in arrays.items() if key.startswith(start)}
        if found:
            tree = tree_of(found, part.surface)
            if (tree.labels != own).any():
                raise ValueError(f"labels: those of piece {k} must be those of its tree")
            parts.append(tree.at(tree.levels))
        else:
            parts.append(Segmentation(part.surface, own, epsilon=float(epsilon[k])))
        trees.append(tree)
        first += counts[k]
    return scene, parts, trees
