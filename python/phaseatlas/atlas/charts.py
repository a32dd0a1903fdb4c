"""Records of an atlas, from the domain of a chart to the layout of all of them."""

from __future__ import annotations

from dataclasses import dataclass

from .. import _core
from ..arrays import Bools, Floats, Ints
from ..notebook import Pictured
from ..points import flat_areas
from ..surface import Surface

__all__ = ["Chart", "Domain", "Layout"]


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


@dataclass(frozen=True, eq=False)
class Layout(Pictured):
    """Charts of a surface and their sharp parts packed into the unit square.

    Attributes
    ----------
    surface : Surface
        With n vertices and m faces.
    labels : (m,) array of int
        Segment of each face.
    charts : tuple of Chart
        The charts; every face is labelled in one.
    uv : (m, 3, 2) array
        Packed texture coordinates of the corners of each face, v up, in [0, 1].
    """

    surface: Surface
    labels: Ints
    charts: tuple[Chart, ...]
    uv: Floats

    def __repr__(self) -> str:
        covered = f"{100 * float(flat_areas(self.uv).sum()):.3g} % of the square"
        name, of = type(self).__name__, repr(self.surface)
        return f"{name}({len(self.charts)} charts on {covered},\n  of {of})"
