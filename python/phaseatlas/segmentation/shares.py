"""The shares of the area that segments are to have, checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import quality
from ..arrays import Floats
from ..surface import Surface
from .tree import MAX_LEVELS
from .whole import n_units

__all__ = ["check_levels", "check_shares", "parts_of"]


def parts_of(
    surface: Surface, levels: int | None, shares: Sequence[float] | None
) -> Sequence[float]:
    """The shares of the segments, checked."""
    if shares is not None:
        if levels is not None:
            raise ValueError("shares: must be given without levels")
        parts = check_shares(shares)
        least = float(surface.face_areas.min() / surface.area)
        if (parts < least * parts.sum()).any():
            small = int(np.argmin(parts))
            raise ValueError(
                f"shares[{small}]: {parts[small]} must be at least {least:.3g} of their sum, the "
                "area of a face"
            )
        if len(parts) > surface.n_faces:
            raise ValueError(
                f"shares: {len(parts)} asks for more segments than {surface.n_faces} faces"
            )
        return parts.tolist()  # type: ignore[no-any-return]
    check_levels(levels)
    count = 2 ** (1 if levels is None else int(levels))
    most = n_units(surface, count)
    if most == 1:
        raise ValueError("levels: a single face cannot be cut")
    if most < count:
        quality.warn(f"levels: {most} segments instead of {count}, one for each face")
    return [1.0] * min(count, most)


def check_levels(levels: int | None) -> None:
    """ValueError for a depth that no tree has."""
    if levels is not None and levels not in range(1, MAX_LEVELS + 1):
        raise ValueError(f"levels: {levels!r} must be a whole number in 1..{MAX_LEVELS}")


def check_shares(shares: Sequence[float]) -> Floats:
    """Shares as an array; ValueError for anything but two or more positive numbers."""
    parts = np.asarray(shares, dtype=np.float64)
    if parts.ndim != 1 or len(parts) < 2:
        raise ValueError(f"shares: shape {parts.shape} must be (k,) with k at least 2")
    good = np.isfinite(parts) & (parts > 0)
    if not good.all():
        wrong = int(np.argmin(good))
        raise ValueError(f"shares[{wrong}]: {parts[wrong]} must be a positive number")
    if len(parts) > 2**MAX_LEVELS:
        raise ValueError(f"shares: {len(parts)} of them must be at most {2**MAX_LEVELS}")
    return parts
