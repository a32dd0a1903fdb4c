"""Wavefront OBJ files: the positions and faces of the whole file, in its order."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from .. import _core
from ..arrays import Bytes, Floats, Ints

__all__ = ["digits_for", "obj", "read_obj"]


# A texel of 16,384 is 6e-5: eight decimals place a corner to a thousandth of it.
_UV_DIGITS = 8
_NORMAL_DIGITS = 6


def read_obj(path: Path) -> tuple[Floats, Ints]:
    """Read the vertices and faces of an OBJ file; polygons are cut into fans of triangles.

    Parameters
    ----------
    path : Path
        File in UTF-8, UTF-16, UTF-32 or any encoding that contains ASCII. Texture coordinates,
        normals, groups and materials are not read.

    Returns
    -------
    vertices : (n, 3) array of float
        All positions, also those that no face uses.
    faces : (m, 3) array of int
        Triangles, in the order of the polygons.

    Raises
    ------
    ValueError
        For what is no position or names no vertex; the message names the line.
    """
    vertices, corners, ends = _core.parse_obj(_without_wide_characters(path.read_bytes()))
    return vertices, _fans(corners, ends)


def _without_wide_characters(data: bytes) -> bytes:
    # A file that starts with ASCII, as an OBJ does, shows its encoding by its first zeros, exactly
    # as JSON does.
    encoding = json.detect_encoding(data)
    if encoding == "utf-8":
        # Comments and names may be in another one.
        return data
    return data.decode(encoding, errors="replace").encode()


def _fans(corners: Ints, ends: Ints) -> Ints:
    """Triangles (m, 3) of polygons that end at `ends` in `corners`, around their first corners."""
    starts = np.concatenate([[0], ends])[:-1]
    counts = ends - starts - 2
    first = np.repeat(starts, counts)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    faces: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return faces


def obj(
    path: Path,
    vertices: Floats,
    faces: Ints,
    normals: Floats,
    uv: Floats,
    image: Bytes,
) -> dict[Path, bytes]:
    """Return an OBJ file and, beside it, the MTL file and the PNG file that it names.

    Parameters
    ----------
    path : Path
        Of the OBJ file.
    vertices, normals : (n, 3) array
        Positions and unit normals.
    faces : (m, 3) array of int
        Triangles.
    uv : (n, 2) array
        Texture coordinates, v up.
    image : (h, w, 3) array of uint8
        The texture, first row on top.
    """
    from PIL import Image

    picture = io.BytesIO()
    Image.fromarray(image).save(picture, format="png")
    name = path.stem
    material = (
        f"newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nNs 1\nd 1\nillum 1\nmap_Kd {name}.png\n"
    )
    number = (faces + 1).reshape(-1).astype(str)
    corners = np.char.add(np.char.add(number, "/"), np.char.add(np.char.add(number, "/"), number))
    lines = [
        f"mtllib {name}.mtl",
        f"o {name}",
        *_lines("v", vertices, digits_for(vertices)),
        *_lines("vt", uv, _UV_DIGITS),
        *_lines("vn", normals, _NORMAL_DIGITS),
        f"usemtl {name}",
        *(f"f {a} {b} {c}" for a, b, c in corners.reshape(-1, 3).tolist()),
        "",
    ]
    return {
        path.with_suffix(".png"): picture.getvalue(),
        path.with_suffix(".mtl"): material.encode(),
        path: "\n".join(lines).encode(),
    }


def digits_for(vertices: Floats) -> int:
    """Decimals that keep nine digits of the extent, and more where vertices would become one."""
    extent = float(np.ptp(vertices, axis=0).max())
    digits = max(8, 9 - int(np.floor(np.log10(extent))))
    distinct = len(np.unique(vertices, axis=0))
    # Seventeen digits hold any double.
    for more in range(9):
        if len(np.unique(np.round(vertices, digits + more), axis=0)) == distinct:
            return digits + more
    return digits + 8


def _lines(word: str, rows: Floats, digits: int) -> list[str]:
    form = f"{word} " + " ".join([f"%.{digits}f"] * rows.shape[1])
    return [form % tuple(row) for row in rows.tolist()]
