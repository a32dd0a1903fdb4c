"""Options of the atlas of a file: each once, with its default, its meaning and its check."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from .atlas.bake import check_resolution
from .atlas.drawing import check_drawing
from .atlas.flatten import FLATTENINGS, Flattening
from .atlas.pages import PackOptions
from .file_textures import CHECKER
from .optimise import AreaConstraint, Solver
from .partitioning import check_options
from .partitioning.partition import DISTORTION, Effort
from .partitioning.symmetry import Axis
from .scene.wishes import Wishes
from .segmentation import Options
from .segmentation.options import Initial, Law
from .segmentation.shares import check_levels, check_shares

__all__ = ["AtlasOptions", "check_saved", "check_solved", "files_of"]

# Options of one of the two ways to charts, which mean nothing to the other.
_OF_THE_TREE = ("connected", "law", "area", "epsilon", "solver", "initial")
_OF_THE_PARTITION = ("max_distortion", "max_charts", "effort", "symmetry")
_OF_SEAMS = ("seam_cost", "seams", "keep", "creases")


@dataclass(frozen=True)
class AtlasOptions:
    """How a file gets its atlas.

    Parameters
    ----------
    levels : int, optional
        Cut into the 2^levels segments of equal area of `segment`; without it into the charts of
        least energy of `partition`.
    shares : tuple of float, optional
        Instead of `levels`: areas of the segments in proportion, for a file of one piece.
    distortion : float, optional
        As in `partition`, 600 where it is left out; with `levels` as in `segment`, and 0.
    max_distortion, max_charts, effort, symmetry
        As in `partition`; not with `levels` or `shares`.
    stack : bool, default False
        Lay the charts of one half over their mirror images; with `symmetry` alone, and not with
        `cut`.
    connected, law, area, epsilon, solver, initial
        As in `segment`; with `levels` or `shares` alone.
    seed : int, default 0
        Of what is random.
    flatten : {"isometric", "bff", "lscm"}, optional
        As in `build_atlas`.
    weld : float, default 0
        Join vertices nearer than this, in the units of the mesh.
    cut : bool, default False
        Cut triangles along straightened seams: the mesh that is written is a new one.
    uv_set : int, optional
        As in `scene.document.Document.with_uv`.
    texture : str or PathLike, optional
        An image to repeat over the charts, or ``"checker"``. None is made where it is left out.
    rebake : bool, default False
        Bake the file's own textures and colours into pictures of the atlas.
    resolution : int, optional
        Side of the textures in texels: 1024, or what a density needs.
    padding : int, default 4
        Least distance of the charts in texels of the last of the mip levels.
    mips, density, pages
        As in `build_atlas`.
    udim : bool, default False
        Write page k into UDIM tile 1001 + k, and its texture as `name.1001.png` and so on. Without
        it several pages lie in the unit square, each with materials of its own.
    charts : str or PathLike, optional
        A `.glb` file for the overlapping charts, as `Atlas.save_charts` writes it.
    outlines : str or PathLike, optional
        An `.svg` or `.dxf` file for the outlines of the flat segments, as `Outlines.save` does.
    unit : {"mm", "cm", "m", "in", "ft"}, optional
        Of the lengths of the mesh; m for a glTF file, else mm by default.
    seam_cost, seams, keep, creases
        Where seams may run; see `scene.wishes.Wishes`.

    Raises
    ------
    ValueError
        For a value that cannot be used; the message starts with its name.
    """

    levels: int | None = None
    shares: tuple[float, ...] | None = None
    distortion: float | None = None
    max_distortion: float | None = None
    max_charts: int | None = None
    effort: Effort = "normal"
    connected: bool = True
    law: Law = "sharp"
    area: AreaConstraint = "lagrangian"
    epsilon: float | None = None
    solver: Solver = "lbfgs"
    initial: Initial = "auto"
    seed: int = 0
    flatten: Flattening | None = None
    weld: float = 0.0
    cut: bool = False
    uv_set: int | None = None
    texture: str | PathLike[str] | None = None
    rebake: bool = False
    resolution: int | None = None
    padding: int = 4
    charts: str | PathLike[str] | None = None
    outlines: str | PathLike[str] | None = None
    unit: str | None = None
    mips: int = 0
    density: float | None = None
    pages: int = 1
    udim: bool = False
    symmetry: Axis | None = None
    stack: bool = False
    seam_cost: str | None = None
    seams: str | PathLike[str] | None = None
    keep: tuple[str, ...] = ()
    creases: float | None = None

    def __post_init__(self) -> None:
        defaults = type(self).__dataclass_fields__
        if self.levels is not None and self.shares is not None:
            raise ValueError("shares: value must not be given with levels")
        for name in _OF_THE_PARTITION if self.by_tree else _OF_THE_TREE:
            if getattr(self, name) != defaults[name].default:
                raise ValueError(
                    f"{name}: value must not be given with levels or shares"
                    if self.by_tree
                    else f"{name}: value must be given with levels or shares alone"
                )
        if self.charts is not None and Path(self.charts).suffix.lower() != ".glb":
            raise ValueError(f"charts: {self.charts} must end in .glb")
        if self.unit is not None and self.outlines is None:
            raise ValueError("unit: value must be given with outlines alone")
        if self.outlines is not None:
            check_drawing(Path(self.outlines), self.unit or "mm")
        check_levels(self.levels)
        if self.shares is not None:
            check_shares(self.shares)
        if not (math.isfinite(self.weld) and self.weld >= 0):
            raise ValueError(f"weld: {self.weld} must be a number of at least 0")
        if self.uv_set is not None and self.uv_set < 0:
            raise ValueError(f"uv_set: {self.uv_set} must be at least 0")
        if any(not str(name).strip() for name in self.keep):
            raise ValueError("keep: a name must not be empty")
        if isinstance(self.keep, str):
            raise ValueError(f"keep: {self.keep!r} must be a tuple of names")
        if self.rebake and self.texture is not None:
            raise ValueError("rebake: value must not be given with texture")
        if self.flatten not in (None, *FLATTENINGS):
            raise ValueError(f"flatten: {self.flatten!r} must be one of {FLATTENINGS}")
        if self.stack and self.symmetry is None:
            raise ValueError("stack: value must be given with symmetry alone")
        if self.stack and self.cut:
            # Straightened seams are not symmetric.
            raise ValueError("stack: value must not be given with cut")
        packing = PackOptions(**self.of_packing())
        if self.density is None:
            check_resolution(packing.side)
        self.wishes()
        if self.by_tree:
            Options(**self.of_tree())
        else:
            check_options(**self.of_partition())

    @property
    def by_tree(self) -> bool:
        """Whether the charts are the segments of a tree."""
        return self.levels is not None or self.shares is not None

    def of_partition(self) -> dict[str, Any]:
        """Options of `partition`."""
        return {
            "distortion": DISTORTION if self.distortion is None else self.distortion,
            "max_distortion": self.max_distortion,
            "max_charts": self.max_charts,
            "effort": self.effort,
            "seed": self.seed,
            "symmetry": self.symmetry,
        }

    def of_tree(self) -> dict[str, Any]:
        """Options of `segment`, its levels and shares aside."""
        weight = 0.0 if self.distortion is None else self.distortion
        return {
            "distortion": weight,
            "seed": self.seed,
            **{name: getattr(self, name) for name in _OF_THE_TREE},
        }

    def of_packing(self) -> dict[str, Any]:
        """Options of `PackOptions`."""
        names = ("padding", "resolution", "mips", "density", "pages")
        return {name: getattr(self, name) for name in names}

    def wishes(self) -> Wishes:
        """Where seams may run."""
        seams = None if self.seams is None else Path(self.seams)
        return Wishes(self.seam_cost, seams, self.keep, self.creases)

    def given(self) -> dict[str, Any]:
        """Values that are not the defaults, as JSON can hold them."""
        defaults = type(self).__dataclass_fields__
        return {
            name: str(value) if isinstance(value, PathLike) else value
            for name, value in asdict(self).items()
            if value != defaults[name].default
        }


def check_solved(options: AtlasOptions) -> None:
    """Refuse options of the solve for what was solved before."""
    given = options.given()
    for name in (
        "levels",
        "shares",
        "distortion",
        "weld",
        "seed",
        *_OF_SEAMS,
        *_OF_THE_TREE,
        *_OF_THE_PARTITION,
    ):
        if name in given:
            raise ValueError(f"{name}: value must not be given with an .npz file")


def check_saved(options: AtlasOptions) -> None:
    """Refuse options that an `.npz` file has no place for."""
    given = options.given()
    for name in ("texture", "rebake", "uv_set", "udim"):
        if name in given:
            raise ValueError(f"{name}: value must not be given for an .npz file, which has none")


def files_of(options: AtlasOptions) -> list[Path]:
    """The files that options name, which must not be overwritten."""
    named = [options.texture, options.seams, *options.keep]
    return [Path(name) for name in named if name is not None and str(name) != CHECKER]
