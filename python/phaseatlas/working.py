"""The working surface of a piece: refined, simplified, or none where the piece itself will do.

Phase fields need even triangles, some dozen across a segment, and no more of them than that.
"""

from __future__ import annotations

from .arrays import Ints
from .coarsen import coarsen
from .refine import count_refined, refine
from .surface import Surface
from .transfer import Transfer

__all__ = ["carry_labels", "needles", "working_surface"]

# A surface is coarse where faces longer than this part of the root of a segment's area make up
# more than this part of its area: the default interface would be as wide as half a segment.
_LONG = 0.2
_COARSE_AREA = 0.05
# Longest edge of a refined surface, in roots of a segment's area: 8 segments get some 5,000 faces,
# or 2,000 where a segment has so few faces of the input that they decide more than the field.
_EDGE = 1 / 12
_ROUGH_EDGE = 1 / 8
_FEW_FACES = 64
# Refined surfaces have about so many faces at most: those of few segments, and those of many. Only
# needles and many segments need as many.
_MOST_OF_FEW = 12_000
_MOST_A_SEGMENT = 600
_MOST_REFINED = 40_000
# Faces of a simplified surface, and of a surface that is fine.
_KEPT = 40_000
_FINE = 100_000
# Triangles of quality below the first are needles; on a surface with more than the second part of
# its area in them a field takes minutes. They are left where the input's are less than a sixth as
# wide as a refined edge.
_THIN = 0.3
_THIN_AREA = 0.5
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
        few = surface.n_faces < _FEW_FACES * n_segments
        longest = (_ROUGH_EDGE if few else _EDGE) * length
        if epsilon is not None:
            longest = min(longest, epsilon / 2)
        most = min(max(_MOST_OF_FEW, _MOST_A_SEGMENT * n_segments), _MOST_REFINED)
        while count_refined(surface, longest) > most and longest < _LONG * length:
            longest *= _LONGER
        steps.append(refine(surface, longest))
    return tuple(steps)


def needles(surface: Surface) -> bool:
    """Whether much of a surface is of triangles too thin for a field to be worth its time."""
    thin = surface.face_quality < _THIN
    return bool(surface.face_areas[thin].sum() > _THIN_AREA * surface.area)


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
