"""Pieces of a scene: which are copies of others, and what a bound leaves to each."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from ..quality import warn
from ..surface import Surface
from .phases import Phase

__all__ = ["first_copies", "share_bound", "warn_of_bounds", "warn_of_charts"]

# Places along the longest side of a piece, by which copies of it are known.
_PLACES = 2**14


def first_copies(surfaces: Sequence[Surface]) -> list[int]:
    """Number of the first surface of which each is a copy, but for place and size: often its own.

    Screws and leaves are such copies. The places of vertices may differ by rounding.
    """
    first: dict[bytes, int] = {}
    return [first.setdefault(_shape(surface), k) for k, surface in enumerate(surfaces)]


def _shape(surface: Surface) -> bytes:
    corner = surface.vertices.min(axis=0)
    extent = float((surface.vertices - corner).max())
    places = np.rint((surface.vertices - corner) * (_PLACES / extent)).astype(np.int32)
    digest = hashlib.sha256(places.tobytes())
    digest.update(surface.faces.tobytes())
    for costs in (surface.seam_costs, surface.vertex_seam_costs):
        digest.update(b"none" if costs is None else costs.tobytes())
    return digest.digest()


def share_bound(counts: Sequence[int], most: int) -> Sequence[int]:
    """Share `most` charts out among pieces that want `counts`, at least one a piece.

    It is said where there are more pieces.
    """
    wanted = np.array(counts) - 1
    if len(counts) > most:
        warn(
            f"max_charts: {most} is exceeded, there are {len(counts)} pieces and each has at least "
            "one chart; a larger bound is met"
        )
    room = max(most - len(counts), 0)
    if wanted.sum() <= room:
        return counts
    exact = wanted * (room / wanted.sum())
    given = np.floor(exact).astype(np.int64)
    rest = np.argsort(given - exact, kind="stable")[: room - int(given.sum())]
    given[rest] += 1
    bounds: list[int] = (given + 1).tolist()
    return bounds


def warn_of_charts(n_charts: int, max_charts: int | None) -> None:
    """Say where there are more charts than asked for."""
    if max_charts is not None and n_charts > max_charts:
        warn(f"max_charts: {max_charts} is exceeded, there are {n_charts} charts")


def warn_of_bounds(last: Phase, max_distortion: float | None, max_charts: int | None) -> None:
    """Say which bounds are not met, and which charts overlap themselves."""
    warn_of_charts(last.n_charts, max_charts)
    if max_distortion is not None and last.distortion > max_distortion**2:
        warn(
            f"max_distortion: {max_distortion:g} is exceeded, the root mean square log scale is "
            f"{last.distortion**0.5:.3g}"
        )
    if last.n_overlapping:
        warn(f"{last.n_overlapping} of {last.n_charts} charts overlap themselves")
