"""Any polygons made an oriented manifold, with a map that leads back to every corner."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..arrays import Bools, Floats, Ints

__all__ = [
    "Aside",
    "RepairReport",
    "Repaired",
    "repair",
    "summed",
]


@dataclass(frozen=True)
class RepairReport:
    """What a mesh has, and how often each defect was found.

    Every triangle of a polygon is a face or set aside.

    Attributes
    ----------
    polygons : tuple of (int, int)
        Size and number of the polygons of the input, by size.
    faces : int
        Triangles that are faces of the repaired mesh.
    components : int
        Connected components of these.
    boundary_loops : int
        Boundary loops of the components, those of holes and of what was opened alike.
    isolated_vertices : int
        Vertices that no polygon uses.
    welded_vertices : int
        Vertices that became one with an earlier vertex at the same place.
    degenerate_faces : int
        Triangles without area, set aside.
    duplicate_faces : int
        Triangles on the same vertices as an earlier one in the same winding, set aside.
    opposite_faces : int
        Pairs of faces on the same vertices in opposite windings: two sheets.
    non_manifold_edges : int
        Edges of more than two faces, opened into pairs.
    non_manifold_vertices : int
        Vertices of several fans, opened, though none of their edges is non-manifold or cut and
        none of their triangles without area.
    flipped_faces : int
        Faces that are turned over against most of the area of their component.
    cut_edges : int
        Edges that were cut because a piece was not orientable.
    opened_edges : int
        Edges that were opened because a piece touches itself along another edge.
    """

    polygons: tuple[tuple[int, int], ...]
    faces: int
    components: int
    boundary_loops: int
    isolated_vertices: int
    welded_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    opposite_faces: int
    non_manifold_edges: int
    non_manifold_vertices: int
    flipped_faces: int
    cut_edges: int
    opened_edges: int

    @property
    def aside(self) -> int:
        """Triangles that are set aside."""
        return self.degenerate_faces + self.duplicate_faces

    def sentences(self) -> list[str]:
        """Return what there is, and each defect that was found, in a sentence each."""
        names = {3: ("triangle", "triangles"), 4: ("quadrilateral", "quadrilaterals")}
        parts = [
            _count(count, *names.get(size, (f"polygon of {size}", f"polygons of {size}")))
            for size, count in self.polygons
        ]
        polygons = " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
        faces = _count(self.faces, "triangle", "triangles")
        components = _count(self.components, "component", "components")
        loops = _count(self.boundary_loops, "boundary loop", "boundary loops")
        lines = [
            f"The mesh has {polygons or 'no polygons'}.",
            f"Repaired, it has {faces} in {components} with {loops}.",
        ]
        for name, one, many in _DEFECTS:
            if count := getattr(self, name):
                lines.append((one if count == 1 else many).format(f"{count:,}"))
        return lines


def summed(reports: Sequence[RepairReport]) -> RepairReport:
    """Return the report of several meshes as if they were one."""
    sizes = Counter[int]()
    for report in reports:
        sizes.update(dict(report.polygons))
    counts = {
        field.name: sum(getattr(report, field.name) for report in reports)
        for field in fields(RepairReport)
        if field.name != "polygons"
    }
    return RepairReport(polygons=tuple(sorted(sizes.items())), **counts)


# Field, and the sentence for one and for more.
_DEFECTS = [
    (
        "isolated_vertices",
        "{} vertex belongs to no polygon.",
        "{} vertices belong to no polygon.",
    ),
    (
        "welded_vertices",
        "{} vertex was joined to another at the same place.",
        "{} vertices were joined to others at the same place.",
    ),
    (
        "degenerate_faces",
        "{} triangle has no area and was set aside.",
        "{} triangles have no area and were set aside.",
    ),
    (
        "duplicate_faces",
        "{} triangle is a second copy and was set aside.",
        "{} triangles are second copies and were set aside.",
    ),
    (
        "opposite_faces",
        "{} pair of faces lies back to back and makes two sheets.",
        "{} pairs of faces lie back to back and make two sheets.",
    ),
    (
        "non_manifold_edges",
        "{} edge of more than two faces was opened.",
        "{} edges of more than two faces were opened.",
    ),
    (
        "non_manifold_vertices",
        "{} vertex where fans of faces touch was opened.",
        "{} vertices where fans of faces touch were opened.",
    ),
    (
        "flipped_faces",
        "{} face was turned over to agree with its neighbours.",
        "{} faces were turned over to agree with their neighbours.",
    ),
    (
        "cut_edges",
        "{} edge was cut, because a piece was not orientable.",
        "{} edges were cut, because a piece was not orientable.",
    ),
    (
        "opened_edges",
        "{} edge was opened, because a piece touches itself.",
        "{} edges were opened, because a piece touches itself.",
    ),
]


def _count(count: int, one: str, many: str) -> str:
    return f"{count:,} {one if count == 1 else many}"


@dataclass(frozen=True, eq=False)
class Aside:
    """Triangles that are no faces of the repaired mesh, each with a face that it hangs on to.

    Attributes
    ----------
    polygon : (k,) array of int
        Polygon of each.
    corner : (k, 3) array of int
        Its corners in the input; a polygon of less than three repeats its last.
    host : (k,) array of int
        Face that it hangs on to: the one that it copies, else a face at its longest side that has
        one, else one at a vertex, else the first; -1 where there is no face at all.
    weights : (k, 3, 3) array
        For each corner the barycentric coordinates of its place in the host. A triangle without
        area lies on one side of the host, or at a corner.
    twin : (k,) array of bool
        Whether it is a copy of the host, in the same winding.
    """

    polygon: Ints
    corner: Ints
    host: Ints
    weights: Floats
    twin: Bools


@dataclass(frozen=True, eq=False)
class Repaired:
    """An oriented manifold of several components, and the map that leads back to the input.

    Attributes
    ----------
    vertices : (n, 3) array
        Positions, those of the input; with a `weld`, of the first vertex joined. All vertices have
        a face.
    faces : (m, 3) array of int
        Triangles in the order of the polygons. Every edge has one face or two that run along it in
        opposite directions, and the faces of every vertex form one fan.
    source_vertex : (n,) array of int
        First vertex of the input that each vertex was made of.
    polygon : (m,) array of int
        Polygon of each face.
    corner : (m, 3) array of int
        Corner of the input at each corner of each face, in the winding of the face.
    component : (m,) array of int
        Component of each face, from 0, in the order of their first faces.
    flipped : (m,) array of bool
        Whether a face is turned over against its polygon.
    inner : (m, 3) array of bool
        Whether edge (f[k], f[(k + 1) % 3]) is a diagonal between two faces of a polygon.
    n_corners : int
        Number of corners of the input.
    aside : Aside
        The triangles that are no faces.
    report : RepairReport
        What was found, by kind.
    """

    vertices: Floats
    faces: Ints
    source_vertex: Ints
    polygon: Ints
    corner: Ints
    component: Ints
    flipped: Bools
    inner: Bools
    n_corners: int
    aside: Aside
    report: RepairReport

    def corners(self, uv: ArrayLike) -> Floats:
        """Carry a map of the faces to all corners of the input.

        Parameters
        ----------
        uv : (m, 3, 2) array_like of float
            Texture coordinates at the corners of each face.

        Returns
        -------
        (c, 2) array
            Texture coordinates of each corner, also of polygons that are set aside; 0 where there
            is no face at all. A corner of several faces has those of the last, so that the
            triangles of a polygon belong in one chart.

        Raises
        ------
        ValueError
            For another shape.
        """
        uv = np.asarray(uv, dtype=np.float64)
        if uv.shape != (len(self.faces), 3, 2):
            raise ValueError(f"uv: shape {uv.shape} must be ({len(self.faces)}, 3, 2)")
        out = np.zeros((self.n_corners, 2))
        if len(uv):
            # A corner of several triangles is that of a copy rather than of one without area.
            aside = self.aside
            order = np.argsort(aside.twin, kind="stable")
            carried = np.einsum("kch,khd->kcd", aside.weights[order], uv[aside.host[order]])
            out[aside.corner[order]] = carried
        out[self.corner] = uv
        return out

    @cached_property
    def polygon_face(self) -> Ints:
        """A face that stands for each polygon, (p,): its first, or the host of what is set aside.

        It is -1 for a polygon without corners, and where there is no face at all.
        """
        face = np.full(sum(count for _, count in self.report.polygons), -1)
        face[self.aside.polygon[::-1]] = self.aside.host[::-1]
        face[self.polygon[::-1]] = np.arange(len(self.polygon))[::-1]
        return face


def repair(
    positions: ArrayLike,
    corners: ArrayLike,
    sizes: ArrayLike | None = None,
    *,
    weld: float = 0.0,
) -> Repaired:
    """Make an oriented manifold of any polygons.

    Vertices at equal positions are one. Polygons are cut into triangles; those without area and
    second copies are set aside. Faces are joined along edges, oriented, and opened where they are
    no manifold: around an edge of more than two faces those of consistent orientation are paired,
    of them those that share its vertices in the input, of them the flattest. What only touches is
    not joined. No vertex moves and no corner is lost.

    A mesh of triangles that is an oriented manifold comes back as it is.

    Parameters
    ----------
    positions : (n, 3) array_like of float
        Vertex positions.
    corners : (c,) or (m, 3) array_like of int
        Vertex of each corner, one polygon after the other.
    sizes : (p,) array_like of int, optional
        Number of corners of each polygon; without, all are triangles.
    weld : float, default 0
        Join vertices nearer than this, too, in units of the positions.

    Returns
    -------
    Repaired

    Raises
    ------
    ValueError
        For a wrong shape or dtype, a corner that names no vertex, a vertex in use whose position is
        not finite, sizes that do not fit the corners, and a negative `weld`.
    """
    places = np.ascontiguousarray(positions, dtype=np.float64)
    if places.size == 0:
        places = places.reshape(0, 3)
    if places.ndim != 2 or places.shape[1] != 3:
        raise ValueError(f"positions: shape {places.shape} must be (n, 3)")
    flat = _integers("corners", corners)
    if flat.ndim == 2 and sizes is None and flat.shape[1] != 3:
        raise ValueError(f"corners: shape {flat.shape} must be (c,) or (m, 3)")
    flat = flat.reshape(-1)
    counts = None if sizes is None else _integers("sizes", sizes).reshape(-1)
    core = _core.Repair(places, flat, counts, float(weld))
    polygon = core.polygon()
    defects: dict[str, Any] = core.defects()
    return Repaired(
        vertices=core.vertices(),
        faces=core.faces(),
        source_vertex=core.source_vertex(),
        polygon=polygon,
        corner=core.corner(),
        component=core.component(),
        flipped=core.flipped(),
        inner=core.inner(),
        n_corners=len(flat),
        aside=Aside(
            polygon=core.aside_polygon(),
            corner=core.aside_corner(),
            host=core.aside_host(),
            weights=core.aside_weights().reshape(-1, 3, 3),
            twin=core.aside_twin(),
        ),
        report=RepairReport(polygons=_by_size(len(flat), counts), faces=len(polygon), **defects),
    )


def _integers(argument: str, values: ArrayLike) -> Ints:
    array = np.asarray(values)
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"{argument}: dtype {array.dtype} must be an integer type")
    if array.ndim > 2:
        raise ValueError(f"{argument}: shape {array.shape} must have one dimension")
    return np.ascontiguousarray(array, dtype=np.int64)


def _by_size(n_corners: int, sizes: Ints | None) -> tuple[tuple[int, int], ...]:
    if sizes is None:
        return ((3, n_corners // 3),) if n_corners else ()
    values, counts = np.unique(sizes, return_counts=True)
    return tuple(zip(values.tolist(), counts.tolist(), strict=True))
