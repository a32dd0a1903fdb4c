"""Files whose meshes are cut along straightened seams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Floats, Ints
from ..cutting import cut_along_seams
from ..partitioning import Partition
from ..segmentation import SceneSegmentation, Segmentation
from ..surface import Surface
from ..transfer import Transfer
from .components import Component
from .document import Document
from .mesh import Cut, Mesh
from .repair import Aside, Repaired
from .scene import Scene, SceneMesh
from .sources import CutSource

__all__ = ["cut_document"]


@dataclass(frozen=True, eq=False)
class _Parts:
    """Faces of a repaired mesh, cut.

    Attributes
    ----------
    faces : (l, 3) array of int
        Vertices of the repaired mesh, and then the new ones.
    origin : (l,) array of int
        Face of the repaired mesh that each is a part of, ascending.
    weights : (l, 3, 3) array
        Barycentric coordinates of its corners there.
    ends : (p, 2) array of int
        Vertices of the repaired mesh that each new one lies between.
    place : (p,) array
        How far from the first to the second.
    """

    faces: Ints
    origin: Ints
    weights: Floats
    ends: Ints
    place: Floats


def cut_document(
    document: Document, scene: Scene, segmentation: SceneSegmentation
) -> tuple[Document, Scene, SceneSegmentation]:
    """Cut all meshes of a file along the straightened seams of a segmentation.

    The new meshes have triangles alone. Positions, texture coordinates, normals and colours are
    interpolated, in a glTF file all attributes and morph targets. Triangles without area are left
    out; second copies are cut like the first.

    Parameters
    ----------
    document : Document
        What was read.
    scene : Scene
        Of its meshes.
    segmentation : SceneSegmentation
        Of the scene.

    Returns
    -------
    Document
        The new meshes, to be written like others.
    Scene
        Of these.
    SceneSegmentation
        Of that scene.
    """
    found: list[tuple[Segmentation, Transfer | None]] = []
    for part in segmentation.parts:
        transfer, cut = (None, part) if part.n_segments == 1 else cut_along_seams(part)
        found.append((cut, transfer))
    firsts = [mesh.first_face for mesh in scene.meshes]
    owner = np.searchsorted(firsts, [p.faces[0] for p in scene.pieces], side="right") - 1
    cuts, repaired = [], []
    for k, (mesh, placed) in enumerate(zip(document.meshes, scene.meshes, strict=True)):
        mine = np.flatnonzero(owner == k)
        pairs = [(scene.pieces[p], found[p][1]) for p in mine]
        cut_mesh, new = _cut(mesh, placed.repaired, _gathered(placed, pairs))
        cuts.append(cut_mesh)
        repaired.append((mesh.name, new))
    made = Scene(repaired)
    if any(part.surface.vertex_seam_costs is not None for part, _ in found):
        costs = np.ones(made.n_vertices)
        for (part, _), piece in zip(found, made.pieces, strict=True):
            if part.surface.vertex_seam_costs is not None:
                costs[piece.vertices] = part.surface.vertex_seam_costs
        made = made.with_seam_costs(None, costs)
    moved = [
        _moved(part, piece.surface) for (part, _), piece in zip(found, made.pieces, strict=True)
    ]
    source = CutSource(document.source, tuple(cuts))
    return replace(document, source=source), made, SceneSegmentation(made, moved)


def _moved(part: Segmentation, surface: Surface) -> Segmentation:
    """The same segmentation of an equal surface."""
    weights = part.weights if part.weights_given else None
    if isinstance(part, Partition):
        return Partition(surface, part.labels, weights, part.diagnostics, epsilon=part.epsilon)
    return Segmentation(surface, part.labels, weights, epsilon=part.epsilon)


def _gathered(mesh: SceneMesh, pieces: Sequence[tuple[Component, Transfer | None]]) -> _Parts:
    """The cut faces of all pieces of a mesh."""
    n_new = 0
    columns: list[list[Any]] = [[], [], [], [], []]
    for piece, transfer in pieces:
        vertices = piece.vertices - mesh.first_vertex
        faces = piece.surface.faces
        origin, weights = np.arange(len(faces)), np.broadcast_to(np.eye(3), (len(faces), 3, 3))
        ends, place = np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        if transfer is not None and transfer.origin_face is not None:
            faces, origin = transfer.target.faces, transfer.origin_face
            weights = transfer.corners.barycentric.reshape(-1, 3, 3)
            rows = transfer.forward[len(vertices) :].tocsr()
            ends, place = vertices[rows.indices.reshape(-1, 2)], rows.data.reshape(-1, 2)[:, 1]
        new = len(mesh.repaired.vertices) + n_new + np.arange(len(place))
        n_new += len(place)
        found = (
            np.concatenate([vertices, new])[faces],
            piece.faces[origin] - mesh.first_face,
            weights,
            ends,
            place,
        )
        for column, values in zip(columns, found, strict=True):
            column.append(values)
    if not pieces:
        nothing = np.zeros(0, dtype=np.int64)
        return _Parts(
            nothing.reshape(0, 3), nothing, np.zeros((0, 3, 3)), nothing.reshape(0, 2), np.zeros(0)
        )
    faces, origin, weights, ends, place = (np.concatenate(column) for column in columns)
    order = np.argsort(origin, kind="stable")
    return _Parts(faces[order], origin[order], weights[order], ends, place)


def _cut(mesh: Mesh, old: Repaired, parts: _Parts) -> tuple[Cut, Repaired]:
    """The new mesh of a file, and its faces as an oriented manifold."""
    twin = np.flatnonzero(old.aside.twin)
    # Copies are cut like the faces that they copy: for each twin the parts of its host.
    begin, end = (
        np.searchsorted(parts.origin, old.aside.host[twin], side=side) for side in ("left", "right")
    )
    copied = np.repeat(begin - np.cumsum(end - begin) + (end - begin), end - begin) + np.arange(
        int((end - begin).sum())
    )
    copy = np.repeat(twin, end - begin)
    weights_of_copies = np.einsum("kch,kwh->kcw", parts.weights[copied], old.aside.weights[copy])
    polygon = np.concatenate([old.polygon[parts.origin], old.aside.polygon[copy]])
    corners = np.concatenate([old.corner[parts.origin], old.aside.corner[copy]])
    weights = np.concatenate([parts.weights, weights_of_copies])
    # In the file faces have the winding that they had.
    flipped = old.flipped[np.concatenate([parts.origin, parts.origin[copied]])]
    order = np.argsort(polygon, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    turn = np.where(flipped[:, None], [0, 2, 1], [0, 1, 2])
    corner = 3 * rank[:, None] + turn
    count = 3 * len(order)
    of_corner = np.empty((count, 3), dtype=np.int64)
    of_corner[corner.reshape(-1)] = np.repeat(corners, 3, axis=0)
    at = np.empty((count, 3))
    at[corner.reshape(-1)] = weights.reshape(-1, 3)
    # Vertices of the file where corners are at corners, new ones elsewhere.
    n_old = len(old.vertices)
    both = np.concatenate([parts.faces, parts.faces[copied]]).reshape(-1)
    nearest = np.take_along_axis(
        np.repeat(corners, 3, axis=0), weights.reshape(-1, 3).argmax(axis=1)[:, None], axis=1
    )[:, 0]
    vertex = np.where(both < n_old, mesh.corners[nearest], both - n_old + len(mesh.positions))
    vertices = np.empty(count, dtype=np.int64)
    vertices[corner.reshape(-1)] = vertex
    new_mesh = replace(
        mesh,
        positions=np.concatenate(
            [mesh.positions, _between(mesh.positions[old.source_vertex], parts)]
        ),
        corners=vertices,
        sizes=np.full(len(order), 3),
        material_of=mesh.material_of[polygon[order]],
    )
    kept = len(parts.faces)
    report = replace(
        old.report, polygons=((3, len(order)),), faces=kept, degenerate_faces=0, isolated_vertices=0
    )
    repaired = Repaired(
        vertices=np.concatenate([old.vertices, _between(old.vertices, parts)]),
        faces=parts.faces,
        source_vertex=np.concatenate(
            [old.source_vertex, len(mesh.positions) + np.arange(len(parts.place))]
        ),
        polygon=rank[:kept],
        corner=corner[:kept],
        component=old.component[parts.origin],
        flipped=flipped[:kept],
        inner=np.zeros((kept, 3), dtype=np.bool_),
        n_corners=count,
        aside=Aside(
            polygon=rank[kept:],
            corner=corner[kept:],
            host=copied,
            weights=np.broadcast_to(np.eye(3), (len(copied), 3, 3)),
            twin=np.ones(len(copied), dtype=np.bool_),
        ),
        report=report,
    )
    return Cut(new_mesh, of_corner, at), repaired


def _between(positions: Floats, parts: _Parts) -> Floats:
    """Positions of the new vertices."""
    place = parts.place[:, None]
    between: Floats = (1 - place) * positions[parts.ends[:, 0]] + place * positions[
        parts.ends[:, 1]
    ]
    return between
