"""The tree of one surface: its working surface, and the nodes in the order of their parents."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from ..arrays import Floats
from ..functionals import indicator
from ..optimise import Status
from ..side_by_side import submitted
from ..surface import Surface
from ..transfer import Transfer
from ..working import needles, working_surface
from .back import carried_back, with_whole_polygons
from .bisect import bisect
from .halfway import halfway
from .node import (
    CollapsedError,
    Diagnostics,
    DisconnectedError,
    Node,
    Progress,
    Report,
    Split,
    StoppedError,
)
from .options import Initial, Options, Widths
from .tree import SegmentTree, children, front, outline, paths

__all__ = ["grow"]

# A refined surface with a triangle of less quality is stiff: by default it takes one start instead
# of eight, and so many steps a stage. Whole faces do not show the difference.
_STIFF = 1e-3
_STEPS = 500
# Sharp segments whose areas miss their shares by more than this part are said to.
_SHARP_MISS = 0.01


def grow(
    surface: Surface,
    parts: Sequence[float],
    options: Options,
    initial: Initial | ArrayLike,
    executor: Executor | None,
    progress: Report | None,
    warn: Callable[[str], object],
) -> SegmentTree:
    """Cut a surface into segments whose areas are in proportion to `parts`.

    Parameters
    ----------
    surface : Surface
    parts : sequence of float
    options : Options
    initial : str or array
        As in `segment`.
    executor : Executor or None
        Runs the nodes of a level.
    progress : callable or None
    warn : callable
        Called with what is worse than asked for.
    """
    steps = working_surface(surface, len(parts), options.epsilon, simplify=options.coarse)
    if steps:
        initial = _forward(steps, surface, initial)
        target, quick = steps[-1].target, _quick(options, steps[-1])
        found = _solved(target, parts, quick, initial, executor, progress, warn, refined=True)
        tree = carried_back(found, steps, options)
    else:
        tree = with_whole_polygons(
            _solved(surface, parts, options, initial, executor, progress, warn)
        )
    _warn(tree, options, warn)
    return tree


def _solved(
    surface: Surface,
    parts: Sequence[float],
    options: Options,
    initial: Initial | ArrayLike,
    executor: Executor | None,
    progress: Report | None,
    warn: Callable[[str], object],
    *,
    refined: bool = False,
) -> SegmentTree:
    """Cut a surface itself."""
    widths = options.widths(surface)
    length = float(np.sqrt(surface.area))
    if widths.epsilon * length < surface.mean_edge_length:
        warn(
            f"epsilon: {widths.epsilon * length:.6g} is below the mean edge length, "
            f"{surface.mean_edge_length:.6g}, and the triangles do not resolve the interface; a "
            "larger epsilon or finer triangles (phaseatlas remesh) help"
        )
    nodes = outline(parts)
    split, ways = children(nodes), paths(nodes)
    starts = _given_fields(surface, list(split), initial)
    unit = surface.scaled(1 / length)
    thin = refined and needles(surface)
    owner = np.zeros(surface.n_faces, dtype=np.int64)
    indicators: dict[int, Floats | None] = {0: None}
    for level in range(max(map(len, ways))):
        splitting = [k for k in split if len(ways[k]) == level]
        work = [
            Node(
                surface=unit,
                path=ways[k],
                share=nodes[split[k][0]].share / nodes[k].share,
                indicator=indicators[k],
                faces=owner == k,
                start=starts.get(k),
            )
            for k in splitting
        ]
        done = _run(work, options, widths, executor, progress, thin)
        for k, node, found in zip(splitting, work, done, strict=True):
            diagnostics = replace(found.diagnostics, length=found.diagnostics.length * length)
            nodes[k] = replace(nodes[k], field=found.u, diagnostics=diagnostics)
            first, second = split[k]
            owner[node.faces] = np.where(found.positive[node.faces], first, second)
            inside = 1.0 if node.indicator is None else node.indicator
            chi = indicator(found.u, widths.delta)
            indicators[first], indicators[second] = inside * chi, inside * (1 - chi)

    number = np.zeros(len(nodes), dtype=np.int64)
    leaves = front(nodes, len(nodes))
    number[leaves] = np.arange(len(leaves))
    return SegmentTree(surface, widths.epsilon * length, widths.delta, tuple(nodes), number[owner])


def _quick(options: Options, step: Transfer) -> Options:
    """Less work by default where a refined surface is stiff, and shows little of what it gains."""
    stiff = float(step.target.face_quality.min()) < _STIFF
    by_default = (options.max_iterations, options.initial) == (
        Options.max_iterations,
        Options.initial,
    )
    if stiff and by_default and step.origin_face is not None:
        return replace(options, max_iterations=_STEPS, initial="random")
    return options


def _forward(
    steps: Sequence[Transfer], surface: Surface, initial: Initial | ArrayLike
) -> Initial | ArrayLike:
    """Fields to start from, on the working surface."""
    if isinstance(initial, str):
        return initial
    fields = np.asarray(initial, dtype=np.float64)
    if fields.ndim not in (1, 2) or fields.shape[-1] != surface.n_vertices:
        raise ValueError(f"initial: shape {fields.shape} must end in {surface.n_vertices}")
    for step in steps:
        fields = (step.forward @ fields.T).T
    return fields


def _given_fields(
    surface: Surface, split: Sequence[int], initial: Initial | ArrayLike
) -> dict[int, Floats]:
    """The fields to start from, by the nodes that they are for."""
    if isinstance(initial, str):
        return {}
    fields = np.asarray(initial, dtype=np.float64)
    shapes = [(surface.n_vertices,), (len(split), surface.n_vertices)]
    if fields.shape not in shapes:
        raise ValueError(f"initial: shape {fields.shape} must be {shapes[0]} or {shapes[1]}")
    fields = fields.reshape(-1, surface.n_vertices)
    return {k: surface.vector("initial", field) for k, field in zip(split, fields, strict=False)}


def _run(
    nodes: Sequence[Node],
    options: Options,
    widths: Widths,
    executor: Executor | None,
    progress: Report | None,
    thin: bool,
) -> list[Split]:
    # Set here too: limits that overlapping threads set and reset would undo one another.
    with threadpool_limits(1, user_api="blas"):
        if executor is None:
            return [_bisect(node, options, widths, thin, progress) for node in nodes]
        calls = [(node, options, widths, thin) for node in nodes]
        splits = []
        with submitted(executor, _bisect, calls) as futures:
            for node, future in zip(nodes, futures, strict=True):
                split = future.result()
                splits.append(split)
                if progress is not None and progress(_end(node, split, widths)):
                    raise StoppedError(f"{node.name}: stopped by the progress callback")
        return splits


def _bisect(
    node: Node, options: Options, widths: Widths, thin: bool, progress: Report | None = None
) -> Split:
    """Split a node by a phase field; by default half way between its ends where that fails."""
    by_default = options.connected and options.epsilon is None and options.area == "lagrangian"
    if by_default and thin and node.start is None:
        found = halfway(node, options, widths, f"{node.name}: most triangles are needles")
        if found is not None:
            return found
    try:
        return bisect(node, options, widths, progress)
    except (CollapsedError, DisconnectedError) as error:
        found = halfway(node, options, widths, str(error).split(";")[0]) if by_default else None
        if found is None:
            raise
        return found


def _end(node: Node, split: Split, widths: Widths) -> Progress:
    done = split.diagnostics
    return Progress(node.level + 1, node.index, widths.epsilon, done.iterations, done.energy)


def _warn(tree: SegmentTree, options: Options, warn: Callable[[str], object]) -> None:
    """Say what makes the tree worse than asked for."""
    for d in tree.diagnostics:
        if d.fallback:
            warn(f"{d.fallback}: it was split half way between its ends, without a phase field")
        elif not d.converged:
            warn(_unconverged(d))
    if options.area != "lagrangian":
        return
    off = np.abs(tree.areas / (tree.shares * tree.surface.area) - 1)
    worst = int(np.argmax(off))
    if off[worst] > _SHARP_MISS:
        warn(
            f"areas: sharp segment {worst} misses its share by {100 * off[worst]:.3g} %, where "
            f"{100 * _SHARP_MISS:g} % is expected; finer triangles (phaseatlas remesh) help"
        )


def _unconverged(d: Diagnostics) -> str:
    return (
        f"level {d.level + 1}, node {d.node}: not converged after {d.iterations} iterations, "
        f"{Status(d.status).sentence}; the area is off by {d.violation:.1e}; more steps "
        "(max_iterations), another seed or a larger epsilon may help"
    )
