"""Charts by energy, all at once.

The energy is (seam + cuts) / sqrt A + distortion * Y + charts / 10, where A is the area and Y the
mean squared log scale of the conformal maps that keep lengths on the boundaries of the charts.
Charts are cut to disks. Every move is judged by the exact difference of the energy; the moves are
in the `partition` module of the core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..arrays import Ints
from ..scene.scene import Scene
from ..segmentation import SceneSegmentation, Segmentation
from ..surface import Surface
from .descent import SOLVED, carry, carry_far, descend, repair
from .levels import Level, levels_of
from .phases import Log, Phase, rating
from .pieces import first_copies, share_bound, warn_of_bounds

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


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Partition(Segmentation):
    """A segmentation by energy.

    Attributes
    ----------
    diagnostics : tuple of Phase
        The figures after each phase, in order.
    """

    diagnostics: tuple[Phase, ...] = ()

    def __init__(
        self,
        surface: Surface,
        labels: ArrayLike,
        weights: ArrayLike | None = None,
        diagnostics: tuple[Phase, ...] = (),
        *,
        epsilon: float | None = None,
    ) -> None:
        super().__init__(surface, labels, weights, epsilon=epsilon)
        object.__setattr__(self, "diagnostics", diagnostics)


@overload
def partition(  # type: ignore[overload-overlap]
    surface: Scene,
    *,
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    progress: Callable[[Phase], object] | None = None,
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
    progress: Callable[[Phase], object] | None = None,
) -> Partition: ...


def partition(
    surface: Surface,
    *,
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    progress: Callable[[Phase], object] | None = None,
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
    progress : callable, optional
        Called with the `Phase` so far after each group of moves; a true answer stops the work.

    Returns
    -------
    Partition or SceneSegmentation
        Charts by area, the largest first; of a scene, a partition of each piece.

    Raises
    ------
    ValueError
        For a weight or bound that is not positive, an unknown effort, or a negative seed.
    StoppedError
        Where `progress` gave a true answer.

    Warns
    -----
    QualityWarning
        Where a bound is not met.
    """
    check_options(distortion, max_distortion, max_charts, effort, seed)

    def of_piece(piece: Surface, most: int | None) -> Partition:
        return _partition(piece, distortion, max_distortion, most, effort, seed, progress)

    if not isinstance(surface, Scene):
        return of_piece(surface, max_charts)
    surfaces = [piece.surface for piece in surface.pieces]
    parts: list[Partition] = []
    for each, first in zip(surfaces, first_copies(surfaces), strict=True):
        if first == len(parts):
            parts.append(of_piece(each, None))
        else:
            copied = parts[first]
            parts.append(Partition(each, copied.labels, diagnostics=copied.diagnostics))
    if max_charts is not None:
        bounds = share_bound([part.n_segments for part in parts], max_charts)
        parts = [
            part if part.n_segments <= bound else of_piece(part.surface, bound)
            for part, bound in zip(parts, bounds, strict=True)
        ]
    return SceneSegmentation(surface, parts)


def _partition(
    surface: Surface,
    distortion: float,
    max_distortion: float | None,
    max_charts: int | None,
    effort: Effort,
    seed: int,
    progress: Callable[[Phase], object] | None,
) -> Partition:
    """Partition one piece."""
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
    warn_of_bounds(last, max_distortion, max_charts)
    return Partition(surface, _by_area(labels, surface), diagnostics=tuple(log.phases))


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


def _by_area(labels: Ints, surface: Surface) -> Ints:
    order = np.argsort(-np.bincount(labels, surface.face_areas), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[labels].astype(np.int64)


def check_options(
    distortion: float = DISTORTION,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: str = "normal",
    seed: int = 0,
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
