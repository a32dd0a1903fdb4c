"""Scenes: the pieces of surface that polygons are made of, and the way back to their corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Floats, Ints
from ..files import digest
from ..seam_factors import check_factors
from ..surface import Surface
from .components import Component, components
from .document import Document, read_document
from .mesh import Mesh
from .repair import Repaired, RepairReport, repair, summed

__all__ = [
    "NoAreaError",
    "Scene",
    "SceneFile",
    "SceneMesh",
    "load_scene",
    "no_places",
    "polygons_of",
    "scene_in",
    "scene_of",
]

# No seam runs along a diagonal of a polygon.
_DIAGONAL = np.inf


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A mesh of a scene.

    Attributes
    ----------
    name : str
        As in the file; empty where it has none.
    repaired : Repaired
        Its faces, in the units of the scene, and the way back to its corners.
    first_face, first_vertex : int
        Of the scene.
    """

    name: str
    repaired: Repaired
    first_face: int
    first_vertex: int


class NoAreaError(ValueError):
    """Polygons of which none has an area."""


@dataclass(frozen=True)
class SceneFile:
    """The file that a scene was read from.

    Attributes
    ----------
    path : str
        As it was given.
    sha256 : str
        Digest of its content, in hexadecimal digits.
    """

    path: str
    sha256: str


class Scene(Surface):
    """Pieces of surface that share an atlas: all faces of one or several meshes.

    It is a surface that need not hang together. Meshes of polygons are repaired: see
    `scene.repair`. A mesh with several instances is here once, with the transform of the largest.

    Attributes
    ----------
    meshes : tuple of SceneMesh
        In the order of the file.
    pieces : tuple of Component
        The connected parts, mesh by mesh: each a surface, with its faces and vertices as faces and
        vertices of the scene.
    file : SceneFile or None
        Where `load_scene` read it from.
    """

    meshes: tuple[SceneMesh, ...]
    pieces: tuple[Component, ...]
    file: SceneFile | None

    def __init__(
        self,
        meshes: Sequence[tuple[str, Repaired]],
        file: SceneFile | None = None,
        seam_costs: Floats | None = None,
        vertex_seam_costs: Floats | None = None,
    ) -> None:
        placed, pieces = [], []
        inner = np.concatenate([repaired.inner for _, repaired in meshes])
        costs = np.ones(inner.shape) if seam_costs is None else seam_costs.copy()
        costs[inner] = _DIAGONAL
        first_face = first_vertex = 0
        for name, repaired in meshes:
            placed.append(SceneMesh(name, repaired, first_face, first_vertex))
            for part in components(repaired):
                surface = part.surface
                faces, vertices = part.faces + first_face, part.vertices + first_vertex
                at_vertices = None if vertex_seam_costs is None else vertex_seam_costs[vertices]
                of_edges = costs[faces] if (costs[faces] != 1).any() else None
                if of_edges is not None or at_vertices is not None:
                    surface = surface.with_seam_costs(of_edges, at_vertices)
                pieces.append(Component(surface, faces, vertices))
            first_face += len(repaired.faces)
            first_vertex += len(repaired.vertices)
        if not pieces:
            raise NoAreaError("faces: no face has an area")
        self.meshes, self.pieces, self.file = tuple(placed), tuple(pieces), file
        self._build(
            np.concatenate([mesh.repaired.vertices for mesh in placed]),
            np.concatenate([mesh.repaired.faces + mesh.first_vertex for mesh in placed]),
            accepted=True,
            pieces=True,
            costs=(costs if (costs != 1).any() else None, vertex_seam_costs),
        )

    def __repr__(self) -> str:
        return (
            f"Scene({len(self.meshes)} meshes, {len(self.pieces)} pieces, "
            f"{self.n_vertices} vertices, {self.n_faces} faces)"
        )

    def __reduce__(self) -> tuple[type[Scene], tuple[Any, ...]]:
        meshes = [(mesh.name, mesh.repaired) for mesh in self.meshes]
        return Scene, (meshes, self.file, self.seam_costs, self.vertex_seam_costs)

    @property
    def genus(self) -> int:
        """Sum of the genera of the pieces."""
        return sum(piece.surface.genus for piece in self.pieces)

    @property
    def report(self) -> RepairReport:
        """What was repaired in all meshes."""
        return summed([mesh.repaired.report for mesh in self.meshes])

    def with_seam_costs(
        self, seam_costs: ArrayLike | None, vertex_seam_costs: ArrayLike | None = None
    ) -> Scene:
        """Return the scene with factors on the length of seams; see `Surface.with_seam_costs`.

        The diagonals of polygons keep theirs.
        """
        costs = check_factors(seam_costs, vertex_seam_costs, self.n_faces, self.n_vertices)
        return Scene([(mesh.name, mesh.repaired) for mesh in self.meshes], self.file, *costs)

    def corners(self, uv: ArrayLike) -> list[Floats]:
        """Carry values at the corners of the faces back to all corners of each mesh.

        Parameters
        ----------
        uv : (m, 3, 2) array_like of float
            Texture coordinates at the corners of each face.

        Returns
        -------
        list of (c, 2) arrays
            One a mesh, in the order of its corners.
        """
        array = np.asarray(uv, dtype=np.float64)
        return [
            mesh.repaired.corners(array[mesh.first_face :][: len(mesh.repaired.faces)])
            for mesh in self.meshes
        ]

    def polygon_values(self, values: Ints) -> list[Ints]:
        """Carry a value of each face back to the polygons of each mesh; -1 where there is no face.

        Parameters
        ----------
        values : (m,) array of int
        """
        found = []
        for mesh in self.meshes:
            face = mesh.repaired.polygon_face
            of_faces = values[mesh.first_face :][: len(mesh.repaired.faces)]
            found.append(np.where(face >= 0, np.append(of_faces, -1)[face], -1))
        return found


def load_scene(path: str | PathLike[str], *, weld: float = 0.0) -> Scene:
    """Read all meshes of a file, whatever their polygons are like.

    Parameters
    ----------
    path : str or PathLike
        A GLB, glTF, OBJ, PLY, STL or OFF file.
    weld : float, default 0
        Join vertices nearer than this, too, in the units of the scene.

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        For a file that cannot be read or holds no surface; the message starts with its name.
    FileNotFoundError, IsADirectoryError
        For a missing file and for a folder.
    """
    scene = scene_in(read_document(path), weld=weld)
    scene.file = scene_file(path)
    return scene


def scene_file(path: str | PathLike[str]) -> SceneFile:
    """Path and digest of a file."""
    return SceneFile(str(path), digest(Path(path)))


def scene_in(document: Document, *, weld: float = 0.0, whole: bool = True) -> Scene:
    """Put all meshes of a file into one scene.

    Parameters
    ----------
    document : Document
    weld : float, default 0
        As in `load_scene`.
    whole : bool, default True
        Whether seams keep off the diagonals of polygons.

    Raises
    ------
    NoAreaError
        Where no face has an area; the message starts with the file's name.
    """
    try:
        return scene_of(document.meshes, weld=weld, whole=whole)
    except NoAreaError as error:
        raise NoAreaError(f"{document.path}: {error}") from error
    except ValueError as error:
        raise ValueError(f"{document.path}: {error}") from error


def scene_of(meshes: Sequence[Mesh], *, weld: float = 0.0, whole: bool = True) -> Scene:
    """Repair meshes and put them into one scene."""
    repaired = [
        (mesh.name, repair(_placed(mesh), mesh.corners, mesh.sizes, weld=weld)) for mesh in meshes
    ]
    if not whole:
        repaired = [
            (name, replace(each, inner=np.zeros_like(each.inner))) for name, each in repaired
        ]
    return Scene(repaired)


def no_places(meshes: Sequence[Mesh]) -> list[Floats]:
    """Texture coordinates for polygons of which none has an area: 0 at all corners."""
    return [np.zeros((len(mesh.corners), 2)) for mesh in meshes]


def polygons_of(faces: ArrayLike | Sequence[Sequence[int]]) -> tuple[Ints, Ints]:
    """Corners of polygons, one after the other, and their number of each.

    Parameters
    ----------
    faces : (p, k) array_like of int, or sequence of sequences of int
        Vertices of each polygon.

    Raises
    ------
    ValueError
        For indices that are no integers.
    """
    if isinstance(faces, np.ndarray):
        if faces.ndim != 2:
            raise ValueError(f"faces: shape {faces.shape} must be (p, k)")
        sizes = np.full(len(faces), faces.shape[1])
        corners = faces.reshape(-1)
    else:
        listed = [np.asarray(face).reshape(-1) for face in faces]  # type: ignore[union-attr]
        sizes = np.array([len(face) for face in listed], dtype=np.int64)
        corners = np.concatenate(listed) if listed else np.zeros(0, dtype=np.int64)
    if corners.size and not np.issubdtype(corners.dtype, np.integer):
        raise ValueError(f"faces: dtype {corners.dtype} must be an integer type")
    return corners.astype(np.int64), sizes.astype(np.int64)


def _placed(mesh: Mesh) -> Floats:
    """Positions as the largest instance has them."""
    sizes = np.abs(np.linalg.det(mesh.transforms[:, :3, :3]))
    largest = mesh.transforms[int(np.argmax(sizes))]
    # An instance that is shrunk to nothing has the shape that the mesh has.
    if not (np.isfinite(largest).all() and sizes.max() > 0):
        return mesh.positions
    # A vertex that no face uses may be anything.
    with np.errstate(invalid="ignore"):
        placed: Floats = mesh.positions @ largest[:3, :3].T + largest[:3, 3]
    return placed
