"""From any polygons to texture coordinates at their corners, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Bools, Floats, Ints
from .atlas import Atlas, build_atlas
from .atlas.flatten import Flattening
from .atlas.metrics import Flaws
from .atlas.pages import PackOptions
from .notebook import Pictured
from .partitioning.partition import DISTORTION, Effort, partition
from .partitioning.symmetry import Axis
from .scene.opened import half_edges, opened
from .scene.repair import RepairReport, repair
from .scene.scene import Scene, polygons_of
from .seam_costs import mask, with_seam_cost
from .segmentation import Segmentation, SegmentTree, segment
from .surface import Surface

__all__ = ["UnwrapReport", "Unwrapped", "unwrap"]


@dataclass(frozen=True)
class UnwrapReport:
    """What was repaired and what came out.

    Attributes
    ----------
    repairs : tuple of RepairReport
        Of each mesh; none for a `Surface`.
    pieces : int
        Connected pieces.
    charts : int
    metrics : dict of str to float
        As `Atlas.metrics`.
    flaws : Flaws
        As `Atlas.diagnostics`.
    """

    repairs: tuple[RepairReport, ...]
    pieces: int
    charts: int
    metrics: dict[str, float]
    flaws: Flaws


@dataclass(frozen=True, eq=False)
class Unwrapped(Pictured):
    """Texture coordinates of polygons.

    Attributes
    ----------
    corners : array
        Texture coordinates in [0, 1], v up, at every corner in the order of the input: (p, k, 2)
        for faces (p, k), else (c, 2), one polygon after the other. For a scene, the meshes follow
        each other. With `udim` they are in [0, 1] beside the corner of the tile.
    charts : (p,) array of int
        Chart of each polygon, -1 for one without any area in a mesh without any face.
    report : UnwrapReport
    atlas : Atlas
        The charts, to bake a texture or to pack them again.
    """

    corners: Floats
    charts: Ints
    report: UnwrapReport
    atlas: Atlas

    @property
    def pages(self) -> Ints:
        """Page of each polygon, (p,)."""
        pages: Ints = np.where(self.charts < 0, 0, self.atlas.pages[self.charts])
        return pages

    def __repr__(self) -> str:
        corners, report = self.corners.size // 2, self.report
        figures = f"stretch {report.metrics['l2']:.4g}, packing {report.metrics['packing']:.3g} %"
        pieces = f"{report.pieces} piece{'s' * (report.pieces != 1)}"
        charts = f"{report.charts} chart{'s' * (report.charts != 1)}"
        return f"Unwrapped({corners} corners, {charts}, {pieces},\n  {figures})"


def unwrap(
    vertices: ArrayLike | Surface,
    faces: ArrayLike | Sequence[Sequence[int]] | None = None,
    *,
    levels: int | None = None,
    distortion: float | None = None,
    max_distortion: float | None = None,
    max_charts: int | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    flatten: Flattening | None = None,
    padding: int = 4,
    resolution: int | None = None,
    weld: float = 0.0,
    mips: int = 0,
    density: float | None = None,
    pages: int = 1,
    udim: bool = False,
    symmetry: Axis | None = None,
    stack: bool = False,
    seam_cost: ArrayLike | None = None,
    seams: ArrayLike | None = None,
    keep: ArrayLike | None = None,
    creases: float | None = None,
    executor: Executor | None = None,
) -> Unwrapped:
    """Give every corner of any triangles or polygons its place in a texture.

    The polygons need not be a manifold, oriented or connected: they are repaired first, see
    `scene.repair`, and no vertex and no corner is lost. No polygon is cut by a seam.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or Surface or Scene
        Vertex positions, or what has faces of its own.
    faces : (p, k) array_like of int, or sequence of sequences of int
        Vertices of each polygon; none for a surface or a scene.
    levels : int, optional
        Cut into the 2^levels segments of equal area of `segment`; without it into the charts of
        least energy of `partition`.
    distortion, max_distortion, max_charts, effort, seed, symmetry
        As in `partition`, and with `levels`, `distortion` and `seed` as in `segment`.
    flatten, padding, resolution, mips, density, pages
        As in `build_atlas`.
    weld : float, default 0
        Join vertices nearer than this, too, in the units of the vertices.
    udim : bool, default False
        Put the corners of page k into UDIM tile 1001 + k, and not all into [0, 1].
    stack : bool, default False
        Lay the charts of one half over their mirror images; with `symmetry` alone.
    seam_cost : (n,) or (m, 3) array_like of float, optional
        Positive factor on the length of a seam at each vertex, as in `with_seam_cost`; with faces
        (m, 3), or for a surface or scene, also along each of their edges.
    seams : (k, 2) array_like of int, optional
        Vertices at the ends of edges that must be cut. The surface is opened along them first. A
        single edge inside that meets no other one and no boundary cannot be opened.
    keep : array_like of int or bool, optional
        Polygons between which no seam runs, by their numbers or as a mask.
    creases : float, optional
        Edges whose faces turn by more than this angle, in degrees, cost a fifth.
    executor : concurrent.futures.Executor, optional
        As in `partition` and `segment`; the result does not depend on it.

    Returns
    -------
    Unwrapped

    Raises
    ------
    ValueError
        For an option or polygons that cannot be used, and where no face has an area.

    Warns
    -----
    QualityWarning
        For `seams` that cannot be opened.
    """
    shape: tuple[int, ...] = (-1, 2)
    if isinstance(vertices, Surface):
        if faces is not None:
            raise ValueError("faces: value must be left out for a surface")
        if weld:
            raise ValueError("weld: value must be left out for a surface")
        surface: Surface = with_seam_cost(vertices, seam_cost, keep=keep, creases=creases)
        if seams is not None:
            if not isinstance(surface, Scene):
                shape = (surface.n_faces, 3, 2)
            surface = _opened(surface, half_edges(surface.faces, seams, surface.n_vertices))
    else:
        if isinstance(vertices, str | PathLike):
            raise ValueError(f"vertices: {vertices} is a path; load_scene reads it")
        if faces is None:
            raise ValueError("faces: value must be given with vertices")
        corners, sizes = polygons_of(faces)
        if sizes.size and (isinstance(faces, np.ndarray) or (sizes == sizes[0]).all()):
            shape = (len(sizes), int(sizes[0]), 2)
        scene = Scene([("", repair(vertices, corners, sizes, weld=weld))])
        surface = _wished(scene, corners, sizes, len(np.asarray(vertices)), seam_cost, seams, keep)
        surface = with_seam_cost(surface, creases=creases)
    if stack and symmetry is None:
        raise ValueError("stack: value must be given with symmetry alone")
    PackOptions(padding, resolution, mips, density, pages).check_area(surface.area)
    if levels is not None:
        given: dict[str, object] = {
            "max_distortion": max_distortion,
            "max_charts": max_charts,
            "symmetry": symmetry,
            "effort": None if effort == "normal" else effort,
        }
        for name, value in given.items():
            if value is not None:
                raise ValueError(f"{name}: value must be left out with levels")
        weight = 0.0 if distortion is None else distortion
        charted: SegmentTree | Segmentation = segment(
            surface, levels, distortion=weight, seed=seed, executor=executor
        )
    else:
        charted = partition(
            surface,
            distortion=DISTORTION if distortion is None else distortion,
            max_distortion=max_distortion,
            max_charts=max_charts,
            effort=effort,
            seed=seed,
            symmetry=symmetry,
            executor=executor,
        )
    atlas = build_atlas(
        charted,
        flatten=flatten,
        padding=padding,
        resolution=resolution,
        mips=mips,
        density=density,
        pages=pages,
        stack=symmetry if stack else None,
    )
    return unwrapped(atlas, shape, udim=udim)


def _opened(surface: Surface, edges: Bools) -> Scene:
    """A surface or scene opened along edges, as a scene."""
    if isinstance(surface, Scene):
        return opened(surface, edges)
    # An oriented manifold comes back as it is.
    scene = Scene([("", repair(surface.vertices, surface.faces))])
    return opened(scene.with_seam_costs(surface.seam_costs, surface.vertex_seam_costs), edges)


def _wished(
    scene: Scene,
    corners: Ints,
    sizes: Ints,
    n: int,
    seam_cost: ArrayLike | None,
    seams: ArrayLike | None,
    keep: ArrayLike | None,
) -> Scene:
    """The scene of polygons with what is wished of its seams, by their vertices and numbers."""
    repaired = scene.meshes[0].repaired
    if seam_cost is not None:
        costs = np.asarray(seam_cost, dtype=np.float64)
        legal = ((n,), (len(sizes), 3)) if (sizes == 3).all() else ((n,),)
        if costs.shape not in legal:
            allowed = " or ".join(map(str, legal))
            raise ValueError(f"seam_cost: shape {costs.shape} must be {allowed}")
        if costs.ndim == 2:
            # Edge k of a polygon lies between its corners k and k + 1, in either winding.
            a, b = repaired.corner % 3, np.roll(repaired.corner, -1, axis=1) % 3
            edge = np.where((a + 1) % 3 == b, a, b)
            costs = np.take_along_axis(costs[repaired.polygon], edge, axis=1)
        else:
            costs = costs[repaired.source_vertex]
        scene = with_seam_cost(scene, costs)
    if keep is not None:
        scene = with_seam_cost(scene, keep=mask("keep", keep, len(sizes))[repaired.polygon])
    if seams is None:
        return scene
    return opened(scene, half_edges(corners[repaired.corner], seams, n))


def unwrapped(atlas: Atlas, shape: tuple[int, ...] = (-1, 2), *, udim: bool = False) -> Unwrapped:
    """Carry the layout of an atlas back to the corners of what its surface was made of.

    Parameters
    ----------
    atlas : Atlas
    shape : tuple of int, optional
        Of the corners of the result.
    udim : bool, default False
        As in `unwrap`.
    """
    surface = atlas.surface
    uv = atlas.udim if udim else atlas.uv
    chart = atlas.face_charts
    if isinstance(surface, Scene):
        corners = np.concatenate(surface.corners(uv)).reshape(shape)
        charts = np.concatenate(surface.polygon_values(chart))
        repairs = tuple(mesh.repaired.report for mesh in surface.meshes)
        pieces = len(surface.pieces)
    else:
        corners, charts, repairs, pieces = uv, chart, (), 1
    report = UnwrapReport(repairs, pieces, len(atlas.charts), atlas.metrics(), atlas.diagnostics)
    return Unwrapped(corners, charts, report, atlas)
