"""What a partition is: labels by energy, and the figures of the phases that led to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Ints
from ..segmentation import Segmentation
from ..surface import Surface
from .phases import Phase

__all__ = ["Partition", "by_area"]


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


def by_area(labels: Ints, surface: Surface) -> Ints:
    """Number labels by area, the largest first."""
    order = np.argsort(-np.bincount(labels, surface.face_areas), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[labels].astype(np.int64)
