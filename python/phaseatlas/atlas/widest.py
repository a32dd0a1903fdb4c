"""The widest domains of a segment on which its labelled faces lie well."""

from __future__ import annotations

from collections.abc import Sequence

from ..segmentation import Segmentation
from .domains import domains
from .flatten import Flattening, Map, flatten, spread

__all__ = ["widest"]

# Squared deviation of the log scale, over the surface, below which no narrower domain is sought,
# and the ratio to the best one that a wider one may have beyond it. The boundary-first charts of
# the partitions of eight meshes have .002 to .013 in all (docs/decisions/isometric.md).
_FREE_SPREAD = 1e-3
_WIDENING = 1.25


def widest(
    segmentation: Segmentation, segment: int, thresholds: Sequence[float], method: Flattening
) -> list[Map] | None:
    """Map the domains of a segment at the least threshold that suits its labelled faces.

    None where the map of the labelled faces is no bijection at any threshold.
    """
    surface = segmentation.surface
    tried: list[tuple[float, list[Map]]] = []
    for threshold in thresholds:
        found = [flatten(d, method, surface) for d in domains(segmentation, segment, threshold)]
        maps = [mapped for mapped in found if mapped is not None]
        if len(maps) < len(found):
            continue
        cost = sum(spread(mapped, surface.face_areas) / surface.area for mapped in maps)
        tried.append((cost, maps))
        if tried[0][0] <= _FREE_SPREAD:
            return maps
    if not tried:
        return None
    bound = _FREE_SPREAD + _WIDENING * min(cost for cost, _ in tried)
    return next(maps for cost, maps in tried if cost <= bound)
