"""Binary and text files of glTF 2.0."""

from __future__ import annotations

import importlib.util
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Bytes, Floats, Ints

__all__ = ["check_extensions", "glb", "ruin_of_single_precision", "translation"]

DRACO = "KHR_draco_mesh_compression"
QUANTIZED = "KHR_mesh_quantization"
# What vertices may move, relative to the extent, when they are rounded: ten times the rounding of
# single precision around the origin.
MOVED = 1e-6
# What a file may require without changing a position or a face.
APPEARANCE = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_")


def check_extensions(path: Path) -> None:
    """Refuse a file that requires what the positions and faces cannot be read without.

    Parameters
    ----------
    path : Path
        A `.glb` or `.gltf` file.

    Raises
    ------
    ValueError
        For a required extension that is not supported; the message names it.
    """
    header = _header(path)
    readable = set()
    if importlib.util.find_spec("DracoPy") is not None:
        readable.add(DRACO)
    if not any(accessor.get("normalized") for accessor in _positions(header)):
        readable.add(QUANTIZED)
    required = header.get("extensionsRequired", [])
    unknown = [name for name in required if not name.startswith(APPEARANCE)]
    unknown = [name for name in unknown if name not in readable]
    if unknown:
        raise ValueError(f"needs the glTF extension {', '.join(unknown)}, which is not supported")


def _positions(header: dict[str, Any]) -> list[dict[str, Any]]:
    """The accessors of all positions."""
    primitives = [p for mesh in header.get("meshes", []) for p in mesh.get("primitives", [])]
    accessors = header.get("accessors", [])
    return [
        accessors[primitive["attributes"]["POSITION"]]
        for primitive in primitives
        if "POSITION" in primitive.get("attributes", {})
    ]


def _header(path: Path) -> dict[str, Any]:
    """The JSON of a file; none where it is damaged, which its reader will say."""
    try:
        with path.open("rb") as file:
            magic = file.read(4)
            if magic == b"glTF":
                _, _, size, _ = struct.unpack("<4I", file.read(16))
                header = json.loads(file.read(size))
            else:
                header = json.loads(magic + file.read())
    except (ValueError, struct.error):
        return {}
    return header if isinstance(header, dict) else {}


def glb(
    name: str,
    vertices: Floats,
    faces: Ints,
    normals: Floats,
    uv: Floats | None = None,
    image: Bytes | None = None,
) -> bytes:
    """Return a binary glTF file of one mesh with one material, white or textured.

    Positions in a file are of single precision. Where they lie far from the origin they are written
    relative to a translation of the node, so that they keep it to their extent.

    Parameters
    ----------
    name : str
        Of the mesh, its node and its material.
    vertices : (n, 3) array
        Positions.
    faces : (m, 3) array of int
        Triangles.
    normals : (n, 3) array
        Unit normals of the vertices.
    uv : (n, 2) array, optional
        Texture coordinates, v up.
    image : (h, w, 3) array of uint8, optional
        The base colour, first row on top.
    """
    import trimesh
    from PIL import Image

    material = trimesh.visual.material.PBRMaterial(
        name=name,
        # glTF takes a missing metallicFactor for 1: dark metal.
        baseColorFactor=np.full(4, 255, dtype=np.uint8),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        baseColorTexture=None if image is None else Image.fromarray(image),
    )
    centre = translation(vertices)
    mesh = trimesh.Trimesh(
        vertices=vertices - centre,
        faces=faces,
        vertex_normals=normals,
        visual=trimesh.visual.TextureVisuals(uv=uv, material=material),
        process=False,
    )
    scene = trimesh.Scene()
    transform = trimesh.transformations.translation_matrix(centre)
    scene.add_geometry(mesh, node_name=name, geom_name=name, transform=transform)
    data: bytes = trimesh.exchange.gltf.export_glb(scene, include_normals=True)
    return data


def translation(vertices: Floats) -> Floats:
    """What positions are relative to: their centre, if they lie further off than they reach."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    far = np.abs(vertices).max() > (high - low).max()
    centre: Floats = 0.5 * (low + high) if far else np.zeros(3)
    return centre


def ruin_of_single_precision(vertices: Floats) -> str | None:
    """What rounding to single precision spoils, as a clause; None where it does no harm."""
    single = vertices.astype(np.float32)
    merged = len(np.unique(vertices, axis=0)) - len(np.unique(single, axis=0))
    if merged:
        return f"{merged} vertices would stand where others do, for want of digits"
    moved = float(np.abs(single - vertices).max() / np.ptp(vertices, axis=0).max())
    return f"vertices would move by {moved:.1e} of the extent" if moved > MOVED else None
