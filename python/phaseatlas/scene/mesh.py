"""What every format gives: meshes of polygons, what their corners carry, materials, files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..arrays import Floats, Ints

__all__ = ["Contents", "Corners", "Cut", "Image", "Material", "Mesh", "Placement"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Polygons of a file that belong together.

    Attributes
    ----------
    name : str
        As in the file; empty where it has none.
    positions : (n, 3) array
        In the mesh's own coordinates, also those that no polygon uses.
    corners : (c,) array of int
        Vertices of all polygons, one polygon after the other.
    sizes : (p,) array of int
        Corners of each polygon.
    transforms : (k, 4, 4) array
        From own coordinates to those of the scene, one an instance.
    material_of : (p,) array of int
        Material of each polygon among those of the document, -1 for none.
    materials : tuple of str
        Names of the materials that its polygons use.
    uv_sets : int
        Sets of texture coordinates that the file holds.
    vertex_colours : bool
        Whether the file colours its vertices.
    """

    name: str
    positions: Floats
    corners: Ints
    sizes: Ints
    transforms: Floats = field(default_factory=lambda: np.eye(4)[None])
    material_of: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    materials: tuple[str, ...] = ()
    uv_sets: int = 0
    vertex_colours: bool = False


@dataclass(frozen=True, eq=False)
class Corners:
    """What the corners of a mesh carry, in the order of `Mesh.corners`.

    Attributes
    ----------
    uvs : tuple of (c, 2) array
        The sets of texture coordinates, v up; NaN at corners without.
    normals : (c, 3) array, optional
        NaN at corners without.
    colours : (c, 4) array, optional
        Red, green, blue and opacity in [0, 1].
    tangents : (c, 4) array, optional
        Direction of u of the first set, and the sign of the binormal; NaN at corners without.
    """

    uvs: tuple[Floats, ...] = ()
    normals: Floats | None = None
    colours: Floats | None = None
    tangents: Floats | None = None


@dataclass(frozen=True, eq=False)
class Cut:
    """A mesh cut into new triangles, and where their corners lie in the old one.

    Attributes
    ----------
    mesh : Mesh
        The new triangles, in the order of the polygons that they are parts of.
    corners : (c, 3) array of int
        Corners of the old mesh that each new corner lies between.
    weights : (c, 3) array
        Its barycentric coordinates there.
    """

    mesh: Mesh
    corners: Ints
    weights: Floats

    def interpolate(self, values: Floats) -> Floats:
        """Values at the new corners from those at the old ones, (c, d)."""
        # What has no weight may be NaN.
        parts = np.where(self.weights[..., None] > 0, values[self.corners], 0.0)
        found: Floats = np.einsum("kcd,kc->kd", parts, self.weights)
        return found


@dataclass(frozen=True)
class Image:
    """A picture of a file: its name and its bytes as they are, PNG, JPEG or another format."""

    name: str
    data: bytes


@dataclass(frozen=True)
class Placement:
    """How an OBJ material lays its texture: scale and offset of u and v, and what is outside."""

    offset: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)
    clamp: bool = False


@dataclass(frozen=True)
class Material:
    """What formats have in common of a material; the texture is None where it is missing.

    Its set of texture coordinates is None where it is seen through those that are written.
    """

    name: str
    colour: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    texture: Image | None = None
    uv_set: int | None = 0
    metallic: float = 0.0
    roughness: float = 1.0
    missing: str = ""
    placement: Placement = Placement()


@dataclass(frozen=True)
class Contents:
    """Files to be written together, and a sentence for each thing that they cannot hold."""

    files: dict[Path, bytes]
    notes: tuple[str, ...] = ()
