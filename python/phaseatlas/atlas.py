"""Atlas generation, section 4: overlapping charts, flattened, packed and textured."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from . import _core, quality
from .files import write_bytes, write_files
from .metrics import atlas_metrics
from .packing import check_packing, face_areas, pack
from .scene.gltf import glb, ruin_of_single_precision, translation
from .scene.obj import obj
from .segmentation import Segmentation, SegmentTree
from .surface import Surface
from .texture import Texture, bake, blend_vertices, checker

__all__ = ["Atlas", "Chart", "build_atlas"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flatten = Literal["bff", "lscm"]

# Thresholds of narrower domains; the last leaves about the labelled faces.
_NARROWER = (0.1, 0.25, 0.5)
# Squared deviation of the log scale, over the surface, that a wider domain may cost its leaf.
_FREE_SPREAD = 1e-3
_WIDENING = 1.25
_TINY = float(np.finfo(float).tiny)

_FLATTEN: dict[str, Callable[[_core.TriangleMesh], Floats]] = {
    "bff": lambda disk: _core.bff(disk)[0],
    "lscm": _core.lscm,
}


@dataclass(frozen=True, eq=False)
class Chart:
    """One chart: the domain where its weight is positive, as a disk, and its map to the plane.

    Attributes
    ----------
    segment : int
        Leaf of the tree.
    faces : (k,) array of int
        Surface faces of the domain; domains of neighbouring charts overlap.
    labelled : (k,) array of bool
        The faces that belong to the sharp segment.
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
    labelled: NDArray[np.bool_]
    vertices: Ints
    triangles: Ints
    uv: Floats
    weights: Floats
    log_scale: Floats
    cut_length: float = 0.0


@dataclass(frozen=True, eq=False)
class Atlas:
    """Overlapping charts of a surface and their sharp parts packed into the unit square.

    Attributes
    ----------
    surface : Surface
    labels : (m,) array of int
        Leaf of each face.
    charts : tuple of Chart
    uv : (m, 3, 2) array
        Packed texture coordinates of the corners of each face, v up, in [0, 1].
    """

    surface: Surface
    labels: Ints
    charts: tuple[Chart, ...]
    uv: Floats = field(repr=False)

    def metrics(self) -> dict[str, float]:
        """Charts, seam, distortion, flips, overlap and packing; see `metrics.atlas_metrics`."""
        return atlas_metrics(self.surface, self.uv)

    def bake(
        self, texture: Texture | None = None, *, resolution: int = 1024, blend: bool = True
    ) -> NDArray[np.uint8]:
        """Bake a texture, repeated over the charts' planes, into the packed layout.

        Parameters
        ----------
        texture : (h, w, c) array or callable, optional
            What covers the plane; a checker by default.
        resolution : int, default 1024
            Side of the baked image in texels.
        blend : bool, default True
            Blend the overlapping charts by their weights, or take the labelled chart alone.

        Returns
        -------
        (resolution, resolution, 3) array of uint8, first row on top
        """
        return bake(
            self, checker() if texture is None else texture, resolution=resolution, blend=blend
        )

    def vertex_colors(self, texture: Texture | None = None) -> Floats:
        """Blend of f o phi over the charts at the vertices, (n, 3) in [0, 1]."""
        return blend_vertices(self, checker() if texture is None else texture)

    def save(
        self,
        path: str | PathLike[str],
        *,
        texture: Texture | None = None,
        resolution: int = 1024,
        image: NDArray[np.uint8] | None = None,
    ) -> None:
        """Write the surface with its texture coordinates and a baked texture.

        Parameters
        ----------
        path : str or PathLike
            A `.glb` file, or an `.obj` file beside which a `.mtl` and a `.png` are written.
            Files are written whole or not at all.
        texture, resolution
            As in `bake`.
        image : (r, r, 3) array of uint8, optional
            What `bake` returned, to write it instead of baking again.

        Raises
        ------
        ValueError
            For another suffix.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix not in (".glb", ".obj"):
            raise ValueError(f"path: suffix {path.suffix!r} of {path} must be .glb or .obj")
        if image is None:
            image = self.bake(texture, resolution=resolution)
        # A vertex on a seam stands once a side, with the normal of the whole surface.
        corners = np.column_stack(
            [self.surface.faces.reshape(-1).astype(np.float64), self.uv.reshape(-1, 2)]
        )
        unique, inverse = np.unique(corners, axis=0, return_inverse=True)
        origin, uv = unique[:, 0].astype(np.int64), unique[:, 1:]
        faces = inverse.reshape(-1, 3)
        vertices, normals = self.surface.vertices[origin], self.surface.vertex_normals[origin]
        if suffix == ".glb":
            welded = self.surface.vertices
            if ruin := ruin_of_single_precision(welded - translation(welded)):
                quality.warn(f"{path}: {ruin}; an .obj file holds them")
            write_bytes(path, glb(path.stem, vertices, faces, normals, uv, image))
        else:
            write_files(obj(path, vertices, faces, normals, uv, image))


def build_atlas(
    tree: SegmentTree | Segmentation,
    *,
    flatten: Flatten = "bff",
    threshold: float | None = None,
    padding: int = 4,
    resolution: int = 1024,
) -> Atlas:
    """Flatten the overlapping domains of the leaves and pack their sharp parts.

    The domain of a leaf is where its weight exceeds `threshold`, together with its labelled
    faces and those across their border; a domain that is no disk is cut open along shortest paths.

    Parameters
    ----------
    tree : SegmentTree or Segmentation
        What to cut along: the leaves of a tree, or any labels with weights.
    flatten : {"bff", "lscm"}
        The map: boundary-first with scale 1 on the border of the domain (Sawhney and Crane
        2017), which distorts area least among the conformal maps (Springborn, Schroeder and
        Pinkall 2008), or least-squares conformal in its spectral form (Mullen et al. 2008).
    threshold : float, optional
        The charts blend by max(chi^alpha - threshold, 0), scaled to sum 1. By default each leaf
        has its own: the least of 0.02 (half of 1 / leaves where that is less), 0.1, 0.25 and
        0.5 that costs the map of the labelled
        faces little area distortion. A limb as thin as the interface would lie in the domains of
        both sides whole, with its tip. With 0, the paper's choice, the domains are larger and
        often rings: a field fades to 0 where its parent does, so that siblings share a faint
        seam all around their parent.
    padding : int, default 4
        Least distance of the packed charts, in texels.
    resolution : int, default 1024
        Side in texels of the texture that the padding refers to.

    Returns
    -------
    Atlas

    Raises
    ------
    ValueError
        For an unknown `flatten`, or a `threshold` outside [0, 1 / number of leaves).
    """
    if flatten not in _FLATTEN:
        raise ValueError(f"flatten: {flatten!r} must be one of {sorted(_FLATTEN)}")
    n_leaves = len(tree.weights)
    check_packing(padding, resolution)
    if threshold is None:
        thresholds: tuple[float, ...] = (min(0.02, 0.5 / n_leaves), *_NARROWER)
    elif 0 <= threshold < 1 / n_leaves:
        thresholds = (threshold,)
    else:
        raise ValueError(f"threshold: {threshold} must be in [0, 1 / {n_leaves})")

    def leaf_charts(leaf: int) -> list[_Map]:
        return _widest(tree, leaf, thresholds, _FLATTEN[flatten])

    with ThreadPoolExecutor() as pool:
        maps = [chart for charts in pool.map(leaf_charts, range(n_leaves)) for chart in charts]
    weights = _blending_weights(tree, maps)
    charts = tuple(_chart(tree, *pair) for pair in zip(maps, weights, strict=True))
    return Atlas(
        surface=tree.surface,
        labels=tree.labels,
        charts=charts,
        uv=pack(charts, tree.surface.n_faces, padding=padding, resolution=resolution),
    )


@dataclass(frozen=True)
class _Map:
    """A domain of a leaf and its map to the plane, in any unit of length."""

    leaf: int
    faces: Ints
    labelled: NDArray[np.bool_]
    vertices: Ints
    triangles: Ints
    uv: Floats
    flat_areas: Floats
    mass: Floats
    raised: Floats
    cut_length: float


def _widest(
    tree: SegmentTree | Segmentation,
    leaf: int,
    thresholds: tuple[float, ...],
    flatten: Callable[[_core.TriangleMesh], Floats],
) -> list[_Map]:
    """Map the domains of a leaf at the least threshold that suits its labelled faces."""
    tried = []
    for threshold in thresholds:
        maps = _maps(tree, leaf, threshold, flatten)
        spread = sum(_spread(tree.surface, chart) for chart in maps)
        tried.append((spread, maps))
        if tried[0][0] <= _FREE_SPREAD:
            return maps
    bound = _FREE_SPREAD + _WIDENING * min(spread for spread, _ in tried)
    return next(maps for spread, maps in tried if spread <= bound)


def _spread(surface: Surface, chart: _Map) -> float:
    """Integral of the squared deviation of the log scale on the labelled faces, over the area."""
    areas = surface.face_areas[chart.faces][chart.labelled]
    log_scale = 0.5 * np.log(np.maximum(chart.flat_areas[chart.labelled], _TINY) / areas)
    mean = areas @ log_scale / areas.sum()
    return float(areas @ (log_scale - mean) ** 2 / surface.area)


def _maps(
    tree: SegmentTree | Segmentation,
    leaf: int,
    threshold: float,
    flatten: Callable[[_core.TriangleMesh], Floats],
) -> list[_Map]:
    """Map the components of {weight > threshold} that hold labelled faces.

    With these, and the faces across their borders, so that neighbouring domains always overlap.
    """
    surface = tree.surface
    labelled = tree.labels == leaf
    raised = np.maximum(tree.weights[leaf] - threshold, 0)
    inside = (raised[surface.faces] > 0).any(axis=1) | labelled
    across = surface.face_neighbours[labelled]
    inside[across[across >= 0]] = True
    parts = _core.label_components(surface._mesh, inside.astype(np.int64))
    maps = []
    for part in np.unique(parts[labelled]):
        faces = np.flatnonzero(parts == part)
        disk, triangles, vertices, _, cut_length = _core.cut_chart(surface._mesh, faces)
        uv = flatten(disk)
        maps.append(
            _Map(
                leaf=leaf,
                faces=faces,
                labelled=labelled[faces],
                vertices=vertices,
                triangles=triangles,
                uv=uv,
                flat_areas=face_areas(uv[triangles]),
                mass=disk.mass(),
                raised=raised,
                cut_length=cut_length,
            )
        )
    return maps


def _blending_weights(tree: SegmentTree | Segmentation, maps: list[_Map]) -> Floats:
    """Weights of the charts, (charts, n): those of the leaf on the domain, 0 elsewhere, sum 1.

    A vertex where no weight is above its threshold belongs in equal parts to all charts that label
    a face there: every face is then in a chart of positive weight.
    """
    weights = np.zeros((len(maps), tree.surface.n_vertices))
    labelled = np.zeros(weights.shape, dtype=bool)
    for k, chart in enumerate(maps):
        members = np.unique(tree.surface.faces[chart.faces])
        weights[k, members] = chart.raised[members]
        labelled[k, tree.surface.faces[chart.faces[chart.labelled]]] = True
    bare = weights.sum(axis=0) == 0
    weights[:, bare] = labelled[:, bare]
    weights /= weights.sum(axis=0)
    return weights


def _chart(tree: SegmentTree | Segmentation, chart: _Map, weight: Floats) -> Chart:
    surface_area = tree.surface.face_areas[chart.faces][chart.labelled].sum()
    scale = np.sqrt(surface_area / chart.flat_areas[chart.labelled].sum())
    flat_mass = np.bincount(chart.triangles.reshape(-1), weights=np.repeat(chart.flat_areas, 3))
    return Chart(
        segment=chart.leaf,
        faces=chart.faces,
        labelled=chart.labelled,
        vertices=chart.vertices,
        triangles=chart.triangles,
        uv=chart.uv * scale,
        weights=weight[chart.vertices],
        log_scale=0.5 * np.log(scale**2 * flat_mass / (3 * chart.mass)),
        cut_length=chart.cut_length,
    )
