"""Bounds on a partition: given out to pieces, and said where they are not met."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..quality import warn
from .phases import Phase

__all__ = ["share_bound", "warn_of_bounds"]


def share_bound(counts: Sequence[int], most: int) -> Sequence[int]:
    """Share `most` charts out among pieces that want `counts`, at least one a piece."""
    wanted = np.array(counts) - 1
    room = max(most - len(counts), 0)
    if wanted.sum() <= room:
        return counts
    exact = wanted * (room / wanted.sum())
    given = np.floor(exact).astype(np.int64)
    rest = np.argsort(given - exact, kind="stable")[: room - int(given.sum())]
    given[rest] += 1
    bounds: list[int] = (given + 1).tolist()
    return bounds


def warn_of_bounds(last: Phase, max_distortion: float | None, max_charts: int | None) -> None:
    """Say which bounds are not met, and which charts overlap themselves."""
    if max_charts is not None and last.n_charts > max_charts:
        warn(f"max_charts: {max_charts} is exceeded, there are {last.n_charts} charts")
    if max_distortion is not None and last.distortion > max_distortion**2:
        warn(
            f"max_distortion: {max_distortion:g} is exceeded, the root mean square log scale is "
            f"{last.distortion**0.5:.3g}"
        )
    if last.n_overlapping:
        warn(f"{last.n_overlapping} of {last.n_charts} charts overlap themselves")
