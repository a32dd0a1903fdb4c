"""Reading meshes and writing files, whole or not at all."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Floats, Ints
from .files import check_input, write_bytes
from .scene.gltf import check_extensions, glb, ruin_of_single_precision, translation
from .scene.obj import digits_for, read_obj
from .scene.ply import ply
from .surface import Surface

if TYPE_CHECKING:
    from .segmentation import Segmentation, SegmentTree

__all__ = ["load", "save_mesh", "save_ply"]

MESH_SUFFIXES = (".obj", ".ply", ".glb", ".off", ".stl")


def load(path: str | PathLike[str]) -> Surface:
    """Read a triangle mesh: an OBJ file, or any other format that trimesh knows (PLY, GLB, ...).

    Vertices at exactly equal positions are one vertex where edges of two faces match: formats
    that store texture seams or loose triangles repeat them. Vertices keep the order of their first
    use. Materials are not read.

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
    check_input(path)
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
    """Make one vertex of those at equal positions, but where faces meet at a point alone.

    Formats repeat vertices along texture seams and around loose triangles: there the edges of two
    faces match, and their ends are joined. Two parts of a surface that only touch at a point were
    apart in the file and stay apart.
    """
    # Left to Surface, which names the culprit by its index in the file.
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        return vertices, faces
    _, first, place = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(vertices):
        return vertices, faces
    place = place.reshape(-1)
    starts, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    turned = place[starts] > place[ends]
    starts, ends = np.where(turned, ends, starts), np.where(turned, starts, ends)
    order = np.lexsort((place[ends], place[starts]))
    starts, ends = starts[order], ends[order]
    match = (place[starts[1:]] == place[starts[:-1]]) & (place[ends[1:]] == place[ends[:-1]])
    pairs = [
        (starts[:-1][match], starts[1:][match]),
        (ends[:-1][match], ends[1:][match]),
        _unused(faces, place),
    ]
    a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(vertices)
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    _, joined = connected_components(graph, directed=False)
    _, first, group = np.unique(joined, return_index=True, return_inverse=True)
    representative = first[group.reshape(-1)]
    kept = np.unique(representative)
    return vertices[kept], np.searchsorted(kept, representative[faces])


def _unused(faces: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Vertices without a face, each with one that stands at its place and has a face."""
    used = np.zeros(len(place), dtype=np.bool_)
    used[faces] = True
    at = np.full(place.max() + 1, -1)
    at[place[used]] = np.flatnonzero(used)
    loose = np.flatnonzero(~used & (at[place] >= 0))
    return loose, at[place[loose]]


def save_ply(tree: SegmentTree | Segmentation, path: str | PathLike[str]) -> None:
    """Write the surface with its weights (per vertex) and labels (per face) as a binary PLY.

    The vertex properties are weight_0, weight_1, ...; the face property is label. Of a scene, which
    may have thousands of pieces, the labels alone are written.

    Parameters
    ----------
    tree : SegmentTree or Segmentation
        What to write.
    path : str or PathLike
        The file; written whole or not at all.
    """
    from .segmentation import SceneSegmentation

    weights = {}
    if not isinstance(tree, SceneSegmentation):
        weights = {f"weight_{leaf}": weight for leaf, weight in enumerate(tree.weights)}
    surface = tree.surface
    write_bytes(path, ply(surface.vertices, surface.faces, weights, tree.labels))


def save_mesh(surface: Surface, path: str | PathLike[str]) -> None:
    """Write the vertices and faces of a surface.

    Parameters
    ----------
    surface : Surface
        What to write.
    path : str or PathLike
        OBJ, PLY, GLB, OFF or STL, by its suffix; written whole or not at all. PLY holds double
        precision, OBJ and OFF nine digits of the extent or as many as tell all vertices apart, GLB
        single precision of the extent, STL single precision.

    Raises
    ------
    ValueError
        For another suffix, and where single precision would ruin the surface: vertices become one,
        or move by more than a millionth of the extent.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"path: {path} must end in {' or '.join(MESH_SUFFIXES)}")
    vertices, faces = surface.vertices, surface.faces
    data: Any
    if suffix == ".ply":
        data = ply(vertices, faces, {}, None)
    elif suffix == ".glb":
        if ruin := ruin_of_single_precision(vertices - translation(vertices)):
            raise ValueError(f"path: {path} must be a .ply or .obj file: in a GLB file {ruin}")
        data = glb(path.stem, vertices, faces, surface.vertex_normals)
    else:
        import trimesh

        if suffix == ".stl" and (ruin := ruin_of_single_precision(vertices)):
            raise ValueError(f"path: {path} must be a .ply or .obj file: in an STL file {ruin}")
        options: dict[str, Any] = {} if suffix == ".stl" else {"digits": digits_for(vertices)}
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        data = mesh.export(file_type=suffix[1:], **options)
    write_bytes(path, data.encode() if isinstance(data, str) else data)
