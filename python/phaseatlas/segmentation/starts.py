"""Ways to start the solve of a node, and the contest between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.cluster.vq

from ..arrays import Floats
from ..optimise import Point
from .grids import COARSEST, RESOLVED, Grid, Grids
from .node import Report
from .stages import Spent, Stage, State, halved, in_pieces, limits, run, solve

__all__ = ["first_state"]

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
# Normals closer than this are the same; a split by normals is +-tanh of this many deviations.
_SAME_NORMALS = 1e-9
_SPLIT_SLOPE = 6.0


@dataclass(frozen=True, eq=False)
class _Contest:
    """What every start is given."""

    grids: Grids
    stages: Sequence[Stage]
    rough: bool
    random: np.random.Generator
    report: Report | None

    def solve(
        self,
        stage: Stage,
        state: State,
        *,
        steps: int | None = None,
        only_perimeter: bool = False,
    ) -> State:
        """Solve a stage as a trial, which ends early."""
        trial = limits(self.grids, rough=self.rough)
        if steps is not None:
            trial = replace(trial, max_iterations=min(trial.max_iterations, steps))
        stage = replace(stage, limits=trial, final=False, only_perimeter=only_perimeter)
        return solve(self.grids, stage, state, self.report)

    def state(self, u: Floats, grid: int, spent: Spent) -> State:
        """A field to start from."""
        return State(Point(u, 0.0, self.grids.options.penalty), grid, spent=spent)

    def noise(self, grid: int, spent: Spent) -> State:
        """Random values in [-1, 1]."""
        n = self.grids.grids[grid].surface.n_vertices
        return self.state(self.random.uniform(-1, 1, n), grid, spent)


#: A way to start; None where the node has no such start.
Start = Callable[[_Contest, Spent], State | None]


def first_state(
    grids: Grids, stages: Sequence[Stage], spent: Spent, report: Report | None = None
) -> State:
    """Start a node: the given field, or the best of several starts after the first stages.

    Returns
    -------
    State
        Its `done` counts the stages that need not be done again; its `spent` is of all starts.

    Raises
    ------
    ValueError
        For a start by normals on a flat surface.
    """
    node, options = grids.node, grids.options
    random = np.random.default_rng([options.seed, node.level, node.index])
    if node.start is not None:
        return State(Point(node.start, 0.0, options.penalty), 0, spent=spent)
    cheap = sum(grids.grids[stage.grid].surface.n_vertices <= _CHEAP for stage in stages)
    starts = _starts(grids, cheap)
    contest = _Contest(grids, stages, len(starts) > 1, random, report)
    rivals = []
    for start in starts:
        state = start(contest, spent)
        if state is not None:
            rivals.append(state)
            spent = state.spent
    rough = contest.rough
    for until, kept in _rounds(grids, stages, cheap):
        ends = []
        for rival in rivals:
            state = replace(rival, spent=spent)
            for stage in stages[rival.done : until]:
                if rough and not stage.final:
                    stage = replace(stage, limits=limits(grids, rough=True))
                state = run(grids, stage, state, report)
            spent = state.spent
            ends.append(state)
        rivals = _best(grids, ends, kept)
        rough = False
    return replace(rivals[0], spent=spent)


def _starts(grids: Grids, cheap: int) -> Sequence[Start]:
    """Ways to start; with distortion none is the best everywhere, and a wide interface is blind."""
    options = grids.options
    if options.initial == "normals":
        return [_clusters_of_normals]
    if options.distortion > 0:
        rivals = [_split_by_normals, _shortest] if options.initial == "auto" else []
        return [_parted_noise, *rivals]
    if options.initial == "random" or cheap == 0:
        return [_noise]
    others = [_narrower_noise if cheap > 1 else _noise]
    return [_noise, *others] * (_RANDOM_STARTS // 2)


def _rounds(grids: Grids, stages: Sequence[Stage], cheap: int) -> list[tuple[int, int]]:
    """After how many stages starts are compared, and how many go on; the first ones are cheap."""
    if grids.options.distortion > 0:
        before_last = max(1, len(stages) - 1)
        rounds = [(min(cheap, before_last), 2), (before_last, 1)]
    else:
        # The perimeter tells soon.
        rounds = [(min(cheap, 2), 2), (cheap, 1)]
    return [(until, kept) for until, kept in rounds if until > 0]


def _best(grids: Grids, ends: Sequence[State], kept: int) -> list[State]:
    """The ends of least energy, one of each energy; those in pieces come last."""
    best: list[State] = []
    for end in sorted(ends, key=lambda end: (in_pieces(grids, end), end.energy)):
        energies = [other.energy for other in best]
        if not np.isclose(energies, end.energy, rtol=_SAME_ENERGY, atol=0).any():
            best.append(end)
    return best[:kept]


def _noise(contest: _Contest, spent: Spent, first: int = 0) -> State:
    """Random values, parted by the widest interface."""
    stage = contest.stages[first]
    state = replace(contest.noise(stage.grid, spent), done=first)
    if first + 1 == len(contest.stages):
        return state
    # By the perimeter alone: noise has hundreds of components.
    state = contest.solve(stage, state, only_perimeter=True)
    return replace(state, done=first + 1)


def _narrower_noise(contest: _Contest, spent: Spent) -> State:
    """Random values, parted by the second widest interface."""
    return _noise(contest, spent, 1)


def _parted_noise(contest: _Contest, spent: Spent) -> State:
    """Random values after the few steps in which they part into a labyrinth of phases."""
    stage = contest.stages[0]
    stage = replace(stage, epsilon=0.5 * stage.epsilon)
    state = contest.noise(stage.grid, spent)
    return contest.solve(stage, state, steps=_NOISE_STEPS, only_perimeter=True)


def _clusters_of_normals(contest: _Contest, spent: Spent) -> State:
    """Two clusters of normals."""
    at = contest.stages[0].grid
    grid = contest.grids.grids[at]
    normals = grid.surface.vertex_normals
    members = np.unique(grid.surface.faces[grid.faces])
    if np.ptp(normals[members], axis=0).max() < _SAME_NORMALS:
        raise ValueError('initial: "normals" needs normals that differ; this surface is flat')
    _, cluster = scipy.cluster.vq.kmeans2(normals[members], 2, minit="++", rng=contest.random)
    u = np.zeros(grid.surface.n_vertices)
    u[members] = np.where(cluster == 0, 1.0, -1.0)
    return contest.state(u, at, spent)


def _split_by_normals(contest: _Contest, spent: Spent) -> State | None:
    """The split along the principal axis of the normals that is best after some steps."""
    stage = contest.stages[0]
    grid = contest.grids.grids[stage.grid]
    splits = _splits_of_normals(grid, contest.grids.node.share)
    rivals = [contest.state(u, stage.grid, spent) for u in splits]
    steps = _START_STEPS
    while len(rivals) > 1:
        tried = []
        for rival in rivals:
            state = contest.solve(stage, replace(rival, spent=spent), steps=steps)
            spent = state.spent
            tried.append(state)
        tried.sort(key=lambda state: state.energy)
        rivals = tried[: len(tried) // 2]
        steps *= 2
    return replace(rivals[0], spent=spent) if rivals else None


def _shortest(contest: _Contest, spent: Spent) -> State:
    """The field of least perimeter."""
    grids, last = contest.grids, contest.stages[0]
    widths = halved(last.epsilon, grids.size * COARSEST)
    at = [grids.coarsest_for(RESOLVED * width) for width in widths]
    state = contest.noise(at[0], spent)
    for width, grid in zip(widths, at, strict=True):
        stage = replace(last, epsilon=width, grid=grid)
        state = contest.solve(stage, state, only_perimeter=True)
    return state


def _splits_of_normals(grid: Grid, share: float) -> list[Floats]:
    """Fields that cut the share along each principal axis of the normals, widest first."""
    normals = grid.surface.vertex_normals
    measure = grid.inside * grid.surface.mass
    _, axes = np.linalg.eigh((normals * measure[:, None]).T @ normals)
    splits = []
    for axis in axes.T[::-1]:
        along = normals @ axis
        order = np.argsort(along, kind="stable")
        below = np.cumsum(measure[order])
        along -= along[order[np.searchsorted(below, (1 - share) * below[-1])]]
        width = float(np.sqrt(measure @ along**2 / below[-1]))
        if width > _SAME_NORMALS:
            splits.append(np.tanh(_SPLIT_SLOPE * along / width))
    return splits
