"""One bisection of the tree: problem (6), on deeper levels (10), from a node to its split."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..arrays import Bools
from ..optimise import Timers
from . import sharp
from .grids import Grids, make_grids
from .node import (
    CollapsedError,
    Diagnostics,
    DisconnectedError,
    Node,
    Report,
    Split,
    confine,
)
from .options import Options, Widths
from .stages import REPAIR_ROUNDS, Spent, Stage, State, perimeter, plan, repaired, resolve, run
from .starts import first_state

__all__ = ["bisect", "split"]

_FINER = "a smaller epsilon on finer triangles (phaseatlas remesh) or another seed may help"


def bisect(node: Node, options: Options, widths: Widths, report: Report | None = None) -> Split:
    """Split a node on the part of the surface that its indicator reaches.

    Parameters
    ----------
    node : Node
        What to split.
    options : Options
        How.
    widths : Widths
        At which lengths.
    report : callable, optional
        Called with a `Progress` after each step; a true answer stops the segmentation.

    Raises
    ------
    DisconnectedError
        Where the segments are to be connected and stay in pieces.
    CollapsedError
        Where a phase is empty.
    StoppedError
        Where `report` asked for it.
    ValueError
        For a start by normals on a flat surface.
    """
    # OpenBLAS shares sums over more than 10,000 terms among its threads: the sums then depend on
    # their number, and threads that spin beside those of the core cost far more than they give.
    with threadpool_limits(1, user_api="blas"):
        confined = confine(node)
        if confined is None:
            return split(node, options, widths, report)
        part, vertices, faces = confined
        found = split(part, options, widths, report)
        u = np.zeros(node.surface.n_vertices)
        u[vertices] = found.u
        positive = np.zeros(node.surface.n_faces, dtype=np.bool_)
        positive[faces] = found.positive
        return replace(found, u=u, positive=positive)


def split(node: Node, options: Options, widths: Widths, report: Report | None = None) -> Split:
    """Split a node on its whole surface, with the errors of `bisect`.

    Where distortion leaves it in pieces, it is split again from its shortest interface.
    """
    try:
        return _attempt(node, options, widths, report)
    except DisconnectedError:
        if options.distortion == 0 or node.start is not None:
            raise
    shortest = _attempt(node, replace(options, distortion=0.0), widths, report)
    return _attempt(replace(node, start=shortest.u), options, widths, report)


def _attempt(node: Node, options: Options, widths: Widths, report: Report | None) -> Split:
    """Wide interfaces on simplified surfaces, then the given one, then sharp segments."""
    timers = Timers()
    grids = make_grids(node, options, widths, timers)
    stages = plan(grids)
    state = first_state(grids, stages, Spent(seconds=timers.seconds), report)
    for stage in stages[state.done :]:
        state = run(grids, stage, state, report)
    state, segments = _sharpen(grids, stages[-1], state, report)
    return Split(state.point.u, segments.positive, _diagnostics(grids, state, segments))


@dataclass(frozen=True, eq=False)
class _Segments:
    """The sharp segments of a node and how they came.

    `positive` are the faces of the positive one, and `components` were counted before any repair;
    `islands` are the faces that were relabelled after it.
    """

    positive: Bools
    threshold: float
    components: tuple[int, int]
    islands: Bools


def _sharpen(
    grids: Grids, final: Stage, state: State, report: Report | None
) -> tuple[State, _Segments]:
    """Cut a field at its threshold; large islands are turned over, small ones relabelled.

    After islands were turned over, the final stage is solved again.
    """
    node, grid = grids.node, grids.grids[0]
    positive, threshold = sharp.cut(grid, state.point.u, node.share, grids.options)
    found = sharp.count_components(grid, positive)
    if min(found) == 0:
        raise CollapsedError(_collapsed(grids, state, "positive" if found[0] == 0 else "negative"))
    if not grids.options.connected:
        return state, _Segments(positive, threshold, found, np.zeros_like(positive))
    for _ in range(REPAIR_ROUNDS):
        again = repaired(grids, state)
        if again is None:
            break
        state = resolve(grids, final, again, report)
        positive, threshold = sharp.cut(grid, state.point.u, node.share, grids.options)
    islands = sharp.islands(grid, positive)
    if not sharp.negligible(grid, islands):
        raise DisconnectedError(
            f"{node.name}: {100 * sharp.part_of_area(grid, islands):.2g} % of the area is cut off "
            f"from the segments after {state.spent.repairs} rounds of repair; {_FINER}"
        )
    positive = positive ^ islands
    components = sharp.count_components(grid, positive)
    if min(components) == 0:
        empty = "positive" if components[0] == 0 else "negative"
        raise CollapsedError(_collapsed(grids, state, empty))
    if components != (1, 1):
        raise DisconnectedError(
            f"{node.name}: the two segments have {components[0]} and {components[1]} components; "
            f"{_FINER}"
        )
    return state, _Segments(positive, threshold, found, islands)


def _collapsed(grids: Grids, state: State, phase: str) -> str:
    """What is said of a phase that has no face."""
    empty = f"{grids.node.name}: the {phase} phase is empty"
    if grids.options.area == "none":
        return f'{empty}, for its area is free; area="lagrangian" holds it'
    assert state.solution is not None, "the last stage has been solved"
    missed = 100 * abs(state.solution.violation)
    return f"{empty}; the diffuse area is off by {missed:.2g} % of its target; {_FINER}"


def _diagnostics(grids: Grids, state: State, segments: _Segments) -> Diagnostics:
    node, grid, solution = grids.node, grids.grids[0], state.solution
    assert solution is not None, "the last stage has been solved"
    return Diagnostics(
        level=node.level,
        node=node.index,
        energy=solution.energy,
        length=perimeter(grids, grid, grids.widths.epsilon).length(state.point.u),
        violation=solution.violation,
        iterations=state.spent.iterations,
        evaluations=state.spent.evaluations,
        converged=solution.converged,
        components=segments.components,
        repairs=state.spent.repairs,
        relabelled_faces=int(segments.islands.sum()),
        relabelled_area=sharp.part_of_area(grid, segments.islands),
        level_set=segments.threshold,
        status=str(solution.status),
        share=node.share,
        sharp_share=sharp.part_of_area(grid, segments.positive),
        seconds=state.spent.seconds,
    )
