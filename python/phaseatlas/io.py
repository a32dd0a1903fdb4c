"""Reading meshes and writing files, whole or not at all."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Floats, Ints
from .files import write_bytes
from .scene.gltf import check_extensions
from .scene.obj import read_obj
from .surface import Surface

if TYPE_CHECKING:
    from .segmentation.tree import SegmentTree

__all__ = ["load", "save_mesh", "save_ply"]

MESH_SUFFIXES = (".obj", ".ply", ".glb", ".off", ".stl")


def load(path: str | PathLike[str]) -> Surface:
    """Read a triangle mesh: an OBJ file, or any other format that trimesh knows (PLY, GLB, ...).

    Vertices at exactly equal positions are one vertex: formats that store texture seams or loose
    triangles repeat them. Vertices keep the order of their first use. Materials are not read.

    Parameters
    ----------
    path : str or PathLike
        File to read.

    Returns
    -------
    Surface

    Raises
    ------
    ValueError
        For a file that cannot be read as a mesh, a point cloud, and every mesh that `Surface`
        refuses; the message starts with the file's name.
    FileNotFoundError, IsADirectoryError
        For a missing file and for a folder.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: a folder, not a file")
    with path.open("rb") as file:
        if not file.read(1):
            raise ValueError(f"{path}: empty file")
    try:
        vertices, faces = read_obj(path) if path.suffix.lower() == ".obj" else _read(path)
    except MemoryError:
        raise
    except Exception as error:
        reason = str(error).strip().splitlines()
        raise ValueError(
            f"{path}: cannot be read as a mesh: {reason[0] if reason else type(error).__name__}"
        ) from error
    if len(faces) == 0:
        raise ValueError(f"{path}: no faces; a point cloud or an empty mesh is no surface")
    try:
        return Surface(*_merge_coincident(vertices, faces))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _read(path: Path) -> tuple[Floats, Ints]:
    if path.suffix.lower() in (".glb", ".gltf"):
        check_extensions(path)
    # It takes as long to import as all the rest: only where it is needed.
    import trimesh

    # Transforms of positions that are not finite would warn; the surface refuses those.
    with np.errstate(invalid="ignore"):
        mesh: Any = trimesh.load(
            path, force="mesh", process=False, maintain_order=True, skip_materials=True
        )
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _merge_coincident(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    # Left to Surface, which names the culprit by its index in the file.
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        return vertices, faces
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(vertices):
        return vertices, faces
    representative = first[inverse.reshape(-1)]
    kept = np.unique(representative)
    return vertices[kept], np.searchsorted(kept, representative[faces])


def save_ply(tree: SegmentTree, path: str | PathLike[str]) -> None:
    """Write the surface with its weights (per vertex) and labels (per face) as a binary PLY.

    The vertex properties are weight_0, weight_1, ...; the face property is label.

    Parameters
    ----------
    tree : SegmentTree
        What to write.
    path : str or PathLike
        The file; written whole or not at all.
    """
    import trimesh

    mesh = trimesh.Trimesh(tree.surface.vertices, tree.surface.faces, process=False)
    for leaf, weight in enumerate(tree.weights):
        mesh.vertex_attributes[f"weight_{leaf}"] = weight
    mesh.face_attributes["label"] = tree.labels.astype(np.int32)
    write_bytes(path, mesh.export(file_type="ply"))


def save_mesh(surface: Surface, path: str | PathLike[str]) -> None:
    """Write the vertices and faces of a surface.

    Parameters
    ----------
    surface : Surface
        What to write.
    path : str or PathLike
        OBJ, PLY, GLB, OFF or STL, by its suffix; written whole or not at all. OBJ and OFF hold
        nine digits of the coordinates, the others single precision.

    Raises
    ------
    ValueError
        For another suffix.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"path: {path} must end in {' or '.join(MESH_SUFFIXES)}")
    import trimesh

    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    data: Any
    if suffix in (".obj", ".off"):
        data = mesh.export(file_type=suffix[1:], digits=decimals(surface))
    else:
        data = mesh.export(file_type=suffix[1:])
    write_bytes(path, data.encode() if isinstance(data, str) else data)


def decimals(surface: Surface) -> int:
    """Decimals that keep nine digits of the coordinates of a surface of any size."""
    extent = float(np.ptp(surface.vertices, axis=0).max())
    return max(8, 9 - int(np.floor(np.log10(extent))))
