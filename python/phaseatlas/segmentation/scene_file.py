"""The file of a segmentation of a scene."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np

from ..scene.arrays import scene_arrays, scene_of_arrays
from ..scene.scene import Scene
from .scene import SceneSegmentation
from .segmentation import Segmentation
from .tree import SegmentTree, read_arrays, tree_arrays, tree_of, write_arrays

__all__ = ["load", "save"]

_FORMAT = 2


def save(segmentation: SceneSegmentation, path: str | PathLike[str]) -> None:
    """Write the file; see `SceneSegmentation.save`."""
    scene = segmentation.surface
    if not isinstance(scene, Scene):
        raise TypeError("surface: must be a Scene")
    piece = np.empty(scene.n_faces, dtype=np.int64)
    for k, part in enumerate(scene.pieces):
        piece[part.faces] = k
    arrays: dict[str, Any] = {
        "format": _FORMAT,
        **scene_arrays(scene),
        "labels": segmentation.labels,
        "piece": piece,
        "segments": np.array([part.n_segments for part in segmentation.parts]),
        "epsilon": np.array([part.epsilon for part in segmentation.parts]),
    }
    for k, tree in enumerate(segmentation.trees):
        if tree is not None:
            arrays |= {f"tree_{k}_{key}": value for key, value in tree_arrays(tree).items()}
    write_arrays(path, arrays)


def load(path: str | PathLike[str]) -> SceneSegmentation:
    """Read the file; see `SceneSegmentation.load`."""
    return read_arrays(path, _FORMAT, _segmentation)


def _segmentation(arrays: dict[str, Any]) -> SceneSegmentation:
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
    return SceneSegmentation(scene, parts, trees)
