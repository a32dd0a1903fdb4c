"""What a page shows: made of surfaces, segmentations and atlases."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import singledispatch

import numpy as np
from PIL import Image

from ..arrays import Bytes, Floats, Ints
from ..atlas import Atlas
from ..scene.picture import eight_bits, unreadable
from ..scene.scene import Scene
from ..segmentation import SceneSegmentation, Segmentation, SegmentTree
from ..surface import Surface
from ..unwrapping import Unwrapped

__all__ = ["Picture", "Subject", "subject"]

# Segments above which their weights are not blended to a picture: each is a linear system.
_MOST_BLENDED = 256
# Sides of the texture that is baked where none is given.
_RESOLUTION = 1024
# Largest side of a texture in a page, in texels, and the quality of its JPEG.
_MOST_TEXELS = 2048
_QUALITY = 88


@dataclass(frozen=True, eq=False)
class Picture:
    """What a material looks like.

    Attributes
    ----------
    data : bytes or None
        A JPEG file.
    colour : tuple of float
        Factor of the colour, linear.
    side : int
        Of the texture before it was made small, in texels; 0 for none.
    """

    data: bytes | None = None
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    side: int = 0

    @classmethod
    def read(cls, data: bytes, colour: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Picture:
        """Take the file of a texture, made as small as a page needs it; none of a broken one."""
        try:
            with Image.open(io.BytesIO(data)) as image:
                return cls._of(image, colour)
        except unreadable():
            return cls(colour=colour)

    @classmethod
    def of(cls, image: Bytes) -> Picture:
        """Take a baked image, (r, r, 3) or (r, r, 4), first row on top."""
        return cls._of(Image.fromarray(image), (1.0, 1.0, 1.0))

    @classmethod
    def _of(cls, image: Image.Image, colour: tuple[float, float, float]) -> Picture:
        side = round(float(np.sqrt(image.width * image.height)))
        small = eight_bits(image).convert("RGB")
        small.thumbnail((_MOST_TEXELS, _MOST_TEXELS))
        out = io.BytesIO()
        small.save(out, format="jpeg", quality=_QUALITY)
        return cls(out.getvalue(), colour, side)


@dataclass(frozen=True, eq=False)
class Blend:
    """Weights at the vertices: of each chart its own vertices, and its weights there."""

    n_vertices: int
    parts: Sequence[tuple[int, Ints, Floats]]

    def colours(self, of_charts: Bytes) -> Floats:
        """The mean of the charts' colours, (count, 3), at the vertices, (n, 3)."""
        sums = np.zeros((self.n_vertices, 3))
        total = np.zeros(self.n_vertices)
        for chart, vertices, weights in self.parts:
            # A vertex on a cut stands in a chart twice.
            places, first = np.unique(vertices, return_index=True)
            sums[places] += weights[first, None] * of_charts[chart]
            total[places] += weights[first]
        mean: Floats = sums / np.maximum(total, np.finfo(float).tiny)[:, None]
        return mean


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface and what is known of it.

    Attributes
    ----------
    surface : Surface
        With n vertices and m faces.
    chart : (m,) array of int
        Chart or segment of each face, in 0..count-1.
    count : int
        Number of charts or segments; 1 where there are none.
    noun : str
        "chart", "segment", or "" for neither.
    uv : (m, 3, 2) array or None
        Texture coordinates, v up.
    pictures : tuple of Picture
        By material.
    material : (m,) array of int or None
        Of each face; None where all have the first.
    colours : (m, 3, 3) array or None
        Colours at the corners, linear, by which the pictures are multiplied.
    levels : tuple of (count,) arrays of int
        Segment on each level of a tree, from its second one down, of each chart.
    weights : Blend or None
        Weights by which charts blend; None where each face is of one alone.
    resolution : int
        Side of the texture, in texels.
    metrics : dict of str to float
    notes : tuple of str
        Sentences for the reader.
    """

    surface: Surface
    chart: Ints
    count: int
    noun: str = ""
    uv: Floats | None = None
    pictures: tuple[Picture, ...] = ()
    material: Ints | None = None
    colours: Floats | None = None
    levels: tuple[Ints, ...] = ()
    weights: Blend | None = None
    resolution: int = _RESOLUTION
    metrics: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@singledispatch
def subject(thing: object) -> Subject:
    """Gather what a page shows of a surface, a segmentation, a tree, or an atlas."""
    raise TypeError(f"thing: {type(thing).__name__} must be a surface, a segmentation or an atlas")


@subject.register
def _(thing: Surface) -> Subject:
    pieces = {"pieces": len(thing.pieces)} if isinstance(thing, Scene) else {}
    return Subject(
        thing,
        np.zeros(thing.n_faces, dtype=np.int64),
        1,
        metrics={
            "vertices": thing.n_vertices,
            "faces": thing.n_faces,
            **pieces,
            "genus": thing.genus,
            "boundary loops": thing.n_boundary_loops,
            "area": thing.area,
        },
    )


@subject.register
def _(thing: Segmentation) -> Subject:
    levels: tuple[Ints, ...] = ()
    if isinstance(thing, SceneSegmentation):
        levels = _levels_of_scene(thing)
    return _segmented(thing, levels)


@subject.register
def _(thing: SegmentTree) -> Subject:
    levels = tuple(
        _of_charts(thing.labels_at(level), thing.labels, len(thing.areas))
        for level in range(1, thing.levels + 1)
    )
    return _segmented(thing.at(thing.levels), levels)


@subject.register
def _(thing: Atlas) -> Subject:
    surface = thing.surface
    chart = thing.face_charts
    parts = [(k, each.vertices, each.weights) for k, each in enumerate(thing.charts)]
    blended = any(not each.labelled.all() for each in thing.charts)
    return Subject(
        surface,
        chart,
        len(thing.charts),
        "chart",
        # Several pages are drawn side by side.
        thing.udim,
        weights=Blend(surface.n_vertices, parts) if blended else None,
        metrics=thing.metrics(),
    )


@subject.register
def _(thing: Unwrapped) -> Subject:
    return subject(thing.atlas)


def _segmented(thing: Segmentation, levels: tuple[Ints, ...]) -> Subject:
    surface, count = thing.surface, thing.n_segments
    shares = 100 * thing.areas / surface.area
    depth = {"levels": len(levels)} if levels else {}
    return Subject(
        surface,
        thing.labels,
        count,
        "segment",
        levels=levels,
        weights=_weights(thing),
        metrics={
            "segments": count,
            **depth,
            "largest": float(shares.max()),
            "smallest": float(shares.min()),
            "in pieces": int((thing.components > 1).sum()),
            "length": thing.length / float(np.sqrt(surface.area)),
        },
    )


def _weights(thing: Segmentation) -> Blend | None:
    if thing.n_segments > _MOST_BLENDED or thing.n_segments == 1:
        return None
    parts: list[tuple[int, Ints, Floats]] = []
    if isinstance(thing, SceneSegmentation):
        for piece, part in zip(thing.pieces, thing.parts, strict=True):
            first = len(parts)
            parts += [(first + k, piece.vertices, part.weight(k)) for k in range(part.n_segments)]
    else:
        everywhere = np.arange(thing.surface.n_vertices)
        parts += [(k, everywhere, thing.weight(k)) for k in range(thing.n_segments)]
    return Blend(thing.surface.n_vertices, parts)


def _levels_of_scene(thing: SceneSegmentation) -> tuple[Ints, ...]:
    """Segments of all pieces on each level; a tree that ends above it has its leaves there."""
    depth = max((tree.levels for tree in thing.trees if tree is not None), default=0)
    levels = []
    for level in range(1, depth + 1):
        found: list[Ints] = []
        first = 0
        for part, tree in zip(thing.parts, thing.trees, strict=True):
            of_part = np.zeros(part.n_segments, dtype=np.int64)
            if tree is not None:
                labels = tree.labels_at(min(level, tree.levels))
                of_part = _of_charts(labels, part.labels, part.n_segments)
            found.append(of_part + first)
            first += int(of_part.max()) + 1
        levels.append(np.concatenate(found))
    return tuple(levels)


def _of_charts(values: Ints, chart: Ints, count: int) -> Ints:
    """The value that all faces of each chart have, (count,); 0 for a chart without faces."""
    found = np.zeros(count, dtype=np.int64)
    found[chart] = values
    return found
