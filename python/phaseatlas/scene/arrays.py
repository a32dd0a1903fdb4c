"""A scene as arrays with names, which files hold, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from ..arrays import Ints
from ..seam_costs import cost_arrays, with_costs
from .repair import Aside, Repaired, RepairReport
from .scene import Scene, SceneFile

__all__ = ["scene_arrays", "scene_of_arrays"]

# Arrays of a repaired mesh with a row a face; its vertices and faces are those of the scene.
_OF_FACES = ("polygon", "corner", "component", "flipped", "inner")


def scene_arrays(scene: Scene) -> dict[str, Any]:
    """Return vertices, faces, the file and what leads back to its corners, by their names."""
    repaired = [mesh.repaired for mesh in scene.meshes]
    arrays: dict[str, Any] = {
        "vertices": scene.vertices,
        "faces": scene.faces,
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
    arrays |= cost_arrays(scene, np.concatenate([each.inner for each in repaired]))
    for name in _OF_FACES:
        arrays[f"mesh_{name}"] = np.concatenate([getattr(each, name) for each in repaired])
    for field in fields(Aside):
        found = [getattr(each.aside, field.name) for each in repaired]
        arrays[f"mesh_aside_{field.name}"] = np.concatenate(found)
    return arrays


def scene_of_arrays(arrays: Mapping[str, Any]) -> Scene:
    """Return the scene that `scene_arrays` gave these arrays of."""
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
    scene = Scene(meshes, SceneFile(path, str(arrays["sha256"])) if path else None)
    return with_costs(scene, arrays)


def _within(faces: Ints, vertices: slice) -> Ints:
    """Faces of a mesh by its own vertices."""
    if len(faces) and (faces.min() < vertices.start or faces.max() >= vertices.stop):
        raise ValueError("faces: a mesh must have the vertices of its own alone")
    own: Ints = faces - vertices.start
    return own
