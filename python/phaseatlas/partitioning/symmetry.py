"""Surfaces that are their own mirror images: the plane, the half, and labels of both halves."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Bools, Floats, Ints
from ..quality import QualityWarning
from ..scene.repair import repair
from ..scene.scene import Scene
from ..segmentation import SceneSegmentation, Segmentation
from ..surface import Surface
from .phases import Log
from .pieces import warn_of_charts
from .record import Partition, by_area

__all__ = ["AXES", "Axis", "Mirror", "mirror", "mirrored", "mirrored_labels", "stacked_corners"]

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = get_args(Axis)

# Least part of the area that must have a mirror image.
_MATCHED = 0.95
# How far an image may lie from its partner, in square roots of its area, and how far their areas
# and their normals may differ: far less than from polygon to polygon.
_NEAR = 0.1
_ALIKE = 0.02
# Neighbours that are looked at: sheets that lie on each other have one centre.
_NEIGHBOURS = 6
# Vertices whose images are sought where the plane is not known.
_SAMPLED = 20_000
# Rounds in which the plane moves to the middle of the pairs that it makes.
_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane across an axis, and what it makes of the polygons of a surface.

    Attributes
    ----------
    offset : float
        Coordinate of the plane on the axis across it.
    unit : (m,) array of int
        Polygon of each face; a face by itself is one.
    partner : (u,) array of int
        Mirror image of each polygon, itself for one that lies across the plane; -1 for none.
    kept : (u,) array of bool
        Of each pair the polygon beyond the plane, and all that have no other as their image.
    share : float
        Part of the area that has an image.
    image : (n,) array of int
        A vertex at the place of the image of each, the same for all at that place; -1 for none.
    """

    offset: float
    unit: Ints
    partner: Ints
    kept: Bools
    share: float
    image: Ints

    @property
    def half(self) -> Ints:
        """Faces that are kept."""
        return np.flatnonzero(self.kept[self.unit])


def mirror(surface: Surface, axis: Axis) -> Mirror:
    """Find the plane across an axis on whose two sides a surface is the same.

    Parameters
    ----------
    surface : Surface or Scene
        Polygons of a scene are matched whole, however they are cut into triangles.
    axis : {"x", "y", "z"}

    Raises
    ------
    ValueError
        For another axis, and where less than 95 % of the area has a mirror image.
    """
    if axis not in AXES:
        raise ValueError(f"symmetry: {axis!r} must be one of {AXES}")
    along = AXES.index(axis)
    offset, image = _plane(surface, along)
    unit = _with_quads(surface, _units(surface), image)
    count = int(unit.max()) + 1
    corners = surface.vertices[surface.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    sizes: Floats = np.bincount(unit, surface.face_areas, count).astype(np.float64)
    moments = corners.mean(axis=1) * surface.face_areas[:, None]
    centres = np.stack([np.bincount(unit, x, count) for x in moments.T], axis=1) / sizes[:, None]
    normals = np.stack([np.bincount(unit, x, count) for x in area.T], axis=1) / sizes[:, None]
    partner = _partners(centres, normals, sizes, along, offset)
    share = float(sizes[partner >= 0].sum() / sizes.sum())
    if share < _MATCHED:
        raise ValueError(
            f"symmetry: {100 * share:.3g} % of the area has a mirror image across {axis} = "
            f"{offset:.6g}, the best plane; must be at least {100 * _MATCHED:g} %"
        )
    beyond = centres[:, along] - centres[partner, along]
    kept = (partner < 0) | (beyond > 0) | ((beyond == 0) & (np.arange(count) <= partner))
    return Mirror(offset, unit, partner, kept, share, image)


def _plane(surface: Surface, along: int) -> tuple[float, Ints]:
    """Offset of the plane with the most vertices whose image is one, and these, -1 for none.

    Vertices at one place have one number.
    """
    vertices = surface.vertices
    tree = cKDTree(vertices)
    near = _NEAR * surface.mean_edge_length
    area = surface.face_areas
    centre = vertices[surface.faces].mean(axis=1)[:, along]
    best: tuple[int, float, Ints] | None = None
    # The centre of the area is exact where all has an image, the mode of the middles where not.
    for start in (float(area @ centre / area.sum()), _mode_of_middles(vertices, along, near)):
        offset = start
        for _ in range(_ROUNDS):
            turned = vertices.copy()
            turned[:, along] = 2.0 * offset - turned[:, along]
            distance, image = tree.query(turned)
            hit = distance <= near
            if best is None or np.count_nonzero(hit) > best[0]:
                best = int(np.count_nonzero(hit)), offset, np.where(hit, image, -1)
            if not hit.any():
                break
            offset = float(np.median(0.5 * (vertices[hit] + vertices[image[hit]])[:, along]))
    assert best is not None
    return best[1], best[2]


def _mode_of_middles(vertices: Floats, along: int, near: float) -> float:
    """The most frequent middle between vertices that may be images across some plane.

    These have the same coordinates but for the one on the axis.
    """
    others = np.delete(vertices, along, axis=1)
    step = max(len(vertices) // _SAMPLED, 1)
    k = min(_NEIGHBOURS, len(vertices))
    distance, image = cKDTree(others).query(others[::step], k=k, distance_upper_bound=near)
    row, column = np.nonzero(np.isfinite(distance.reshape(-1, k)))
    coordinates = vertices[:, along]
    middles = 0.5 * (coordinates[::step][row] + coordinates[image.reshape(-1, k)[row, column]])
    middles = np.sort(middles)
    ends = np.searchsorted(middles, middles + near, side="right")
    start = int((ends - np.arange(len(ends))).argmax())
    return float(np.median(middles[start : ends[start]]))


def _with_quads(surface: Surface, unit: Ints, image: Ints) -> Ints:
    """Join pairs of triangles whose image is a pair, cut along the other diagonal.

    Grids that became triangles have such pairs.
    """
    place = _place(surface)
    corners = place[surface.faces]
    across = image[surface.faces]
    alone = np.bincount(unit)[unit] == 1
    whole = (across >= 0).all(axis=1)
    known = _keys(np.sort(corners, axis=1))
    missing = alone & whole & ~np.isin(_keys(np.sort(across, axis=1)), known)
    faces = np.flatnonzero(missing)
    if not len(faces):
        return unit
    start = corners[faces]
    edges = np.sort(np.stack([start, np.roll(start, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    # Three faces at an edge are no pair.
    same &= ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False]
    first, second = order[:-1][same], order[1:][same]
    one, two = faces[first // 3], faces[second // 3]
    ends = [surface.faces[one, first % 3], surface.faces[one, (first + 1) % 3]]
    tips = [surface.faces[one, (first + 2) % 3], surface.faces[two, (second + 2) % 3]]
    quads = np.stack([*ends, *tips], axis=1)
    here = _keys(np.sort(place[quads], axis=1))
    there = _keys(np.sort(image[quads], axis=1))
    # A diagonal joins other vertices than its image does.
    fits = np.isin(there, here)
    joined = unit.copy()
    free = np.bincount(np.concatenate([one[fits], two[fits]]), minlength=surface.n_faces) == 1
    fits &= free[one] & free[two]
    joined[two[fits]] = unit[one[fits]]
    _, joined = np.unique(joined, return_inverse=True)
    return joined.reshape(-1).astype(np.int64)


def _place(surface: Surface) -> Ints:
    """A vertex at the place of each, the same for all at that place."""
    place: Ints = cKDTree(surface.vertices).query(surface.vertices)[1].astype(np.int64)
    return place


def stacked_corners(surface: Surface, found: Mirror) -> Ints:
    """For each corner of an image the corner that it is the image of.

    Parameters
    ----------
    surface : Surface or Scene
    found : Mirror
        Of it.

    Returns
    -------
    (m, 3) array of int
        Three times the face plus the corner; -1 at faces that are kept, and where there is none.
    """
    n = surface.n_vertices
    kept = found.kept[found.unit]
    units = np.repeat(found.unit, 3)
    corners = np.flatnonzero(np.repeat(kept, 3))
    key = units[corners] * n + _place(surface)[surface.faces.reshape(-1)[corners]]
    order = np.argsort(key, kind="stable")
    image = found.image[surface.faces]
    wanted = found.partner[found.unit][:, None] * n + image
    slot = np.minimum(np.searchsorted(key[order], wanted), len(order) - 1)
    known = (key[order][slot] == wanted) & (image >= 0)
    whole = known.all(axis=1) & ~kept
    return np.where(whole[:, None], corners[order][slot], -1)


def _keys(rows: Ints) -> Ints:
    """A number for each row of vertices, the same for equal rows of one call or another."""
    key = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        # Mixed, not exact: rows of 64 bits would overflow.
        key = (key * np.uint64(0x9E3779B97F4A7C15) ^ column.astype(np.uint64)) * np.uint64(
            0xBF58476D1CE4E5B9
        )
    return key.astype(np.int64)


def _units(surface: Surface) -> Ints:
    """Polygon of each face; faces that a seam may part are polygons of their own."""
    if not isinstance(surface, Scene):
        return np.arange(surface.n_faces)
    numbers, first = [], 0
    for mesh in surface.meshes:
        repaired = mesh.repaired
        whole = np.zeros(int(repaired.polygon.max(initial=-1)) + 1, dtype=np.bool_)
        whole[repaired.polygon[repaired.inner.any(axis=1)]] = True
        faces = np.arange(len(repaired.faces)) + len(whole)
        key = np.where(whole[repaired.polygon], repaired.polygon, faces)
        # A polygon may be in several components.
        pairs = np.stack([key, repaired.component])
        _, number = np.unique(pairs, axis=1, return_inverse=True)
        number = number.reshape(-1)
        numbers.append(number + first)
        first += int(number.max(initial=-1)) + 1
    return np.concatenate(numbers)


def _partners(centres: Floats, normals: Floats, sizes: Floats, along: int, offset: float) -> Ints:
    """The polygon that each one's image is, if that of the other is the one; else -1."""
    images, turned = centres.copy(), normals.copy()
    images[:, along] = 2.0 * offset - images[:, along]
    turned[:, along] *= -1.0
    k = min(_NEIGHBOURS, len(centres))
    distance, near = cKDTree(centres).query(images, k=k)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    fits = (
        (distance <= _NEAR * np.sqrt(sizes)[:, None])
        & (np.abs(sizes[near] / sizes[:, None] - 1.0) <= _ALIKE)
        & (np.abs(normals[near] - turned[:, None]).max(axis=2) <= _NEAR)
    )
    first = near[np.arange(len(near)), fits.argmax(axis=1)]
    partner: Ints = np.where(fits.any(axis=1), first, -1).astype(np.int64)
    mutual = (partner >= 0) & (partner[partner] == np.arange(len(partner)))
    return np.where(mutual, partner, -1)


def mirrored(
    surface: Surface,
    axis: Axis,
    distortion: float,
    max_charts: int | None,
    partition: Callable[[Scene], SceneSegmentation],
) -> Partition | SceneSegmentation:
    """Charts of one half of a surface, and their images on the other.

    Parameters
    ----------
    surface : Surface or Scene
    axis : {"x", "y", "z"}
    distortion : float
        Weight with which the figures of the whole are told.
    max_charts : int or None
        Bound on the charts of both halves.
    partition : callable
        What finds the charts of one half, a scene.

    Raises
    ------
    ValueError
        As `mirror`.

    Warns
    -----
    QualityWarning
        Where `max_charts` is exceeded.
    """
    log = Log([], perf_counter(), None)
    with warnings.catch_warnings():
        # The bound is on both halves together.
        warnings.filterwarnings("ignore", "max_charts: ", QualityWarning)
        labels = mirrored_labels(surface, mirror(surface, axis), partition)

    def of_piece(piece: Surface, labels: Ints) -> Partition:
        _, numbers = np.unique(labels, return_inverse=True)
        core = piece.one_chart(distortion)
        core.set_labels(numbers.reshape(-1), 0.0)
        figures = log.note("mirror", piece, core)
        return Partition(piece, by_area(numbers.reshape(-1), piece), diagnostics=(figures,))

    found: Partition | SceneSegmentation
    if isinstance(surface, Scene):
        parts = [of_piece(piece.surface, labels[piece.faces]) for piece in surface.pieces]
        found = SceneSegmentation(surface, parts)
    else:
        found = of_piece(surface, labels)
    warn_of_charts(found.n_segments, max_charts)
    return found


def mirrored_labels(
    surface: Surface, found: Mirror, partition: Callable[[Scene], Segmentation]
) -> Ints:
    """Labels of one half, and of the other by their images.

    Parameters
    ----------
    surface : Surface or Scene
    found : Mirror
        Of it.
    partition : callable
        What labels the faces of one half, a scene.

    Returns
    -------
    (m,) array of int
        A label and its image are different ones. Faces of a polygon have one label.
    """
    half = found.half
    scene, place = _scene_of(surface, half, found.unit[half])
    labels = np.zeros(len(half), dtype=np.int64)
    labels[place] = partition(scene).labels
    of_unit = np.zeros(len(found.partner), dtype=np.int64)
    of_unit[found.unit[half]] = labels
    images = ~found.kept
    of_unit[images] = of_unit[found.partner[images]] + labels.max() + 1
    return of_unit[found.unit]


def _scene_of(surface: Surface, faces: Ints, unit: Ints) -> tuple[Scene, Ints]:
    """Some faces as a scene without seams in polygons, and the place of each of its faces."""
    # Vertices where sheets touch at a point alone become several.
    repaired = repair(surface.vertices, surface.faces[faces].reshape(-1), np.full(len(faces), 3))
    n = len(repaired.vertices)
    start = repaired.faces.reshape(-1)
    end = np.roll(repaired.faces, -1, axis=1).reshape(-1)
    order = np.argsort(start * n + end)
    key = (start * n + end)[order]
    slot = np.minimum(np.searchsorted(key, end * n + start), len(key) - 1)
    other = order[slot] // 3
    of = unit[repaired.polygon]
    inner = (key[slot] == end * n + start) & (of[other] == np.repeat(of, 3))
    scene = Scene([("", replace(repaired, inner=inner.reshape(-1, 3)))])
    of_edges, at_vertices = surface.seam_costs, surface.vertex_seam_costs
    if of_edges is not None:
        # Faces may have been turned over: the edge between corners a and b is a's, or else b's.
        a = repaired.corner % 3
        b = np.roll(a, -1, axis=1)
        of_edges = of_edges[faces[repaired.polygon][:, None], np.where(b == (a + 1) % 3, a, b)]
        if scene.seam_costs is not None:
            of_edges = np.maximum(of_edges, scene.seam_costs)
    if of_edges is not None or at_vertices is not None:
        at_vertices = None if at_vertices is None else at_vertices[repaired.source_vertex]
        own = scene.seam_costs if of_edges is None else of_edges
        scene = scene.with_seam_costs(own, at_vertices)
    return scene, repaired.polygon
