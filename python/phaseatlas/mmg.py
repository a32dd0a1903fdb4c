"""The library MMG: a surface in, one with edges of unit length out.

MMG (https://www.mmgtools.org, LGPL) is called by its bindings mmgpy. It leaves to its user an
input fine enough to be followed closely, and a choice of the creases to keep.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.spatial

from .arrays import Bools, Floats, Ints
from .interrupt import run_interruptible
from .surface import Surface

__all__ = ["LONGEST_INPUT", "MEAN_TOLERANCE", "WORST_QUALITY", "remesh_unit", "split"]

# Lengths are in units of the target edge length.

# The longest edge that MMG is given. It leaves a mesh alone whose edges are all between 1 / sqrt(2)
# and sqrt(2), however far their mean is from the target: then it is given a finer one to coarsen.
LONGEST_INPUT = (2**0.5, 0.8, 0.5**0.5)
MEAN_TOLERANCE = 0.07
# Distance to the surface beyond which MMG makes smaller triangles than asked for.
HAUSDORFF = 0.5
# Shorter creases are noise: keeping them would dictate the triangles around them.
CREASE_LENGTH = 3.0
# Creases that force a worse triangle than this are given up, as far as this from it.
WORST_QUALITY = 0.2
WORST_DISTANCE = 2.0
# Straight stretches of the boundary come back from MMG with single edges that are longer.
LONGEST_OUTPUT = 2.0


def remesh_unit(surface: Surface, angle: float) -> Surface:
    """Remesh to unit edge length, with as many creases as leave well-shaped triangles."""
    edges, is_crease = _sharp_edges(surface, angle)
    while True:
        kept, corners = _chains(surface, edges, is_crease, angle)
        creases = edges[kept & is_crease]
        result = _mmg(surface, creases, corners)
        bad = result.face_quality < WORST_QUALITY
        if not bad.any() or len(creases) == 0:
            return result
        centroids = result.vertices[result.faces[bad]].mean(axis=1)
        middles = surface.vertices[edges].mean(axis=1)
        distance, _ = scipy.spatial.cKDTree(centroids).query(middles)
        given_up = is_crease & kept & (distance < WORST_DISTANCE)
        if not given_up.any():
            return result
        edges, is_crease = edges[~given_up], is_crease[~given_up]


def _mmg(surface: Surface, creases: Ints, corners: Ints) -> Surface:
    try:
        from mmgpy import MmgMeshS
    except ImportError as error:
        raise ImportError(
            "remesh needs the package mmgpy: pip install 'phaseatlas[remesh]'"
        ) from error
    mesh = MmgMeshS()
    mesh.set_mesh_size(surface.n_vertices, surface.n_faces, len(creases))
    mesh.set_vertices(surface.vertices)
    mesh.set_triangles(surface.faces.astype(np.int32))
    if len(creases):
        mesh.set_edges(creases.astype(np.int32))
        mesh.set_ridge_edges(np.arange(len(creases), dtype=np.int32))
    if len(corners):
        mesh.set_corners(corners.astype(np.int32))
    try:
        run_interruptible(lambda: mesh.remesh(hsiz=1.0, hausd=HAUSDORFF, angle=0, verbose=-1))
    except Exception as error:
        raise RuntimeError(f"remesh: MMG failed: {error}") from error
    try:
        faces = mesh.get_triangles().astype(np.int64)
        return Surface(*split(mesh.get_vertices(), faces, LONGEST_OUTPUT))
    except ValueError as error:
        raise RuntimeError(
            f"remesh: MMG returned no valid surface, another edge length may help: {error}"
        ) from error


def split(vertices: Floats, faces: Ints, longest: float) -> tuple[Floats, Ints]:
    """Halve edges and cut their faces, conformingly, until no edge is longer than `longest`."""
    while True:
        sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
        edges, edge_of = np.unique(
            np.sort(sides, axis=-1).reshape(-1, 2), axis=0, return_inverse=True
        )
        length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        long = length > longest
        if not long.any():
            return vertices, faces
        middle = np.full(len(edges), -1)
        middle[long] = len(vertices) + np.arange(np.count_nonzero(long))
        vertices = np.concatenate([vertices, vertices[edges[long]].mean(axis=1)])
        faces = _cut(vertices, faces, middle[edge_of.reshape(-1, 3)])


def _cut(vertices: Floats, faces: Ints, middles: Ints) -> Ints:
    """Cut faces at the middles of their sides, (m, 3), side k from corner k on; -1 for none."""
    count = np.count_nonzero(middles >= 0, axis=1)
    # Turned so that a single cut side is the first, and a single whole side the last.
    first = np.where(count == 1, middles.argmax(axis=1), (middles.argmin(axis=1) + 1) % 3)
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    ab, bc, ca = np.take_along_axis(middles, turn, axis=1).T

    def pick(where: Bools, *corners: Ints) -> Ints:
        return np.stack([corner[where] for corner in corners], axis=1)

    none, one, two, three = (count == k for k in range(4))
    # The quadrilateral a, ab, bc, c is cut along its shorter diagonal.
    to_bc = np.linalg.norm(vertices[a] - vertices[bc], axis=1) < np.linalg.norm(
        vertices[ab] - vertices[c], axis=1
    )
    return np.concatenate(
        [
            faces[none],
            pick(one, a, ab, c),
            pick(one, ab, b, c),
            pick(two, ab, b, bc),
            pick(two & to_bc, a, ab, bc),
            pick(two & to_bc, a, bc, c),
            pick(two & ~to_bc, a, ab, c),
            pick(two & ~to_bc, ab, bc, c),
            pick(three, a, ab, ca),
            pick(three, b, bc, ab),
            pick(three, c, ca, bc),
            pick(three, ab, bc, ca),
        ]
    )


def _sharp_edges(surface: Surface, angle: float) -> tuple[Ints, Bools]:
    """Edges whose faces meet at more than `angle`, then the boundary: (k, 2), (k,) not boundary."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = surface.face_neighbours
    inner = np.nonzero(across > np.arange(surface.n_faces)[:, None])
    cosine = (normals[inner[0]] * normals[across[inner]]).sum(axis=1)
    sharp = cosine < np.cos(np.radians(angle))
    boundary = np.nonzero(across < 0)
    face = np.concatenate([inner[0][sharp], boundary[0]])
    side = np.concatenate([inner[1][sharp], boundary[1]])
    edges = np.stack([surface.faces[face, side], surface.faces[face, (side + 1) % 3]], axis=1)
    return edges, np.arange(len(edges)) < np.count_nonzero(sharp)


def _chains(surface: Surface, edges: Ints, is_crease: Bools, angle: float) -> tuple[Bools, Ints]:
    """Drop short creases: the edges to keep, (k,), and the corners of what is left, (c,).

    A chain runs over vertices of two edges until it bends by more than `angle`. A short chain of
    the boundary cannot be dropped; its bends are noise and are no corners.
    """
    points = surface.vertices
    ends = edges.reshape(-1)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    kept = np.ones(len(edges), dtype=bool)
    rounded = np.zeros(surface.n_vertices, dtype=bool)
    while True:
        degree = np.bincount(ends[np.repeat(kept, 2)], minlength=surface.n_vertices)
        single = np.flatnonzero(np.repeat(kept, 2) & (degree[ends] == 2))
        joint = single[np.argsort(ends[single], kind="stable")].reshape(-1, 2)
        vertex = ends[joint[:, 0]]
        # The other end of an edge whose ends are 2 e and 2 e + 1.
        legs = points[ends[joint ^ 1]] - points[vertex][:, None]
        legs /= np.linalg.norm(legs, axis=2, keepdims=True)
        straight = -(legs[:, 0] * legs[:, 1]).sum(axis=1) >= np.cos(np.radians(angle))
        bend = ~straight & ~rounded[vertex]
        joined = joint[~bend] // 2
        graph = scipy.sparse.coo_array(
            (np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(edges), len(edges))
        )
        _, chain = scipy.sparse.csgraph.connected_components(graph, directed=False)
        short = kept & (np.bincount(chain, length)[chain] < CREASE_LENGTH)
        noise = bend & (short & ~is_crease)[joint // 2].any(axis=1)
        if not (short & is_crease).any() and not noise.any():
            return kept, np.concatenate([vertex[bend], np.flatnonzero(degree > 2)])
        kept &= ~(short & is_crease)
        rounded[vertex[noise]] = True
