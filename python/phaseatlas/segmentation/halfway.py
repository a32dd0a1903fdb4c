"""A split without a phase field, for nodes where the field collapses or comes apart."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import dijkstra

from ..arrays import Bools, Floats, Ints
from ..functionals import Area, Perimeter
from ..optimise import Status
from .node import Diagnostics, Node, Split
from .options import Options, Widths
from .whole import share_out

__all__ = ["halfway"]


def halfway(node: Node, options: Options, widths: Widths, reason: str) -> Split | None:
    """Split the faces of a node half way between two far ends, in connected parts of its shares.

    Parameters
    ----------
    node : Node
        What to split; its faces connect.
    options, widths : Options, Widths
        For the figures of the diagnostics.
    reason : str
        Why it is not split by its field.

    Returns
    -------
    Split or None
        None for a single face, and for faces that do not connect.
    """
    faces = np.flatnonzero(node.faces)
    if len(faces) < 2:
        return None
    ahead = _between_ends(node, faces)
    if ahead is None:
        return None
    surface = node.surface
    order = np.argsort(ahead, kind="stable")
    areas = surface.face_areas[faces]
    below = np.cumsum(areas[order]) <= node.share * areas.sum()
    leaf = np.ones(len(faces), dtype=np.int64)
    leaf[order[below]] = 0
    covered = scipy.sparse.csr_array((areas, (np.arange(len(faces)), leaf)), shape=(len(faces), 2))
    leaf = share_out(surface, covered, [node.share, 1 - node.share], np.array([[0, 1, 2]]), faces)
    positive = np.zeros(surface.n_faces, dtype=np.bool_)
    positive[faces[leaf == 0]] = True
    u = _field(node, positive)
    length = Perimeter(
        surface,
        widths.epsilon,
        weight=node.indicator,
        eta=options.eta,
        sigma=options.sigma,
        seam_cost=surface.diffuse_seam_costs,
    )
    area = Area(surface, widths.epsilon, delta=widths.delta, weight=node.indicator)
    target = node.share * area.total
    diagnostics = Diagnostics(
        level=node.level,
        node=node.index,
        energy=length.value_and_gradient(u)[0],
        length=length.length(u),
        violation=area.value_and_gradient(u)[0] / target - 1,
        iterations=0,
        evaluations=0,
        converged=False,
        components=(1, 1),
        repairs=0,
        relabelled_faces=0,
        relabelled_area=0.0,
        level_set=0.0,
        status=str(Status.NO_DESCENT),
        share=node.share,
        sharp_share=float(areas[leaf == 0].sum() / areas.sum()),
        fallback=reason,
    )
    return Split(u, positive, diagnostics)


def _between_ends(node: Node, faces: Ints) -> Floats | None:
    """For each face how much nearer it is to one end of the node than to the other one."""
    surface = node.surface
    place = np.full(surface.n_faces, -1)
    place[faces] = np.arange(len(faces))
    across = surface.face_neighbours[faces]
    f, k = np.nonzero((across >= 0) & node.faces[across])
    middles = surface.vertices[surface.faces[faces]].mean(axis=1)
    g = place[across[f, k]]
    # No link is of length 0: that would be none.
    lengths = np.linalg.norm(middles[f] - middles[g], axis=1) + np.finfo(float).tiny
    links = scipy.sparse.csr_array((lengths, (f, g)), shape=(len(faces), len(faces)))
    one = int(np.argmax(dijkstra(links, indices=0)))
    from_one = dijkstra(links, indices=one)
    if not np.isfinite(from_one).all():
        return None
    other = int(np.argmax(from_one))
    ahead: Floats = from_one - dijkstra(links, indices=other)
    return ahead


def _field(node: Node, positive: Bools) -> Floats:
    """Mean of 1 and -1 over the node's faces around each vertex; 0 outside."""
    surface = node.surface
    side = np.where(node.faces, np.where(positive, 1.0, -1.0), 0.0)
    corners = surface.faces.reshape(-1)
    sums = np.bincount(
        corners, np.repeat(side * surface.face_areas, 3), minlength=surface.n_vertices
    )
    u: Floats = sums / (3 * surface.mass)
    return u
