"""Seams of labels that leave the edges: curves across faces, with less of a zigzag.

A vertex on the seam of two labels may move to one of them; the seam then passes it on the other
side, through the faces around it. So a seam stays within half an edge of where it was, does not
cross itself or another, and has the topology that it had. Vertices where more than two labels meet,
or where a seam ends at the boundary of the surface, stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse.csgraph
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from .arrays import Bools, Floats, Ints
from .surface import Surface

__all__ = ["Pattern", "Seams", "pattern", "straighten"]

# Least distance of a crossing from the ends of its edge, relative to the edge: no slivers.
_NEAREST = 0.05
# Largest distance from the vertex that a crossing goes around. With all of the edge, or a second
# round from where the seams then are, they shrink around caps: they get 2 % shorter again, but the
# distortion rises by more than that is worth.
_FARTHEST = 0.5
# Where an edge has two crossings, each from its end.
_MIDDLE = 0.45
# Angle, in radians, by which a seam has to turn at a vertex for a way past the vertex to be sought.
_TURN = 0.02
# Steps of the minimiser; it takes about 50.
_STEPS = 200
# Lengths are smoothed below this part of the mean edge length.
_SMOOTH = 1e-3
# Pieces of fewer faces keep their boundaries: they would shrink.
_FEWEST = 12


@dataclass(frozen=True)
class Pattern:
    """How a seam passes a face: points 0 to 2 are its corners, 3 + 2 k and 4 + 2 k lie on edge k.

    Attributes
    ----------
    chords : tuple of (int, int, int)
        Ends of the seam's segments inside, and a corner that each cuts off.
    pieces : tuple of (tuple of int, int)
        Polygons, and the corner whose label each takes; -1 keeps the label of the face.
    """

    chords: tuple[tuple[int, int, int], ...]
    pieces: tuple[tuple[tuple[int, ...], int], ...]


@lru_cache(maxsize=512)
def pattern(key: int) -> Pattern:
    """The pattern of a face from three times three bits, lowest first.

    Whether each corner is cut off, whether each edge is on the seam as it was, and whether each
    corner stays where it is.
    """
    cut, seam, fixed = ([bool(key >> (3 * group + k) & 1) for k in range(3)] for group in range(3))
    chords: list[tuple[int, int, int]] = []
    pieces: list[tuple[tuple[int, ...], int]] = []
    rest: list[int] = []
    for c in range(3):
        before = edge = (c + 2) % 3
        if not cut[c]:
            rest.append(c)
            continue
        if cut[before] and seam[edge]:
            # It is in the run of the corner before.
            continue
        run = [c]
        while cut[(run[-1] + 1) % 3] and seam[run[-1]] and len(run) < 3:
            run.append((run[-1] + 1) % 3)
        end, after = run[-1], (run[-1] + 1) % 3
        first = 4 + 2 * edge if not seam[edge] else before if fixed[before] else 3 + 2 * edge
        last = 3 + 2 * end if not seam[end] else after if fixed[after] else 3 + 2 * end
        chords.append((first, last, c))
        pieces.append(((first, *run, last), c))
        rest += [point for point in (first, last) if point > 2]
    # Points of the rest in their order around the face.
    around = {0: 0, 3: 1, 4: 2, 1: 3, 5: 4, 6: 5, 2: 6, 7: 7, 8: 8}
    rest.sort(key=around.__getitem__)
    if len(rest) > 2:
        pieces.append((tuple(rest), -1))
    return Pattern(tuple(chords), tuple(pieces))


@dataclass(frozen=True, eq=False)
class Seams:
    """Seams across faces.

    Attributes
    ----------
    keys : (m,) array of int
        `pattern` of each face.
    side : (n,) array of int
        Label that a vertex has moved to, -1 where it has not.
    points : (m, 9) array of int
        The points of each face's pattern: vertices, or n plus the number of a crossing.
    ends : (p, 2) array of int
        Vertices of the edge of each crossing.
    edge : (p,) array of int
        The edge.
    place : (p,) array
        Where it is between them, in (0, 1).
    """

    keys: Ints
    side: Ints
    points: Ints
    ends: Ints
    edge: Ints
    place: Floats


@dataclass(frozen=True, eq=False)
class _Setting:
    """A surface, its labels, and what is known of their seams as they are."""

    surface: Surface
    labels: Ints
    face_edges: Ints
    on_seam: Bools


def straighten(surface: Surface, labels: Ints, curvature: float) -> Seams:
    """Shorten the seams of labels.

    Parameters
    ----------
    surface : Surface
        With n vertices and m faces.
    labels : (m,) array of int
    curvature : float
        A vertex leaves a seam that turns there by more than so many times its curvature.
    """
    setting = _setting(surface, labels)
    side = _sides(setting, curvature)
    with threadpool_limits(1, user_api="blas"):
        seams = _shortened(setting, _laid(setting, side))
        # What the seams want to pass on its other side is on them.
        seams = _shortened(setting, _laid(setting, _snapped(setting, seams)))
        side = _worth(setting, seams)
        if np.array_equal(side, seams.side):
            return seams
        return _shortened(setting, _laid(setting, side))


def _setting(surface: Surface, labels: Ints) -> _Setting:
    n, faces = surface.n_vertices, surface.faces
    ahead = np.roll(faces, -1, axis=1)
    code = surface.edges[:, 0] * n + surface.edges[:, 1]
    face_edges = np.searchsorted(code, np.minimum(faces, ahead) * n + np.maximum(faces, ahead))
    across = surface.face_neighbours
    seam = (across >= 0) & (labels[across] != labels[:, None])
    on_seam = np.zeros(surface.n_edges, dtype=np.bool_)
    on_seam[face_edges[seam]] = True
    return _Setting(surface, labels, face_edges, on_seam)


def _sides(setting: _Setting, curvature: float) -> Ints:
    """Label that each vertex on a seam is to move to, -1 for none.

    A vertex where the seam turns moves so that the seam cuts the corner. One with much curvature
    stays: on the boundary of a chart its curvature distorts nothing.
    """
    surface, labels, faces = setting.surface, setting.labels, setting.surface.faces
    n = surface.n_vertices
    degree = np.bincount(surface.edges[setting.on_seam].reshape(-1), minlength=n)
    movable = (degree == 2) & ~surface.on_border
    pieces = surface.label_components(labels)
    small = np.bincount(pieces)[pieces] < _FEWEST
    movable[faces[small]] = False
    lower = np.full(n, labels.max())
    upper = np.full(n, -1)
    np.minimum.at(lower, faces, labels[:, None])
    np.maximum.at(upper, faces, labels[:, None])
    corners = surface.vertices[faces]
    a, b = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=2), (a * b).sum(axis=2))
    below, above = (
        np.bincount(faces.reshape(-1), (angle * (labels[:, None] == of[faces])).reshape(-1), n)
        for of in (lower, upper)
    )
    turn = np.pi - np.minimum(below, above)
    turns = turn > np.maximum(_TURN, curvature * np.abs(surface.angle_defects))
    return np.where(movable & turns, np.where(below < above, upper, lower), -1)


def _laid(setting: _Setting, side: Ints) -> Seams:
    """Seams around the vertices that have moved to `side`, somewhere on the edges to cross."""
    surface, labels, edges = setting.surface, setting.labels, setting.surface.edges
    faces, face_edges, n = surface.faces, setting.face_edges, surface.n_vertices
    at = side[faces]
    cut = (at >= 0) & (at != labels[:, None])
    seam = setting.on_seam[face_edges]
    bits = np.concatenate([cut, seam, at < 0], axis=1)
    keys = np.where(cut.any(axis=1), bits @ (1 << np.arange(9)), 0)
    # The end of an edge next to a corner, for the edge from it and the edge to it. An edge of the
    # seam has one crossing at most, told by its first end.
    points = np.zeros((len(faces), 9), dtype=np.int64)
    points[:, :3] = faces
    needed = np.zeros(2 * len(edges), dtype=np.bool_)
    for k in range(3):
        edge, ahead = face_edges[:, k], (k + 1) % 3
        for code, corner in ((3 + 2 * k, k), (4 + 2 * k, ahead)):
            slot = 2 * edge + np.where(seam[:, k], 0, edges[edge, 0] != faces[:, corner])
            points[:, code] = slot
            needed[slot[cut[:, corner] & ~seam[:, k]]] = True
        both = (at[:, k] >= 0) & (at[:, ahead] >= 0) & (at[:, k] != at[:, ahead])
        needed[2 * edge[seam[:, k] & both]] = True
    slots = np.flatnonzero(needed)
    number = np.full(len(needed), -1)
    number[slots] = n + np.arange(len(slots))
    points[:, 3:] = number[points[:, 3:]]
    edge, end = slots // 2, slots % 2
    ends = np.where(end[:, None] == 1, edges[edge, ::-1], edges[edge])
    place = np.where(setting.on_seam[edge], 0.5, 0.3)
    return Seams(keys, side, points, ends, edge, place)


def _chords(seams: Seams) -> Ints:
    """Segments of the seams within faces: both ends, as points of `Seams`, and a vertex, (c, 3).

    The vertex is one that the segment cuts off.
    """
    ends = [np.zeros((0, 3), dtype=np.int64)]
    for key in np.unique(seams.keys[seams.keys > 0]):
        points = seams.points[seams.keys == key]
        ends += [points[:, chord] for chord in pattern(int(key)).chords]
    return np.concatenate(ends)


def _shortened(setting: _Setting, seams: Seams) -> Seams:
    """The shortest seams that cross the same edges."""
    if not len(seams.place):
        return seams
    surface, unit = setting.surface, setting.surface.mean_edge_length
    n = surface.n_vertices
    a, b = surface.vertices[seams.ends.T]
    along = b - a
    chords = _chords(seams)

    def length(t: Floats) -> tuple[float, Floats]:
        positions = np.concatenate([surface.vertices, a + t[:, None] * along])
        apart = positions[chords[:, 1]] - positions[chords[:, 0]]
        lengths = np.sqrt((apart**2).sum(axis=1) + (_SMOOTH * unit) ** 2)
        gradient = np.zeros(len(t))
        for end, sign in ((0, -1.0), (1, 1.0)):
            inside = chords[:, end] >= n
            c = chords[inside, end] - n
            slope = sign * (apart[inside] * along[c]).sum(axis=1) / lengths[inside]
            gradient += np.bincount(c, slope, len(t))
        return float(lengths.sum()) / unit, gradient / unit

    twice = np.bincount(seams.edge, minlength=surface.n_edges)[seams.edge] == 2
    between = setting.on_seam[seams.edge]
    most = np.where(twice, _MIDDLE, np.where(between, 1 - _NEAREST, _FARTHEST))
    bounds = np.column_stack([np.full(len(most), _NEAREST), most])
    found: Any = minimize(
        length,
        np.clip(seams.place, _NEAREST, most),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _STEPS},
    )
    return replace(seams, place=np.clip(found.x, _NEAREST, most))


def _snapped(setting: _Setting, seams: Seams) -> Ints:
    """The sides, without vertices that all crossings around them are as near to as they may."""
    farthest = np.zeros(setting.surface.n_vertices)
    np.maximum.at(farthest, seams.ends[:, 0], seams.place)
    between = setting.on_seam[seams.edge]
    np.maximum.at(farthest, seams.ends[between, 1], 1 - seams.place[between])
    return np.where(farthest < 1.01 * _NEAREST, -1, seams.side)


def _worth(setting: _Setting, seams: Seams) -> Ints:
    """The sides, without runs of vertices around which the seam has become no shorter."""
    surface, n = setting.surface, setting.surface.n_vertices
    edges = surface.edges[setting.on_seam]
    moved = seams.side[edges] >= 0
    together = edges[moved.all(axis=1)].T
    links = scipy.sparse.coo_array((np.ones(together.shape[1]), tuple(together)), shape=(n, n))
    _, run = scipy.sparse.csgraph.connected_components(links, directed=False)
    # An edge of the seam with a moved end belongs to the run of that end.
    old = edges[moved.any(axis=1)]
    owner = run[np.where(seams.side[old[:, 0]] >= 0, old[:, 0], old[:, 1])]
    a, b = surface.vertices[seams.ends.T]
    crossings = a + seams.place[:, None] * (b - a)
    positions = np.concatenate([surface.vertices, crossings])
    chords = _chords(seams)

    def lengths(ends: Ints, of: Ints) -> Floats:
        apart = positions[ends[:, 0]] - positions[ends[:, 1]]
        return np.bincount(of, np.linalg.norm(apart, axis=1), n).astype(np.float64)

    shorter = lengths(chords, run[chords[:, 2]]) < lengths(old, owner)
    return np.where(shorter[run], seams.side, -1)
