"""What a partition tells while it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

from .. import _core
from ..arrays import Ints
from ..segmentation import StoppedError
from ..surface import Surface

__all__ = ["Labelled", "Log", "Phase", "rating", "told"]


@dataclass(frozen=True)
class Phase:
    """Figures of a partition after a phase of its making.

    Attributes
    ----------
    name : str
        What was done: "cells", "merge", "relax", "perturb", "refine", "repair"; "mirror" where a
        half has got its mirror image.
    n_faces : int
        Faces of the surface that it was done on; the first phases work on a simplified one.
    energy : float
    seam, cuts : float
        Lengths between charts and of the cuts that open them, in roots of the area, times the seam
        costs of the surface where it has some.
    distortion : float
        Mean squared log scale of the boundary-first maps.
    n_charts : int
    n_overlapping : int
        Charts whose map is known to cover a point twice or to turn a face over.
    smallest : float
        Area of the smallest chart, relative to the surface.
    seconds : float
        Since the start.
    """

    name: str
    n_faces: int
    energy: float
    seam: float
    cuts: float
    distortion: float
    n_charts: int
    n_overlapping: int
    smallest: float
    seconds: float


@dataclass(frozen=True)
class Log:
    """Notes the phases and passes them on."""

    phases: list[Phase]
    start: float
    progress: Callable[[Phase], object] | None

    def note(self, name: str, surface: Surface, core: _core.Partition) -> Phase:
        energy, seam, cuts, distortion, _, smallest, charts, overlapping = core.figures()
        phase = Phase(
            name=name,
            n_faces=surface.n_faces,
            energy=energy,
            seam=seam,
            cuts=cuts,
            distortion=distortion,
            n_charts=charts,
            n_overlapping=overlapping,
            smallest=smallest,
            seconds=perf_counter() - self.start,
        )
        if self.progress is not None and self.progress(phase):
            raise StoppedError(f"{name}: stopped by the progress callback")
        return phase

    def close(self, phase: Phase) -> None:
        self.phases.append(phase)


def rating(end: Phase, max_charts: int | None, weight: float) -> tuple[int, int, float]:
    """How good an end is, what counts most first: the bound, overlaps, energy at one weight."""
    above = 0 if max_charts is None else max(end.n_charts - max_charts, 0)
    return above, end.n_overlapping, end.seam + end.cuts + weight * end.distortion


#: The chart of each face of a piece, and the figures after each phase.
Labelled = tuple[Ints, tuple[Phase, ...]]


def told(found: Labelled, progress: Callable[[Phase], object] | None) -> Labelled:
    """Report the end of a piece, and give the piece."""
    if progress is not None and progress(found[1][-1]):
        raise StoppedError("partition: stopped by the progress callback")
    return found
