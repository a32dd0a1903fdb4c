"""Charts side by side in the unit square."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import _core
from ..arrays import Floats, Ints
from ..points import flat_areas
from ..quality import warn
from .charts import Chart


def pack(
    charts: Sequence[Chart], n_faces: int, *, padding: int = 4, resolution: int = 1024
) -> Floats:
    """Lay the labelled faces of all charts into the unit square without overlap.

    Charts are turned and moved, never mirrored, and share one scale, so relative sizes are those
    of ``Chart.uv``. A chart whose labelled faces fall into several pieces is packed piece by piece.

    Parameters
    ----------
    charts : sequence of Chart
        The labelled faces of the charts together are every face exactly once.
    n_faces : int
        Number m of faces of the surface.
    padding : int, default 4
        Least distance between pieces, in texels of a square texture of side `resolution`; half
        of it is kept free along the border.
    resolution : int, default 1024
        Side of the texture that the layout is meant for, in texels.

    Returns
    -------
    (m, 3, 2) array of float64
        UV of every corner of every face in [0, 1], v pointing up.

    Raises
    ------
    ValueError
        If a face is labelled by no chart or by several, a UV is not finite, a piece has no area in
        the plane, or an option is out of range.

    Warns
    -----
    QualityWarning
        If so many pieces cannot be kept `padding` apart; they are as far apart as leaves them half
        of the side.
    """
    check_packing(padding, resolution)
    _check_cover(charts, n_faces)
    points = np.concatenate([chart.uv for chart in charts])
    first = np.cumsum([0, *(len(chart.uv) for chart in charts)])
    triangles = np.concatenate(
        [
            chart.triangles[chart.labelled] + start
            for chart, start in zip(charts, first[:-1], strict=True)
        ]
    )
    faces = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    count, piece = _core.edge_components(triangles)
    _check_shapes(points, triangles, faces, piece, first)

    largest = _core.most_padding(count)
    share = min(padding / resolution, largest)
    if share < padding / resolution:
        warn(
            f"padding: {count} pieces have no room for {padding} texels between them at "
            f"resolution {resolution}, they are {share * resolution:.2g} apart; a larger "
            "resolution helps"
        )
    uv = np.empty((n_faces, 3, 2))
    uv[faces] = _core.pack(points, triangles, piece, share)
    return uv


def check_packing(padding: int, resolution: int) -> None:
    """Raise ValueError where `pack` would refuse its options."""
    if resolution < 1:
        raise ValueError(f"resolution: {resolution} must be at least 1")
    if not 0 <= padding <= resolution // 8:
        raise ValueError(
            f"padding: {padding} must be in 0..{resolution // 8}, an eighth of the resolution"
        )


def _check_cover(charts: Sequence[Chart], n_faces: int) -> None:
    if not charts:
        raise ValueError("charts: must not be empty")
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    if labelled.size and not 0 <= labelled.min() <= labelled.max() < n_faces:
        wrong = int(labelled.max() if labelled.max() >= n_faces else labelled.min())
        raise ValueError(f"charts: face {wrong} must be in 0..{n_faces - 1}")
    times = np.bincount(labelled, minlength=n_faces)
    if (times != 1).any():
        face = int(np.flatnonzero(times != 1)[0])
        raise ValueError(f"charts: face {face} must be labelled by one, not by {times[face]}")


def _check_shapes(points: Floats, triangles: Ints, faces: Ints, piece: Ints, first: Ints) -> None:
    """Raise ValueError where a piece is no shape; chart c has the points from ``first[c]`` on."""
    corners = triangles.ravel()
    broken = np.flatnonzero(~np.isfinite(points[corners]).all(axis=1))
    if broken.size:
        vertex = int(corners[broken[0]])
        chart = int(np.searchsorted(first, vertex, side="right")) - 1
        raise ValueError(
            f"charts[{chart}].uv[{vertex - first[chart]}]: {points[vertex]} must be finite numbers"
        )
    areas = np.bincount(piece, weights=flat_areas(points[triangles]))
    flat = np.flatnonzero(~(areas > 0.0)[piece])
    if flat.size:
        face = int(flat[0])
        chart = int(np.searchsorted(first, triangles[face, 0], side="right")) - 1
        raise ValueError(f"charts[{chart}].uv: the piece at face {faces[face]} must have an area")
