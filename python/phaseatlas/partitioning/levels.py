"""The simplified surfaces on which charts are found."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import Ints
from ..coarsen import coarsen, reduced
from ..surface import Surface

__all__ = ["Level", "levels_of"]

# Faces of the coarsest surface, and of a surface against those of the next coarser one.
_FEWEST = 4000
_RATIO = 4
# Faces above which a surface gets charts carried to it; up to there sweeps on the surface itself
# find better ones in less time. And the faces of the surfaces on which they are sought.
_FINE = 100_000
_SOUGHT = 16_000
# Faces of a surface against those of the one that its charts are carried from, at most: the bands
# of the cuts are as wide as the edges there.
_WIDEST = 16


@dataclass(frozen=True, eq=False)
class Level:
    """A surface on the way from the coarsest to the given one.

    Attributes
    ----------
    surface : Surface
        With m faces.
    parents : (m,) array of int or None
        The face of the next coarser surface for each face; None on the coarsest.
    carried : bool
        Whether its charts are those of the coarser surface, but for their boundaries.
    """

    surface: Surface
    parents: Ints | None
    carried: bool = False


def levels_of(surface: Surface) -> list[Level]:
    """Return the surface and simplified ones, the coarsest first, each made of the next.

    Parameters
    ----------
    surface : Surface
    """
    found: list[Level] = []
    fine = surface.n_faces > _FINE
    while fine and surface.n_faces > 2 * _SOUGHT:
        n_faces = max(_SOUGHT, surface.n_faces // _WIDEST)
        coarse, parents = reduced(surface, n_faces)
        # Of many handles and borders too many faces are left.
        if _RATIO * coarse.n_faces > 3 * surface.n_faces:
            break
        found.insert(0, Level(surface, parents, carried=True))
        surface = coarse
    counts = [_FEWEST]
    while counts[-1] * _RATIO**2 < surface.n_faces:
        counts.append(counts[-1] * _RATIO)
    for n_faces in reversed(counts):
        transfer = coarsen(surface, n_faces)
        if transfer is not None:
            found.insert(0, Level(surface, transfer.parent_face))
            surface = transfer.target
    return [Level(surface, None), *found]
