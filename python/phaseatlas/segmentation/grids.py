"""A node on its simplified surfaces, the grids, and what is built once for each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Bools, Floats
from ..coarsen import coarsen
from ..functionals import Area
from ..optimise import Timers
from ..surface import Surface
from ..transfer import Transfer
from .node import Node
from .options import Options, Widths

__all__ = ["COARSEST", "RESOLVED", "Grid", "Grids", "make_grids"]

# Continuation starts where epsilon is about this part of the square root of the segment's area:
# the interface is then as wide as the segment, and few local minima are left.
COARSEST = 0.2
# An interface is resolved by edges of this part of epsilon; a simplified surface has edges a little
# longer than twice those of the finer one.
RESOLVED = 0.65
# The faces of a coarse grid that lie inside the node by at least this part of their area are its.
_MAJORITY = 0.5


@dataclass(frozen=True, eq=False)
class Grid:
    """A node on one surface.

    Attributes
    ----------
    surface : Surface
        With n vertices and m faces.
    indicator : (n,) array or None
        Diffuse indicator of the node; None is 1 everywhere.
    faces : (m,) array of bool
        The faces of the node's sharp segment.
    area : Area
        The constrained functional.
    transfer : Transfer or None
        From the next finer grid; None on the finest.
    """

    surface: Surface
    indicator: Floats | None
    faces: Bools
    area: Area
    transfer: Transfer | None = None

    @cached_property
    def inside(self) -> Floats:
        """The indicator as an array, (n,)."""
        return np.ones(self.surface.n_vertices) if self.indicator is None else self.indicator


@dataclass(frozen=True, eq=False)
class Grids:
    """A node on all of its grids, finest first, and how it is to be solved.

    Attributes
    ----------
    node : Node
        What is split.
    options : Options
        How.
    widths : Widths
        At which lengths.
    grids : tuple of Grid
        The node's own surface, then ever coarser ones.
    """

    node: Node
    options: Options
    widths: Widths
    grids: tuple[Grid, ...]

    @cached_property
    def size(self) -> float:
        """Square root of twice the area of the smaller child: of the node, where it is halved."""
        return _size(self.node, self.grids[0].area)

    def coarsest_for(self, edge_length: float) -> int:
        """The coarsest grid with edges of up to this length, or the finest."""
        return sum(grid.surface.mean_edge_length <= edge_length for grid in self.grids[1:])

    def carry(self, u: Floats, here: int, there: int) -> Floats:
        """Return a field on one grid as a field on another."""
        for k in range(here, there, -1):
            u = self._transfer(k).backward @ u
        for k in range(here, there):
            u = self._transfer(k + 1).forward @ u
        return u

    def _transfer(self, k: int) -> Transfer:
        transfer = self.grids[k].transfer
        assert transfer is not None, "the finest grid alone has none"
        return transfer


def make_grids(node: Node, options: Options, widths: Widths, timers: Timers) -> Grids:
    """Simplify the surface of a node as far as its widest interface allows."""
    with timers.timed("set-up"):
        area = Area(node.surface, widths.epsilon, delta=widths.delta, weight=node.indicator)
        grids = [Grid(node.surface, node.indicator, node.faces, area)]
        if options.coarse and node.start is None:
            widest = widths.start or _size(node, area) * COARSEST
            while 2 * grids[-1].surface.mean_edge_length <= RESOLVED * widest:
                with timers.timed("coarsening"):
                    transfer = coarsen(grids[-1].surface)
                if transfer is None:
                    break
                grid = _coarser(grids[-1], transfer, widths)
                if grid is None:
                    break
                grids.append(grid)
    return Grids(node, options, widths, tuple(grids))


def _coarser(grid: Grid, transfer: Transfer, widths: Widths) -> Grid | None:
    """The node on a simplified surface, unless it is too thin for that."""
    surface = grid.surface
    inside = np.bincount(
        surface.faces.reshape(-1),
        np.repeat(grid.faces * surface.face_areas, 3),
        minlength=surface.n_vertices,
    )
    share: Floats = transfer.forward @ (inside / (3 * surface.mass))
    faces = transfer.target.face_mean(share) >= _MAJORITY
    if not faces.any():
        return None
    indicator = None
    if grid.indicator is not None:
        # Means of values up to 1 may round to more.
        indicator = np.minimum(transfer.forward @ grid.indicator, 1.0)
    area = Area(transfer.target, widths.epsilon, delta=widths.delta, weight=indicator)
    return Grid(transfer.target, indicator, faces, area, transfer)


def _size(node: Node, area: Area) -> float:
    return float(np.sqrt(2 * min(node.share, 1 - node.share) * area.total))
