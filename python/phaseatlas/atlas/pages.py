"""Charts on one page or several: how far apart for mip levels, at which texel density."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Ints
from ..points import flat_areas
from ..quality import warn
from ..segmentation import SceneSegmentation, Segmentation, SegmentTree
from .charts import Chart, charts_of_faces
from .packing import Pieces, check_packing, gather, share_with_room

__all__ = [
    "MAX_PAGES",
    "MAX_SIDE",
    "PackOptions",
    "Packing",
    "lay_out",
    "pages_of_subtrees",
]

#: Side in texels of the largest texture that graphics cards take.
MAX_SIDE = 16384
#: Ten rows of ten UDIM tiles.
MAX_PAGES = 100
# The side follows a density in steps of four texels, the blocks of compressed textures.
_BLOCK = 4
# Part of a page that charts fill, more or less, where none is packed yet.
_FILL = 0.8
# Two points of one texel are at most its diagonal apart; charts further apart share none.
_DIAGONAL = math.sqrt(2.0) * (1.0 + 1e-6)
# Of distances and scales: far more than rounding, far less than a texel.
_EQUAL = 1e-9
# Rounds in which pages come to one scale; two do nearly always.
_ROUNDS = 8


@dataclass(frozen=True)
class PackOptions:
    """How charts are laid out.

    Parameters
    ----------
    padding : int, default 4
        Least distance of two charts in texels of the last of the mip levels.
    resolution : int, optional
        Side of each page in texels; 1024 by default, and with a density what that needs.
    mips : int, default 0
        Halvings of the texture after which the charts are still `padding` texels apart: at full
        size `padding` times 2^mips. No texel of these levels is touched by two charts, even where
        `padding` is 0 or 1, for they are at least a diagonal of its texels apart; from a padding of
        3 on none that a chart touches takes any colour from the gutter of another. The resolution
        is a multiple of 2^mips, so that texels are halved whole.
    density : float, optional
        Texels a unit length of the surface, the same for all charts and meshes: the mean over the
        faces of a chart, whose map keeps its area. The resolution follows: the least multiple of 4,
        and of 2^mips, that has room.
    pages : int, default 1
        Number of textures that share the charts.

    Raises
    ------
    ValueError
        For a value out of range, and a resolution given with a density.
    """

    padding: int = 4
    resolution: int | None = None
    mips: int = 0
    density: float | None = None
    pages: int = 1

    def __post_init__(self) -> None:
        most = MAX_SIDE.bit_length() - 1
        if not 0 <= self.mips <= most:
            raise ValueError(f"mips: {self.mips} must be in 0..{most}")
        if not 1 <= self.pages <= MAX_PAGES:
            raise ValueError(f"pages: {self.pages} must be in 1..{MAX_PAGES}")
        if self.density is not None:
            if self.resolution is not None:
                raise ValueError("resolution: value must be left out with density")
            if not (math.isfinite(self.density) and self.density > 0):
                raise ValueError(f"density: {self.density} must be a positive number")
            if self.padding < 0:
                raise ValueError(f"padding: {self.padding} must be at least 0")
            self._check_texels(MAX_SIDE)
            return
        check_packing(self.padding, self.side)
        if self.side % 2**self.mips:
            raise ValueError(
                f"resolution: {self.side} must be a multiple of {2**self.mips} for mips {self.mips}"
            )
        self._check_texels(self.side)

    def _check_texels(self, side: int) -> None:
        if self.texels > side // 8:
            name = "mips" if self.mips else "padding"
            raise ValueError(
                f"{name}: {getattr(self, name)} puts {self.texels:g} texels between charts, which "
                f"must be at most {side // 8}, an eighth of the resolution"
            )

    @property
    def side(self) -> int:
        """The resolution where there is no density."""
        return 1024 if self.resolution is None else self.resolution

    @property
    def texels(self) -> float:
        """Least distance of two charts in texels of the full size."""
        if not self.mips:
            return self.padding
        return max(self.padding, _DIAGONAL) * float(2**self.mips)

    def check_area(self, area: float) -> None:
        """Refuse a density that overfills all pages or leaves no texel, before there are charts.

        Parameters
        ----------
        area : float
            Of the surface.
        """
        if self.density is None:
            return
        full = area * self.density**2 / MAX_SIDE**2
        if full > self.pages:
            raise self._too_dense(self.density, math.sqrt(full / self.pages), full / _FILL)
        if area * self.density**2 < 1.0:
            raise ValueError(
                f"density: {self.density:g} texels a unit leave less than a texel for the surface; "
                f"the density must be at least {1.0 / math.sqrt(area):.3g}"
            )

    def _too_dense(self, density: float, times: float, pages: float) -> ValueError:
        least = math.ceil(pages)
        cure = f"pages must be at least {least}, or " if least <= MAX_PAGES else ""
        return ValueError(
            f"density: {density:g} texels a unit take pages of {MAX_SIDE * times:.0f} texels "
            f"a side, more than {MAX_SIDE}; {cure}the density at most {density / times:.3g}"
        )

    def side_of(self, scale: float) -> int:
        """The resolution that a density needs.

        Parameters
        ----------
        scale : float
            Of the charts on the fullest page, whose side is 1.

        Raises
        ------
        ValueError
            If it is more than `MAX_SIDE`.
        """
        if self.density is None:
            return self.side
        step = max(_BLOCK, 2**self.mips)
        side: int = step * math.ceil(self.density / scale / step - _EQUAL)
        if side > MAX_SIDE:
            times = self.density / scale / MAX_SIDE
            raise self._too_dense(self.density, times, self.pages * times**2)
        return side


@dataclass(frozen=True, eq=False)
class Packing:
    """Where charts came to lie.

    Attributes
    ----------
    uv : (m, 3, 2) array
        Corners of each face on its page, in [0, 1].
    pages : (c,) array of int
        Page of each chart.
    resolution : int
        Side of each page in texels.
    """

    uv: Floats
    pages: Ints
    resolution: int


def lay_out(
    charts: Sequence[Chart],
    n_faces: int,
    options: PackOptions,
    pages: Ints | None = None,
    stack: Ints | None = None,
) -> Packing:
    """Lay the labelled faces of all charts onto pages, at one scale.

    Parameters
    ----------
    charts : sequence of Chart
        The labelled faces of the charts together are every face exactly once.
    n_faces : int
        Number m of faces of the surface.
    options : PackOptions
    pages : (c,) array of int, optional
        Page of each chart, -1 where it is free. Free charts go, the largest first, to the page that
        holds least.
    stack : (m, 3) array of int, optional
        As `Layout.stack`. A chart is stacked whole.

    Raises
    ------
    ValueError
        As in `packing.pack`, and for a density with which the pages would be too large.

    Warns
    -----
    QualityWarning
        If so many charts cannot be kept apart, and if pages stay empty.
    """
    pieces = gather(charts, n_faces)
    below = _charts_below(charts, n_faces, stack)
    own = np.flatnonzero(below == np.arange(len(charts)))
    if len(own) < len(charts):
        pieces = pieces.of(own)
    areas: Floats = np.bincount(pieces.chart, pieces.areas, len(charts)).astype(np.float64)
    pages = _shared_out(areas, options.pages, pages)[below]
    used = np.unique(pages)
    if len(used) < options.pages:
        warn(f"pages: {len(charts)} charts fill {len(used)} pages, not {options.pages}")
    sheets = [pieces.of(np.flatnonzero(pages == page)) for page in used]
    uv = np.empty((n_faces, 3, 2))
    if options.density is not None:
        length = options.texels / options.density
        placed = [_placed(sheet, length, as_length=True) for sheet in sheets]
        side = options.side_of(min(each.scale for each in placed))
        scale = options.density / side
    else:
        side = options.side
        share = share_with_room(sheets, options.texels, side)
        if options.mips and share * side < _DIAGONAL * 2**options.mips:
            warn(f"mips: texels of level {options.mips} are touched by several charts")
        placed = _at_one_scale(sheets, share)
        scale = min(each.scale for each in placed)
    for each in placed:
        # The one whose scale it is stays as it is, to the bit.
        factor = scale / each.scale
        uv[each.pieces.faces] = each.uv if factor >= 1.0 else factor * each.uv
    if stack is not None:
        stacked = stack[:, 0] >= 0
        uv[stacked] = uv.reshape(-1, 2)[stack[stacked]]
    return Packing(uv, pages, side)


def _charts_below(charts: Sequence[Chart], n_faces: int, stack: Ints | None) -> Ints:
    """The chart that each one lies over, itself for one that has a place of its own."""
    below = np.arange(len(charts))
    if stack is None:
        return below
    of_face = charts_of_faces(charts, n_faces)
    for number, chart in enumerate(charts):
        corner = stack[chart.faces[chart.labelled][0], 0]
        if corner >= 0:
            below[number] = of_face[corner // 3]
    return below


@dataclass(frozen=True, eq=False)
class _Placed:
    """Pieces in a square of their own, their scale there and their distance in their own units."""

    pieces: Pieces
    uv: Floats
    scale: float
    length: float


def _placed(pieces: Pieces, padding: float, *, as_length: bool) -> _Placed:
    uv = pieces.packed(padding, as_length=as_length)
    scale = math.sqrt(float(flat_areas(uv).sum() / pieces.areas.sum()))
    return _Placed(pieces, uv, scale, padding if as_length else padding / scale)


def _at_one_scale(sheets: Sequence[Pieces], share: float) -> list[_Placed]:
    """Pack sheets so that all have their gap at the scale of the one that is fullest."""
    placed = [_placed(sheet, share, as_length=False) for sheet in sheets]
    for _ in range(_ROUNDS):
        scale = min(each.scale for each in placed)
        length = share / scale
        near = [k for k, each in enumerate(placed) if each.length < length * (1.0 - _EQUAL)]
        if not near:
            break
        for k in near:
            placed[k] = _placed(sheets[k], length, as_length=True)
    else:
        least = min(each.length for each in placed) * min(each.scale for each in placed)
        if least < share * (1.0 - _EQUAL):
            warn(f"padding: on one page charts are {100 * least / share:.4g} % as far apart")
    return placed


def _shared_out(areas: Floats, count: int, given: Ints | None) -> Ints:
    """Page of each chart; those without one go to the page that holds least."""
    pages = np.full(len(areas), -1, dtype=np.int64) if given is None else given.copy()
    free = np.flatnonzero(pages < 0)
    # Of nothing, the sums are of integers.
    held = np.bincount(pages[pages >= 0], areas[pages >= 0], count).astype(np.float64)
    # Single precision makes charts of one size equal, whatever rounding made of them.
    order = np.argsort(-areas[free].astype(np.float32), kind="stable")
    for chart in free[order].tolist():
        page = int(held.argmin())
        pages[chart] = page
        held[page] += areas[chart]
    return pages


def pages_of_subtrees(
    tree: SegmentTree | Segmentation, charts: Sequence[Chart], count: int
) -> Ints:
    """Page of each chart: the subtrees of equal area on one level of a tree fill equal pages.

    Parameters
    ----------
    tree : SegmentTree or Segmentation
        What the charts are of. Each piece of a scene has a tree of its own.
    charts : sequence of Chart
    count : int
        Number of pages.

    Returns
    -------
    (c,) array of int
        -1 for charts that are of no such subtree.
    """
    page_of_face = np.full(tree.surface.n_faces, -1, dtype=np.int64)
    if isinstance(tree, SceneSegmentation):
        for piece, part in zip(tree.pieces, tree.trees, strict=False):
            if part is not None:
                page_of_face[piece.faces] = _subtree_of_face(part, count)
    elif isinstance(tree, SegmentTree):
        page_of_face = _subtree_of_face(tree, count)
    return np.array([page_of_face[chart.faces[chart.labelled][0]] for chart in charts])


def _subtree_of_face(tree: SegmentTree, count: int) -> Ints:
    """Subtree of each face on the level of `count` equal ones; -1 where there is no such level."""
    level = count.bit_length() - 1
    none = np.full(tree.surface.n_faces, -1, dtype=np.int64)
    if 2**level != count or level > tree.levels:
        return none
    subtree = tree.labels_at(level)
    leaves, first = np.unique(tree.labels, return_index=True)
    shares = np.bincount(subtree[first], weights=tree.shares[leaves], minlength=count)
    return subtree if np.allclose(shares * count, 1.0) else none
