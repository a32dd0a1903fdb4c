"""Records of a node of the tree: what is split, how it went, and what can go wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..surface import Surface

__all__ = [
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Node",
    "Progress",
    "Report",
    "Split",
    "StoppedError",
    "confine",
    "with_whole_fans",
]


class CollapsedError(RuntimeError):
    """One of the two phases of a node took no face: there is nothing to split."""


class DisconnectedError(RuntimeError):
    """A segment that was to be connected is not, and repair did not help."""


class StoppedError(RuntimeError):
    """The progress callback stopped the segmentation."""


@dataclass(frozen=True)
class Progress:
    """Where a segmentation is, as handed to the progress callback after every step.

    Attributes
    ----------
    level, node : int
        Level of the tree, from 1, and node on it, from 0.
    epsilon : float
        Interface width of the continuation's present stage, relative to sqrt(area).
    iteration : int
        Steps taken in this node.
    energy : float
        Weighted sum of the functionals on the surface scaled to unit area.
    surface : Surface or None
        Where the step was taken: the node's part of the surface scaled to unit area, or a
        simplified one. None where only the end of a node is told.
    u : array or None
        The accepted field at the vertices of that surface.
    """

    level: int
    node: int
    epsilon: float
    iteration: int
    energy: float
    surface: Surface | None = field(default=None, repr=False, compare=False)
    u: Floats | None = field(default=None, repr=False, compare=False)


#: Called after each step; a true answer stops the segmentation.
Report = Callable[[Progress], object]


@dataclass(frozen=True)
class Diagnostics:
    """How one node of the tree was split.

    Attributes
    ----------
    level, node : int
        The node that was split: level 0 is the whole surface.
    energy : float
        Weighted sum of the functionals, surface scaled to unit area.
    length : float
        Length of the new interface in the units of the surface: perimeter / sqrt(2); with seam
        costs its weighted length.
    violation : float
        Relative violation of the area constraint.
    iterations, evaluations : int
        Steps and evaluations, over all stages.
    converged : bool
        Whether the last stage converged within its limit of steps.
    components : (int, int)
        Components of the two sharp segments as the solver left them.
    repairs : int
        Times that islands were turned over and the node, or its next stage, solved again.
    relabelled_faces : int
        Faces of small islands, which got the label of what surrounds them.
    relabelled_area : float
        Their part of the area of the node.
    level_set : float
        Value of u, averaged over a face, that separates the sharp segments.
    status : str
        Why the last stage ended: a value of `optimise.Status`.
    share : float
        Part of the node's area that its positive child was to have.
    sharp_share : float
        Part of the area of the node's faces that the child's faces have.
    seconds : dict of str to float
        Wall time by what it was spent on, over all stages.
    fallback : str
        Why the node was split half way between its ends instead of by its field; empty where it
        was not.
    """

    level: int
    node: int
    energy: float
    length: float
    violation: float
    iterations: int
    evaluations: int
    converged: bool
    components: tuple[int, int]
    repairs: int
    relabelled_faces: int
    relabelled_area: float
    level_set: float
    status: str = ""
    share: float = 0.5
    sharp_share: float = 0.5
    seconds: dict[str, float] = field(default_factory=dict, repr=False, compare=False)
    fallback: str = ""


@dataclass(frozen=True, eq=False)
class Node:
    """One node to split, self-contained so that any executor can take it.

    Attributes
    ----------
    surface : Surface
        The surface scaled to unit area, or a part of it, with n vertices and m faces.
    path : tuple of bool
        From the root down, whether each step went to the positive child.
    share : float
        Part of the node's area that the positive child is to have, in (0, 1).
    indicator : (n,) array or None
        Diffuse indicator of the node; None is 1 everywhere.
    faces : (m,) array of bool
        The faces of the node's sharp segment.
    start : (n,) array or None
        A field to start from.
    """

    surface: Surface
    path: tuple[bool, ...]
    share: float
    indicator: Floats | None
    faces: Bools
    start: Floats | None = None

    @property
    def level(self) -> int:
        """Level of the node, 0 for the root."""
        return len(self.path)

    @property
    def index(self) -> int:
        """Place among the nodes that a level can have: its path as a binary number."""
        place = 0
        for positive in self.path:
            place = 2 * place + (not positive)
        return place

    @property
    def name(self) -> str:
        """How messages name the node, whose children are on the next level."""
        return f"level {self.level + 1}, node {self.index}"


@dataclass(frozen=True, eq=False)
class Split:
    """The field of a node, (n,), the faces of its positive child, (m,), and how both came."""

    u: Floats
    positive: Bools
    diagnostics: Diagnostics


def confine(node: Node) -> tuple[Node, Ints, Ints] | None:
    """The node on the part of the surface that its indicator reaches, its vertices and faces.

    With all faces within two rings of a vertex where the indicator is positive, no term that u
    enters is lost: further off u is 0. Only paths far outside the node are, and s is 0 on the
    boundary of the part, where the penalty of equation (12) has made it so. None where that part
    is the whole surface or in pieces.
    """
    surface = node.surface
    if node.indicator is None:
        return None
    reached = node.indicator > 0
    reached[surface.faces[node.faces]] = True
    for _ in range(2):
        reached[surface.faces[reached[surface.faces].any(axis=1)]] = True
    inside = with_whole_fans(surface, np.all(reached[surface.faces], axis=1))
    parts = surface.label_components(inside.astype(np.int64))[inside]
    if inside.all() or parts.min() != parts.max():
        return None
    faces = np.flatnonzero(inside)
    part, vertices = surface.submesh(faces)
    confined = Node(
        surface=part,
        path=node.path,
        share=node.share,
        indicator=node.indicator[vertices],
        faces=node.faces[faces],
        start=None if node.start is None else node.start[vertices],
    )
    return confined, vertices, faces


def with_whole_fans(surface: Surface, inside: Bools) -> Bools:
    """Add the faces around each vertex where the set of faces touches itself, until none is left.

    The faces at a vertex less the edges between them are the fans that they form.
    """
    neighbours = surface.face_neighbours
    while True:
        between = (neighbours >= 0) & inside[:, None] & inside[neighbours]
        fans = np.bincount(surface.faces[inside].reshape(-1), minlength=surface.n_vertices)
        # Each edge between two faces is seen from both, at one of its ends each time.
        fans -= np.bincount(surface.faces[between], minlength=surface.n_vertices)
        pinched = fans > 1
        if not pinched.any():
            return inside
        inside = inside | pinched[surface.faces].any(axis=1)
