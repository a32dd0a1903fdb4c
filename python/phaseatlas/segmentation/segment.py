"""Hierarchical segmentation, section 4: the tree, its nodes solved level by level."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from .. import quality
from ..arrays import Floats
from ..functionals import indicator
from ..optimise import AreaConstraint, Solver, Status
from ..scene.scene import Scene
from ..seam_costs import with_seam_cost
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
from .options import Initial, Law, Options, Widths
from .scene import SceneSegmentation, leaves_of_pieces
from .shares import check_levels, parts_of
from .tree import SegmentTree, children, front, outline, paths

__all__ = ["segment"]

# A refined surface with a triangle of less quality is stiff: by default it takes one start instead
# of eight, and so many steps a stage. Whole faces do not show the difference.
_STIFF = 1e-3
_STEPS = 500
# Sharp segments whose areas miss their shares by more than this part are said to.
_SHARP_MISS = 0.01


@overload
def segment(surface: Scene, levels: int | None = None, **options: Any) -> SceneSegmentation: ...  # type: ignore[overload-overlap]


@overload
def segment(
    surface: Surface,
    levels: int | None = None,
    *,
    shares: Sequence[float] | None = None,
    epsilon: float | None = Options.epsilon,
    epsilon_start: float | None = Options.epsilon_start,
    connected: bool = Options.connected,
    kappa: float = Options.kappa,
    delta: float | None = Options.delta,
    eta: float = Options.eta,
    sigma: float = Options.sigma,
    area: AreaConstraint = Options.area,
    penalty: float = Options.penalty,
    distortion: float = Options.distortion,
    law: Law = Options.law,
    initial: Initial | ArrayLike = Options.initial,
    seed: int = Options.seed,
    solver: Solver = Options.solver,
    max_iterations: int = Options.max_iterations,
    coarse: bool = Options.coarse,
    seam_cost: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
    progress: Report | None = None,
) -> SegmentTree: ...


def segment(  # type: ignore[misc]
    surface: Surface,
    levels: int | None = None,
    *,
    shares: Sequence[float] | None = None,
    epsilon: float | None = Options.epsilon,
    epsilon_start: float | None = Options.epsilon_start,
    connected: bool = Options.connected,
    kappa: float = Options.kappa,
    delta: float | None = Options.delta,
    eta: float = Options.eta,
    sigma: float = Options.sigma,
    area: AreaConstraint = Options.area,
    penalty: float = Options.penalty,
    distortion: float = Options.distortion,
    law: Law = Options.law,
    initial: Initial | ArrayLike = Options.initial,
    seed: int = Options.seed,
    solver: Solver = Options.solver,
    max_iterations: int = Options.max_iterations,
    coarse: bool = Options.coarse,
    seam_cost: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
    progress: Report | None = None,
) -> SegmentTree | SceneSegmentation:
    """Cut a surface into segments of equal area, or of given shares, by recursive bisection.

    Each node minimises the perimeter of its interface and, if asked for, connectedness and
    conformal distortion, problems (6) and (13) and on deeper levels (10).

    Parameters
    ----------
    surface : Surface or Scene
        What to cut. It is scaled to unit area first. The segments of a scene are given out to its
        pieces by area, at least one each; those of a piece have equal areas. Coarse surfaces are
        refined and fine ones simplified for the solve; segments are of whole faces of the surface
        as it was given.
    levels : int, optional
        Depth of the binary tree of halves, 2**levels segments, or as many as there are faces; 1 by
        default.
    shares : sequence of float, optional
        Instead of `levels`: positive numbers in proportion to which the segments get their areas,
        as many segments as numbers, by bisections into unequal parts. Not for scenes of several
        pieces.
    epsilon, epsilon_start, connected, kappa, delta, eta, sigma, area, penalty, distortion, law, \
seed, solver, max_iterations, coarse
        The options of `Options`, which says what they mean.
    initial : {"auto", "random", "normals"} or array
        As in `Options`, or fields of shape (n,) for the root or (segments - 1, n) for all nodes,
        level by level.
    seam_cost, keep, creases : optional
        Where seams may run, as in `with_seam_cost`. The perimeter takes the factors, which do not
        tell where they are finer than `epsilon`, and the faces to keep belong to one segment each
        connected part. The lengths of `Diagnostics` are weighted.
    executor : concurrent.futures.Executor, optional
        Runs the nodes of a level side by side; the result does not depend on it.
    progress : callable, optional
        Called with a `Progress` after each step, which holds the field; with an executor, after
        each node. A true answer stops the segmentation.

    Returns
    -------
    SegmentTree or SceneSegmentation
        Of a scene, with a tree of each piece that is cut.

    Raises
    ------
    ValueError
        For an argument that cannot be used.
    DisconnectedError
        Where `connected` was asked for and a segment stays in pieces at the given `epsilon`.
    CollapsedError
        Where a phase is empty, for want of an area constraint or of faces at the given `epsilon`.
    StoppedError
        Where `progress` asked for it.

    Warns
    -----
    QualityWarning
        For each node whose solve did not converge, or failed so that it was split half way between
        its ends, for an epsilon below the mean edge length, for fewer segments than were asked
        for, and where sharp areas miss their shares by more than 1 %.
    """
    options = Options(
        epsilon=epsilon,
        epsilon_start=epsilon_start,
        connected=connected,
        kappa=kappa,
        delta=delta,
        eta=eta,
        sigma=sigma,
        area=area,
        penalty=penalty,
        distortion=distortion,
        law=law,
        initial=initial if isinstance(initial, str) else Options.initial,  # type: ignore[arg-type]
        seed=seed,
        solver=solver,
        max_iterations=max_iterations,
        coarse=coarse,
    )
    surface = with_seam_cost(surface, seam_cost, keep=keep, creases=creases)
    if not isinstance(surface, Scene):
        parts = parts_of(surface, levels, shares)
        return _tree(surface, parts, options, initial, executor, progress)
    if not isinstance(initial, str):
        raise ValueError("initial: value must be a name for a scene")
    surfaces = [piece.surface for piece in surface.pieces]
    if shares is not None:
        if len(surfaces) > 1:
            raise ValueError("shares: value must be left out for a scene of several pieces")
        parts = parts_of(surfaces[0], levels, shares)
        tree = _tree(surfaces[0], parts, options, initial, executor, progress)
        return SceneSegmentation.of_trees(surface, [tree])
    check_levels(levels)
    counts = leaves_of_pieces(surfaces, 2 ** (1 if levels is None else levels))
    asked = max(2 ** (1 if levels is None else levels), len(surfaces))
    if sum(counts) < asked:
        quality.warn(f"levels: {sum(counts)} segments instead of {asked}, one for each face")
    trees = [
        _tree(piece, [1.0] * count, options, initial, executor, progress) if count > 1 else None
        for piece, count in zip(surfaces, counts, strict=True)
    ]
    return SceneSegmentation.of_trees(surface, trees)


def _tree(
    surface: Surface,
    parts: Sequence[float],
    options: Options,
    initial: Initial | ArrayLike,
    executor: Executor | None,
    progress: Report | None,
) -> SegmentTree:
    """Cut a surface into segments whose areas are in proportion to `parts`."""
    steps = working_surface(surface, len(parts), options.epsilon, simplify=options.coarse)
    if steps:
        initial = _forward(steps, surface, initial)
        target, quick = steps[-1].target, _quick(options, steps[-1])
        found = _solved(target, parts, quick, initial, executor, progress, refined=True)
        tree = carried_back(found, steps, options)
    else:
        tree = with_whole_polygons(_solved(surface, parts, options, initial, executor, progress))
    _warn(tree, options)
    return tree


def _solved(
    surface: Surface,
    parts: Sequence[float],
    options: Options,
    initial: Initial | ArrayLike,
    executor: Executor | None,
    progress: Report | None,
    *,
    refined: bool = False,
) -> SegmentTree:
    """Cut a surface itself."""
    widths = options.widths(surface)
    length = float(np.sqrt(surface.area))
    if widths.epsilon * length < surface.mean_edge_length:
        quality.warn(
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
        futures = [executor.submit(_bisect, node, options, widths, thin) for node in nodes]
        splits = []
        try:
            for node, future in zip(nodes, futures, strict=True):
                split = future.result()
                splits.append(split)
                if progress is not None and progress(_end(node, split, widths)):
                    raise StoppedError(f"{node.name}: stopped by the progress callback")
        except BaseException:
            for future in futures:
                future.cancel()
            raise
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


def _warn(tree: SegmentTree, options: Options) -> None:
    """Say what makes the tree worse than asked for."""
    for d in tree.diagnostics:
        if d.fallback:
            quality.warn(
                f"{d.fallback}: it was split half way between its ends, without a phase field"
            )
        elif not d.converged:
            quality.warn(_unconverged(d))
    if options.area != "lagrangian":
        return
    off = np.abs(tree.areas / (tree.shares * tree.surface.area) - 1)
    worst = int(np.argmax(off))
    if off[worst] > _SHARP_MISS:
        quality.warn(
            f"areas: sharp segment {worst} misses its share by {100 * off[worst]:.3g} %, where "
            f"{100 * _SHARP_MISS:g} % is expected; finer triangles (phaseatlas remesh) help"
        )


def _unconverged(d: Diagnostics) -> str:
    return (
        f"level {d.level + 1}, node {d.node}: not converged after {d.iterations} iterations, "
        f"{Status(d.status).sentence}; the area is off by {d.violation:.1e}; more steps "
        "(max_iterations), another seed or a larger epsilon may help"
    )
