"""How much memory a process takes for the atlas of a file, estimated before it is read.

The peak is that of the modules, a number of bytes for each triangle, and those for each texel of
what is baked. They were measured as the most resident memory of `phaseatlas atlas` with one thread:
124 MB for a sphere of 320 faces, 1.0 to 3.4 kB for each face more of spheres of up to 81,920 and of
scans of 86,482 and 345,928, with segments of equal area no more; for each texel 6 bytes with a
texture and 94 with one picture that is baked anew. Here they are rounded up.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from ..atlas_options import AtlasOptions

__all__ = ["peak", "triangles"]

_MODULES = 150e6
_TRIANGLE = 4000.0
_TEXEL = 20.0
# Up to five pictures are baked anew, one after the other.
_BAKED_TEXEL = 150.0
# Sides of a texture where none is given; with a density it is known after the solve alone.
_SIDE, _DENSE_SIDE = 1024, 4096
# Least bytes of a triangle in each format: those of binary files, and of text with short numbers.
_BYTES = {".glb": 18.0, ".gltf": 18.0, ".obj": 23.0, ".off": 20.0, ".ply": 19.0, ".stl": 50.0}


def peak(source: Path, options: AtlasOptions) -> float:
    """Bytes that a process is expected to take at most, 0 for a file that cannot be read."""
    try:
        count = triangles(source)
    except OSError:
        return 0.0
    texel = _BAKED_TEXEL if options.rebake else _TEXEL if options.texture is not None else 0.0
    side = options.resolution or (_SIDE if options.density is None else _DENSE_SIDE)
    return _MODULES + _TRIANGLE * count + texel * side**2 * options.pages


def triangles(source: Path) -> float:
    """About how many triangles a file has, by its size, or what a glTF file says; rather too many.

    Raises
    ------
    OSError
        For a file that cannot be read.
    """
    suffix = source.suffix.lower()
    if suffix in (".glb", ".gltf"):
        # Pictures may be most of it.
        try:
            return _said(_document(source))
        except (ValueError, TypeError, KeyError, IndexError, AttributeError, struct.error):
            # What is wrong with it is said when it is read.
            pass
    return source.stat().st_size / _BYTES.get(suffix, min(_BYTES.values()))


def _document(source: Path) -> Any:
    with source.open("rb") as file:
        head = file.read(20)
        if head[:4] != b"glTF":
            return json.loads(head + file.read())
        return json.loads(file.read(struct.unpack_from("<I", head, 12)[0]))


def _said(document: Any) -> float:
    """The triangles of a glTF document."""
    counts = [accessor["count"] for accessor in document.get("accessors", [])]
    count = 0.0
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            index = primitive.get("indices", primitive["attributes"]["POSITION"])
            # Three of a list; a strip or fan has more.
            count += counts[index] / (3 if primitive.get("mode", 4) == 4 else 1)
    return count
