"""Charts side by side in the unit square."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from .. import _core
from ..arrays import Floats, Ints
from ..points import flat_areas
from ..quality import warn
from .charts import Chart

# The packer searches positions cell by cell, at a cost that grows like the fourth power of this.
_SEARCH_RESOLUTION = 512
# Packings to choose from; fewer of many pieces, where none is much better than another.
_TRIALS = 128
_TRIED_PIECES = 12800
# Share of the square that charts of ordinary shape fill; only sets how fine the search is.
_EXPECTED_FILL = 0.7
# Largest share of the side that the padding may take, were the pieces in a square grid.
_MOST_PADDING = 0.5
# Factor on the padding in cells, which depends on the side of the square, known only afterwards.
_MARGIN = 1.02
# The padding settles in two, or in some more where it takes half of the side.
_ROUNDS = 32


@dataclass(frozen=True)
class _Island:
    """An edge-connected part of a chart's labelled faces, its long side turned along u."""

    faces: Ints
    corners: Floats


def pack(
    charts: Sequence[Chart], n_faces: int, *, padding: int = 4, resolution: int = 1024
) -> Floats:
    """Lay the labelled faces of all charts into the unit square without overlap.

    Charts are turned and moved, never mirrored, and share one scale, so relative sizes are those
    of ``Chart.uv``. A chart whose labelled faces fall into several pieces is packed piece by piece.
    Pieces are placed one after the other, the large ones first, where the square around them grows
    least: a search on a raster, see ``rust/core/src/packing.rs``.

    Parameters
    ----------
    charts
        The labelled faces of the charts together are every face exactly once.
    n_faces
        Number m of faces of the surface.
    padding
        Least distance between charts, in texels of a square texture of side ``resolution``; half
        of it is kept free along the boundary.
    resolution
        Side of the texture that the layout is meant for, in texels.

    Returns
    -------
    (m, 3, 2) float64 array
        UV of every corner of every face in [0, 1], v pointing up.

    Raises
    ------
    ValueError
        If a face is labelled by no chart or by several, a UV is not finite, a piece has no area in
        the plane, or an option is out of range.

    Warns
    -----
    QualityWarning
        If there is no room to keep so many pieces `padding` apart.
    """
    check_packing(padding, resolution)
    _check_cover(charts, n_faces)
    islands = [island for index, chart in enumerate(charts) for island in _islands(index, chart)]
    size = min(resolution, _SEARCH_RESOLUTION)
    area = sum(float(flat_areas(island.corners).sum()) for island in islands)
    longest = max(float(island.corners.max()) for island in islands)
    unit = size * min(np.sqrt(_EXPECTED_FILL / area), 1.0 / longest)
    kept = min(padding, int(_MOST_PADDING * resolution / np.sqrt(len(islands))))
    if kept < padding:
        warn(
            f"padding: {len(islands)} pieces have no room for {padding} texels between them at "
            f"resolution {resolution}, they are {kept} apart; a larger resolution helps"
        )

    side = float(size)
    for _ in range(_ROUNDS):
        gap = _MARGIN * kept * side / (resolution - kept)
        low, turned, side = _place([island.corners * unit for island in islands], gap)
        needed = kept * side / (resolution - kept)
        if gap >= needed:
            break
    uv = np.empty((n_faces, 3, 2))
    for island, corners, offset in zip(islands, turned, low, strict=True):
        uv[island.faces] = (corners + offset + 0.5 * needed) / (side + needed)
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


def _islands(index: int, chart: Chart) -> list[_Island]:
    faces = chart.faces[chart.labelled]
    triangles = chart.triangles[chart.labelled]
    corners = chart.uv[triangles]
    if not np.isfinite(corners).all():
        vertex = int(triangles.ravel()[np.flatnonzero(~np.isfinite(corners).all(axis=2))[0]])
        raise ValueError(f"charts[{index}].uv[{vertex}]: {chart.uv[vertex]} must be finite numbers")
    count, piece = _edge_components(triangles)
    islands = []
    for k in range(count):
        member = piece == k
        areas = flat_areas(corners[member])
        if not areas.sum() > 0.0:
            face = int(faces[member][0])
            raise ValueError(f"charts[{index}].uv: the piece at face {face} must have an area")
        islands.append(_Island(faces[member], _upright(corners[member])))
    return islands


def _edge_components(triangles: Ints) -> tuple[int, NDArray[np.int32]]:
    """Number of edge-connected parts and the part of each triangle."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    owner = np.repeat(np.arange(len(triangles)), 3)
    incidence = coo_array((np.ones(len(edge)), (owner, edge.ravel()))).tocsr()
    count, part = connected_components(incidence @ incidence.T, directed=False)
    return int(count), part


def _upright(corners: Floats) -> Floats:
    """Turn corners so that their smallest bounding rectangle lies along u, low corner at 0."""
    points = corners.reshape(-1, 2)
    try:
        hull = points[ConvexHull(points).vertices]
    except QhullError:
        hull = points[:1]
    sides = np.roll(hull, -1, axis=0) - hull
    angles = np.append(np.arctan2(sides[:, 1], sides[:, 0]), 0.0)
    cosines, sines = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = hull[:, 0] * cosines + hull[:, 1] * sines
    across = hull[:, 1] * cosines - hull[:, 0] * sines
    width, height = np.ptp(along, axis=1), np.ptp(across, axis=1)
    best = int(np.argmin(width * height))
    angle = angles[best] + (0.5 * np.pi if height[best] > width[best] else 0.0)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = corners @ rotation
    moved: Floats = turned - turned.min(axis=(0, 1))
    return moved


def _quarter_turns(corners: Floats, turns: int) -> Floats:
    x, y = corners[..., 0], corners[..., 1]
    turned = np.stack([(x, y), (-y, x), (-x, -y), (y, -x)][turns], axis=-1)
    moved: Floats = turned - turned.min(axis=(0, 1))
    return moved


def _place(pieces: Sequence[Floats], gap: float) -> tuple[Ints, list[Floats], float]:
    """Low corners of the pieces, the pieces turned, and the side of the square, all in cells."""
    starts = np.cumsum([0, *(len(piece) for piece in pieces)])
    trials = min(_TRIALS, 1 + _TRIED_PIECES // len(pieces))
    placement = _core.pack(np.concatenate(pieces), starts, gap, trials)
    turned = [
        _quarter_turns(piece, turns)
        for piece, turns in zip(pieces, placement.turns.tolist(), strict=True)
    ]
    high = [
        piece.max(axis=(0, 1)) + offset for piece, offset in zip(turned, placement.low, strict=True)
    ]
    return placement.low, turned, float(np.max(high))
