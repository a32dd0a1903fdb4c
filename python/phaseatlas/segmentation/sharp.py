"""From a field to sharp segments: the threshold that meets the areas, and islands."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Floats, Ints
from .grids import Grid
from .options import Options

__all__ = [
    "THRESHOLD",
    "count_components",
    "cut",
    "islands",
    "negligible",
    "part_of_area",
]

# The connectedness functional sees all that the distortion does: its threshold is about the value
# at which that starts to penalise the other phase.
THRESHOLD = 0.3
# Islands up to this part of the area of their node, or of this many faces, are relabelled: faces
# at the tips of a jagged interface. Larger ones are turned over and the node is solved again.
_NEGLIGIBLE_SHARE = 1e-3
_NEGLIGIBLE_FACES = 4


def cut(grid: Grid, u: Floats, share: float, options: Options) -> tuple[Bools, float]:
    """Faces of the positive segment, (m,), and the threshold that bounds them.

    The threshold is the one that gives it its share of the area of the node's faces. For halves it
    is 0, by symmetry, but for the size of a face, which the finest segments feel. Where the area
    is only penalised, or free, it is 0. Where that threshold would tear a segment which the
    connectedness functional holds together, it is the nearest that the functional sees beyond.
    """
    values = grid.surface.face_mean(u)
    faces = np.flatnonzero(grid.faces)
    threshold = 0.0
    if options.area == "lagrangian":
        order = np.argsort(-values[faces], kind="stable")
        areas = np.cumsum(grid.surface.face_areas[faces[order]])
        last = int(np.argmin(np.abs(areas - share * areas[-1])))
        threshold = float(values[faces[order[last]]])
    positive = grid.faces & (values >= threshold)
    held = float(np.clip(threshold, -THRESHOLD, THRESHOLD))
    if options.connected and threshold != held and count_components(grid, positive) != (1, 1):
        threshold = held
        positive = grid.faces & (values >= threshold)
    return positive, threshold


def count_components(grid: Grid, positive: Bools) -> tuple[int, int]:
    """Numbers of components of the positive and of the negative segment."""
    sides, parts = _parts(grid, positive)
    return len(np.unique(parts[sides == 0])), len(np.unique(parts[sides == 1]))


def islands(grid: Grid, positive: Bools) -> Bools:
    """Faces to move to the other side so that both sides connect, where the node does.

    All components but the largest of the positive side move; then all but the largest of what
    the negative side has become.
    """
    moved = np.zeros_like(positive)
    for side in (0, 1):
        sides, parts = _parts(grid, positive ^ moved)
        mine = np.flatnonzero(sides == side)
        if len(mine) == 0:
            continue
        areas = np.bincount(parts[mine], weights=grid.surface.face_areas[mine])
        moved[mine[parts[mine] != np.argmax(areas)]] ^= True
    return moved


def negligible(grid: Grid, faces: Bools) -> bool:
    """Whether islands are so small that they are relabelled."""
    few = bool(faces.sum() <= _NEGLIGIBLE_FACES)
    return few or part_of_area(grid, faces) <= _NEGLIGIBLE_SHARE


def part_of_area(grid: Grid, faces: Bools) -> float:
    """Part of the area of the node's faces that some of them have."""
    areas = grid.surface.face_areas
    return float(areas[faces].sum() / areas[grid.faces].sum())


def _parts(grid: Grid, positive: Bools) -> tuple[Ints, Ints]:
    """Side of each face (0 and 1 in the node, -1 outside) and its component."""
    sides = np.where(grid.faces, np.where(positive, 0, 1), -1)
    return sides, grid.surface.label_components(sides)
