"""Charts by energy, all at once.

The energy is (seam + cuts) / sqrt A + distortion * Y + charts / 10, where A is the area and Y the
mean squared log scale of the conformal maps that keep lengths on the boundaries of the charts.
Charts are cut to disks. Every move is judged by the exact difference of the energy; the moves are
in the `partition` module of the core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from time import perf_counter
from typing import Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..arrays import Ints
from ..scene.scene import Scene
from ..seam_costs import with_seam_cost
from ..segmentation import SceneSegmentation, Segmentation
from ..side_by_side import submitted
from ..surface import Surface
from .descent import SOLVED, carry, carry_far, descend, repair
from .levels import Level, levels_of
from .phases import Labelled, Log, Phase, rating, told
from .pieces import first_copies, share_bound, warn_of_bounds
from .record import Partition, by_area
from .symmetry import AXES, Axis, mirrored

__all__ = ["Effort", "Partition", "Phase", "check_options", "partition"]

Effort = Literal["fast", "normal", "best"]

# Distortion weight by default: on a smooth surface the energy is least where it is about a quarter
# of the seam over the distortion, 400 to 1000.
DISTORTION = 600.0
# Perturbations; each of the first 20 gains about 0.3 % of the energy.
_PERTURBATIONS: dict[Effort, int] = {"fast": 8, "normal": 32, "best": 160}
# Borders, and twice the handles, up to which it gets all of them, and beyond which fewer: on 133
# handles each of them takes more than a second.
_HOLES = 64
# Faces up to which a surface gets the perturbations of "normal" at least: they take a millisecond.
_SMALL = 500
# Perturbations between two looks at the clock and the keyboard.
_BATCH = 4
# Cells of the first phase.
_CELLS = 60
# Width of the first bands around boundaries that come from a simplified surface, in mean edges.
_REACH = 1.5
# Faces above which overlaps are sought and mended on the next coarser surface first.
_REPAIRED = 200_000
# Energy of a chart, besides its seams and its distortion.
_A_CHART = 0.1
# Weights of the distortion between which bounds are met, steps of the bisection, attempts at it.
_WEIGHTS = (1e-2, 1e6)
_BISECTIONS = 10
_ATTEMPTS = 8


@overload
def partition(  # type: ignore[overload-overlap]
    surface: Scene,
    *,
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    seam_cost: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
    progress: Callable[[Phase], object] | None = None,
    symmetry: Axis | None = None,
) -> SceneSegmentation: ...


@overload
def partition(
    surface: Surface,
    *,
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    seam_cost: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
    progress: Callable[[Phase], object] | None = None,
    symmetry: Axis | None = None,
) -> Partition: ...


def partition(
    surface: Surface,
    *,
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    seam_cost: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
    progress: Callable[[Phase], object] | None = None,
    symmetry: Axis | None = None,
) -> Partition | SceneSegmentation:
    """Cut a surface into the charts that cost least in seam, cuts and distortion together.

    Every chart is connected, and a disk once it is cut along the cuts that are counted; its
    boundary-first map covers no point twice and turns no face over, but for single faces of a
    surface of more than 400,000.

    Parameters
    ----------
    surface : Surface or Scene
        The pieces of a scene are cut one by one.
    distortion : float, default 600
        Weight of the mean squared log scale against the length of the seams in roots of the area.
        400 to 1000 suit smooth surfaces; less gives fewer charts.
    max_distortion : float, optional
        Bound on the root mean square log scale; 0.05 lets texels vary by 5 %. It overrides
        `distortion`.
    max_charts : int, optional
        Bound on the number of charts, which overrides `distortion` as well; where both bounds are
        given and clash, this one holds. Every piece of a scene has at least one.
    effort : {"fast", "normal", "best"}
        How many perturbations are tried.
    seed : int, default 0
        Seed of the perturbations. Equal inputs give equal charts for any number of threads.
    seam_cost, keep, creases : optional
        Where seams may run, as in `with_seam_cost`; they and the cuts cost the factors times their
        lengths.
    executor : concurrent.futures.Executor, optional
        Runs the pieces of a scene side by side; the result does not depend on it.
    progress : callable, optional
        Called with the `Phase` so far after each group of moves, with an executor after each
        piece; a true answer stops the work.
    symmetry : {"x", "y", "z"}, optional
        Cut the surface along the plane across this axis on whose two sides it is the same, and give
        one half the mirror images of the charts of the other. Polygons across the plane are on one
        side whole; what has no image has charts of its own. `max_charts` is shared out evenly,
        seams cost what they do on one half, and the diagnostics are the figures of the whole with
        the weight `distortion`.

    Returns
    -------
    Partition or SceneSegmentation
        Charts by area, the largest first; of a scene, a partition of each piece.

    Raises
    ------
    ValueError
        For a weight or bound that is not positive, an unknown effort, a negative seed, and where
        less than 95 % of the area has a mirror image.
    StoppedError
        Where `progress` gave a true answer.

    Warns
    -----
    QualityWarning
        Where a bound is not met.
    """
    check_options(distortion, max_distortion, max_charts, effort, seed, symmetry)
    surface = with_seam_cost(surface, seam_cost, keep=keep, creases=creases)
    if symmetry is not None:
        return mirrored(
            surface,
            symmetry,
            distortion,
            max_charts,
            lambda half: partition(
                half,
                distortion=distortion,
                max_distortion=max_distortion,
                max_charts=None if max_charts is None else max(max_charts // 2, 1),
                effort=effort,
                seed=seed,
                executor=executor,
                progress=progress,
            ),
        )

    def of_pieces(pieces: Sequence[Surface], most: Sequence[int | None]) -> list[Partition]:
        calls = [
            (piece, distortion, max_distortion, bound, effort, seed)
            for piece, bound in zip(pieces, most, strict=True)
        ]
        if executor is None or len(calls) == 1:
            found = [_labelled(*call, progress) for call in calls]
        else:
            with submitted(executor, _labelled, calls) as futures:
                found = [told(future.result(), progress) for future in futures]
        for (_, phases), bound in zip(found, most, strict=True):
            warn_of_bounds(phases[-1], max_distortion, bound)
        return [
            Partition(piece, labels, diagnostics=phases)
            for piece, (labels, phases) in zip(pieces, found, strict=True)
        ]

    if not isinstance(surface, Scene):
        return of_pieces([surface], [max_charts])[0]
    surfaces = [piece.surface for piece in surface.pieces]
    firsts = list(first_copies(surfaces))
    own = [k for k, first in enumerate(firsts) if first == k]
    made = dict(zip(own, of_pieces([surfaces[k] for k in own], [None] * len(own)), strict=True))
    parts = [
        made[first]
        if first == k
        else Partition(surfaces[k], made[first].labels, diagnostics=made[first].diagnostics)
        for k, first in enumerate(firsts)
    ]
    if max_charts is not None:
        bounds = share_bound([part.n_segments for part in parts], max_charts)
        again = [k for k, part in enumerate(parts) if part.n_segments > bounds[k]]
        fewer = iter(of_pieces([surfaces[k] for k in again], [bounds[k] for k in again]))
        parts = [next(fewer) if k in again else part for k, part in enumerate(parts)]
    return SceneSegmentation(surface, parts)


def _labelled(
    surface: Surface,
    distortion: float,
    max_distortion: float | None,
    max_charts: int | None,
    effort: Effort,
    seed: int,
    progress: Callable[[Phase], object] | None = None,
) -> Labelled:
    """Find the charts of one piece, in any process."""
    log = Log([], perf_counter(), progress)
    levels = levels_of(surface)
    cores = [level.surface.one_chart(distortion) for level in levels]
    perturbations = _perturbations(effort, levels[0].surface)
    ends: list[tuple[Phase, Ints]] = []
    given = distortion
    if max_distortion is not None or max_charts is not None:
        distortion = _weight(cores[0], max_distortion, max_charts)
    if max_charts is not None and distortion < given:
        # Charts of the weight as given, merged down: less weight may jump far past the bound.
        for core in cores:
            core.set_distortion(given)
        bound = max_charts, given
        last = _charts(cores, levels, perturbations, seed, log, bound)
        ends.append((last, cores[-1].labels()))
    for _ in range(_ATTEMPTS):
        for core in cores:
            core.set_distortion(distortion)
        last = _charts(cores, levels, perturbations, seed, log)
        if max_charts is not None and last.n_charts > max_charts:
            distortion *= 0.5
        elif (
            max_distortion is not None
            and max_charts is None
            and last.distortion > max_distortion**2
        ):
            # The distortion falls like the weight to the power of -4 / 5.
            distortion *= 1.1 * (last.distortion / max_distortion**2) ** 1.25
        else:
            break
    ends.append((last, cores[-1].labels()))

    last, labels = min(ends, key=lambda end: rating(end[0], max_charts, given))
    if len(ends) > 1:
        log.close(last)
    return by_area(labels, surface), tuple(log.phases)


def _charts(
    cores: Sequence[_core.Partition],
    levels: Sequence[Level],
    perturbations: int,
    seed: int,
    log: Log,
    bound: tuple[int, float] | None = None,
) -> Phase:
    """Find charts on the coarsest surface and carry them to the finest.

    With a bound, a number of charts and the weight, they are merged down to it between.
    """
    # What was forbidden at the end of the last attempt.
    for core in cores:
        core.allow_overlap()
    _search(cores[0], levels[0].surface, perturbations, seed, log)
    if bound is not None:
        _merge_down(cores[0], levels[0].surface, *bound, log)
    surface = levels[-1].surface
    upright = surface.n_faces <= SOLVED
    for k in range(1, len(levels)):
        if levels[k].carried and k == len(levels) - 1 and surface.n_faces > _REPAIRED:
            # So that few charts fail where a repair takes long.
            repair(cores[k - 1], levels[k - 1].surface, log, upright)
        if levels[k].carried and levels[k].surface.n_faces > SOLVED:
            carry_far(cores[k - 1 : k + 1], levels[k - 1 : k + 1], log)
            continue
        labels = cores[k - 1].labels()[levels[k].parents]
        if levels[k].carried:
            carry(cores[k], levels[k - 1 : k + 1], labels, log)
        else:
            _refine(cores[k], levels[k].surface, labels, log)
    return repair(cores[-1], surface, log, upright)


def _perturbations(effort: Effort, surface: Surface) -> int:
    # Each of them takes long on a surface of many handles and borders.
    holes = 2 - surface.euler_characteristic
    count = max(1, int(_PERTURBATIONS[effort] * min(1.0, _HOLES / max(holes, 1))))
    return max(count, _PERTURBATIONS["normal"]) if surface.n_faces <= _SMALL else count


def _search(
    core: _core.Partition, surface: Surface, perturbations: int, seed: int, log: Log
) -> None:
    """Find charts from cells."""
    core.set_cells(_CELLS)
    log.close(log.note("cells", surface, core))
    core.merge()
    log.close(log.note("merge", surface, core))
    rest = descend(core, surface, "relax", log)
    log.close(rest)
    # A second chart alone costs more than a disk of this energy.
    if rest.n_charts == 1 and rest.cuts == 0 and rest.energy <= 2 * _A_CHART:
        return
    for first in range(0, perturbations, _BATCH):
        core.perturb(seed, first, min(first + _BATCH, perturbations))
        log.note("perturb", surface, core)
    log.close(descend(core, surface, "perturb", log))


def _merge_down(
    core: _core.Partition, surface: Surface, most: int, distortion: float, log: Log
) -> None:
    """Merge the best pairs of charts, although the energy rises, until there are no more."""
    charts = Segmentation(surface, core.labels())
    if charts.n_segments > most:
        core.set_labels(charts.merge_tree(distortion).at(most).labels, _REACH)
        log.close(descend(core, surface, "merge", log))


def _refine(core: _core.Partition, surface: Surface, labels: Ints, log: Log) -> None:
    """Relax labels that come from a simplified surface."""
    core.allow_overlap()
    core.set_labels(labels, _REACH)
    log.close(descend(core, surface, "refine", log))


def _weight(core: _core.Partition, max_distortion: float | None, max_charts: int | None) -> float:
    """Bisect for the least weight that meets the bound, without perturbations."""
    low, high = np.log(_WEIGHTS)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        core.set_distortion(float(np.exp(middle)))
        core.set_cells(_CELLS)
        core.merge()
        core.sweep()
        core.merge()
        _, _, _, distortion, _, _, charts, _ = core.figures()
        if max_charts is not None:
            enough = charts > max_charts
        else:
            enough = max_distortion is not None and distortion < max_distortion**2
        low, high = (low, middle) if enough else (middle, high)
    return float(np.exp(low if max_charts is not None else high))


def check_options(
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: str = "normal",
    seed: int = 0,
    symmetry: str | None = None,
) -> None:
    """Raise ValueError where `partition` would refuse its options."""
    bounds = {"distortion": distortion, "max_distortion": max_distortion}
    for name, value in bounds.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: value must be a positive number, got {value}")
    if max_charts is not None and max_charts < 1:
        raise ValueError(f"max_charts: value must be at least 1, got {max_charts}")
    if effort not in get_args(Effort):
        raise ValueError(f"effort: value must be one of {get_args(Effort)}, got {effort!r}")
    if seed < 0:
        raise ValueError(f"seed: value must not be negative, got {seed}")
    if seed >= 2**64:
        raise ValueError(f"seed: value must be less than 2^64, got {seed}")
    if symmetry not in (None, *AXES):
        raise ValueError(f"symmetry: {symmetry!r} must be one of {AXES}")
