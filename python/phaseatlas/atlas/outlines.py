"""Outlines of the flattened segments at their true size, with notches along shared seams."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Bools, Floats, Ints
from ..files import write_bytes
from ..points import flat_areas
from ..quality import warn
from .chains import chains
from .charts import Layout
from .metrics import uv_topology

__all__ = ["Notches", "Outlines", "Piece", "Seam", "outlines"]

# Notches along a seam as long as the root of the area, where no spacing is given.
_NOTCHES = 8
# Length of a notch in spacings.
_LENGTH = 0.12
# Part by which the two sides of a seam may differ in length before it is said: sewn cloth is eased
# by a few percent.
_MISMATCH = 0.05


@dataclass(frozen=True, eq=False)
class Piece:
    """A flat piece: the faces of a chart's segment that hang together.

    Attributes
    ----------
    chart : int
        Its chart.
    segment : int
        The segment of the chart.
    loops : tuple of (k, 2) arrays
        Its boundary, the outer loop first: points around each loop, the faces on the left.
    vertices : tuple of (k,) arrays of int
        Surface vertex of each point.
    label : (2,) array
        A point well inside.
    room : float
        Distance of that point from the boundary.
    """

    chart: int
    segment: int
    loops: tuple[Floats, ...]
    vertices: tuple[Ints, ...]
    label: Floats
    room: float


@dataclass(frozen=True, eq=False)
class Seam:
    """A curve of the surface along which two sides of pieces are to be joined.

    Attributes
    ----------
    pieces : (2,) array of int
        The pieces on its sides; twice the same where a piece is cut open.
    vertices : (k,) array of int
        Surface vertices along it, in the direction of the first piece's boundary.
    length : float
        On the surface.
    flat : (2,) array
        Lengths of the two sides in the plane.
    """

    pieces: Ints
    vertices: Ints
    length: float
    flat: Floats


@dataclass(frozen=True, eq=False)
class Notches:
    """Pairs of marks: notch i is one point of the surface and two points of the plane.

    Attributes
    ----------
    seam : (p,) array of int
        Seam of each notch.
    arclength : (p,) array
        Where it is on the seam, from its first vertex, on the surface.
    position : (p, 3) array
        The point of the surface.
    points : (p, 2, 2) array
        Its places on the outlines of the seam's first and second piece.
    inward : (p, 2, 2) array
        Unit vectors across the outlines, into the pieces.
    """

    seam: Ints
    arclength: Floats
    position: Floats
    points: Floats
    inward: Floats


@dataclass(frozen=True, eq=False)
class Outlines:
    """Flat pieces side by side, in the units of the surface, with what joins them.

    Attributes
    ----------
    pieces : tuple of Piece
    seams : tuple of Seam
    notches : Notches
    size : (2,) array
        Width and height of the sheet; all lies in [0, width] x [0, height], y up.
    notch_length : float
        Length that notches are drawn with.
    """

    pieces: tuple[Piece, ...]
    seams: tuple[Seam, ...]
    notches: Notches
    size: Floats
    notch_length: float

    def save(self, path: str | PathLike[str], *, unit: str = "mm") -> None:
        """Write the sheet, 1:1, whole or not at all.

        Notches have their numbers, which stand once on each side of a seam; pieces have the
        number of their chart. Outlines, notches and labels are groups of the SVG file and layers
        of the DXF file.

        Parameters
        ----------
        path : str or PathLike
            An `.svg` file, or a `.dxf` file, which needs the extra `dxf`.
        unit : {"mm", "cm", "m", "in", "ft"}, default "mm"
            What the coordinates of the surface are in.

        Raises
        ------
        ValueError
            For another suffix or unit.
        ImportError
            For a `.dxf` file without the extra.
        """
        from .drawing import check_drawing, dxf, svg

        path = Path(path)
        check_drawing(path, unit)
        write = svg if path.suffix.lower() == ".svg" else dxf
        write_bytes(path, write(self, path.stem, unit))


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of all outlines; each runs from its own start to that of the next."""

    start: Ints
    vertex: Ints
    piece: Ints
    following: Ints
    twin: Ints


def outlines(layout: Layout, *, spacing: float | None = None) -> Outlines:
    """Return the outlines of the packed pieces of an atlas at their true size.

    Pieces lie as they are packed. A seam ends where another one begins, and has notches at even
    distances on the surface, at least one. Both sides of a seam are of equal length where maps keep
    lengths; "isometric" ones nearly do, conformal ones do not.

    Parameters
    ----------
    layout : Layout
        The atlas.
    spacing : float, optional
        Distance of notches along a seam, in the units of the surface; an eighth of the root of its
        area by default.

    Returns
    -------
    Outlines

    Raises
    ------
    ValueError
        For a spacing that is not positive.

    Warns
    -----
    QualityWarning
        Where the two sides of a seam differ in length by more than 5 %.
    """
    surface = layout.surface
    if spacing is None:
        spacing = float(np.sqrt(surface.area)) / _NOTCHES
    elif not (np.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing: {spacing} must be a positive number")
    topology = uv_topology(surface, layout.uv)
    flat = sum(flat_areas(c.uv[c.triangles[c.labelled]]).sum() for c in layout.charts)
    corners = layout.uv * np.sqrt(flat / flat_areas(layout.uv).sum())
    corners = corners - corners.min(axis=(0, 1)) + spacing / 2
    points = np.empty((topology.n_vertices, 2))
    points[topology.corner] = corners
    edges = _edges(layout, topology.corner, topology.chart, topology.open_edges)
    pieces = _pieces(layout, edges, points, corners, topology.chart)
    seams, notches = _seams(layout, edges, points, spacing)
    _warn_of_mismatch(seams)
    size = corners.max(axis=(0, 1)) + spacing / 2
    return Outlines(pieces, seams, notches, size, _LENGTH * spacing)


def _edges(layout: Layout, corner: Ints, piece: Ints, open_edges: Bools) -> _Edges:
    """The open edges of a layout, in the order of their faces."""
    faces, across = layout.surface.faces, layout.surface.face_neighbours
    f, k = np.nonzero(open_edges)
    ahead = (k + 1) % 3
    number = np.full(open_edges.shape, -1)
    number[f, k] = np.arange(len(f))
    at = np.empty(int(corner.max()) + 1, dtype=np.int64)
    at[corner[f, k]] = np.arange(len(f))
    other = across[f, k]
    # The edge starts there where this one ends.
    there = np.argmax(faces[other] == faces[f, ahead][:, None], axis=1)
    return _Edges(
        start=corner[f, k],
        vertex=faces[f, k],
        piece=piece[f],
        following=at[corner[f, ahead]],
        twin=np.where(other >= 0, number[other, there], -1),
    )


def _pieces(
    layout: Layout, edges: _Edges, points: Floats, corners: Floats, piece: Ints
) -> tuple[Piece, ...]:
    chart = layout.face_charts
    loops = chains(edges.following)
    owner = edges.piece[[loop[0] for loop in loops]]
    order = np.argsort(piece, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(piece))[:-1])
    found = []
    for k, faces in enumerate(members):
        mine = [loops[i] for i in np.flatnonzero(owner == k)]
        # The outer loop alone runs around all others.
        mine.sort(key=lambda loop: -float(np.ptp(points[edges.start[loop]], axis=0).sum()))
        boundary = points[edges.start[np.concatenate(mine)]]
        inside = corners[faces].mean(axis=1)
        depth, _ = cKDTree(boundary).query(inside)
        best = int(np.argmax(depth))
        number = int(chart[faces[0]])
        found.append(
            Piece(
                chart=number,
                segment=int(layout.charts[number].segment),
                loops=tuple(points[edges.start[loop]] for loop in mine),
                vertices=tuple(edges.vertex[loop] for loop in mine),
                label=inside[best],
                room=float(depth[best]),
            )
        )
    return tuple(found)


def _seams(
    layout: Layout, edges: _Edges, points: Floats, spacing: float
) -> tuple[tuple[Seam, ...], Notches]:
    twin, following = edges.twin, edges.following
    # A seam goes on where its other side does, and turns back where a cut ends.
    goes_on = (twin >= 0) & (twin[following] >= 0) & (twin != following)
    goes_on &= following[twin[following]] == twin
    runs = chains(np.where(goes_on, following, -1))
    number = np.empty(len(twin), dtype=np.int64)
    number[np.concatenate(runs)] = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
    seams, notches = [], []
    for chain in runs:
        # Each seam once; its other side comes later.
        if twin[chain[0]] < 0 or number[twin[chain[0]]] < number[chain[0]]:
            continue
        sides = np.stack([chain, twin[chain]])
        vertices = np.append(edges.vertex[chain], edges.vertex[sides[1, -1]])
        starts, ends = points[edges.start[sides]], points[edges.start[following[sides]]]
        along = layout.surface.vertices[vertices]
        lengths = np.linalg.norm(np.diff(along, axis=0), axis=1)
        flat = np.linalg.norm(ends - starts, axis=2)
        total = float(lengths.sum())
        seams.append(Seam(edges.piece[sides[:, 0]], vertices, total, flat.sum(axis=1)))
        count = max(1, round(total / spacing))
        arclength = (np.arange(count) + 0.5) * total / count
        edge = np.searchsorted(np.cumsum(lengths), arclength)
        part = (arclength - (np.cumsum(lengths) - lengths)[edge]) / lengths[edge]
        # The second side runs the other way.
        parts = np.stack([part, 1 - part])[..., None]
        there = starts[:, edge] + parts * (ends - starts)[:, edge]
        direction = (ends - starts)[:, edge] / flat[:, edge, None]
        inward = np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
        position = along[edge] + part[:, None] * (along[edge + 1] - along[edge])
        seam = np.full(count, len(seams) - 1)
        notches.append((seam, arclength, position, there.swapaxes(0, 1), inward.swapaxes(0, 1)))
    if not notches:
        none = (np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3)))
        return (), Notches(*none, np.zeros((0, 2, 2)), np.zeros((0, 2, 2)))
    return tuple(seams), Notches(*(np.concatenate(column) for column in zip(*notches, strict=True)))


def _warn_of_mismatch(seams: tuple[Seam, ...]) -> None:
    apart = [abs(float(np.log(seam.flat[0] / seam.flat[1]))) for seam in seams]
    wrong = sum(gap > _MISMATCH for gap in apart)
    if wrong:
        warn(
            f"seams: the sides of {wrong} of {len(seams)} differ in length, by up to "
            f"{100 * np.expm1(max(apart)):.0f} %; isometric maps (--flatten isometric) of "
            "charts by energy fit best"
        )
