"""A surface with a texture, or several, as a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..arrays import Bytes, Floats, Ints
from ..surface import Surface
from .convert_gltf import as_gltf
from .convert_obj import as_obj
from .gltf import glb
from .gltf_files import gltf_files
from .mesh import Corners, Mesh
from .obj import obj
from .paged import Pages, paged

__all__ = ["surface_files"]


def surface_files(
    path: Path, surface: Surface, uv: Floats, pages: Ints, images: Sequence[Bytes]
) -> dict[Path, bytes]:
    """Return a `.glb` or `.obj` file and what belongs beside it.

    Parameters
    ----------
    path : Path
        Of the file.
    surface : Surface
        With m faces.
    uv : (m, 3, 2) array
        Texture coordinates, v up.
    pages : (m,) array of int
        Page of each face.
    images : sequence of (h, w, 3) array of uint8
        Texture of each page, first row on top.
    """
    if len(images) > 1:
        return _paged(path, surface, uv, pages, images)
    # A vertex on a seam stands once a side, with the normal of the whole surface.
    corners = np.column_stack([surface.faces.reshape(-1).astype(np.float64), uv.reshape(-1, 2)])
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    origin, places = unique[:, 0].astype(np.int64), unique[:, 1:]
    faces = inverse.reshape(-1, 3)
    vertices, normals = surface.vertices[origin], surface.vertex_normals[origin]
    if path.suffix.lower() == ".obj":
        return obj(path, vertices, faces, normals, places, images[0])
    return {path: glb(path.stem, vertices, faces, normals, places, images[0])}


def _paged(
    path: Path, surface: Surface, uv: Floats, pages: Ints, images: Sequence[Bytes]
) -> dict[Path, bytes]:
    corners = surface.faces.reshape(-1)
    mesh = Mesh(
        name=path.stem,
        positions=surface.vertices,
        corners=corners,
        sizes=np.full(surface.n_faces, 3),
        material_of=np.full(surface.n_faces, -1),
    )
    meshes, materials = paged([mesh], (), Pages((pages,), tuple(images)), path.stem)
    carried = [Corners(normals=surface.vertex_normals[corners])]
    uvs = [uv.reshape(-1, 2)]
    if path.suffix.lower() == ".obj":
        return dict(as_obj(path, (), meshes, carried, materials, uvs, image=None).files)
    document, buffer = as_gltf(path.stem, meshes, carried, materials, uvs, image=None, uv_set=0)
    return dict(gltf_files(path, document, buffer, path.parent, embedded=True).files)
