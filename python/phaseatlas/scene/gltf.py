"""Binary and text files of glTF 2.0."""

from __future__ import annotations

import importlib.util
import json
import struct
from pathlib import Path
from typing import Any

__all__ = ["check_extensions"]

DRACO = "KHR_draco_mesh_compression"
QUANTIZED = "KHR_mesh_quantization"
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
