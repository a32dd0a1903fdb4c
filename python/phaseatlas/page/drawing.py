"""Triangles as a viewer takes them: a vertex for each side of a seam, few enough to be shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Floats, Ints
from ..atlas.chains import chains
from ..atlas.metrics import UvTopology
from ..coarsen import collapsed
from ..plot.render import corner_normals
from ..scene.gltf_files import glb_bytes
from ..surface import Surface

__all__ = ["MOST_FACES", "Drawing", "drawing", "outlines"]

#: Faces above which a surface is simplified to be shown, and how many are kept then.
MOST_FACES = 200_000
_KEPT_FACES = 100_000
# How eagerly edges collapse: the default of fast-simplification.
_EAGERNESS = 7
_FLOAT, _INT, _BYTE = 5126, 5125, 5120
# What is 1 in a normalised signed byte.
_MOST_BYTE = 127


@dataclass(frozen=True, eq=False)
class Drawing:
    """What is drawn of a surface.

    Attributes
    ----------
    index : (m, 3) array of int
        Vertex of every corner of the surface, before it was simplified.
    origin, chart, material : (n,) array of int
        Vertex of the surface, chart and material of each of these vertices.
    kept : (k,) array of int
        Those that are drawn.
    faces : (l, 3) array of int
        The triangles, in vertices that are drawn.
    areas : (m,) array
        Of the faces of the surface.
    positions, normals : (k, 3) array
    uv : (k, 2) array or None
        Texture coordinates, v up.
    """

    index: Ints
    origin: Ints
    chart: Ints
    material: Ints
    kept: Ints
    faces: Ints
    areas: Floats
    positions: Floats
    normals: Floats
    uv: Floats | None

    @property
    def simplified(self) -> bool:
        """Whether there are fewer faces than the surface has."""
        return len(self.faces) < len(self.index)

    def means(self, values: Floats) -> Floats:
        """Values of the faces, (m,), as means by area over those around each drawn vertex."""
        corners = self.index.reshape(-1)
        weights = np.repeat(self.areas, 3)
        sums = np.bincount(corners, weights * np.repeat(values, 3), len(self.origin))
        found: Floats = (sums / np.bincount(corners, weights, len(self.origin)))[self.kept]
        return found

    def glb(self) -> bytes:
        """Return a glTF file of the triangles, a primitive a material, relative to unit extent."""
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        positions = (self.positions - 0.5 * (low + high)) / float((high - low).max() or 1.0)
        normals = np.zeros((len(positions), 4), dtype=np.int8)
        normals[:, :3] = np.rint(_MOST_BYTE * self.normals)
        arrays: list[tuple[Any, dict[str, Any]]] = [
            (
                positions.astype(np.float32),
                {
                    "componentType": _FLOAT,
                    "type": "VEC3",
                    "min": positions.astype(np.float32).min(axis=0).tolist(),
                    "max": positions.astype(np.float32).max(axis=0).tolist(),
                },
            ),
            (normals, {"componentType": _BYTE, "type": "VEC3", "normalized": True}),
        ]
        attributes = {"POSITION": 0, "NORMAL": 1}
        if self.uv is not None:
            attributes["TEXCOORD_0"] = len(arrays)
            uv = (self.uv * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32)
            arrays.append((uv, {"componentType": _FLOAT, "type": "VEC2"}))
        primitives: list[dict[str, Any]] = []
        of_face = self.material[self.kept[self.faces[:, 0]]]
        for material in np.unique(of_face).tolist():
            primitives.append(
                {"attributes": attributes, "indices": len(arrays), "material": len(primitives)}
            )
            corners = self.faces[of_face == material].astype(np.uint32).reshape(-1)
            arrays.append((corners, {"componentType": _INT, "type": "SCALAR"}))
        return _glb(arrays, primitives, np.unique(of_face).tolist())


def _glb(
    arrays: list[tuple[Any, dict[str, Any]]], primitives: list[dict[str, Any]], numbers: list[int]
) -> bytes:
    """A file of one mesh; a material's name is its number."""
    views: list[dict[str, Any]] = []
    accessors = []
    offset = 0
    for k, (array, accessor) in enumerate(arrays):
        view: dict[str, Any] = {"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes}
        if accessor["type"] != "SCALAR":
            view["byteStride"] = array.strides[0]
        views.append(view)
        accessors.append({"bufferView": k, "count": len(array), **accessor})
        offset += array.nbytes
    look = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
    document = {
        "asset": {"version": "2.0", "generator": "phaseatlas"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": [
            {"name": f"{number}", "doubleSided": True, "pbrMetallicRoughness": look}
            for number in numbers
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    return glb_bytes(document, b"".join(array.tobytes() for array, _ in arrays))


def drawing(
    surface: Surface,
    chart: Ints,
    material: Ints,
    uv: Floats | None = None,
    topology: UvTopology | None = None,
) -> Drawing:
    """Split the vertices of a surface along seams, sharp edges and bounds of charts.

    Parameters
    ----------
    surface : Surface
        With m faces.
    chart, material : (m,) array of int
        Of each face.
    uv : (m, 3, 2) array, optional
        Texture coordinates of the corners.
    topology : UvTopology, optional
        Of these, where there are any.
    """
    fine = surface.n_faces > MOST_FACES
    corner = surface.faces if topology is None else topology.corner
    kinds = np.stack([chart, material], axis=1)
    _, kind = np.unique(kinds, axis=0, return_inverse=True)
    key = corner * (int(kind.max()) + 1) + kind.reshape(-1)[:, None]
    if fine:
        normals = surface.vertex_normals[surface.faces]
    else:
        normals = corner_normals(surface)
        # The corners at sharp edges stand alone.
        sharp = (normals != surface.vertex_normals[surface.faces]).any(axis=2)
        key[sharp] = key.max() + 1 + np.arange(int(sharp.sum()))
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    index = inverse.reshape(-1, 3)
    origin, face = surface.faces.reshape(-1)[first], first // 3
    kept, faces, positions = np.arange(len(first)), index, surface.vertices[origin]
    if fine:
        kept, faces, positions = _fewer(positions, index)
    chosen = first[kept]
    return Drawing(
        index=index,
        origin=origin,
        chart=chart[face],
        material=material[face],
        kept=kept,
        faces=faces,
        areas=surface.face_areas,
        positions=positions,
        normals=normals.reshape(-1, 3)[chosen],
        uv=None if uv is None else uv.reshape(-1, 2)[chosen],
    )


def _fewer(vertices: Floats, faces: Ints) -> tuple[Ints, Ints, Floats]:
    """Some of the vertices, fewer faces on them, and places; those on seams stay all, in place."""
    moved, triangles, collapsed_to = collapsed(vertices, faces, _KEPT_FACES, True, _EAGERNESS)
    used, corners = np.unique(triangles, return_inverse=True)
    # Of those that have become one the nearest gives what it carries beside its place.
    distance = np.linalg.norm(moved[collapsed_to] - vertices, axis=1)
    order = np.lexsort((distance, collapsed_to))
    first = np.searchsorted(collapsed_to[order], used)
    return order[first], corners.reshape(-1, 3), np.asarray(moved[used], dtype=np.float64)


def outlines(chart: Ints, topology: UvTopology, uv: Floats, count: int) -> list[list[Floats]]:
    """The boundary loops of each chart in the plane.

    Parameters
    ----------
    chart : (m,) array of int
        Chart of each face.
    topology : UvTopology
        Of the layout.
    uv : (m, 3, 2) array
    count : int
        Number of charts.

    Returns
    -------
    list of lists of (k, 2) arrays
        Loops without their first point again.
    """
    face, side = np.nonzero(topology.open_edges)
    start = topology.corner[face, side]
    end = topology.corner[face, (side + 1) % 3]
    # Around a vertex of the cut surface its faces form one fan, so one open edge leaves it.
    leaving = np.full(topology.n_vertices, -1)
    leaving[start] = np.arange(len(start))
    found: list[list[Floats]] = [[] for _ in range(count)]
    for edges in chains(leaving[end]):
        found[chart[face[edges[0]]]].append(uv[face[edges], side[edges]])
    return found
