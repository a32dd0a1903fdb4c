"""Binary PLY files with properties of vertices and faces."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import Floats, Ints

__all__ = ["ply"]


def ply(vertices: Floats, faces: Ints, weights: Mapping[str, Floats], labels: Ints | None) -> bytes:
    """Return a binary PLY file; positions are of double precision.

    Parameters
    ----------
    vertices : (n, 3) array
        Positions.
    faces : (m, 3) array of int
        Triangles.
    weights : mapping of str to (n,) array
        Further properties of the vertices, by name.
    labels : (m,) array of int, optional
        The property `label` of the faces.
    """
    point = np.dtype([(name, "<f8") for name in ("x", "y", "z", *weights)])
    rows = np.empty(len(vertices), dtype=point)
    for name, column in zip(point.names or (), [*vertices.T, *weights.values()], strict=True):
        rows[name] = column
    parts = [("count", "u1"), ("corners", "<i4", 3)]
    polygons = np.empty(len(faces), dtype=parts + ([] if labels is None else [("label", "<i4")]))
    polygons["count"] = 3
    polygons["corners"] = faces
    if labels is not None:
        polygons["label"] = labels
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property double {name}" for name in point.names or ()),
        f"element face {len(polygons)}",
        "property list uchar int vertex_indices",
        *([] if labels is None else ["property int label"]),
        "end_header",
        "",
    ]
    return "\n".join(header).encode() + rows.tobytes() + polygons.tobytes()
