"""Scenes opened along edges: where a seam must run there is no surface to cut any more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from .. import quality
from ..arrays import Bools, Ints
from .components import components
from .repair import Repaired
from .scene import Scene

__all__ = ["NoEdgeError", "half_edges", "opened"]


class NoEdgeError(ValueError):
    """Two vertices of a list of edges that no edge joins.

    Attributes
    ----------
    row : int
        Of the two in the list.
    """

    def __init__(self, row: int, a: int, b: int) -> None:
        super().__init__(row, a, b)
        self.row = row

    def __str__(self) -> str:
        row, a, b = self.args
        return f"seams[{row}]: no edge joins vertices {a} and {b}"


def half_edges(vertices: Ints, pairs: ArrayLike, n: int) -> Bools:
    """Edges of faces by the vertices at their ends.

    Parameters
    ----------
    vertices : (m, 3) array of int
        Vertex at each corner of each face, in 0..n-1.
    pairs : (k, 2) array_like of int
        Vertices at the ends of each edge, in either order.
    n : int
        Number of vertices.

    Returns
    -------
    (m, 3) array of bool
        Whether (f[k], f[(k + 1) % 3]) is one of the edges.

    Raises
    ------
    ValueError
        For another shape.
    NoEdgeError
        For vertices that no edge joins.
    """
    ends = np.asarray(pairs)
    if ends.size == 0:
        return np.zeros(vertices.shape, dtype=np.bool_)
    if ends.ndim != 2 or ends.shape[1] != 2 or not np.issubdtype(ends.dtype, np.integer):
        raise ValueError(f"seams: shape {ends.shape} of {ends.dtype} must be (k, 2) of int")
    wanted = _keys(ends[:, 0], ends[:, 1], n)
    there = _keys(vertices, np.roll(vertices, -1, axis=1), n)
    known = np.isin(wanted, there) & ((ends >= 0) & (ends < n)).all(axis=1)
    if not known.all():
        row = int(np.argmin(known))
        raise NoEdgeError(row, *ends[row].tolist())
    return np.isin(there, wanted)


def opened(scene: Scene, edges: Bools) -> Scene:
    """Open a scene along edges, so that their two sides are no neighbours any more.

    A vertex stands once for each fan of faces that is left around it. Nothing moves, and the way
    back to the corners of the file stays. A chart may still lie on both sides of an edge, but the
    edge is a seam of it.

    Parameters
    ----------
    scene : Scene
        With m faces.
    edges : (m, 3) array of bool
        Whether the surface is to be opened along edge (f[k], f[(k + 1) % 3]) of each face f; one
        side is enough. Diagonals inside polygons stay closed.

    Returns
    -------
    Scene

    Warns
    -----
    QualityWarning
        For edges that cannot be opened, as both of their ends lie inside and no other edge there is
        opened.
    """
    faces, n = scene.faces, scene.n_vertices
    starts, stops = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    first, second = _twins(_keys(starts, stops, n))
    cut = edges.reshape(-1)[first] | edges.reshape(-1)[second]
    inner = np.concatenate([mesh.repaired.inner for mesh in scene.meshes]).reshape(-1)
    cut &= ~inner[first]
    if not cut.any():
        return scene
    # The two corners at each end of an edge that stays are one.
    a, b = first[~cut], second[~cut]
    after = np.roll(np.arange(len(starts)).reshape(-1, 3), -1, axis=1).reshape(-1)
    pairs = np.concatenate([a, after[a]]), np.concatenate([after[b], b])
    fan = _joined(len(starts), *pairs)
    corner = np.unique(fan, return_index=True)[1]
    order = np.lexsort((corner, starts[corner]))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    origin, new = starts[corner[order]], number[fan].reshape(-1, 3)
    closed = new.reshape(-1)[first[cut]] == new.reshape(-1)[after[second[cut]]]
    closed &= new.reshape(-1)[after[first[cut]]] == new.reshape(-1)[second[cut]]
    if closed.any():
        quality.warn(
            f"seams: {np.count_nonzero(closed)} of {np.count_nonzero(cut)} edges are not opened, "
            "as they stand alone inside the surface"
        )
    meshes = []
    begin = 0
    for mesh in scene.meshes:
        of_faces = slice(mesh.first_face, mesh.first_face + len(mesh.repaired.faces))
        end = int(np.searchsorted(origin, mesh.first_vertex + len(mesh.repaired.vertices)))
        old = origin[begin:end] - mesh.first_vertex
        meshes.append((mesh.name, _opened(mesh.repaired, new[of_faces] - begin, old)))
        begin = end
    at_vertices = scene.vertex_seam_costs
    return Scene(
        meshes,
        scene.file,
        scene.seam_costs,
        None if at_vertices is None else at_vertices[origin],
    )


def _opened(old: Repaired, faces: Ints, origin: Ints) -> Repaired:
    """The mesh with other vertices, each made of one of the old ones."""
    keys = _keys(faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1), len(origin))
    first, second = _twins(keys)
    # Numbers in the order of the first faces, as a repair gives them.
    found = _joined(len(faces), first // 3, second // 3)
    _, place = np.unique(found, return_index=True)
    rank = np.empty(len(place), dtype=np.int64)
    rank[np.argsort(place)] = np.arange(len(place))
    made = replace(
        old,
        vertices=old.vertices[origin],
        faces=faces,
        source_vertex=old.source_vertex[origin],
        component=rank[found],
        report=replace(old.report, components=len(place)),
    )
    loops = sum(part.surface.n_boundary_loops for part in components(made))
    return replace(made, report=replace(made.report, boundary_loops=loops))


def _keys(starts: Ints, stops: Ints, n: int) -> Ints:
    """A number for each pair of vertices, whatever their order."""
    keys: Ints = np.minimum(starts, stops) * n + np.maximum(starts, stops)
    return keys


def _twins(keys: Ints) -> tuple[Ints, Ints]:
    """The half-edges on either side of each inner edge."""
    order = np.argsort(keys, kind="stable")
    pair = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    return order[pair], order[pair + 1]


def _joined(n: int, a: Ints, b: Ints) -> Ints:
    graph = scipy.sparse.csr_array((np.ones(len(a)), (a, b)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
