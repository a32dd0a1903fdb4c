"""The file of a segmentation of a scene."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from os import PathLike
from typing import Any

import numpy as np

from ..arrays import Ints
from ..scene.repair import Aside, Repaired, RepairReport
from ..scene.scene import Scene, SceneFile
from .scene import SceneSegmentation
from .segmentation import Segmentation
from .tree import SegmentTree, read_arrays, tree_arrays, tree_of, write_arrays

__all__ = ["load", "save"]

_FORMAT = 2
# Arrays of a repaired mesh with a row a face; its vertices and faces are those of the scene.
_OF_FACES = ("polygon", "corner", "component", "flipped", "inner")


def save(segmentation: SceneSegmentation, path: str | PathLike[str]) -> None:
    """Write the file; see `SceneSegmentation.save`."""
    scene = segmentation.surface
    if not isinstance(scene, Scene):
        raise TypeError("surface: must be a Scene")
    repaired = [mesh.repaired for mesh in scene.meshes]
    piece = np.empty(scene.n_faces, dtype=np.int64)
    for k, part in enumerate(scene.pieces):
        piece[part.faces] = k
    arrays: dict[str, Any] = {
        "format": _FORMAT,
        "vertices": scene.vertices,
        "faces": scene.faces,
        "labels": segmentation.labels,
        "piece": piece,
        "segments": np.array([part.n_segments for part in segmentation.parts]),
        "epsilon": np.array([part.epsilon for part in segmentation.parts]),
        "source": "" if scene.file is None else scene.file.path,
        "sha256": "" if scene.file is None else scene.file.sha256,
        "mesh_names": json.dumps([mesh.name for mesh in scene.meshes]),
        "mesh_reports": json.dumps([asdict(each.report) for each in repaired]),
        "mesh_corners": np.array([each.n_corners for each in repaired]),
        "mesh_vertices": np.array([len(each.vertices) for each in repaired]),
        "mesh_faces": np.array([len(each.faces) for each in repaired]),
        "mesh_asides": np.array([len(each.aside.polygon) for each in repaired]),
        "mesh_source_vertex": np.concatenate([each.source_vertex for each in repaired]),
    }
    for name in _OF_FACES:
        arrays[f"mesh_{name}"] = np.concatenate([getattr(each, name) for each in repaired])
    for field in fields(Aside):
        found = [getattr(each.aside, field.name) for each in repaired]
        arrays[f"mesh_aside_{field.name}"] = np.concatenate(found)
    for k, tree in enumerate(segmentation.trees):
        if tree is not None:
            arrays |= {f"tree_{k}_{key}": value for key, value in tree_arrays(tree).items()}
    write_arrays(path, arrays)


def load(path: str | PathLike[str]) -> SceneSegmentation:
    """Read the file; see `SceneSegmentation.load`."""
    return read_arrays(path, _FORMAT, _segmentation)


def _segmentation(arrays: dict[str, Any]) -> SceneSegmentation:
    scene = _scene(arrays)
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


def _scene(arrays: dict[str, Any]) -> Scene:
    names, reports = (json.loads(str(arrays[f"mesh_{key}"])) for key in ("names", "reports"))
    ends = {key: np.cumsum([0, *arrays[f"mesh_{key}"]]) for key in ("vertices", "faces", "asides")}
    meshes = []
    for k, (name, report) in enumerate(zip(names, reports, strict=True)):
        of_vertices, of_faces, of_asides = (slice(*each[k : k + 2]) for each in ends.values())
        report["polygons"] = tuple((size, count) for size, count in report["polygons"])
        repaired = Repaired(
            vertices=arrays["vertices"][of_vertices],
            faces=_within(arrays["faces"][of_faces], of_vertices),
            source_vertex=arrays["mesh_source_vertex"][of_vertices],
            n_corners=int(arrays["mesh_corners"][k]),
            aside=Aside(
                **{
                    field.name: arrays[f"mesh_aside_{field.name}"][of_asides]
                    for field in fields(Aside)
                }
            ),
            report=RepairReport(**report),
            **{key: arrays[f"mesh_{key}"][of_faces] for key in _OF_FACES},
        )
        meshes.append((str(name), repaired))
    path = str(arrays["source"])
    return Scene(meshes, SceneFile(path, str(arrays["sha256"])) if path else None)


def _within(faces: Ints, vertices: slice) -> Ints:
    """Faces of a mesh by its own vertices."""
    if len(faces) and (faces.min() < vertices.start or faces.max() >= vertices.stop):
        raise ValueError("faces: a mesh must have the vertices of its own alone")
    own: Ints = faces - vertices.start
    return own
