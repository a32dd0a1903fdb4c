"""PLY files as meshes, and meshes as PLY files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Floats, Ints
from .mesh import Corners, Mesh
from .ply_elements import Element, Lists, Ply, read_elements, write_elements
from .polygons import outside, split_vertices, starts_of

__all__ = ["ply", "ply_of", "ply_with_uv", "read_ply"]

# Names of texture coordinates of a vertex: those of Blender, which are written too, come first.
_TEXTURES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_LISTS = ("vertex_indices", "vertex_index")


def ply(vertices: Floats, faces: Ints, weights: Mapping[str, Floats], labels: Ints | None) -> bytes:
    """Return a binary PLY file; positions are of double precision.

    Parameters
    ----------
    vertices : (n, 3) array
        Positions.
    faces : (m, 3) array of int
        Triangles.
    weights : mapping of str to (n,) array
        Further properties of the vertices, by name.
    labels : (m,) array of int, optional
        The property `label` of the faces.
    """
    point = np.dtype([(name, "<f8") for name in ("x", "y", "z", *weights)])
    rows = np.empty(len(vertices), dtype=point)
    for name, column in zip(point.names or (), [*vertices.T, *weights.values()], strict=True):
        rows[name] = column
    parts = [("count", "u1"), ("corners", "<i4", 3)]
    polygons = np.empty(len(faces), dtype=parts + ([] if labels is None else [("label", "<i4")]))
    polygons["count"] = 3
    polygons["corners"] = faces
    if labels is not None:
        polygons["label"] = labels
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property double {name}" for name in point.names or ()),
        f"element face {len(polygons)}",
        "property list uchar int vertex_indices",
        *([] if labels is None else ["property int label"]),
        "end_header",
        "",
    ]
    return "\n".join(header).encode() + rows.tobytes() + polygons.tobytes()


def read_ply(data: bytes) -> tuple[Ply, Mesh, Corners]:
    """Read the elements of a file, and the mesh that they make.

    Parameters
    ----------
    data : bytes
        Of the file, in ASCII or binary of either byte order.

    Raises
    ------
    ValueError
        For a header that makes no sense, a file that is cut short, and a face that names a vertex
        that does not exist.
    """
    elements = _with_faces(read_elements(data))
    vertex = elements.elements.get("vertex", Element(0, {})).columns
    if not {"x", "y", "z"} <= set(vertex):
        raise ValueError("there are no vertices with x, y and z")
    positions = _columns(vertex, ("x", "y", "z"))
    face = elements.elements.get("face", Element(0, {})).columns
    polygons = next((face[name] for name in _LISTS if name in face), None)
    if not isinstance(polygons, Lists):
        polygons = Lists(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    kept = polygons.sizes > 2
    inside = np.repeat(kept, polygons.sizes)
    corners, sizes = polygons.values.astype(np.int64)[inside], polygons.sizes[kept]
    if len(corners) and (corners.min() < 0 or corners.max() >= len(positions)):
        named = outside(corners, len(positions))
        raise ValueError(f"a face names vertex {named} among {len(positions)}")
    uvs: tuple[Floats, ...] = ()
    wedge = face.get("texcoord")
    if isinstance(wedge, Lists) and (wedge.sizes[kept] == 2 * sizes).all():
        uvs = (wedge.values[np.repeat(kept, wedge.sizes)].astype(np.float64).reshape(-1, 2),)
    elif pair := next((pair for pair in _TEXTURES if set(pair) <= set(vertex)), None):
        uvs = (_columns(vertex, pair)[corners],)
    normals = colours = None
    if {"nx", "ny", "nz"} <= set(vertex):
        normals = _columns(vertex, ("nx", "ny", "nz"))[corners]
    if {"red", "green", "blue"} <= set(vertex):
        names = ("red", "green", "blue", *(["alpha"] if "alpha" in vertex else []))
        colours = np.ones((len(corners), 4))
        whole = vertex["red"]
        scale = 255.0 if isinstance(whole, np.ndarray) and whole.dtype.kind == "u" else 1.0
        colours[:, : len(names)] = _columns(vertex, names)[corners] / scale
    mesh = Mesh(
        name="",
        positions=positions,
        corners=corners,
        sizes=sizes,
        material_of=np.full(len(sizes), -1),
        uv_sets=len(uvs),
        vertex_colours=colours is not None,
    )
    return elements, mesh, Corners(uvs, normals, colours)


def _with_faces(elements: Ply) -> Ply:
    """Faces in place of strips of triangles, where a file has no other faces."""
    strips = elements.elements.get("tristrips", Element(0, {}))
    found = next((strips.columns[name] for name in _LISTS if name in strips.columns), None)
    others = elements.elements.get("face", Element(0, {})).rows
    if not isinstance(found, Lists) or others or not len(found.values):
        return elements
    values = found.values.astype(np.int64)
    # A negative number ends a strip, and so does a list.
    stop = np.concatenate([values < 0, [True]])
    first = np.zeros(len(values), dtype=np.int64)
    first[starts_of(found.sizes)[found.sizes > 0]] = starts_of(found.sizes)[found.sizes > 0]
    after = np.flatnonzero(values[:-1] < 0) + 1
    first[after] = after
    first = np.maximum.accumulate(first)
    at = np.arange(max(len(values) - 2, 0))
    whole = (first[at + 2] <= at) & ~stop[at] & ~stop[at + 1] & ~stop[at + 2]
    at = at[whole]
    odd = (at - first[at]) % 2
    triangles = values[np.stack([at, at + 1 + odd, at + 2 - odd], axis=1)]
    # A repeated vertex turns a strip; such triangles are none.
    turns = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    corners = triangles[~turns].astype(np.int32).reshape(-1)
    sizes = np.full(len(corners) // 3, 3)
    kept = {k: v for k, v in elements.elements.items() if k not in ("tristrips", "face")}
    faces = Element(len(sizes), {_LISTS[0]: Lists(sizes, corners)})
    return replace(elements, elements={**kept, "face": faces})


def _columns(columns: dict[str, Any], names: Sequence[str]) -> Floats:
    return np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)


def ply_with_uv(elements: Ply, uv: Floats, image: str | None) -> bytes:
    """Return the elements with texture coordinates `s` and `t` of the vertices.

    A vertex on a seam stands once a side with all its properties; the first stays in its place, so
    that edges and other elements still name it. Older texture coordinates go.

    Parameters
    ----------
    elements : Ply
        As they were read.
    uv : (c, 2) array
        At the corners of the faces with three corners or more, v up.
    image : str, optional
        Name of the texture's file, for the comment `TextureFile`.
    """
    vertex, face = elements.elements["vertex"], elements.elements["face"]
    name = next(name for name in _LISTS if name in face.columns)
    polygons = face.columns[name]
    if not isinstance(polygons, Lists):
        raise ValueError(f"{name} is no list")
    inside = np.repeat(polygons.sizes > 2, polygons.sizes)
    corners = polygons.values.astype(np.int64)
    single = uv.astype(np.float32)
    rows, corners[inside], texture = split_vertices(vertex.rows, corners[inside], single)
    old = {column for pair in _TEXTURES if set(pair) <= set(vertex.columns) for column in pair}
    columns: dict[str, Any] = {
        key: values.take(rows) if isinstance(values, Lists) else values[rows]
        for key, values in vertex.columns.items()
        if key not in old
    }
    columns |= {"s": texture[:, 0].copy(), "t": texture[:, 1].copy()}
    faces = {
        key: Lists(polygons.sizes, corners.astype(np.int32)) if key == name else values
        for key, values in face.columns.items()
        if key not in ("texcoord", "texnumber")
    }
    comments = tuple(c for c in elements.comments if not c.startswith("comment TextureFile"))
    if image is not None:
        comments = (*comments, f"comment TextureFile {image}")
    changed = {"vertex": Element(len(rows), columns), "face": Element(face.rows, faces)}
    return write_elements(
        replace(elements, elements={**elements.elements, **changed}, comments=comments)
    )


def ply_of(mesh: Mesh, carried: Corners) -> Ply:
    """The elements of a mesh that was no PLY file."""
    vertex: dict[str, Any] = {
        axis: mesh.positions[:, k].copy() for k, axis in enumerate(("x", "y", "z"))
    }
    for names, values in (
        (("nx", "ny", "nz"), carried.normals),
        (("red", "green", "blue", "alpha"), carried.colours),
    ):
        if values is not None:
            at = np.zeros((len(mesh.positions), len(names)))
            at[mesh.corners] = values
            whole = np.rint(at * 255).astype(np.uint8) if names[0] == "red" else at
            vertex |= {name: whole[:, k].copy() for k, name in enumerate(names)}
    face: dict[str, Any] = {"vertex_indices": Lists(mesh.sizes, mesh.corners.astype(np.int32))}
    return Ply(
        {
            "vertex": Element(len(mesh.positions), vertex),
            "face": Element(len(mesh.sizes), face),
        },
        # Not every reader of binary files can do with lists of several lengths.
        text=bool((mesh.sizes != mesh.sizes[:1]).any()),
    )
