"""What a file of meshes holds, in numbers and in sentences."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from typing import Any

import numpy as np

from ..surface import Surface
from .document import Document
from .repair import RepairReport
from .scene import Scene

__all__ = ["defects", "describe", "figures"]

# Fields of a report that count no defect.
_NO_DEFECTS = ("polygons", "faces", "components", "boundary_loops")


def describe(document: Document, scene: Scene) -> dict[str, Any]:
    """Return what a file holds, as `phaseatlas info --json` prints it.

    Parameters
    ----------
    document : Document
        What was read.
    scene : Scene
        Its meshes, repaired.

    Returns
    -------
    dict
        Strings, finite numbers, None for a number that is not finite, lists and dicts of these:

        - ``file``: the path.
        - ``vertices``, ``faces``, ``components``, ``genus``, ``boundary_loops``: of all repaired
          meshes together; faces are triangles, the genus is the sum over the components.
        - ``area``, ``extent`` (a number an axis), ``mean_edge_length``: of each mesh once, in the
          place of its largest instance.
        - ``face_quality``: the least, 1 for an equilateral triangle.
        - ``default_epsilon``: width of the interfaces of `segment` where none is given.
        - ``polygons``: number of polygons by the number of their corners.
        - ``defects``: number of each kind; see `scene.repair.RepairReport`.
        - ``materials``: names of those that polygons use.
        - ``meshes``: for each mesh ``name``, ``vertices`` (of the file), ``faces``, ``components``,
          ``genus``, ``boundary_loops``, ``area``, ``polygons``, ``defects``, ``materials``,
          ``uv_sets`` (sets of texture coordinates), ``vertex_colours`` (whether it has any),
          ``instances`` and ``transforms`` (their matrices, row by row).
    """
    genus = Counter[int]()
    firsts = np.array([mesh.first_face for mesh in scene.meshes])
    for piece in scene.pieces:
        owner = int(np.searchsorted(firsts, piece.faces[0], side="right")) - 1
        genus[owner] += piece.surface.genus
    meshes = []
    for k, (mesh, placed) in enumerate(zip(document.meshes, scene.meshes, strict=True)):
        report = placed.repaired.report
        last = placed.first_face + len(placed.repaired.faces)
        meshes.append(
            {
                "name": mesh.name,
                "vertices": len(mesh.positions),
                "faces": report.faces,
                "components": report.components,
                "genus": genus[k],
                "boundary_loops": report.boundary_loops,
                "area": _number(scene.face_areas[placed.first_face : last].sum()),
                "polygons": _polygons(report),
                "defects": defects(report),
                "materials": list(mesh.materials),
                "uv_sets": mesh.uv_sets,
                "vertex_colours": mesh.vertex_colours,
                "instances": len(mesh.transforms),
                "transforms": [
                    [[_number(x) for x in row] for row in matrix] for matrix in mesh.transforms
                ],
            }
        )
    whole = scene.report
    return {
        "file": str(document.path),
        **figures(scene),
        "components": whole.components,
        "polygons": _polygons(whole),
        "defects": defects(whole),
        "materials": list(dict.fromkeys(name for m in document.meshes for name in m.materials)),
        "meshes": meshes,
    }


def figures(surface: Surface) -> dict[str, Any]:
    """Return size, topology, area, edge lengths and quality of a surface, as `describe` does."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    return {
        "vertices": surface.n_vertices,
        "faces": surface.n_faces,
        "genus": surface.genus,
        "boundary_loops": surface.n_boundary_loops,
        "area": _number(surface.area),
        "extent": [_number(side) for side in high - low],
        "mean_edge_length": _number(surface.mean_edge_length),
        "face_quality": _number(surface.face_quality.min()),
        "default_epsilon": _number(2 * surface.mean_edge_length),
    }


def _number(value: float) -> float | None:
    """A number that JSON can hold."""
    return float(value) if np.isfinite(value) else None


def _polygons(report: RepairReport) -> dict[str, int]:
    return {str(size): count for size, count in report.polygons}


def defects(report: RepairReport) -> dict[str, int]:
    """Number of each kind of defect by its name."""
    names = [field.name for field in fields(report) if field.name not in _NO_DEFECTS]
    return {name: getattr(report, name) for name in names}
