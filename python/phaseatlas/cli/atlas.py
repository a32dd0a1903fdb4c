"""phaseatlas atlas."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import typer

from ..quality import QualityWarning
from . import options
from .output import check_output
from .process import UsageError, say
from .report import phases, say_cut, say_metrics, say_segmentation
from .segment import segmented

if TYPE_CHECKING:
    from ..arrays import Bytes
    from ..partitioning import Partition
    from ..scene.scene import Scene
    from ..segmentation import SceneSegmentation
    from ..surface import Surface

__all__ = ["atlas", "partitioned"]

_SUFFIXES = (".glb", ".gltf", ".obj", ".ply")

# What is said for --texture to have the checker of the library.
_CHECKER = Path("checker")
# Options of one of the two ways to charts, which mean nothing to the other.
_OF_THE_TREE = ("connected", "law", "area", "epsilon", "solver", "initial")
_OF_THE_PARTITION = ("max_distortion", "max_charts", "effort")


def atlas(
    context: typer.Context,
    mesh: options.Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.glb, .gltf, .obj, or .ply of such a file.")
    ],
    distortion: options.AtlasDistortion = None,
    max_distortion: options.MaxDistortion = None,
    max_charts: options.MaxCharts = None,
    effort: options.Effort = "normal",
    seed: options.Seed = 0,
    flatten: options.Flatten = None,
    weld: options.Weld = 0.0,
    cut: options.Cut = False,
    uv_set: options.UvSet = None,
    texture: options.Texture = None,
    rebake: options.Rebake = False,
    resolution: options.Resolution = 1024,
    padding: options.Padding = 4,
    levels: options.AtlasLevels = None,
    connected: options.Connected = True,
    law: options.Formulation = "sharp",
    area: options.Area = "lagrangian",
    epsilon: options.Epsilon = None,
    solver: options.Solver = "lbfgs",
    initial: options.Initial = "auto",
    strict: options.Strict = False,
) -> None:
    """Give all meshes of a file one atlas: cut them into charts and write them with their places.

    The file keeps all else that it holds. The charts are those of least energy, few and of short
    seams; with --levels they are the segments of equal area of the binary tree, to which
    --connected, --law, --area, --epsilon, --solver and --initial belong.
    """
    _check_ways(context, levels)
    if rebake and texture is not None:
        raise UsageError("--rebake: value must not be given with --texture")
    given = texture if texture is not None and texture != _CHECKER else None
    check_output(output, [mesh] if given is None else [mesh, given], *_SUFFIXES)
    from ..atlas.bake import check_resolution
    from ..atlas.packing import check_packing
    from ..scene.check import check_layout
    from ..scene.document import read_document
    from ..scene.scene import NoAreaError, no_places, scene_in

    check_resolution(resolution)
    check_packing(padding, resolution)
    picture = None if given is None else _read_image(given)
    ways: dict[str, Any] = {"seed": seed}
    if distortion is not None:
        ways["distortion"] = distortion
    if levels is None:
        ways |= {"max_distortion": max_distortion, "max_charts": max_charts, "effort": effort}
    else:
        ways |= {"connected": connected, "law": law, "area": area, "epsilon": epsilon}
        ways |= {"solver": solver, "initial": initial}
    _check_options(levels, ways)
    document = read_document(mesh)
    try:
        scene = scene_in(document, weld=weld, whole=not cut)
    except NoAreaError:
        nowhere = document.save(output, no_places(document.meshes), uv_set=uv_set)
        words = "no face has an area: all texture coordinates are 0, and no texture is made"
        say(*(f"note: {note}" for note in (*nowhere, words)))
        return
    before = scene
    from ..atlas import build_atlas

    segmentation = (
        partitioned(scene, **ways) if levels is None else segmented(scene, levels, **ways)
    )
    if cut:
        from ..scene.cut import cut_document

        document, scene, segmentation = cut_document(document, scene, segmentation)
    with warnings.catch_warnings():
        # What is wrong with the layout is said below.
        warnings.filterwarnings("ignore", r"(flips|overlap|density): ", QualityWarning)
        charts = build_atlas(
            segmentation,
            flatten=flatten,
            padding=padding,
            resolution=resolution,
            overlap=texture is not None,
        )
    corners = scene.corners(charts.uv)
    try:
        check_layout(scene, corners, charts, even=levels is None)
    except ValueError as error:
        raise ValueError(f"{mesh}: {output} is not written: {error}") from error
    image = None if texture is None else charts.bake(picture, resolution=resolution)
    baked = None
    if rebake:
        from ..scene.rebake import rebake as baked_anew

        baked = baked_anew(document, scene, corners, resolution=resolution)
    notes = document.save(output, corners, image=image, uv_set=uv_set, baked=baked)
    for note in (*notes, *(baked.notes if baked else ())):
        say(f"note: {note}")
    if cut:
        say_cut(before, scene)
    say_segmentation(segmentation)
    say_metrics(charts)


@overload
def partitioned(surface: Scene, **options: Any) -> SceneSegmentation: ...


@overload
def partitioned(surface: Surface, **options: Any) -> Partition: ...


def partitioned(surface: Surface, **options: Any) -> Partition | SceneSegmentation:
    """Cut a surface into charts; the progress is shown on a terminal.

    Parameters
    ----------
    surface : Surface
    **options
        Of the library's `partition`.
    """
    from ..partitioning import partition

    with phases() as report:
        return partition(surface, progress=report, **options)


def _check_options(levels: int | None, ways: dict[str, Any]) -> None:
    """Refuse options before a file is read."""
    if levels is None:
        from ..partitioning import check_options

        check_options(**ways)
    else:
        from ..segmentation import Options

        Options(**ways)


def _check_ways(context: typer.Context, levels: int | None) -> None:
    """Refuse options of the tree without its levels, and of the partition with them."""
    wrong = _OF_THE_TREE if levels is None else _OF_THE_PARTITION
    for name in wrong:
        source = context.get_parameter_source(name)
        if source is not None and source.name != "DEFAULT":
            option = f"--{name.replace('_', '-')}"
            raise UsageError(
                f"{option}: value must be given with --levels alone"
                if levels is None
                else f"{option}: value must not be given with --levels"
            )


def _read_image(path: Path) -> Bytes:
    from ..atlas.bake import load_image

    try:
        return load_image(path)
    except MemoryError:
        raise
    except Exception as error:
        # Each format fails in its own way; a file that cannot be opened says so itself.
        if isinstance(error, OSError) and error.filename is not None:
            raise
        raise ValueError(f"{path}: cannot be read as an image: {error}") from error
