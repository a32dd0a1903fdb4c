"""Charts side by side in the unit square."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xatlas
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from ..arrays import Floats, Ints
from ..points import flat_areas
from ..quality import warn
from .charts import Chart

# The packer searches positions texel by texel, at a cost that grows like the fourth power of this.
_SEARCH_RESOLUTION = 512
# Faces below these sizes, in texels of the search, are degenerate to xatlas in single precision.
_SHORTEST_EDGE = 1e-3
_SMALLEST_FACE = 1e-5
# Shortest side of a rectangle that stands for a piece: its halves are above both sizes.
_SHORTEST_SIDE = 1e-2
# Packings to choose from; fewer of many pieces, where none is much better than another.
_TRIALS = 12
_TRIED_PIECES = 1200
# Share of the square that charts of ordinary shape fill; only sets how fine the search is.
_EXPECTED_FILL = 0.7
# Largest share of the side that the padding of the pieces may take, were they in a square grid.
_MOST_PADDING = 0.5
# The padding settles within three rounds; where it does not, the distance reached is said.
_ROUNDS = 8


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
    Pieces are rasterised and placed by xatlas (Young 2018); it is asked for positions only, because
    it stretches charts to whole texels and mirrors some when it turns them.

    Parameters
    ----------
    charts
        The labelled faces of the charts together are every face exactly once.
    n_faces
        Number m of faces of the surface.
    padding
        Least distance between charts, in texels of a square texture of side ``resolution``; half
        of it is kept free along the border.
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
    RuntimeError
        If xatlas drops or splits the rectangle of a piece.

    Warns
    -----
    QualityWarning
        If so many pieces cannot be kept `padding` apart; they are as far apart as can be.
    """
    check_packing(padding, resolution)
    _check_cover(charts, n_faces)
    islands = [island for index, chart in enumerate(charts) for island in _islands(index, chart)]
    size = min(resolution, _SEARCH_RESOLUTION)
    area = sum(float(flat_areas(island.corners).sum()) for island in islands)
    longest = max(float(island.corners.max()) for island in islands)
    unit = size * min(np.sqrt(_EXPECTED_FILL / area), 1.0 / longest)

    room = int(_MOST_PADDING * resolution / np.sqrt(len(islands)))
    wanted = min(padding, room)
    # The padding in texels of the search depends on the side of the square, known only afterwards.
    needed = wanted * size / resolution
    for _ in range(_ROUNDS):
        reach = int(np.ceil(0.5 * (needed + 1.0)))
        offsets, turned, side = _best_placement(islands, unit, reach)
        needed = wanted * side / (resolution - wanted)
        if 2 * reach - 1 >= needed:
            break
    gap = min(needed, 2.0 * reach - 1.0)
    kept = round(gap * resolution / (side + gap))
    if kept < padding:
        warn(
            f"padding: {padding} texels at resolution {resolution} leave no room for "
            f"{len(islands)} pieces, which are {kept} apart; a larger resolution helps"
        )
    uv = np.empty((n_faces, 3, 2))
    for island, corners, offset in zip(islands, turned, offsets, strict=True):
        uv[island.faces] = (corners * unit + offset + 0.5 * gap) / (side + gap)
    return uv


def check_packing(padding: int, resolution: int) -> None:
    """Raise ValueError where `pack` would refuse its options."""
    if resolution < 1:
        raise ValueError(f"resolution must be at least 1, got {resolution}")
    if not 0 <= padding <= resolution // 8:
        raise ValueError(f"padding must lie in 0..resolution / 8, got {padding} at {resolution}")


def _check_cover(charts: Sequence[Chart], n_faces: int) -> None:
    if not charts:
        raise ValueError("charts is empty")
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    if labelled.size and not 0 <= labelled.min() <= labelled.max() < n_faces:
        wrong = int(labelled.max() if labelled.max() >= n_faces else labelled.min())
        raise ValueError(f"charts name face {wrong}, but there are {n_faces} faces")
    times = np.bincount(labelled, minlength=n_faces)
    if (times != 1).any():
        face = int(np.flatnonzero(times != 1)[0])
        raise ValueError(f"face {face} is labelled by {times[face]} charts, expected 1")


def _islands(index: int, chart: Chart) -> list[_Island]:
    faces = chart.faces[chart.labelled]
    triangles = chart.triangles[chart.labelled]
    corners = chart.uv[triangles]
    if not np.isfinite(corners).all():
        vertex = int(triangles.ravel()[np.flatnonzero(~np.isfinite(corners).all(axis=2))[0]])
        raise ValueError(f"charts[{index}].uv[{vertex}] is not finite: {chart.uv[vertex]}")
    count, piece = _edge_components(triangles)
    islands = []
    for k in range(count):
        member = piece == k
        areas = flat_areas(corners[member])
        if not areas.sum() > 0.0:
            face = int(faces[member][0])
            raise ValueError(f"charts[{index}].uv has a piece without area, at face {face}")
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


def _best_placement(
    islands: Sequence[_Island], unit: float, reach: int
) -> tuple[list[Floats], list[Floats], float]:
    """Smallest of several packings that differ in how the pieces are turned."""
    candidates = []
    for turns in _turn_choices(len(islands)):
        turned = [
            _quarter_turns(island.corners, turn)
            for island, turn in zip(islands, turns, strict=True)
        ]
        offsets, side = _place([corners * unit for corners in turned], reach)
        candidates.append((offsets, turned, side))
    return min(candidates, key=lambda candidate: candidate[2])


def _turn_choices(count: int) -> list[list[int]]:
    """Quarter turns of every piece: all lying, all standing, then draws from a fixed stream."""
    trials = min(_TRIALS, 2 + _TRIED_PIECES // count)
    draws = np.random.default_rng(0).integers(0, 4, (trials - 2, count))
    return [[0] * count, [1] * count, *draws.tolist()]


def _place(pieces: Sequence[Floats], reach: int) -> tuple[list[Floats], float]:
    """Low corner of each piece and the side of the square, both in texels of the search.

    Every piece keeps ``reach`` texels around it to itself. Pieces end up at least 2 reach - 1
    apart: xatlas stretches them to whole texels, and undoing that moves each point by up to one.
    A piece that xatlas drops or splits is placed as its rectangle.
    """
    solid = [_solid(piece, reach) for piece in pieces]
    low, torn, side = _place_solid(solid, reach)
    if torn.any():
        solid = [
            _rectangle(piece) if bad else part
            for piece, part, bad in zip(pieces, solid, torn, strict=True)
        ]
        low, torn, side = _place_solid(solid, reach)
    if torn.any():
        raise RuntimeError(f"xatlas dropped or split piece {np.argmax(torn)} of {len(pieces)}")
    offsets = [at - piece.min(axis=(0, 1)) for at, piece in zip(low, solid, strict=True)]
    return offsets, side


def _place_solid(pieces: Sequence[Floats], reach: int) -> tuple[Floats, NDArray[np.bool_], float]:
    """Low corners as xatlas places them, which pieces it dropped or split, side of the square."""
    sizes = [len(piece) for piece in pieces]
    corners = np.concatenate(pieces).reshape(-1, 2)
    owner = np.repeat(np.arange(len(pieces)), sizes)
    # xatlas takes two meshes whose buffers have the same address for copies of each other, which
    # freed temporaries of one call per chart can have: one mesh, told apart by material, is safe.
    uvs = np.ascontiguousarray(corners, dtype=np.float32)
    indices = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    atlas = xatlas.Atlas()
    atlas.add_uv_mesh(uvs, indices, np.ascontiguousarray(owner[:, None], dtype=np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit = 1.0
    options.padding = reach
    options.bilinear = False
    options.bruteForce = True
    options.rotate_charts = False
    options.rotate_charts_to_axis = False
    atlas.generate(pack_options=options)
    if atlas.atlas_count != 1:
        raise RuntimeError(f"xatlas spread the charts over {atlas.atlas_count} textures, not 1")

    source, _, placed = atlas[0]
    texels = placed.astype(np.float64) * [atlas.width, atlas.height]
    piece = np.repeat(owner, 3)[source]
    low = np.full((len(pieces), 2), np.inf)
    high = np.full((len(pieces), 2), -np.inf)
    np.minimum.at(low, piece, texels)
    np.maximum.at(high, piece, texels)
    extents = np.array([np.ptp(piece, axis=(0, 1)) for piece in pieces])
    # It rounds sides up to whole texels; a piece that spans more has been torn apart.
    sound = np.isfinite(low) & (high - low <= extents + 1.5)
    return low, ~sound.all(axis=1), float(max(atlas.width, atlas.height))


def _solid(piece: Floats, reach: int) -> Floats:
    """The largest part of a piece that xatlas does not take for degenerate.

    A conformal map shrinks the tip of a limb to less than single precision resolves; xatlas
    ignores such faces, and what is joined by them alone would be placed apart. They lie inside
    the rest, whose outline is what counts. Where they do not, the rectangle of the piece counts.
    """
    edges = np.linalg.norm(piece - np.roll(piece, 1, axis=1), axis=2)
    areas = flat_areas(piece)
    sound = (edges.min(axis=1) > _SHORTEST_EDGE) & (areas > _SMALLEST_FACE)
    if sound.all():
        return piece
    if not sound.any():
        return _rectangle(piece)
    kept = np.flatnonzero(sound)
    _, vertices = np.unique(piece.reshape(-1, 2), axis=0, return_inverse=True)
    count, part = _edge_components(vertices.reshape(-1, 3)[kept])
    weight = np.bincount(part, weights=areas[kept], minlength=count)
    solid: Floats = piece[kept[part == np.argmax(weight)]]
    beyond = np.maximum(
        solid.min(axis=(0, 1)) - piece.min(axis=(0, 1)),
        piece.max(axis=(0, 1)) - solid.max(axis=(0, 1)),
    )
    return _rectangle(piece) if (beyond > 0.5 * reach).any() else solid


def _rectangle(piece: Floats) -> Floats:
    """The bounding rectangle of a piece as two triangles of a size that xatlas sees."""
    x, y = np.maximum(np.ptp(piece, axis=(0, 1)), _SHORTEST_SIDE)
    halves = np.array([[(0.0, 0.0), (x, 0.0), (x, y)], [(0.0, 0.0), (x, y), (0.0, y)]])
    rectangle: Floats = halves + piece.min(axis=(0, 1))
    return rectangle
