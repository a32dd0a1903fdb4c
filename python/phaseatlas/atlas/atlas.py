"""The atlas of a segmentation, section 4: domains, flattened, packed, baked, rated, written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from .. import quality
from ..arrays import Bytes, Floats
from ..files import write_files
from ..partitioning.symmetry import Axis
from ..scene.gltf import ruin_of_single_precision, translation
from ..scene.surface_files import surface_files
from ..segmentation import Segmentation, SegmentTree
from .bake import Texture, bake, blend_vertices, checker
from .charts import Layout
from .flatten import FLATTENINGS, Flattening
from .kept import warn_of_cuts
from .mapped import charts_of
from .metrics import CURE, Flaws, atlas_metrics, flaws
from .outlines import Outlines, outlines
from .overlap import save_charts
from .pages import PackOptions, lay_out, pages_of_subtrees
from .pairs import corners_of_pairs
from .saved import load_layout, save_layout

__all__ = ["Atlas", "build_atlas"]


@dataclass(frozen=True, eq=False, repr=False)
class Atlas(Layout):
    """A `Layout`, with what can be done with it: baked, rated, packed anew and written."""

    @cached_property
    def diagnostics(self) -> Flaws:
        """What makes the layout worse than asked for; see `metrics.Flaws`."""
        uv, pages = self.apart
        found = flaws(self.surface, uv, pages=pages)
        return replace(found, stacked=int(np.count_nonzero(self.stacked)))

    def packed(
        self,
        *,
        padding: int = 4,
        resolution: int | None = None,
        mips: int = 0,
        density: float | None = None,
        pages: int = 1,
    ) -> Atlas:
        """Return the same charts in another packing; nothing is flattened again.

        Parameters
        ----------
        padding, resolution, mips, density, pages
            As in `build_atlas`. Charts keep their pages where as many are asked for as there are.

        Raises
        ------
        ValueError
            For values that cannot be used.
        """
        options = PackOptions(padding, resolution, mips, density, pages)
        kept = self.pages if pages == self.n_pages else None
        made = lay_out(self.charts, self.surface.n_faces, options, kept, self.stack)
        return replace(self, uv=made.uv, pages=made.pages, resolution=made.resolution)

    def metrics(self) -> dict[str, float]:
        """Charts, seam, distortion, flips, overlap and packing; see `metrics.atlas_metrics`."""
        return dict(self._metrics)

    @cached_property
    def _metrics(self) -> dict[str, float]:
        uv, pages = self.apart
        return atlas_metrics(self.surface, uv, flaws=self.diagnostics, pages=pages)

    def bake(
        self,
        texture: Texture | None = None,
        *,
        resolution: int | None = None,
        blend: bool = True,
        page: int | None = None,
    ) -> Bytes:
        """Bake a texture, repeated over the charts' planes, into the packed layout.

        Parameters
        ----------
        texture : (h, w, c) array or callable, optional
            What covers the plane; a checker by default.
        resolution : int, optional
            Side of the baked image in texels; by default that of the layout.
        blend : bool, default True
            Blend the overlapping charts by their weights, or take the labelled chart alone.
        page : int, optional
            Which page to bake, where there are several.

        Returns
        -------
        (resolution, resolution, 3) array of uint8, first row on top

        Raises
        ------
        ValueError
            Without a page, where there are several.
        """
        return bake(
            self,
            checker() if texture is None else texture,
            resolution=self.resolution if resolution is None else resolution,
            blend=blend,
            page=page,
        )

    def vertex_colors(self, texture: Texture | None = None) -> Floats:
        """Blend of f o phi over the charts at the vertices, (n, 3) in [0, 1]."""
        return blend_vertices(self, checker() if texture is None else texture)

    def save(
        self,
        path: str | PathLike[str],
        *,
        texture: Texture | None = None,
        resolution: int | None = None,
        image: Bytes | Sequence[Bytes] | None = None,
    ) -> None:
        """Write the surface with its texture coordinates and a baked texture.

        Parameters
        ----------
        path : str or PathLike
            A `.glb` file, an `.obj` file beside which a `.mtl` and a `.png` are written, or an
            `.html` page that shows the atlas. An `.npz` file has no texture, but the charts, which
            `load` reads: vertices, faces, labels, uv, pages, resolution, stack, the fields of
            `Chart` with the prefix ``chart_``, one chart after the other, chart_n_faces and
            chart_n_vertices of each, and format, 3; of a scene what leads back to its file. Several
            pages have a material each. Files are written whole or not at all.
        texture, resolution
            As in `bake`.
        image : (r, r, 3) array of uint8, or a sequence of them, optional
            What `bake` returned, to write it instead of baking again; one for each page.

        Raises
        ------
        ValueError
            For another suffix, and another number of images than of pages.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix == ".npz":
            save_layout(self, path)
            return
        if suffix not in (".glb", ".obj", ".html"):
            allowed = ".glb, .obj, .npz or .html"
            raise ValueError(f"path: suffix {path.suffix!r} of {path} must be {allowed}")
        if image is None:
            pages = range(self.n_pages)
            images = [self.bake(texture, resolution=resolution, page=page) for page in pages]
        else:
            images = [image] if isinstance(image, np.ndarray) else list(image)
        if len(images) != self.n_pages:
            raise ValueError(f"image: {len(images)} images must be {self.n_pages}, one a page")
        if suffix == ".html":
            from ..page import write_page

            write_page(self, path, image=images)
            return
        if suffix == ".glb":
            welded = self.surface.vertices
            if ruin := ruin_of_single_precision(welded - translation(welded)):
                quality.warn(f"{path}: {ruin}; an .obj file holds them")
        write_files(surface_files(path, self.surface, self.uv, self.face_pages, images))

    @staticmethod
    def load(path: str | PathLike[str]) -> Atlas:
        """Read an atlas that `save` wrote to an `.npz` file.

        Raises
        ------
        ValueError
            For a file that is no atlas.
        FileNotFoundError
            For a missing file.
        """
        return Atlas(**vars(load_layout(path)))

    def save_charts(
        self, path: str | PathLike[str], *, padding: int = 4, resolution: int = 1024
    ) -> None:
        """Write the overlapping charts to a `.glb` file, a mesh each; see `overlap.charts_glb`."""
        save_charts(self, path, padding=padding, resolution=resolution)

    def outlines(self, *, spacing: float | None = None) -> Outlines:
        """Return the flat segments' boundaries, 1:1, with notches; see `outlines.outlines`."""
        return outlines(self, spacing=spacing)


def build_atlas(
    tree: SegmentTree | Segmentation,
    *,
    flatten: Flattening | None = None,
    threshold: float | None = None,
    padding: int = 4,
    resolution: int | None = None,
    overlap: bool = True,
    mips: int = 0,
    density: float | None = None,
    pages: int = 1,
    stack: Axis | None = None,
) -> Atlas:
    """Flatten the overlapping domains of the leaves and pack their sharp parts.

    The domain of a leaf is where its weight exceeds `threshold`, together with its labelled faces
    and those across their boundary; a domain that is no disk is cut open along shortest paths.

    The map of the labelled faces of every chart is a bijection, by an exact test: no face is turned
    over, and the boundary does not cross itself. Where the map of a domain fails, narrower domains
    are tried, then the labelled faces alone, to whose map the rest of the domain is attached; at
    last the labelled faces are split. Faces thinner than four units in the last place of a
    single-precision texture coordinate are exempt, and counted in `diagnostics`.

    Parameters
    ----------
    tree : SegmentTree or Segmentation
        What to cut along: the leaves of a tree, or any labels with weights.
    flatten : {"isometric", "bff", "lscm"}, optional
        The map: of least symmetric Dirichlet energy (Smith and Schaefer 2015), which keeps lengths
        and areas best; boundary-first with scale 1 on the boundary of the domain (Sawhney and Crane
        2017), which distorts area least among the conformal maps (Springborn, Schroeder and
        Pinkall 2008); or least-squares conformal in its spectral form (Mullen et al. 2008).
        Isometric maps are those of the labelled faces alone. By default isometric for a
        `Partition`, and boundary-first for all else.
    threshold : float, optional
        The charts blend by max(chi^alpha - threshold, 0), scaled to sum 1. By default each leaf
        has its own: the least of 0.02 (half of 1 / leaves where that is less), 0.1, 0.25 and 0.5
        that costs the map of the labelled faces little area distortion. A limb as thin as the
        interface would lie in the domains of both sides whole, with its tip. With 0, the paper's
        choice, the domains are larger and often rings: a field fades to 0 where its parent does,
        so that siblings share a faint seam all around their parent.
    padding : int, default 4
        Least distance of the packed charts, in texels of the last of the mip levels.
    resolution : int, optional
        Side in texels of the textures: 1024 by default, and with a density what that needs.
    overlap : bool, default True
        Whether isometric charts get faces of their neighbours attached, for textures that blend.
        Where none is baked that is time lost, and the layout is the same without. Other maps are
        those of overlapping domains.
    mips : int, default 0
        Mip levels that keep charts apart: no texel of a level up to this one is touched by two
        charts, and at full size they are `padding` times 2^mips texels apart.
    density : float, optional
        Texels a unit length of the surface. The resolution follows: the least multiple of 4, and of
        2^mips, with room for the charts. It is at most 16384.
    pages : int, default 1
        Textures that share the charts, at one scale. The subtrees of a tree with as many on one
        level, of equal area, fill a page each; other charts are shared out as evenly as they fit.
    stack : {"x", "y", "z"}, optional
        Lay charts over those that they are the mirror images of, across the plane of this axis, as
        those of a partition with that `symmetry` are: both share the same texels, the second turned
        over.

    Returns
    -------
    Atlas

    Raises
    ------
    ValueError
        For an unknown `flatten`, a `threshold` outside [0, 1 / number of segments), and values that
        `PackOptions` refuses.

    Warns
    -----
    QualityWarning
        Where segments had to be split, a region to keep had to be cut, texels are covered twice, or
        more than 2 % of the area has less than a tenth of the mean texel density; the figures are
        in `diagnostics`.
    """
    segmentation = tree.at(tree.levels) if isinstance(tree, SegmentTree) else tree
    if flatten not in (None, *FLATTENINGS):
        raise ValueError(f"flatten: {flatten!r} must be one of {FLATTENINGS}")
    options = PackOptions(padding, resolution, mips, density, pages)
    options.check_area(segmentation.surface.area)
    count = segmentation.n_segments
    if threshold is not None and not 0 <= threshold < 1 / count:
        raise ValueError(f"threshold: {threshold} must be in [0, 1 / {count})")
    charts, n_split = charts_of(segmentation, threshold, flatten, overlap)
    if n_split:
        quality.warn(
            f"charts: {n_split} had to be split, as their maps turned faces over or covered points "
            f"twice; {CURE}"
        )
    subtrees = None if pages == 1 else pages_of_subtrees(tree, charts, pages)
    surface = segmentation.surface
    corners = None if stack is None else corners_of_pairs(surface, charts, stack)
    made = lay_out(charts, surface.n_faces, options, subtrees, corners)
    atlas = Atlas(
        surface,
        segmentation.labels,
        charts,
        made.uv,
        made.pages,
        made.resolution,
        **({} if corners is None else {"stack": corners}),
    )
    for flaw in atlas.diagnostics.sentences():
        quality.warn(flaw)
    warn_of_cuts(surface, made.uv)
    return atlas
