"""From any polygons to texture coordinates at their corners, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats, Ints
from .atlas import Atlas, build_atlas
from .atlas.flatten import Flattening
from .atlas.metrics import Flaws
from .notebook import Pictured
from .partitioning.partition import DISTORTION, Effort, partition
from .scene.repair import RepairReport, repair
from .scene.scene import Scene, polygons_of
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
        each other.
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

    def __repr__(self) -> str:
        corners, report = self.corners.size // 2, self.report
        figures = f"stretch {report.metrics['l2']:.4g}, packing {report.metrics['packing']:.3g} %"
        pieces = f"{report.pieces} piece{'s' * (report.pieces != 1)}"
        return f"Unwrapped({corners} corners, {report.charts} charts, {pieces},\n  {figures})"


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
    resolution: int = 1024,
    weld: float = 0.0,
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
    distortion, max_distortion, max_charts, effort, seed
        As in `partition`, and with `levels`, `distortion` and `seed` as in `segment`.
    flatten, padding, resolution
        As in `build_atlas`.
    weld : float, default 0
        Join vertices nearer than this, too, in the units of the vertices.
    executor : concurrent.futures.Executor, optional
        As in `partition` and `segment`; the result does not depend on it.

    Returns
    -------
    Unwrapped

    Raises
    ------
    ValueError
        For an option or polygons that cannot be used, and where no face has an area.
    """
    shape: tuple[int, ...] = (-1, 2)
    if isinstance(vertices, Surface):
        if faces is not None:
            raise ValueError("faces: value must be left out for a surface")
        surface: Surface = vertices
    else:
        if faces is None:
            raise ValueError("faces: value must be given with vertices")
        corners, sizes = polygons_of(faces)
        if sizes.size and (isinstance(faces, np.ndarray) or (sizes == sizes[0]).all()):
            shape = (len(sizes), int(sizes[0]), 2)
        surface = Scene([("", repair(vertices, corners, sizes, weld=weld))])
    if levels is not None:
        for name, value in (("max_distortion", max_distortion), ("max_charts", max_charts)):
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
            executor=executor,
        )
    atlas = build_atlas(charted, flatten=flatten, padding=padding, resolution=resolution)
    return unwrapped(atlas, shape)


def unwrapped(atlas: Atlas, shape: tuple[int, ...] = (-1, 2)) -> Unwrapped:
    """Carry the layout of an atlas back to the corners of what its surface was made of.

    Parameters
    ----------
    atlas : Atlas
    shape : tuple of int, optional
        Of the corners of the result.
    """
    surface = atlas.surface
    chart = np.empty(surface.n_faces, dtype=np.int64)
    for k, each in enumerate(atlas.charts):
        chart[each.faces[each.labelled]] = k
    if isinstance(surface, Scene):
        corners = np.concatenate(surface.corners(atlas.uv)).reshape(shape)
        charts = np.concatenate(surface.polygon_values(chart))
        repairs = tuple(mesh.repaired.report for mesh in surface.meshes)
        pieces = len(surface.pieces)
    else:
        corners, charts, repairs, pieces = atlas.uv, chart, (), 1
    report = UnwrapReport(repairs, pieces, len(atlas.charts), atlas.metrics(), atlas.diagnostics)
    return Unwrapped(corners, charts, report, atlas)
