"""Figures that rate a texture atlas, whichever tool made it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _core
from ..arrays import Bools, Floats, Ints
from ..points import flat_areas
from ..surface import Surface
from .uv_topology import UvTopology, uv_topology

__all__ = [
    "CURE",
    "THIN",
    "Flaws",
    "UvTopology",
    "atlas_metrics",
    "checked_uv",
    "flaws",
    "singular_values",
    "turned_over",
    "uv_topology",
    "yamabe_factors",
]

# Faces below this part of the mean texel density are sparse; up to this part of the area may be.
_SPARSE = 0.1
_SPARSE_AREA = 0.02
# Height of a face, relative to the side of the layout, below which single precision cannot tell its
# sides apart: four units in the last place just below 1.
THIN = 4 * 2.0**-24
CURE = "a larger weight of the distortion (--distortion) makes charts that lie flatter"


@dataclass(frozen=True)
class Flaws:
    """What makes a layout useless in places.

    Attributes
    ----------
    flips : int
        Faces that are turned over in the plane, without those that are thin.
    overlap : float
        Texels covered by several faces, percent of the texels covered at all.
    sparse : float
        Part of the area with less than a tenth of the mean texel density (texels a length).
    crossing : int
        Charts whose boundary crosses itself, by an exact test.
    thin : int
        Faces thinner than four units in the last place of a single-precision coordinate in [0, 1].
    stacked : int
        Faces that lie over their mirror images as asked for, turned over; not among the flips and
        the overlap.
    """

    flips: int
    overlap: float
    sparse: float
    crossing: int = 0
    thin: int = 0
    stacked: int = 0

    def fatal(self) -> list[str]:
        """One line for each flaw with which a layout must not be written."""
        said = []
        if self.flips:
            said.append(f"flips: {self.flips} faces are turned over in the plane; {CURE}")
        if self.crossing:
            said.append(f"overlap: {self.crossing} charts cover points twice; {CURE}")
        elif self.overlap > 0:
            said.append(f"overlap: {self.overlap:.2g} % of the texels are covered twice; {CURE}")
        return said

    def sentences(self) -> list[str]:
        """One line for each flaw that is worth a word, which names a cure."""
        said = self.fatal()
        if self.sparse > _SPARSE_AREA:
            said.append(
                f"density: {100 * self.sparse:.2g} % of the area has less than a tenth of the mean "
                f"texel density; {CURE}"
            )
        return said


def atlas_metrics(
    surface: Surface,
    uv: Floats,
    *,
    resolution: int = 2048,
    flaws: Flaws | None = None,
    pages: Ints | None = None,
) -> dict[str, float]:
    """Rate a UV layout.

    Below, A is the area of a face in space and s1 >= s2 are the singular values of its map to the
    plane, after one scale for the whole layout that makes its area that of the surface.

    Parameters
    ----------
    surface
        The surface, with m faces.
    uv
        (m, 3, 2) UV of every corner of every face.
    resolution
        Side of the raster on which overlap is counted, in texels.
    flaws
        What `flaws` found, so that overlap is not counted again.
    pages
        (m,) page of each face, where the layout has several: each has its own unit square.

    Returns
    -------
    dict
        ``charts``: connected components of the faces over edges whose two sides carry the same UV.
        ``non_disk``: charts whose Euler characteristic is not 1.
        ``seam``: length of the edges with a face on either side that carry two UVs, over the square
        root of the area of the surface.
        ``yamabe``: sum A u^2 / sum A with u the logarithmic scale factor of the flat conformal
        metric that keeps lengths on the boundary of each chart (see `yamabe_factors`); rates the
        shapes of the charts alone; nan if a chart has no boundary.
        ``qc``: mean of s1 / s2, weighted by A; 1 is conformal.
        ``hencky``: variance of log(s1 s2) / 2 over the surface; 0 keeps relative areas.
        ``l2``: sqrt(sum A (1 / s1^2 + 1 / s2^2) / 2 / sum A) (Sander et al. 2001); 1 is isometric.
        ``degenerate``: faces without area in the plane; left out of the three above.
        ``flips``: faces turned against their chart, which as a whole may be mirrored.
        ``crossing``: charts whose boundary crosses itself, by an exact test.
        ``overlap``: texels covered by several faces, percent of the texels covered at all, the
        layout filling the raster.
        ``packing``: area of the layout, percent of its bounding square, or those of its pages.

    Raises
    ------
    ValueError
        If `uv` has another shape or is not finite, or its total area is zero.
    """
    uv = checked_uv(surface, uv)
    topology = uv_topology(surface, _apart(uv, pages))
    s1, s2, signed = singular_values(surface, uv)
    solid = signed != 0.0
    distortion = _distortion(s1[solid], s2[solid], surface.face_areas[solid])
    factors = yamabe_factors(surface, topology)
    area = float(surface.face_areas.sum())
    mirrored = np.bincount(topology.chart, signed) < 0.0
    turned = np.where(mirrored[topology.chart], -signed, signed)
    extents = [float(np.ptp(of_page, axis=(0, 1)).max()) for of_page in _by_page(uv, pages)]
    return {
        "charts": topology.n_charts,
        "non_disk": int((_euler_characteristics(topology) != 1).sum()),
        "seam": float(_edge_lengths(surface)[topology.seams].sum() / 2.0 / np.sqrt(area)),
        "yamabe": float(_vertex_areas(surface, topology) @ factors**2 / area),
        **distortion,
        "degenerate": int((~solid).sum()),
        "flips": int((turned < 0.0).sum()),
        "crossing": _crossing(uv, topology) if flaws is None else flaws.crossing,
        "overlap": _overlap(uv, resolution, pages) if flaws is None else flaws.overlap,
        "packing": float(100.0 * np.abs(signed).sum() / sum(extent**2 for extent in extents)),
    }


def flaws(
    surface: Surface, uv: Floats, *, resolution: int = 2048, pages: Ints | None = None
) -> Flaws:
    """Find what makes a layout useless in places.

    Parameters
    ----------
    surface : Surface
        The surface, with m faces.
    uv : (m, 3, 2) array
        UV of every corner of every face; no chart is mirrored.
    resolution : int, default 2048
        Side of the raster on which overlap is counted, in texels.
    pages : (m,) array of int, optional
        Page of each face, where the layout has several: each is looked at by itself.
    """
    signed = flat_areas(uv, signed=True)
    areas = surface.face_areas
    density = np.sqrt(np.abs(signed) / areas)
    mean = np.sqrt(np.abs(signed).sum() / areas.sum())
    sparse = areas[density < _SPARSE * mean].sum() / areas.sum()
    return Flaws(
        flips=turned_over(uv),
        overlap=_overlap(uv, resolution, pages),
        sparse=float(sparse),
        crossing=_crossing(uv, uv_topology(surface, _apart(uv, pages))),
        thin=int(_thin(uv, signed).sum()),
    )


def turned_over(uv: Floats, *, largest: float = 1.0) -> int:
    """Count the faces that are turned over in the plane, without those that are thin.

    Parameters
    ----------
    uv : (m, 3, 2) array
        UV of every corner of every face; no chart is mirrored.
    largest : float, default 1
        Of the coordinates: in single precision large ones have fewer digits behind the point.
    """
    signed = flat_areas(uv, signed=True)
    return int(((signed <= 0.0) & ~_thin(uv, signed, largest)).sum())


def _thin(uv: Floats, signed: Floats, largest: float = 1.0) -> Bools:
    # The step of single precision doubles at each power of two.
    step = 2.0 ** np.ceil(np.log2(largest))
    thin: Bools = 2.0 * np.abs(signed) <= step * THIN * _longest(uv)
    return thin


def yamabe_factors(surface: Surface, topology: UvTopology) -> Floats:
    """Logarithmic scale factors that flatten every chart and keep lengths on its boundary.

    They solve div grad u = K on each chart, u = 0 on its boundary, with the cotangent Laplacian and
    angle defects (Springborn, Schroeder and Pinkall 2008, linearised). They are negative where a
    chart shrinks, as the inside of a spherical cap does.

    Parameters
    ----------
    surface
        The surface.
    topology
        Its charts, from `uv_topology`.

    Returns
    -------
    (p,) float64 array
        One value per vertex of the cut surface; nan on charts without a boundary.
    """
    return topology.layout.log_scales(surface._mesh)


def checked_uv(surface: Surface, uv: Floats) -> Floats:
    """Texture coordinates as float64; ValueError for another shape or what is not finite."""
    uv = np.asarray(uv, dtype=np.float64)
    if uv.shape != (surface.n_faces, 3, 2):
        raise ValueError(f"uv: shape {uv.shape} must be {(surface.n_faces, 3, 2)}")
    finite = np.isfinite(uv).all(axis=2)
    if not finite.all():
        face, corner = (int(k) for k in np.argwhere(~finite)[0])
        raise ValueError(f"uv[{face}, {corner}]: {uv[face, corner]} must be finite numbers")
    return uv


def _distortion(s1: Floats, s2: Floats, areas: Floats) -> dict[str, float]:
    share = areas / areas.sum()
    log_scale = 0.5 * np.log(s1 * s2)
    return {
        "qc": float(share @ (s1 / s2)),
        "hencky": float(share @ (log_scale - share @ log_scale) ** 2),
        "l2": float(np.sqrt(share @ (0.5 / s1**2 + 0.5 / s2**2))),
    }


def _edge_lengths(surface: Surface) -> Floats:
    points = surface.vertices[surface.faces]
    lengths: Floats = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2)
    return lengths


def singular_values(surface: Surface, uv: Floats) -> tuple[Floats, Floats, Floats]:
    """Singular values of every face's map, at equal total areas, and its area in the plane."""
    points = surface.vertices[surface.faces]
    e1, e2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    length = np.linalg.norm(e1, axis=1)
    x2 = np.einsum("fd,fd->f", e1, e2) / length
    y2 = 2.0 * surface.face_areas / length
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    signed = flat_areas(uv, signed=True)
    total = float(np.abs(signed).sum())
    if not total > 0.0:
        raise ValueError("uv: area must be positive")
    scale = np.sqrt(surface.face_areas.sum() / total)
    du = scale * a / length[:, None]
    dv = (scale * b - x2[:, None] * du) / y2[:, None]
    conformal = np.hypot(du[:, 0] + dv[:, 1], du[:, 1] - dv[:, 0])
    anticonformal = np.hypot(du[:, 0] - dv[:, 1], du[:, 1] + dv[:, 0])
    s1 = 0.5 * (conformal + anticonformal)
    # The product of the two is the ratio of the areas, which slivers lose in the difference.
    ratio = scale**2 * np.abs(signed) / surface.face_areas
    s2 = ratio / np.where(s1 > 0.0, s1, 1.0)
    return s1, s2, signed


def _euler_characteristics(topology: UvTopology) -> Ints:
    """Vertices - edges + faces of every chart."""
    faces = np.bincount(topology.chart, minlength=topology.n_charts)
    open_edges = np.bincount(
        topology.chart, topology.open_edges.sum(axis=1), minlength=topology.n_charts
    ).astype(np.int64)
    chart_of_vertex = np.empty(topology.n_vertices, dtype=np.int64)
    chart_of_vertex[topology.corner] = topology.chart[:, None]
    vertices = np.bincount(chart_of_vertex, minlength=topology.n_charts)
    characteristics: Ints = vertices - (3 * faces + open_edges) // 2 + faces
    return characteristics


def _vertex_areas(surface: Surface, topology: UvTopology) -> Floats:
    third = np.repeat(surface.face_areas / 3.0, 3)
    corner = topology.corner.ravel()
    areas = np.bincount(corner, weights=third, minlength=topology.n_vertices)
    return areas.astype(np.float64)


def _longest(uv: Floats) -> Floats:
    """Length of the longest side of each face."""
    longest: Floats = np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2).max(axis=1)
    return longest


def _crossing(uv: Floats, topology: UvTopology) -> int:
    """Number of charts whose boundary crosses itself."""
    thin = THIN * float(np.ptp(uv, axis=(0, 1)).max())
    return topology.layout.crossing(np.ascontiguousarray(uv.reshape(-1, 2)), thin)


def _overlap(uv: Floats, resolution: int, pages: Ints | None) -> float:
    covered = doubled = 0
    for of_page in _by_page(uv, pages):
        low = of_page.min(axis=(0, 1))
        extent = float(np.ptp(of_page, axis=(0, 1)).max())
        _, count = _core.rasterize(np.ascontiguousarray((of_page - low) / extent), resolution)
        covered += int((count > 0).sum())
        doubled += int((count > 1).sum())
    return 100.0 * doubled / covered if covered else 0.0


def _by_page(uv: Floats, pages: Ints | None) -> list[Floats]:
    """Coordinates of the faces of each page."""
    return [uv] if pages is None else [uv[pages == page] for page in np.unique(pages)]


def _apart(uv: Floats, pages: Ints | None) -> Floats:
    """Coordinates that are different on different pages."""
    if pages is None:
        return uv
    # The unit squares do not touch.
    return uv + np.stack([2.0 * pages, np.zeros(len(pages))], axis=1)[:, None]
