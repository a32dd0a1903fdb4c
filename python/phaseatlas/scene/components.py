"""Connected components of repaired meshes as surfaces, and meshes that need no repair."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ..arrays import Floats, Ints
from ..surface import Surface
from .repair import Aside, Repaired, RepairReport

__all__ = ["Component", "as_it_is", "components", "without_input"]


@dataclass(frozen=True, eq=False)
class Component:
    """A connected part of a repaired mesh.

    Attributes
    ----------
    surface : Surface
        The part alone.
    faces : (k,) array of int
        Face of the repaired mesh of each of its faces, ascending.
    vertices : (p,) array of int
        Vertex of the repaired mesh of each of its vertices, ascending.
    """

    surface: Surface
    faces: Ints
    vertices: Ints


def as_it_is(vertices: Floats, faces: Ints) -> Repaired:
    """Return a mesh of one component that needs no repair, its corners those of its faces."""
    m = len(faces)
    loops = Surface(vertices, faces).n_boundary_loops
    counts: dict[str, Any] = {field.name: 0 for field in fields(RepairReport)}
    counts |= {"polygons": ((3, m),), "faces": m, "components": 1, "boundary_loops": loops}
    return Repaired(
        vertices=vertices,
        faces=faces,
        source_vertex=np.arange(len(vertices)),
        component=np.zeros(m, dtype=np.int64),
        inner=np.zeros((m, 3), dtype=bool),
        report=RepairReport(**counts),
        **_own_corners(m),
    )


def without_input(repaired: Repaired) -> Repaired:
    """Return a repaired mesh whose corners are those of its faces, not those of what it was."""
    return replace(repaired, **_own_corners(len(repaired.faces)))


def _own_corners(m: int) -> dict[str, Any]:
    none = np.zeros(0, dtype=np.int64)
    thirds = none.reshape(0, 3)
    return {
        "polygon": np.arange(m),
        "corner": np.arange(3 * m).reshape(m, 3),
        "flipped": np.zeros(m, dtype=bool),
        "n_corners": 3 * m,
        "aside": Aside(none, thirds, none, np.zeros((0, 3, 3)), none.astype(bool)),
    }


def components(repaired: Repaired) -> list[Component]:
    """Return the components of a repaired mesh as surfaces, in the order of their numbers."""
    faces = np.argsort(repaired.component, kind="stable")
    of_vertex = np.zeros(len(repaired.vertices), dtype=np.int64)
    of_vertex[repaired.faces] = repaired.component[:, None]
    vertices = np.argsort(of_vertex, kind="stable")
    n = repaired.report.components
    face_ends = np.searchsorted(repaired.component[faces], np.arange(n + 1))
    vertex_ends = np.searchsorted(of_vertex[vertices], np.arange(n + 1))
    local = np.empty(len(vertices), dtype=np.int64)
    local[vertices] = np.arange(len(vertices)) - vertex_ends[of_vertex[vertices]]
    triangles, positions = local[repaired.faces[faces]], repaired.vertices[vertices]
    parts = []
    for c in range(n):
        of_faces = slice(face_ends[c], face_ends[c + 1])
        of_vertices = slice(vertex_ends[c], vertex_ends[c + 1])
        surface = Surface(positions[of_vertices], triangles[of_faces])
        parts.append(Component(surface, faces[of_faces], vertices[of_vertices]))
    return parts
