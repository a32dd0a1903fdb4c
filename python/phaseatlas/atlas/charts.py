"""Records of an atlas, from the domain of a chart to the layout of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .. import _core
from ..arrays import Bools, Floats, Ints
from ..notebook import Pictured
from ..points import flat_areas
from ..surface import Surface
from ..tiles import tile_offsets

__all__ = ["Chart", "Domain", "Layout", "charts_of_faces"]


@dataclass(frozen=True, eq=False)
class Domain:
    """Where a chart is to be: faces of the surface, cut open to a disk.

    Attributes
    ----------
    segment : int
        Segment that the chart is of.
    faces : (k,) array of int
        Faces of the surface.
    labelled : (k,) array of bool
        Those that belong to the sharp segment.
    weight : (n,) array
        Blending weight of the segment above its threshold, at the vertices of the surface.
    disk : TriangleMesh
        The faces, cut open.
    vertices : (p,) array of int
        Surface vertex of each vertex of the disk; a vertex on a cut stands once on each side.
    triangles : (k, 3) array of int
        The faces, in vertices of the disk.
    cut_length : float
        Length of the cut; 0 where the faces were a disk.
    sharp : TriangleMesh, optional
        The labelled faces alone, whose vertices are the first ones of the disk: they are mapped by
        themselves, and the rest is attached to their map. By default the disk is mapped at once.
    """

    segment: int
    faces: Ints
    labelled: Bools
    weight: Floats
    disk: _core.TriangleMesh
    vertices: Ints
    triangles: Ints
    cut_length: float
    sharp: _core.TriangleMesh | None = None


@dataclass(frozen=True, eq=False)
class Chart:
    """One chart: the domain where its weight is positive, as a disk, and its map to the plane.

    The map of the labelled faces is a bijection: it turns no face over, and the boundary does not
    cross itself. A flat piece of the surface with holes is mapped as it is; any other is a disk.

    Attributes
    ----------
    segment : int
        Leaf of the tree, or label of the segmentation; a segment that had to be split has several
        charts.
    faces : (k,) array of int
        Surface faces of the domain; domains of neighbouring charts overlap.
    labelled : (k,) array of bool
        The faces that are packed with this chart: those of the sharp segment, or of its part.
    vertices : (p,) array of int
        Surface vertex of each chart vertex; a vertex on a cut stands once on each side.
    triangles : (k, 3) array of int
        The faces, in chart vertices.
    uv : (p, 2) array
        The map, in the units of the surface: the labelled faces keep their total area.
    weights : (p,) array
        Blending weights; over all charts they sum to 1 at every surface vertex.
    log_scale : (p,) array
        Measured log scale factor of the map: half the log of area in the plane over area on the
        surface, around the vertex.
    cut_length : float
        Length of the cut that made the domain a disk; 0 where it was one.
    """

    segment: int
    faces: Ints
    labelled: Bools
    vertices: Ints
    triangles: Ints
    uv: Floats
    weights: Floats
    log_scale: Floats
    cut_length: float = 0.0

    def __repr__(self) -> str:
        labelled = f"{len(self.faces)} faces, {int(self.labelled.sum())} of them labelled"
        return f"Chart(of segment {self.segment}, {labelled}, cut by {self.cut_length:.4g})"


def charts_of_faces(charts: Sequence[Chart], n_faces: int) -> Ints:
    """Number of the chart that each face is labelled in, (m,)."""
    numbers = np.empty(n_faces, dtype=np.int64)
    for number, chart in enumerate(charts):
        numbers[chart.faces[chart.labelled]] = number
    return numbers


@dataclass(frozen=True, eq=False)
class Layout(Pictured):
    """Charts of a surface and their sharp parts packed into the unit square, or into several.

    Attributes
    ----------
    surface : Surface
        With n vertices and m faces.
    labels : (m,) array of int
        Segment of each face.
    charts : tuple of Chart
        The charts; every face is labelled in one.
    uv : (m, 3, 2) array
        Packed texture coordinates of the corners of each face, v up, in [0, 1] on its page.
    pages : (c,) array of int
        Page of each chart: which of several textures it is in. By default all are in one.
    resolution : int, default 1024
        Side in texels of the textures that the layout is meant for.
    stack : (m, 3) array of int
        Of faces that lie over their mirror images, turned over: the corner, three times the face
        plus its number, whose place each corner shares; else -1. By default there are none.
    """

    surface: Surface
    labels: Ints
    charts: tuple[Chart, ...]
    uv: Floats
    pages: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    resolution: int = 1024
    stack: Ints = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __post_init__(self) -> None:
        if not len(self.pages):
            object.__setattr__(self, "pages", np.zeros(len(self.charts), dtype=np.int64))
        if len(self.pages) != len(self.charts):
            raise ValueError(f"pages: length {len(self.pages)} must be {len(self.charts)}")
        if not len(self.stack):
            none = np.full((self.surface.n_faces, 3), -1, dtype=np.int64)
            object.__setattr__(self, "stack", none)

    @property
    def stacked(self) -> Bools:
        """Faces that lie over their mirror images, (m,)."""
        stacked: Bools = self.stack[:, 0] >= 0
        return stacked

    @property
    def n_pages(self) -> int:
        """Number of pages, up to the last with a chart."""
        return int(self.pages.max(initial=0)) + 1

    @property
    def face_charts(self) -> Ints:
        """Number of the chart of each face, (m,)."""
        return charts_of_faces(self.charts, self.surface.n_faces)

    @property
    def face_pages(self) -> Ints:
        """Page of each face, (m,)."""
        pages: Ints = self.pages[self.face_charts]
        return pages

    @property
    def udim(self) -> Floats:
        """Texture coordinates with each page in its UDIM tile, ten tiles a row, (m, 3, 2)."""
        return self.uv + tile_offsets(self.face_pages)[:, None]

    @property
    def density(self) -> float:
        """Texels a unit length of the surface, in the mean over the area."""
        return float(self.resolution * np.sqrt(flat_areas(self.uv).sum() / self.surface.area))

    @property
    def apart(self) -> tuple[Floats, Ints | None]:
        """Texture coordinates and pages as if no face lay over another one.

        What is stacked is turned back, on pages of its own; the pages are None where all is on one.
        """
        stacked = self.stacked
        if self.n_pages == 1 and not stacked.any():
            return self.uv, None
        uv = self.uv.copy()
        uv[stacked, :, 0] = 1.0 - uv[stacked, :, 0]
        return uv, self.face_pages + self.n_pages * stacked

    def __repr__(self) -> str:
        own = self.uv[~self.stacked]
        share = float(flat_areas(own).sum()) / self.n_pages
        pages = "the square" if self.n_pages == 1 else f"{self.n_pages} pages"
        covered = f"{100 * share:.3g} % of {pages}"
        name, of = type(self).__name__, repr(self.surface)
        return f"{name}({len(self.charts)} charts on {covered},\n  of {of})"
