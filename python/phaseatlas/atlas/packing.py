"""Charts side by side in the unit square."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import _core
from ..arrays import Floats, Ints
from ..points import flat_areas
from ..quality import warn
from .charts import Chart


def pack(
    charts: Sequence[Chart], n_faces: int, *, padding: int = 4, resolution: int = 1024
) -> Floats:
    """Lay the labelled faces of all charts into the unit square without overlap.

    Charts are turned and moved, never mirrored, and share one scale, so relative sizes are those
    of ``Chart.uv``. A chart whose labelled faces fall into several pieces is packed piece by piece.

    Parameters
    ----------
    charts : sequence of Chart
        The labelled faces of the charts together are every face exactly once.
    n_faces : int
        Number m of faces of the surface.
    padding : int, default 4
        Least distance between pieces, in texels of a square texture of side `resolution`; half
        of it is kept free along the border.
    resolution : int, default 1024
        Side of the texture that the layout is meant for, in texels.

    Returns
    -------
    (m, 3, 2) array of float64
        UV of every corner of every face in [0, 1], v pointing up.

    Raises
    ------
    ValueError
        If a face is labelled by no chart or by several, a UV is not finite, a piece has no area in
        the plane, or an option is out of range.

    Warns
    -----
    QualityWarning
        If so many pieces cannot be kept `padding` apart; they are as far apart as leaves them half
        of the side.
    """
    check_packing(padding, resolution)
    pieces = gather(charts, n_faces)
    share = share_with_room([pieces], padding, resolution)
    uv = np.empty((n_faces, 3, 2))
    uv[pieces.faces] = pieces.packed(share)
    return uv


@dataclass(frozen=True, eq=False)
class Pieces:
    """The labelled faces of charts, in pieces that move together.

    Attributes
    ----------
    points : (p, 2) array
        Corners in the planes of the charts.
    triangles : (k, 3) array of int
        Points of each face.
    faces : (k,) array of int
        Faces of the surface.
    piece : (k,) array of int
        Piece of each face.
    chart : (k,) array of int
        Chart of each face.
    """

    points: Floats
    triangles: Ints
    faces: Ints
    piece: Ints
    chart: Ints

    @property
    def count(self) -> int:
        """Number of pieces."""
        return int(self.piece.max()) + 1

    @property
    def areas(self) -> Floats:
        """Area of each face in the plane."""
        return flat_areas(self.points[self.triangles])

    def of(self, charts: Ints) -> Pieces:
        """The pieces of some charts."""
        kept = np.isin(self.chart, charts)
        _, piece = np.unique(self.piece[kept], return_inverse=True)
        return Pieces(
            self.points,
            np.ascontiguousarray(self.triangles[kept]),
            self.faces[kept],
            piece.astype(np.int64),
            self.chart[kept],
        )

    def packed(self, padding: float, *, as_length: bool = False) -> Floats:
        """Corners in the unit square, (k, 3, 2).

        Parameters
        ----------
        padding : float
            Least distance of two pieces: a share of the side, or in the units of the charts.
        as_length : bool, default False
            Which of the two.
        """
        return _core.pack(self.points, self.triangles, self.piece, padding, as_length=as_length)


def gather(charts: Sequence[Chart], n_faces: int) -> Pieces:
    """Take the labelled faces of all charts.

    Raises
    ------
    ValueError
        If a face is labelled by no chart or by several, a UV is not finite, or a piece has no area
        in the plane.
    """
    _check_cover(charts, n_faces)
    points = np.concatenate([chart.uv for chart in charts])
    first = np.cumsum([0, *(len(chart.uv) for chart in charts)])
    triangles = np.concatenate(
        [
            chart.triangles[chart.labelled] + start
            for chart, start in zip(charts, first[:-1], strict=True)
        ]
    )
    faces = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    _, piece = _core.edge_components(triangles)
    _check_shapes(points, triangles, faces, piece, first)
    sizes = [int(np.count_nonzero(chart.labelled)) for chart in charts]
    return Pieces(points, triangles, faces, piece, np.repeat(np.arange(len(charts)), sizes))


def share_with_room(pages: Sequence[Pieces], texels: float, resolution: int) -> float:
    """The padding as a share of the side; less, with a warning, where there is no room for it.

    Parameters
    ----------
    pages : sequence of Pieces
        Each to be packed into a square of its own.
    texels : float
        Least distance between pieces.
    resolution : int
        Side of the squares in texels.
    """
    count = max(page.count for page in pages)
    share = min(texels / resolution, _core.most_padding(count))
    if share < texels / resolution:
        warn(
            f"padding: {count} pieces have no room for {texels:g} texels between them at "
            f"resolution {resolution}, they are {share * resolution:.2g} apart; a larger "
            "resolution helps"
        )
    return share


def check_packing(padding: int, resolution: int) -> None:
    """Raise ValueError where `pack` would refuse its options."""
    if resolution < 1:
        raise ValueError(f"resolution: {resolution} must be at least 1")
    if not 0 <= padding <= resolution // 8:
        raise ValueError(
            f"padding: {padding} must be in 0..{resolution // 8}, an eighth of the resolution"
        )


def _check_cover(charts: Sequence[Chart], n_faces: int) -> None:
    if not charts:
        raise ValueError("charts: must not be empty")
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    if labelled.size and not 0 <= labelled.min() <= labelled.max() < n_faces:
        wrong = int(labelled.max() if labelled.max() >= n_faces else labelled.min())
        raise ValueError(f"charts: face {wrong} must be in 0..{n_faces - 1}")
    times = np.bincount(labelled, minlength=n_faces)
    if (times != 1).any():
        face = int(np.flatnonzero(times != 1)[0])
        raise ValueError(f"charts: face {face} must be labelled by one, not by {times[face]}")


def _check_shapes(points: Floats, triangles: Ints, faces: Ints, piece: Ints, first: Ints) -> None:
    """Raise ValueError where a piece is no shape; chart c has the points from ``first[c]`` on."""
    corners = triangles.ravel()
    broken = np.flatnonzero(~np.isfinite(points[corners]).all(axis=1))
    if broken.size:
        vertex = int(corners[broken[0]])
        chart = int(np.searchsorted(first, vertex, side="right")) - 1
        raise ValueError(
            f"charts[{chart}].uv[{vertex - first[chart]}]: {points[vertex]} must be finite numbers"
        )
    areas = np.bincount(piece, weights=flat_areas(points[triangles]))
    flat = np.flatnonzero(~(areas > 0.0)[piece])
    if flat.size:
        face = int(flat[0])
        chart = int(np.searchsorted(first, triangles[face, 0], side="right")) - 1
        raise ValueError(f"charts[{chart}].uv: the piece at face {faces[face]} must have an area")
