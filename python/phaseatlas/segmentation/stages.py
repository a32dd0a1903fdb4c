"""Stages of a bisection, from wide interfaces to the given one: the only place that solves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..functionals import Connectedness, Distortion, Functional, Perimeter
from ..optimise import (
    LIMITS,
    SOLVERS,
    Constraint,
    Iteration,
    Limits,
    Point,
    Problem,
    Solution,
    Status,
    Timers,
)
from . import sharp
from .grids import COARSEST, RESOLVED, Grid, Grids
from .node import Progress, Report, StoppedError

__all__ = [
    "REPAIR_ROUNDS",
    "Spent",
    "Stage",
    "State",
    "halved",
    "limits",
    "perimeter",
    "plan",
    "repaired",
    "run",
    "solve",
]

# With distortion the continuation starts narrower: a limb that is thinner than the interface has no
# inside, and the interface must find the way along it before it has shrunk to its shortest. And
# stages go on to finer edges before the width halves: coarse ones do not tell good from bad.
_COARSEST_DISTORTED = 0.1
_RESOLVED_DISTORTED = 0.35
# Relative gains of a step at which stages end, by benches/compare/solves.py. The distortion is
# stiff: with 1e-7, as without it, most of the steps gain nothing.
_COARSE_TOLERANCE = 1e-5
_ROUGH_TOLERANCE = 1e-4
_DISTORTED_TOLERANCE = 3e-6
# The masses of the connectedness functional: H rises to 1 at this value of u, and masses saturate
# at epsilon^2, the area of the least island: an island at the tip of a limb spares so much
# distortion that its own small mass would not hold it.
_PLATEAU = 0.5
# Rounds of turning islands over, each with a connectedness term heavier by this factor, and steps.
REPAIR_ROUNDS = 4
_REPAIR_GROWTH = 10.0
_REPAIR_STEPS = 1000
_COARSE_REPAIR_STEPS = 200


@dataclass(frozen=True)
class Stage:
    """An interface width, the grid to solve on, and when to end.

    Attributes
    ----------
    epsilon : float
        Interface width relative to sqrt(area).
    grid : int
        Place of the grid among those of the node, finest first.
    limits : Limits
        When the solve ends.
    final : bool
        Whether it is the last stage: the given width on the node's own surface.
    only_perimeter : bool
        Leave connectedness and distortion out.
    """

    epsilon: float
    grid: int
    limits: Limits
    final: bool = False
    only_perimeter: bool = False


@dataclass(frozen=True)
class Spent:
    """Work so far in a node, over all starts."""

    iterations: int = 0
    evaluations: int = 0
    repairs: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def plus(self, solution: Solution, seconds: dict[str, float]) -> Spent:
        """Return the sum with the work of one solve."""
        together = dict(self.seconds)
        for part in (solution.seconds, seconds):
            for name, value in part.items():
                together[name] = together.get(name, 0.0) + value
        return Spent(
            self.iterations + solution.iterations,
            self.evaluations + solution.evaluations,
            self.repairs,
            together,
        )


@dataclass(frozen=True, eq=False)
class State:
    """Where the solve of a node is.

    Attributes
    ----------
    point : Point
        The field on its grid, multiplier and penalty.
    grid : int
        The grid of the field.
    done : int
        How many stages of the plan are done.
    connectedness : float
        Factor of the connectedness term, raised by repairs.
    solution : Solution or None
        Of the last solve; None before the first.
    spent : Spent
        Work so far.
    """

    point: Point
    grid: int
    done: int = 0
    connectedness: float = 1.0
    solution: Solution | None = None
    spent: Spent = field(default_factory=Spent)

    @property
    def energy(self) -> float:
        """Weighted sum of the functionals at the last solution, nan before the first."""
        return np.nan if self.solution is None else self.solution.energy


def plan(grids: Grids) -> list[Stage]:
    """Widths of the interface and the grids to solve on, down to the given ones."""
    options, epsilon = grids.options, grids.widths.epsilon
    distorted = options.distortion > 0
    if grids.widths.start is not None:
        widest = grids.widths.start
    elif grids.node.start is not None:
        widest = 0.0
    else:
        widest = grids.size * (_COARSEST_DISTORTED if distorted else COARSEST)
    resolved = _RESOLVED_DISTORTED if distorted else RESOLVED
    stages: list[Stage] = []
    for width in halved(epsilon, widest):
        finest = grids.coarsest_for(resolved * width) if width > epsilon else 0
        coarsest = grids.coarsest_for(RESOLVED * width) if stages else finest
        for grid in range(coarsest, finest - 1, -1):
            final = (width, grid) == (epsilon, 0)
            stages.append(Stage(width, grid, limits(grids, final=final), final))
    return stages


def halved(epsilon: float, widest: float) -> list[float]:
    """Halving widths down to `epsilon`, from at most `widest`."""
    widths = [epsilon]
    while 2 * widths[0] <= widest:
        widths.insert(0, 2 * widths[0])
    return widths


def limits(grids: Grids, *, final: bool = False, rough: bool = False) -> Limits:
    """When a stage ends; `rough` before starts are first compared."""
    options, share = grids.options, grids.node.share
    given = LIMITS[options.solver]
    # The violation is relative to the positive child's area: it is met to the same part of the
    # smaller child's.
    feasibility = given.feasibility * min(share, 1 - share) / share
    result = replace(given, feasibility=feasibility, max_iterations=options.max_iterations)
    if final:
        if options.distortion > 0 and options.solver == "lbfgs":
            result = replace(result, tolerance=_DISTORTED_TOLERANCE)
        return result
    return replace(
        result, tolerance=_ROUGH_TOLERANCE if rough else _COARSE_TOLERANCE, max_updates=1
    )


def run(grids: Grids, stage: Stage, state: State, report: Report | None = None) -> State:
    """Do a stage of the plan from where the last one ended.

    A coarse stage is cheap to repair: what it leaves apart would have to grow a bridge, or melt,
    on the finer ones.
    """
    state = solve(grids, stage, replace(state, connectedness=1.0), report)
    if grids.options.connected and not stage.final:
        for _ in range(REPAIR_ROUNDS):
            again = repaired(grids, state)
            if again is None:
                break
            state = solve(grids, _shortened(stage, _COARSE_REPAIR_STEPS), again, report)
    return replace(state, done=state.done + 1)


def resolve(grids: Grids, stage: Stage, state: State, report: Report | None = None) -> State:
    """Do the last stage again, after a repair."""
    return solve(grids, _shortened(stage, _REPAIR_STEPS), state, report)


def solve(grids: Grids, stage: Stage, state: State, report: Report | None = None) -> State:
    """Minimise at one interface width on one grid.

    Raises
    ------
    StoppedError
        Where `report` gave a true answer.
    """
    grid, node = grids.grids[stage.grid], grids.node
    u = grids.carry(state.point.u, state.grid, stage.grid)
    timers = Timers()
    with timers.timed("set-up"):
        problem = _problem(grids, grid, stage, state.connectedness)

    def heard(iteration: Iteration) -> object:
        assert report is not None
        return report(
            Progress(
                node.level + 1,
                node.index,
                stage.epsilon,
                state.spent.iterations + iteration.number,
                iteration.energy,
                grid.surface,
                iteration.u,
            )
        )

    solution = SOLVERS[grids.options.solver](
        problem, replace(state.point, u=u), stage.limits, None if report is None else heard
    )
    if solution.status is Status.STOPPED:
        raise StoppedError(f"{node.name}: stopped by the progress callback")
    return replace(
        state,
        point=solution.point,
        grid=stage.grid,
        solution=solution,
        spent=state.spent.plus(solution, timers.seconds),
    )


def repaired(grids: Grids, state: State) -> State | None:
    """Turn islands over and make the connectedness heavier; None where none is worth it."""
    grid = grids.grids[state.grid]
    u = state.point.u
    positive, _ = sharp.cut(grid, u, grids.node.share, grids.options)
    islands = sharp.islands(grid, positive)
    if sharp.negligible(grid, islands):
        return None
    u = u.copy()
    u[grid.surface.faces[islands & positive]] = -1.0
    u[grid.surface.faces[islands & ~positive]] = 1.0
    return replace(
        state,
        point=replace(state.point, u=u),
        connectedness=min(_REPAIR_GROWTH * state.connectedness, _REPAIR_GROWTH**REPAIR_ROUNDS),
        spent=replace(state.spent, repairs=state.spent.repairs + 1),
    )


def in_pieces(grids: Grids, state: State) -> bool:
    """Whether more of a segment that is to be connected is cut off than negligible islands."""
    return grids.options.connected and repaired(grids, state) is not None


def perimeter(grids: Grids, grid: Grid, epsilon: float) -> Perimeter:
    """The perimeter of a node on a grid, equation (9)."""
    options = grids.options
    return Perimeter(
        grid.surface,
        epsilon,
        weight=grid.indicator,
        eta=options.eta,
        sigma=options.sigma,
        seam_cost=grid.surface.diffuse_seam_costs,
    )


def _problem(grids: Grids, grid: Grid, stage: Stage, connectedness: float) -> Problem:
    """Problem (6), on deeper levels (10), with distortion (13), at one width on one grid."""
    options, epsilon = grids.options, stage.epsilon
    length = perimeter(grids, grid, epsilon)
    terms: list[tuple[float, Functional]] = [(1.0, length)]
    if options.connected and not stage.only_perimeter:
        functional = Connectedness(
            grid.surface,
            epsilon,
            weight=grid.indicator,
            # Only these become segments: a bridge through a neighbour's faces is none.
            inside=grid.faces,
            threshold=sharp.THRESHOLD,
            plateau=_PLATEAU,
            saturation=epsilon**2,
            form="tree",
        )
        terms.append((connectedness * epsilon**-options.kappa, functional))
    if options.distortion > 0 and not stage.only_perimeter:
        distortion = Distortion(
            grid.surface,
            epsilon,
            law=options.law,
            delta=grids.widths.delta,
            weight=grid.indicator,
        )
        terms.append((options.distortion, distortion))
    # The perimeter alone, with the areas free, would shrink to one phase.
    kind = "lagrangian" if stage.only_perimeter and options.area == "none" else options.area
    return Problem(
        terms,
        Constraint(grid.area, grids.node.share * grid.area.total, kind),
        np.sqrt(length.preconditioner()),
    )


def _shortened(stage: Stage, steps: int) -> Stage:
    most = min(stage.limits.max_iterations, steps)
    return replace(stage, limits=replace(stage.limits, max_iterations=most))
