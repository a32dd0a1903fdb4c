"""Labels made better: swept and merged until they rest, carried to larger surfaces, repaired."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import _core
from ..arrays import Ints
from ..surface import Surface
from .levels import Level
from .phases import Log, Phase

__all__ = ["SOLVED", "carry", "carry_far", "descend", "repair"]

# Width of the first bands around boundaries that are at rest on a simplified surface, in mean edges
# there, and the exact energies that a sweep asks for at each boundary, at most.
_CARRY = 0.75
_TRIES = 1
# Rounds of relaxing and merging, sweeps in each, and the gain that is worth another round.
_ROUNDS = 3
_SWEEPS = 16
_WORTH = 1e-3
# Faces that the sweeps of a round look at together: a million takes about 10 s of CPU time; and
# those on a surface whose boundaries have come to rest on a simplified one.
_SWEPT = 1_600_000
_SWEPT_AGAIN = 400_000
# Faces above which charts are carried to a surface without a map of each: boundaries are drawn
# straight by what their charts told on the coarser one. From there on the noise of a scan turns
# single faces of a boundary-first map over wherever charts end; isometric maps mend them.
SOLVED = 400_000
# Times that charts which fail on such a surface are sent back to the coarser one.
_SENT_BACK = 4
# Rounds of splitting charts that overlap themselves.
_REPAIRS = 12


def carry(core: _core.Partition, levels: Sequence[Level], labels: Ints, log: Log) -> None:
    """Relax labels that are at rest on the first of two surfaces a little on the second one."""
    surface = levels[1].surface
    core.set_labels(labels, _CARRY * _ratio(levels))
    core.limit_tries(_TRIES)
    for _ in range(max(1, _SWEPT_AGAIN // surface.n_faces)):
        more = core.sweep()
        log.note("refine", surface, core)
        if not more:
            break
    log.close(log.note("refine", surface, core))


def carry_far(cores: Sequence[_core.Partition], levels: Sequence[Level], log: Log) -> None:
    """Carry charts to a far larger surface; what fails there is split before and carried anew."""
    (coarse, core), parents = cores, levels[1].parents
    for k in range(_SENT_BACK):
        carried = coarse.labels()[parents]
        core.carry_labels(carried, coarse.sensitivities()[parents], _CARRY * _ratio(levels))
        core.forbid_overlap(upright=False)
        log.close(log.note("refine", levels[1].surface, core))
        failing = core.failing()
        if len(failing) == 0 or k == _SENT_BACK - 1:
            break
        labels = core.labels()
        origins = [np.bincount(carried[labels == label]).argmax() for label in failing]
        coarse.condemn(np.unique(origins))
        repair(coarse, levels[0].surface, log, upright=False)


def _ratio(levels: Sequence[Level]) -> float:
    """Mean edge of the first of two surfaces in those of the second one."""
    before, surface = (level.surface for level in levels)
    return before.mean_edge_length / surface.mean_edge_length


def repair(core: _core.Partition, surface: Surface, log: Log, upright: bool) -> Phase:
    """Mend charts that overlap themselves, are tiny or, if `upright`, have faces turned over."""
    core.forbid_overlap(upright=upright)
    for k in range(_REPAIRS):
        if log.note("repair", surface, core).n_overlapping == 0:
            break
        # Where it takes little, the boundaries alone can do it.
        solved = surface.n_faces <= SOLVED
        if solved:
            core.sweep()
        if core.split_failing(2 + k // 2) == 0:
            break
        if not solved:
            continue
        core.merge()
        descend(core, surface, "repair", log)
    core.resize_tiny()
    last = log.note("repair", surface, core)
    log.close(last)
    return last


def descend(core: _core.Partition, surface: Surface, name: str, log: Log) -> Phase:
    """Relax and merge until the energy rests."""
    phase = log.note(name, surface, core)
    left = max(1, _SWEPT // surface.n_faces)
    for _ in range(_ROUNDS):
        energy, n_charts = phase.energy, phase.n_charts
        for _ in range(min(_SWEEPS, left)):
            left -= 1
            more = core.sweep()
            log.note(name, surface, core)
            if not more:
                break
        core.merge()
        phase = log.note(name, surface, core)
        # A merge leaves boundaries to move, what is less than that does not pay.
        if not phase.energy < (1 - _WORTH) * energy or phase.n_charts == n_charts:
            break
    return phase
