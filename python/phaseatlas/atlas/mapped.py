"""The charts of a segmentation: every segment flattened on a domain, split where it must be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from ..arrays import Floats, Ints
from ..partitioning import Partition
from ..segmentation import SceneSegmentation, Segmentation
from ..threads import n_threads
from .charts import Chart
from .domains import blending_weights, piece_domain, pieces, sharp_weights, split
from .flatten import Flattening, Map, chart, flatten
from .widest import widest

__all__ = ["charts_of"]

# Thresholds of narrower domains; the last leaves about the labelled faces.
_NARROWER = (0.1, 0.25, 0.5)


def charts_of(
    segmentation: Segmentation,
    threshold: float | None,
    method: Flattening | None,
    overlap: bool,
) -> tuple[tuple[Chart, ...], int]:
    """Charts of all segments, and how many had to be split.

    Each is on the widest domain that suits its labelled faces. Those of the pieces of a scene are
    made piece by piece.
    """
    if method is None and not isinstance(segmentation, SceneSegmentation):
        method = "isometric" if isinstance(segmentation, Partition) else "bff"
    with ThreadPoolExecutor(n_threads()) as pool:
        if isinstance(segmentation, SceneSegmentation):
            done = pool.map(
                lambda part: charts_of(part, threshold, method, overlap), segmentation.parts
            )
            return _of_scene(segmentation, list(done))
        count = segmentation.n_segments
        thresholds: tuple[float, ...] = (min(0.02, 0.5 / count), *_NARROWER)
        if threshold is not None:
            thresholds = (threshold,)
        overlap = overlap or method != "isometric"
        found = list(
            pool.map(
                lambda segment: _maps(segmentation, segment, thresholds, method or "bff", overlap),
                range(count),
            )
        )
    maps = [mapped for of_segment, _ in found for mapped in of_segment]
    of_maps = [mapped.domain for mapped in maps]
    weights: Iterable[Floats]
    if overlap:
        weights = blending_weights(segmentation, of_maps)
    else:
        weights = [sharp_weights(segmentation.surface, of_maps)] * len(maps)
    charts = tuple(chart(mapped, weight) for mapped, weight in zip(maps, weights, strict=True))
    return charts, sum(n_split for _, n_split in found)


def _of_scene(
    segmentation: SceneSegmentation, done: Sequence[tuple[tuple[Chart, ...], int]]
) -> tuple[tuple[Chart, ...], int]:
    """The charts of the pieces as charts of their scene."""
    charts: list[Chart] = []
    first = 0
    for piece, part, (found, _) in zip(segmentation.pieces, segmentation.parts, done, strict=True):
        charts.extend(
            replace(
                each,
                segment=each.segment + first,
                faces=piece.faces[each.faces],
                vertices=piece.vertices[each.vertices],
            )
            for each in found
        )
        first += part.n_segments
    return tuple(charts), sum(n_split for _, n_split in done)


def _maps(
    segmentation: Segmentation,
    segment: int,
    thresholds: Sequence[float],
    method: Flattening,
    overlap: bool,
) -> tuple[list[Map], int]:
    """Bijections of the labelled faces of a segment, and how many charts were split for them."""
    parts = pieces(segmentation, segment)
    if method != "isometric" and not any(_flat_with_holes(segmentation, p) for p in parts):
        maps = widest(segmentation, segment, thresholds, method)
        if maps is not None:
            return maps, 0
    threshold = thresholds[0] if overlap else None
    found = [_alone(segmentation, segment, part, threshold, method) for part in parts]
    return [mapped for maps in found for mapped in maps], sum(len(maps) > 1 for maps in found)


def _flat_with_holes(segmentation: Segmentation, piece: Ints) -> bool:
    domain = piece_domain(segmentation, 0, piece, None, weighted=False)
    return domain.disk.n_boundary_loops > 1


def _alone(
    segmentation: Segmentation,
    segment: int,
    piece: Ints,
    threshold: float | None,
    method: Flattening,
) -> list[Map]:
    """Map the faces of a piece by themselves, split until all maps are bijections.

    Faces are attached, and there are weights, where a threshold is given.
    """
    surface = segmentation.surface
    maps = []
    waiting = [piece]
    while waiting:
        piece = waiting.pop()
        domain = piece_domain(
            segmentation, segment, piece, threshold, weighted=threshold is not None
        )
        mapped = flatten(domain, method, surface)
        if mapped is None and threshold is not None:
            # What cannot be attached is left out.
            mapped = flatten(piece_domain(segmentation, segment, piece, None), method, surface)
        if mapped is not None:
            maps.append(mapped)
        elif len(piece) > 1:
            waiting.extend(split(domain))
        else:
            raise ValueError(f"faces[{piece[0]}]: a triangle this thin has no map to the plane")
    return maps
