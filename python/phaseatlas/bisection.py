"""One bisection of the hierarchy: problem (6), on deeper levels (10), and how it is solved.

Widths of the interface, from wide to narrow, are stages; wide ones are solved on simplified
surfaces, from several starts. The sharp segments are cut, checked and, where they are in pieces,
repaired.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import scipy.cluster.vq
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from . import _core, ipopt
from .coarsen import Coarse, coarsen
from .functionals import Area, Connectedness, Distortion, Perimeter
from .optimise import AreaConstraint, Iteration, Result, minimise
from .surface import Surface

__all__ = [
    "INITIALS",
    "SOLVERS",
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Initial",
    "Node",
    "Progress",
    "Settings",
    "Solver",
    "Split",
    "bisect",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Initial = Literal["auto", "random", "normals"]
INITIALS = get_args(Initial)
Solver = Literal["lbfgs", "ipopt"]

# Continuation starts where epsilon is about this part of the square root of the segment's area:
# the interface is then as wide as the segment, and few local minima are left.
_COARSEST = 0.2
# With distortion it starts narrower: a limb that is thinner than the interface has no inside, and
# the border must find the way along it before it has shrunk to its shortest.
_COARSEST_DISTORTED = 0.1
# An interface is resolved by edges of this part of epsilon; a simplified surface has edges a little
# longer than twice those of the finer one. With distortion, stages go on from there to finer
# edges: coarse ones do not tell good from bad.
_RESOLVED = 0.65
_RESOLVED_DISTORTED = 0.35
SOLVERS: dict[Solver, Callable[..., Result]] = {
    "lbfgs": minimise,
    "ipopt": ipopt.minimise,
}
_COARSE: dict[Solver, dict[str, Any]] = {
    "lbfgs": {"tolerance": 1e-5, "max_updates": 1},
    "ipopt": {"tolerance": 1e-5},
}
# Until starts are first compared.
_COARSEST_TOLERANCE = 1e-4
# The distortion is stiff: with 1e-7, as without it, most of the steps gain nothing.
_DISTORTED: dict[Solver, dict[str, Any]] = {"lbfgs": {"tolerance": 3e-6}, "ipopt": {}}
# Of starts whose energies differ by less than this part one goes on.
_SAME_ENERGY = 1e-3
# Random starts without distortion. Several starts are tried on surfaces of up to so many vertices;
# with distortion, whose minima differ more, on larger ones too.
_RANDOM_STARTS = 8
_CHEAP = 4000
# First steps of each start: the better half of them goes on, for twice as many, until one is
# left. Steps in which noise parts into phases.
_START_STEPS = 20
_NOISE_STEPS = 15
# The connectedness functional sees all that the distortion does: its threshold is about the value
# at which that starts to penalise the other phase. Masses saturate at epsilon^2, the area of the
# least island: an island at the tip of a limb spares so much distortion that its own small mass
# would not hold it.
_THRESHOLD = 0.3
_PLATEAU = 0.5
# Crumbs up to this part of the area of their node, or of this many faces, are relabelled: faces
# at the tips of a jagged interface. Larger ones are turned over and the node is solved again,
# each round with a heavier connectedness term.
_CRUMB_SHARE = 1e-3
_CRUMB_FACES = 4
_REPAIR_ROUNDS = 4
_REPAIR_STEPS = 1000
_COARSE_REPAIR_STEPS = 200
# Normals closer than this are the same; a split by normals is +-tanh of this many deviations.
_SAME_NORMALS = 1e-9
_SPLIT_SLOPE = 6.0
_REPAIR_GROWTH = 10.0


class CollapsedError(RuntimeError):
    """One of the two phases of a node took no face: there is nothing to split."""


class DisconnectedError(RuntimeError):
    """A segment that was to be connected is not, and repair did not help."""


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
    """

    level: int
    node: int
    epsilon: float
    iteration: int
    energy: float


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
        Length of the new interface in the units of the surface: perimeter / sqrt(2).
    violation : float
        Relative violation of the area constraint.
    iterations, evaluations : int
        Steps and evaluations, over all stages.
    converged : bool
        Whether the last stage converged within its limit of steps.
    components : (int, int)
        Components of the two sharp segments as the solver left them.
    repairs : int
        Times that crumbs were turned over and the node, or its next stage, solved again.
    relabelled_faces : int
        Faces of small crumbs, which got the label of what surrounds them.
    relabelled_area : float
        Their part of the area of the node.
    level_set : float
        Value of u, averaged over a face, that separates the sharp segments.
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


@dataclass(frozen=True)
class Settings:
    """What all nodes share; lengths relative to sqrt(area)."""

    epsilon: float
    coarsest: float | None
    delta: float
    eta: float
    sigma: float
    kappa: float
    connected: bool
    area: AreaConstraint
    penalty: float
    distortion: float
    law: Literal["sharp", "paper"]
    initial: Initial
    seed: int
    solver: Solver
    max_iterations: int
    coarse: bool


@dataclass(frozen=True)
class Node:
    """One node to split, self-contained so that any executor can take it."""

    surface: Surface
    settings: Settings
    level: int
    index: int
    weight: Floats | None
    faces: NDArray[np.bool_]
    initial: Floats | None


@dataclass(frozen=True)
class Split:
    """The field of a node, (n,), the faces with its positive child, (m,), and how both came."""

    u: Floats
    positive: NDArray[np.bool_]
    diagnostics: Diagnostics


def bisect(node: Node, progress: Callable[[Progress], None] | None = None) -> Split:
    """Split one node: continuation in epsilon, then the check of the sharp segments.

    Raises
    ------
    DisconnectedError
        Where the segments are to be connected and stay in pieces.
    CollapsedError
        Where a phase is empty.
    ValueError
        For a start by normals on a flat surface.
    """
    # OpenBLAS shares sums over more than 10,000 terms among its threads: the sums then depend on
    # their number, and threads that spin beside those of the core cost far more than they give.
    with threadpool_limits(1, user_api="blas"):
        support = _support(node)
        if support is None:
            return _solve(node, progress)
        part, vertices, faces = support
        split = _solve(part, progress)
        u = np.zeros(node.surface.n_vertices)
        u[vertices] = split.u
        positive = np.zeros(node.surface.n_faces, dtype=np.bool_)
        positive[faces] = split.positive
        return replace(split, u=u, positive=positive)


def _support(node: Node) -> tuple[Node, Ints, Ints] | None:
    """The node on the part of the surface that its indicator reaches, its vertices and faces.

    With all faces within two rings of a vertex where w > 0, no term that u enters is lost: further
    off u is 0. Only paths far outside the parent are, and s is 0 at the border of the part, where
    the penalty of equation (12) has made it so. None where that part is the whole surface or in
    pieces.
    """
    surface = node.surface
    if node.weight is None:
        return None
    reached = node.weight > 0
    reached[surface.faces[node.faces]] = True
    for _ in range(2):
        reached[surface.faces[reached[surface.faces].any(axis=1)]] = True
    covered = np.all(reached[surface.faces], axis=1)
    inside = _with_whole_fans(surface, covered)
    parts = _core.label_components(surface._mesh, inside.astype(np.int64))[inside]
    if inside.all() or parts.min() != parts.max():
        return None
    faces = np.flatnonzero(inside)
    part_surface, vertices = surface.submesh(faces)
    part = replace(
        node,
        surface=part_surface,
        weight=node.weight[vertices],
        faces=node.faces[faces],
        initial=None if node.initial is None else node.initial[vertices],
    )
    return part, vertices, faces


def _with_whole_fans(surface: Surface, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
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


def _solve(node: Node, progress: Callable[[Progress], None] | None) -> Split:
    """Split a node; where distortion leaves it in pieces, again from its shortest interface."""
    try:
        return _attempt(node, progress)
    except DisconnectedError:
        if node.settings.distortion == 0 or node.initial is not None:
            raise
    settings = replace(node.settings, distortion=0.0)
    shortest = _attempt(replace(node, settings=settings), progress)
    return _attempt(replace(node, initial=shortest.u), progress)


def _attempt(node: Node, progress: Callable[[Progress], None] | None) -> Split:
    solver = _NodeSolver(node, progress)
    solver.solve()
    positive, level_set = solver.sharp()
    found = _count_components(node, positive)
    if min(found) == 0:
        raise CollapsedError(
            f"level {node.level + 1}, node {node.index}: the "
            f"{'positive' if found[0] == 0 else 'negative'} phase is empty; the area is off by "
            f"{100 * solver.state.violation:.2g} % of its target"
        )
    crumbs = np.zeros_like(positive)
    if node.settings.connected:
        crumbs = _crumbs(node, positive)
        for _ in range(_REPAIR_ROUNDS):
            if not solver.repair(crumbs, positive):
                break
            solver.resolve()
            positive, level_set = solver.sharp()
            crumbs = _crumbs(node, positive)
        if not _small(node, crumbs):
            raise DisconnectedError(
                f"level {node.level + 1}, node {node.index}: {100 * _share(node, crumbs):.2g} % of "
                f"the area is cut off from the segments after {solver.repairs} rounds of repair"
            )
        positive = positive ^ crumbs
        components = _count_components(node, positive)
        if components != (1, 1):
            raise DisconnectedError(
                f"level {node.level + 1}, node {node.index}: the two segments have "
                f"{components[0]} and {components[1]} components"
            )
    return Split(
        u=solver.state.u,
        positive=positive,
        diagnostics=Diagnostics(
            level=node.level,
            node=node.index,
            energy=solver.state.energy,
            length=solver.length(),
            violation=solver.state.violation,
            iterations=solver.iterations,
            evaluations=solver.evaluations,
            converged=solver.state.converged,
            components=found,
            repairs=solver.repairs,
            relabelled_faces=int(crumbs.sum()),
            relabelled_area=_share(node, crumbs),
            level_set=level_set,
        ),
    )


class _Level:
    """A node on one surface of its hierarchy, and what is built once for it."""

    def __init__(self, node: Node, coarse: Coarse | None = None) -> None:
        self.node = node
        self._coarse = coarse
        self.inside = np.ones(node.surface.n_vertices) if node.weight is None else node.weight
        settings = node.settings
        self.area = Area(node.surface, settings.epsilon, delta=settings.delta, weight=node.weight)

    @property
    def map(self) -> Coarse:
        """The maps from and to the finer surface, of which the finest has none."""
        assert self._coarse is not None
        return self._coarse

    def coarser(self) -> _Level | None:
        """The node on the simplified surface, unless it is too thin for that."""
        node = self.node
        coarse = coarsen(node.surface)
        if coarse is None:
            return None
        inside = np.bincount(
            node.surface.faces.reshape(-1),
            np.repeat(node.faces * node.surface.face_areas, 3),
            minlength=node.surface.n_vertices,
        )
        share: Floats = coarse.restriction @ (inside / (3 * node.surface.mass))
        faces = coarse.surface.face_mean(share) >= 0.5
        if not faces.any():
            return None
        return _Level(
            replace(
                node,
                surface=coarse.surface,
                # Means of values up to 1 may round to more.
                weight=None
                if node.weight is None
                else np.minimum(coarse.restriction @ node.weight, 1.0),
                faces=faces,
            ),
            coarse,
        )


@dataclass(frozen=True)
class _State:
    """A field on one surface of the hierarchy, finest first, and where its solve ended.

    `weight` multiplies the connectedness functional.
    """

    u: Floats
    at: int
    multiplier: float
    penalty: float
    weight: float = 1.0
    energy: float = np.nan
    violation: float = np.nan
    converged: bool = False


class _Stage(NamedTuple):
    """An interface width and the surface of the hierarchy to solve on."""

    epsilon: float
    at: int


class _Round(NamedTuple):
    """How many starts go on after so many stages."""

    stages: int
    kept: int


class _End(NamedTuple):
    """Where a start has led, and the stages that are left."""

    in_pieces: bool
    state: _State
    left: list[_Stage]


_Start = Callable[[list[_Stage]], list[_Stage]]


class _NodeSolver:
    """The solves of one node, from wide interfaces on coarse surfaces to the given ones."""

    def __init__(self, node: Node, progress: Callable[[Progress], None] | None) -> None:
        self.progress = progress
        self.levels = [_Level(node)]
        self.size = float(np.sqrt(self.levels[0].area.total))
        if node.settings.coarse and node.initial is None:
            coarsest = node.settings.coarsest or self.size * _COARSEST
            while 2 * self.levels[-1].node.surface.mean_edge_length <= _RESOLVED * coarsest:
                coarser = self.levels[-1].coarser()
                if coarser is None:
                    break
                self.levels.append(coarser)
        u = np.zeros(node.surface.n_vertices) if node.initial is None else node.initial
        self.state = _State(u, 0, 0.0, node.settings.penalty)
        self.roughly = False
        self.random = np.random.default_rng([node.settings.seed, node.level, node.index])
        self.iterations = 0
        self.evaluations = 0
        self.repairs = 0

    @property
    def level(self) -> _Level:
        return self.levels[self.state.at]

    @property
    def node(self) -> Node:
        return self.level.node

    def solve(self) -> None:
        """Halve epsilon down to its value, each stage from the minimiser of the last."""
        stages = self._stages()
        if self.node.initial is not None:
            self._descend(stages)
            return
        cheap = sum(self.levels[at].node.surface.n_vertices <= _CHEAP for _, at in stages)
        starts, rounds = self._starts(cheap), self._rounds(stages, cheap)
        self.roughly = len(starts) > 1
        rivals = []
        for start in starts:
            left = start(stages)
            rivals.append((self.state, left))
        for round_ in rounds:
            ends = []
            for self.state, left in rivals:
                todo = max(0, round_.stages - (len(stages) - len(left)))
                self._descend(left[:todo])
                ends.append(_End(self._in_pieces(), self.state, left[todo:]))
            rivals = [(end.state, end.left) for end in _best(ends, round_.kept)]
            self.roughly = False
        self.state, left = rivals[0]
        self._descend(left)

    def _starts(self, cheap: int) -> Sequence[_Start]:
        """Ways to start, which set a field and return the stages that are left to do.

        With distortion none is the best everywhere, and a wide interface does not tell.
        """
        settings = self.node.settings
        if settings.initial == "normals":
            return [self._clustered]
        if settings.distortion > 0:
            rivals = [self._split_by_normals, self._shortest] if settings.initial == "auto" else []
            return [self._parted_noise, *rivals]
        if settings.initial == "random" or cheap == 0:
            return [self._random]
        others = [self._narrower_random if cheap > 1 else self._random]
        return [self._random, *others] * (_RANDOM_STARTS // 2)

    def _rounds(self, stages: list[_Stage], cheap: int) -> list[_Round]:
        """After which stages the starts are compared, the first of which are cheap."""
        if self.node.settings.distortion > 0:
            before_last = max(1, len(stages) - 1)
            rounds = [_Round(min(cheap, before_last), 2), _Round(before_last, 1)]
        else:
            # The perimeter tells soon.
            rounds = [_Round(min(cheap, 2), 2), _Round(cheap, 1)]
        return [round_ for round_ in rounds if round_.stages > 0]

    def _descend(self, stages: list[_Stage]) -> None:
        for stage in stages:
            last = stage == _Stage(self.node.settings.epsilon, 0)
            self.state = replace(self.state, weight=1.0)
            self._stage(stage, last=last)
            if self.node.settings.connected and not last:
                # A coarse stage is cheap to repair: what it leaves apart would have to grow a
                # bridge, or melt, on the finer ones.
                for _ in range(_REPAIR_ROUNDS):
                    if not self.repair(*self._found_crumbs()):
                        break
                    self._stage(stage, max_iterations=_COARSE_REPAIR_STEPS)

    def resolve(self) -> None:
        """Solve again from the present field."""
        last = _Stage(self.node.settings.epsilon, 0)
        self._stage(last, last=True, max_iterations=_REPAIR_STEPS)

    def _random(self, stages: list[_Stage]) -> list[_Stage]:
        """Random values, parted by the widest interface."""
        self._set(stages[0].at, self._noise)
        if len(stages) == 1:
            return stages
        # By the perimeter alone: noise has hundreds of components.
        self._stage(stages[0], alone=True)
        return stages[1:]

    def _narrower_random(self, stages: list[_Stage]) -> list[_Stage]:
        """Random values, parted by the second widest interface."""
        return self._random(stages[1:])

    def _clustered(self, stages: list[_Stage]) -> list[_Stage]:
        """Two clusters of normals."""
        self._set(stages[0].at, self._clusters)
        return stages

    def _parted_noise(self, stages: list[_Stage]) -> list[_Stage]:
        """Random values after the few steps in which they part into a labyrinth of phases."""
        stage = stages[0]._replace(epsilon=0.5 * stages[0].epsilon)
        self._set(stage.at, self._noise)
        self._stage(stage, alone=True, max_iterations=_NOISE_STEPS)
        return stages

    def _split_by_normals(self, stages: list[_Stage]) -> list[_Stage]:
        """The split along the principal axis of the normals that is best after some steps."""
        level = self.levels[stages[0].at]
        penalty = level.node.settings.penalty
        rivals = [
            _State(u, stages[0].at, 0.0, penalty)
            for u in _splits_of_normals(level.node, level.inside)
        ]
        steps = _START_STEPS
        while len(rivals) > 1:
            tried = []
            for self.state in rivals:
                self._stage(stages[0], max_iterations=steps)
                tried.append(self.state)
            tried.sort(key=lambda state: state.energy)
            rivals = tried[: len(tried) // 2]
            steps *= 2
        if rivals:
            self.state = rivals[0]
        return stages

    def _shortest(self, stages: list[_Stage]) -> list[_Stage]:
        """The field of least perimeter."""
        widths = self._halved(stages[0].epsilon, self.size * _COARSEST)
        wide = [_Stage(width, self._coarsest_for(_RESOLVED * width)) for width in widths]
        self._set(wide[0].at, self._noise)
        for stage in wide:
            self._stage(stage, alone=True)
        return stages

    def _set(self, at: int, field: Callable[[Node], Floats]) -> None:
        node = self.levels[at].node
        self.state = _State(field(node), at, 0.0, node.settings.penalty)

    def _noise(self, node: Node) -> Floats:
        return self.random.uniform(-1, 1, node.surface.n_vertices)

    def _clusters(self, node: Node) -> Floats:
        """Two clusters of normals."""
        normals = node.surface.vertex_normals
        members = np.unique(node.surface.faces[node.faces])
        if np.ptp(normals[members], axis=0).max() < _SAME_NORMALS:
            raise ValueError('initial: "normals" needs normals that differ; this surface is flat')
        _, cluster = scipy.cluster.vq.kmeans2(normals[members], 2, minit="++", rng=self.random)
        u = np.zeros(node.surface.n_vertices)
        u[members] = np.where(cluster == 0, 1.0, -1.0)
        return u

    def _move(self, at: int) -> None:
        """Carry the field over to another surface of the hierarchy."""
        u = self.state.u
        for k in range(self.state.at, at, -1):
            u = self.levels[k].map.prolongation @ u
        for k in range(self.state.at, at):
            u = self.levels[k + 1].map.restriction @ u
        self.state = replace(self.state, u=u, at=at)

    def _stages(self) -> list[_Stage]:
        """Widths of the interface and the surfaces to solve on, down to the given ones."""
        settings = self.node.settings
        if settings.coarsest is not None:
            coarsest = settings.coarsest
        elif self.node.initial is not None:
            coarsest = 0.0
        else:
            coarsest = self.size * (_COARSEST_DISTORTED if settings.distortion > 0 else _COARSEST)
        edges = _RESOLVED if settings.distortion == 0 else _RESOLVED_DISTORTED
        stages: list[_Stage] = []
        for width in self._halved(settings.epsilon, coarsest):
            finest = self._coarsest_for(edges * width) if width > settings.epsilon else 0
            coarse = self._coarsest_for(_RESOLVED * width) if stages else finest
            stages += [_Stage(width, at) for at in range(coarse, finest - 1, -1)]
        return stages

    def _coarsest_for(self, edge_length: float) -> int:
        """The coarsest surface with edges of up to this length, or the finest."""
        lengths = [level.node.surface.mean_edge_length for level in self.levels[1:]]
        return sum(length <= edge_length for length in lengths)

    def _halved(self, epsilon: float, coarsest: float) -> list[float]:
        """Halving widths down to `epsilon`, from at most `coarsest`."""
        widths = [epsilon]
        while 2 * widths[0] <= coarsest:
            widths.insert(0, 2 * widths[0])
        return widths

    def _stage(
        self,
        stage: _Stage,
        *,
        last: bool = False,
        alone: bool = False,
        max_iterations: int | None = None,
    ) -> None:
        """Minimise at one interface width on one surface; the perimeter `alone`, or all."""
        self._move(stage.at)
        epsilon = stage.epsilon
        node, settings, level = self.node, self.node.settings, self.level
        terms: list[tuple[float, Any]] = [(1.0, self._perimeter(epsilon))]
        if settings.connected and not alone:
            connectedness = Connectedness(
                node.surface,
                epsilon,
                weight=node.weight,
                # Only these become segments: a bridge through a neighbour's faces is none.
                inside=node.faces,
                threshold=_THRESHOLD,
                plateau=_PLATEAU,
                saturation=epsilon**2,
                form="tree",
            )
            terms.append((self.state.weight * epsilon**-settings.kappa, connectedness))
        if settings.distortion > 0 and not alone:
            distortion = Distortion(
                node.surface,
                epsilon,
                law=settings.law,
                delta=settings.delta,
                weight=node.weight,
            )
            terms.append((settings.distortion, distortion))
        mass = node.surface.mass
        # The diagonal of the perimeter's Hessian at the pure phases, Psi''(1) = 9/2.
        hessian = (level.inside + settings.eta) * (
            epsilon * node.surface.stiffness_diagonal + 4.5 / epsilon * mass
        )
        hessian += 2 / settings.sigma * (1 - level.inside) * mass
        before = self.iterations

        def report(iteration: Iteration) -> None:
            if self.progress is not None:
                self.progress(
                    Progress(
                        node.level + 1,
                        node.index,
                        epsilon,
                        before + iteration.number,
                        iteration.energy,
                    )
                )

        result = SOLVERS[settings.solver](
            terms,
            level.area,
            0.5 * level.area.total,
            self.state.u,
            scale=np.sqrt(hessian),
            # The perimeter alone, with the areas free, would shrink to one phase.
            area="lagrangian" if alone and settings.area == "none" else settings.area,
            multiplier=self.state.multiplier,
            penalty=self.state.penalty,
            max_iterations=min(settings.max_iterations, max_iterations or settings.max_iterations),
            callback=report,
            **self._tolerances(last),
        )
        self.state = replace(
            self.state,
            u=result.u,
            multiplier=result.multiplier,
            penalty=result.penalty,
            energy=result.energy,
            violation=result.violation,
            converged=result.converged,
        )
        self.iterations += result.iterations
        self.evaluations += result.evaluations

    def _tolerances(self, last: bool) -> dict[str, Any]:
        settings = self.node.settings
        if not last:
            roughly = {"tolerance": _COARSEST_TOLERANCE} if self.roughly else {}
            return _COARSE[settings.solver] | roughly
        return _DISTORTED[settings.solver] if settings.distortion > 0 else {}

    def _perimeter(self, epsilon: float) -> Perimeter:
        settings = self.node.settings
        return Perimeter(
            self.node.surface,
            epsilon,
            weight=self.node.weight,
            eta=settings.eta,
            sigma=settings.sigma,
        )

    def length(self) -> float:
        """Length of the interface: the weighted perimeter without its confinement, over sqrt 2."""
        confinement = (1 - self.level.inside) @ (self.node.surface.mass * self.state.u**2)
        value, _ = self._perimeter(self.node.settings.epsilon).value_and_gradient(self.state.u)
        return float(value - confinement / self.node.settings.sigma) / float(np.sqrt(2))

    def sharp(self) -> tuple[NDArray[np.bool_], float]:
        """Faces of the positive segment, (m,), and the level set that bounds them.

        The level is the one that halves the area of the node's faces: 0, by symmetry, but for
        the size of a face, which the finest segments feel. Where the area is only penalised,
        or free, it is 0. Where that level would tear a segment which the connectedness
        functional holds together, it is the nearest that the functional sees beyond.
        """
        node, settings = self.node, self.node.settings
        values = node.surface.face_mean(self.state.u)
        faces = np.flatnonzero(node.faces)
        level = 0.0
        if settings.area == "lagrangian":
            order = np.argsort(-values[faces], kind="stable")
            areas = np.cumsum(node.surface.face_areas[faces[order]])
            half = int(np.argmin(np.abs(areas - 0.5 * areas[-1])))
            level = float(values[faces[order[half]]])
        positive = node.faces & (values >= level)
        held = float(np.clip(level, -_THRESHOLD, _THRESHOLD))
        if settings.connected and level != held and _count_components(node, positive) != (1, 1):
            level = held
            positive = node.faces & (values >= level)
        return positive, level

    def repair(self, crumbs: NDArray[np.bool_], positive: NDArray[np.bool_]) -> bool:
        """Turn crumbs over, if there is enough of them, and make the connectedness heavier."""
        if _small(self.node, crumbs):
            return False
        faces = self.node.surface.faces
        u = self.state.u.copy()
        u[faces[crumbs & positive]] = -1.0
        u[faces[crumbs & ~positive]] = 1.0
        weight = min(_REPAIR_GROWTH * self.state.weight, _REPAIR_GROWTH**_REPAIR_ROUNDS)
        self.state = replace(self.state, u=u, weight=weight)
        self.repairs += 1
        return True

    def _in_pieces(self) -> bool:
        """Whether more of a segment that is to be connected is cut off than crumbs."""
        return self.node.settings.connected and not _small(self.node, self._found_crumbs()[0])

    def _found_crumbs(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        positive, _ = self.sharp()
        return _crumbs(self.node, positive), positive


def _best(ends: list[_End], kept: int) -> list[_End]:
    """The ends of least energy, one of each energy; those in pieces come last."""
    best: list[_End] = []
    for end in sorted(ends, key=lambda end: (end.in_pieces, end.state.energy)):
        energies = [other.state.energy for other in best]
        if not np.isclose(energies, end.state.energy, rtol=_SAME_ENERGY, atol=0).any():
            best.append(end)
    return best[:kept]


def _splits_of_normals(node: Node, inside: Floats) -> list[Floats]:
    """Fields that halve the area along each principal axis of the normals, widest first."""
    normals = node.surface.vertex_normals
    measure = inside * node.surface.mass
    _, axes = np.linalg.eigh((normals * measure[:, None]).T @ normals)
    splits = []
    for axis in axes.T[::-1]:
        along = normals @ axis
        order = np.argsort(along, kind="stable")
        below = np.cumsum(measure[order])
        along -= along[order[np.searchsorted(below, 0.5 * below[-1])]]
        width = float(np.sqrt(measure @ along**2 / below[-1]))
        if width > _SAME_NORMALS:
            splits.append(np.tanh(_SPLIT_SLOPE * along / width))
    return splits


def _parts(node: Node, positive: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Side of each face (0 and 1 in the node, -1 outside) and its component."""
    sides = np.where(node.faces, np.where(positive, 0, 1), -1)
    return sides, _core.label_components(node.surface._mesh, sides)


def _count_components(node: Node, positive: NDArray[np.bool_]) -> tuple[int, int]:
    sides, parts = _parts(node, positive)
    return len(np.unique(parts[sides == 0])), len(np.unique(parts[sides == 1]))


def _crumbs(node: Node, positive: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Faces to move to the other side so that both sides connect, where the node does.

    All components but the largest of the positive side move; then all but the largest of what
    the negative side has become.
    """
    moved = np.zeros_like(positive)
    for side in (0, 1):
        sides, parts = _parts(node, positive ^ moved)
        mine = np.flatnonzero(sides == side)
        if len(mine) == 0:
            continue
        areas = np.bincount(parts[mine], weights=node.surface.face_areas[mine])
        moved[mine[parts[mine] != np.argmax(areas)]] ^= True
    return moved


def _small(node: Node, crumbs: NDArray[np.bool_]) -> bool:
    return bool(crumbs.sum() <= _CRUMB_FACES) or _share(node, crumbs) <= _CRUMB_SHARE


def _share(node: Node, faces: NDArray[np.bool_]) -> float:
    areas = node.surface.face_areas
    return float(areas[faces].sum() / areas[node.faces].sum())
