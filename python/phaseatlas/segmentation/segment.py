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
from ..optimise import AreaConstraint, Solver
from ..scene.scene import Scene
from ..seam_costs import with_seam_cost
from ..side_by_side import submitted
from ..surface import Surface
from .grow import grow
from .node import Progress, Report, StoppedError
from .options import Initial, Law, Options
from .scene import SceneSegmentation, leaves_of_pieces
from .shares import check_levels, parts_of
from .tree import SegmentTree

__all__ = ["segment"]


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
        Runs the nodes of a level and the pieces of a scene side by side; the result does not
        depend on it.
    progress : callable, optional
        Called with a `Progress` after each step, which holds the field; with an executor, after
        each node or piece. A true answer stops the segmentation.

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
        return grow(surface, parts, options, initial, executor, progress, quality.warn)
    if not isinstance(initial, str):
        raise ValueError("initial: value must be a name for a scene")
    surfaces = [piece.surface for piece in surface.pieces]
    if shares is not None:
        if len(surfaces) > 1:
            raise ValueError("shares: value must be left out for a scene of several pieces")
        parts = parts_of(surfaces[0], levels, shares)
        tree = grow(surfaces[0], parts, options, initial, executor, progress, quality.warn)
        return SceneSegmentation.of_trees(surface, [tree])
    check_levels(levels)
    counts = leaves_of_pieces(surfaces, 2 ** (1 if levels is None else levels))
    asked = max(2 ** (1 if levels is None else levels), len(surfaces))
    if sum(counts) < asked:
        quality.warn(f"levels: {sum(counts)} segments instead of {asked}, one for each face")
    trees = _trees(surfaces, counts, options, executor, progress)
    return SceneSegmentation.of_trees(surface, trees)


def _trees(
    surfaces: Sequence[Surface],
    counts: Sequence[int],
    options: Options,
    executor: Executor | None,
    progress: Report | None,
) -> list[SegmentTree | None]:
    """Cut pieces into numbers of segments, those of more than one."""
    if executor is None:
        return [
            grow(piece, [1.0] * count, options, options.initial, None, progress, quality.warn)
            if count > 1
            else None
            for piece, count in zip(surfaces, counts, strict=True)
        ]
    trees: list[SegmentTree | None] = [None] * len(counts)
    said: dict[int, list[str]] = {}
    cut = [k for k, count in enumerate(counts) if count > 1]
    faces = sum(surfaces[k].n_faces for k in cut)
    # The nodes of a piece with most of the faces are sent one by one, the other pieces whole.
    large = [k for k in cut if 2 * surfaces[k].n_faces > faces]
    sent = [k for k in cut if k not in large]
    calls = [(surfaces[k], counts[k], options) for k in sent]
    # Set here too, as for the nodes of a level.
    with threadpool_limits(1, user_api="blas"), submitted(executor, _grown, calls) as futures:
        for k in large:
            said[k] = []
            parts = [1.0] * counts[k]
            trees[k] = grow(
                surfaces[k], parts, options, options.initial, executor, progress, said[k].append
            )
        for k, future in zip(sent, futures, strict=True):
            tree, said[k] = future.result()
            # It came back with a copy of its surface.
            trees[k] = replace(tree, surface=surfaces[k])
            if progress is not None:
                _tell(progress, tree)
    for k in cut:
        for message in said[k]:
            quality.warn(message)
    return trees


def _grown(surface: Surface, count: int, options: Options) -> tuple[SegmentTree, list[str]]:
    """Cut a piece in any process; what is to be warned of is returned."""
    said: list[str] = []
    return grow(surface, [1.0] * count, options, options.initial, None, None, said.append), said


def _tell(progress: Report, tree: SegmentTree) -> None:
    """Report the nodes of a tree that is done."""
    epsilon = tree.epsilon / float(np.sqrt(tree.surface.area))
    for d in tree.diagnostics:
        if progress(Progress(d.level + 1, d.node, epsilon, d.iterations, d.energy)):
            raise StoppedError(
                f"level {d.level + 1}, node {d.node}: stopped by the progress callback"
            )
