"""Wavefront OBJ files: the positions and faces of the whole file, in its order."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from .. import _core
from ..arrays import Floats, Ints

__all__ = ["read_obj"]


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
