"""The working surface of a piece: refined, simplified, or none where the piece itself will do.

Phase fields need even triangles, some dozen across a segment, and no more of them than that.
"""

from __future__ import annotations

from .arrays import Ints
from .coarsen import coarsen
from .refine import count_refined, refine
from .surface import Surface
from .transfer import Transfer

__all__ = ["carry_labels", "working_surface"]

# A surface is coarse where faces longer than this part of the root of a segment's area make up
# more than this part of its area: the default interface would be as wide as half a segment.
_LONG = 0.2
_COARSE_AREA = 0.05
# Longest edge of a refined surface, in roots of a segment's area: 8 segments get some 8,000 faces.
_EDGE = 1 / 14
# Refined surfaces have about so many faces at most, and simplified ones so many. A surface with
# more faces than the third is fine.
_MOST_REFINED = 40_000
_KEPT = 40_000
_FINE = 100_000
# Edges are longer by this factor until a refined surface is small enough.
_LONGER = 1.2


def working_surface(
    surface: Surface, n_segments: int, epsilon: float | None = None, *, simplify: bool = True
) -> tuple[Transfer, ...]:
    """Make the surface to find segments on.

    Parameters
    ----------
    surface : Surface
    n_segments : int
        How many segments it is to have.
    epsilon : float, optional
        Width of the interface that it must resolve, in the units of the surface; by default any.
    simplify : bool, default True
        Simplify fine surfaces.

    Returns
    -------
    tuple of Transfer
        One after the other, from the surface to the working surface; none where it is the same.
    """
    steps: list[Transfer] = []
    if simplify and surface.n_faces > _FINE:
        step = coarsen(surface, _KEPT)
        if step is not None and _resolves(step.target, epsilon):
            steps.append(step)
            surface = step.target
    length = (surface.area / n_segments) ** 0.5
    if _coarse(surface, length):
        longest = _EDGE * length if epsilon is None else min(_EDGE * length, epsilon / 2)
        while count_refined(surface, longest) > _MOST_REFINED and longest < _LONG * length:
            longest *= _LONGER
        steps.append(refine(surface, longest))
        # Needles stay needles when they are split; a simplified surface has none.
        if steps[-1].target.n_faces > 2 * _MOST_REFINED:
            step = coarsen(steps[-1].target, _MOST_REFINED)
            if step is not None:
                steps.append(step)
    return tuple(steps)


def carry_labels(steps: tuple[Transfer, ...], labels: Ints) -> Ints:
    """Carry labels of the faces back through transfers, to the source of the first."""
    for step in reversed(steps):
        labels = labels[step.parent_face]
    return labels


def _coarse(surface: Surface, length: float) -> bool:
    long = surface.face_diameters > _LONG * length
    return bool(surface.face_areas[long].sum() > _COARSE_AREA * surface.area)


def _resolves(surface: Surface, epsilon: float | None) -> bool:
    """Whether the edges are short enough, as they are for the default width."""
    return epsilon is None or epsilon >= 2 * surface.mean_edge_length
