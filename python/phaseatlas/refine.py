"""Refined surfaces: coarse triangles split until their edges are short, in exactly their shape.

Rounds of longest-edge bisection (Rivara 1984) split edges that are the longest of all their faces,
an independent set each; Delaunay flips (Lawson 1977) of edges inside the input's faces keep the
triangles round. Every new face lies in one face of the input.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse

from .arrays import Bools, Floats, Ints
from .surface import Surface, _accepted
from .transfer import Transfer

__all__ = ["count_refined", "refine"]

# Flips between two rounds of splits, at most: a few do nearly all.
_FLIPS = 40
# Faces that a refinement by edges of length 1 makes of an area of 1, and along a length of 1 of a
# face that is thinner: measured on cubes, cylinders and cones.
_FACES_PER_AREA = 4.5
_FACES_PER_LENGTH = 2.0
# Opposite angles sum to more than half a turn by at least this, as a sine, where a flip is made:
# those of squares round to either side.
_NOT_DELAUNAY = 1e-9


def count_refined(surface: Surface, longest: float) -> float:
    """Estimate the number of faces that `refine` makes, within a factor of about two."""
    by_area = _FACES_PER_AREA * surface.face_areas / longest**2
    by_length = _FACES_PER_LENGTH * surface.face_diameters / longest
    return float(np.maximum(np.maximum(by_area, by_length), 1.0).sum())


def refine(surface: Surface, longest: float) -> Transfer:
    """Split the faces of a surface until no edge is longer than a bound.

    Parameters
    ----------
    surface : Surface
        With n vertices and m faces.
    longest : float
        The bound, a positive length in the units of the surface.

    Returns
    -------
    Transfer
        To a surface whose first n vertices are those of this one, and each of whose faces is a
        part of one face of it. Values go forward by linear interpolation, and backward as they
        are at the vertices.

    Raises
    ------
    ValueError
        For a length that is not positive.
    """
    if not (np.isfinite(longest) and longest > 0):
        raise ValueError(f"longest: {longest} must be a positive number")
    vertices, faces = surface.vertices, surface.faces
    origin = np.arange(surface.n_faces)
    ends: list[Ints] = []
    random = np.random.default_rng(0)
    while True:
        for _ in range(_FLIPS):
            flipped = _flipped(vertices, faces, origin, longest, random)
            if flipped is None:
                break
            faces = flipped
        halves = _halves(vertices, faces, origin, longest, random)
        if halves is None:
            break
        pairs, face, corner, middle = halves
        a, b, c = (faces[face, (corner + k) % 3] for k in range(3))
        faces = faces.copy()
        faces[face] = np.stack([a, middle, c], axis=1)
        faces = np.vstack([faces, np.stack([middle, b, c], axis=1)])
        origin = np.concatenate([origin, origin[face]])
        vertices = np.vstack([vertices, 0.5 * (vertices[pairs[:, 0]] + vertices[pairs[:, 1]])])
        ends.append(pairs)
    forward = _interpolation(surface.n_vertices, ends)
    costs, at_vertices = (
        _inherited_costs(surface, faces, origin, forward),
        surface.vertex_seam_costs,
    )
    return Transfer(
        surface,
        _accepted(vertices, faces, costs, None if at_vertices is None else forward @ at_vertices),
        forward=forward,
        backward=scipy.sparse.eye_array(surface.n_vertices, len(vertices), format="csr"),
        origin_face=origin,
    )


def _halves(
    vertices: Floats, faces: Ints, origin: Ints, longest: float, random: np.random.Generator
) -> tuple[Ints, Ints, Ints, Ints] | None:
    """Edges to halve: their ends, and for each of their faces its corner and the new vertex.

    An edge is halved that is the longest of its faces, of those that are too long, so no face has
    two of them. Edges inside a face of the input wait until those around it are short: a needle
    then needs no vertex inside.
    """
    starts, stops = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    lengths = np.linalg.norm(vertices[stops] - vertices[starts], axis=1)
    if not (lengths > longest).any():
        return None
    edge, pairs = _edges(starts, stops, len(vertices))
    # The lengths of both half-edges of an edge are the same numbers.
    of_edge = np.empty(len(pairs))
    of_edge[edge] = lengths
    long = of_edge > longest
    first, _ = _inner_edges(faces, origin, len(vertices))
    around = long.copy()
    around[edge[first]] = False
    if around.any():
        long = around
    rank = np.empty(len(pairs), dtype=np.int64)
    rank[np.lexsort((random.random(len(pairs)), of_edge))] = np.arange(len(pairs))
    rank[~long] = -1
    ranks = rank[edge].reshape(-1, 3)
    is_longest = (ranks == ranks.max(axis=1, keepdims=True)).reshape(-1)
    votes = np.bincount(edge[is_longest], minlength=len(pairs))
    chosen = (votes == np.bincount(edge, minlength=len(pairs))) & long
    number = np.cumsum(chosen) - 1
    halved = np.flatnonzero(chosen[edge])
    middle = len(vertices) + number[edge[halved]]
    return pairs[chosen], halved // 3, halved % 3, middle


def _flipped(
    vertices: Floats, faces: Ints, origin: Ints, longest: float, random: np.random.Generator
) -> Ints | None:
    """Faces after flips that make them rounder, none of a face twice; None where all are round."""
    first, second = _inner_edges(faces, origin, len(vertices))
    if not len(first):
        return None
    a, b, c = (faces[first // 3, (first + k) % 3] for k in range(3))
    d = faces[second // 3, (second + 2) % 3]
    sines = _sine_of_sum(vertices, a, b, c, d)
    # No edge that would be too long, unless it was longer: so splits and flips come to an end.
    before = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    short = np.linalg.norm(vertices[c] - vertices[d], axis=1) <= np.maximum(longest, before)
    wanted = np.flatnonzero((sines < -_NOT_DELAUNAY) & short)
    if not len(wanted):
        return None
    # The worst of those that share a face; a face has at most one of the smallest.
    rank = np.empty(len(wanted), dtype=np.int64)
    rank[np.lexsort((random.random(len(wanted)), sines[wanted]))] = np.arange(len(wanted))
    least = np.full(len(faces), len(wanted))
    np.minimum.at(least, first[wanted] // 3, rank)
    np.minimum.at(least, second[wanted] // 3, rank)
    f, g = first[wanted] // 3, second[wanted] // 3
    now = (least[f] == rank) & (least[g] == rank)
    f, g, chosen = f[now], g[now], wanted[now]
    faces = faces.copy()
    faces[f] = np.stack([a[chosen], d[chosen], c[chosen]], axis=1)
    faces[g] = np.stack([d[chosen], b[chosen], c[chosen]], axis=1)
    return faces


def _sine_of_sum(vertices: Floats, a: Ints, b: Ints, c: Ints, d: Ints) -> Floats:
    """Sine of the sum of the angles at c and d, opposite to the edge from a to b."""
    angles = []
    for apex in (c, d):
        left, right = vertices[a] - vertices[apex], vertices[b] - vertices[apex]
        scale = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=1)
        scale += np.finfo(float).tiny
        sine = np.linalg.norm(np.cross(left, right), axis=1) / scale
        angles.append((sine, (left * right).sum(axis=1) / scale))
    (sine_c, cosine_c), (sine_d, cosine_d) = angles
    result: Floats = sine_c * cosine_d + cosine_c * sine_d
    return result


def _inner_edges(faces: Ints, origin: Ints, n_vertices: int) -> tuple[Ints, Ints]:
    """The two half-edges of each edge between parts of one face, 3 f + k for edge k of face f."""
    starts, stops = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    keys = np.minimum(starts, stops) * n_vertices + np.maximum(starts, stops)
    order = np.argsort(keys, kind="stable")
    pair = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    first, second = order[pair], order[pair + 1]
    same = origin[first // 3] == origin[second // 3]
    return first[same], second[same]


def _edges(starts: Ints, stops: Ints, n_vertices: int) -> tuple[Ints, Ints]:
    """Edge of each half-edge, and the ends of each edge, smaller vertex first."""
    keys = np.minimum(starts, stops) * n_vertices + np.maximum(starts, stops)
    edges, edge = np.unique(keys, return_inverse=True)
    return edge.reshape(-1), np.stack([edges // n_vertices, edges % n_vertices], axis=1)


def _interpolation(n: int, ends: list[Ints]) -> Any:
    """Weights of the first n vertices in all of them, the middles of pairs of earlier ones."""
    forward = scipy.sparse.eye_array(n, format="csr")
    for pairs in ends:
        middles = 0.5 * (forward[pairs[:, 0]] + forward[pairs[:, 1]])
        forward = scipy.sparse.vstack([forward, middles], format="csr")
    return forward


def _inherited_costs(surface: Surface, faces: Ints, origin: Ints, forward: Any) -> Floats | None:
    """Seam costs of parts of edges, as those of the edge; inside a face they cost their length."""
    if surface.seam_costs is None:
        return None
    costs = np.ones(faces.shape)
    for k in range(3):
        # On edge k of its parent a vertex has no weight of the corner opposite to it.
        opposite = surface.faces[origin, (k + 2) % 3]
        on_edge = _without(forward, faces, opposite)
        for j in range(3):
            along = on_edge[:, j] & on_edge[:, (j + 1) % 3]
            costs[along, j] = surface.seam_costs[origin[along], k]
    return costs


def _without(forward: Any, faces: Ints, corner: Ints) -> Bools:
    """Whether the corners of faces have no weight of an input vertex each."""
    weights = forward[faces.reshape(-1), np.repeat(corner, 3)]
    without: Bools = np.asarray(weights).reshape(-1, 3) == 0
    return without
