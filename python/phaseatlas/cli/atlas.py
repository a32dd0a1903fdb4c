"""phaseatlas atlas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .output import check_output
from .process import UsageError
from .report import phases, say_metrics, say_partition, say_tree
from .segment import segmented

if TYPE_CHECKING:
    from ..arrays import Bytes
    from ..partitioning import Partition
    from ..surface import Surface

__all__ = ["atlas", "partitioned"]

# What is said for --texture to have the checker of the library.
_CHECKER = Path("checker")
# Options of one of the two ways to charts, which mean nothing to the other.
_OF_THE_TREE = ("connected", "law", "area", "epsilon", "solver", "initial")
_OF_THE_PARTITION = ("max_distortion", "max_charts", "effort")


def atlas(
    context: typer.Context,
    mesh: options.Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.glb, or OUT.obj with its .mtl and .png.")
    ],
    distortion: options.AtlasDistortion = None,
    max_distortion: options.MaxDistortion = None,
    max_charts: options.MaxCharts = None,
    effort: options.Effort = "normal",
    seed: options.Seed = 0,
    flatten: options.Flatten = None,
    texture: options.Texture = None,
    resolution: options.Resolution = 1024,
    levels: options.AtlasLevels = None,
    connected: options.Connected = True,
    law: options.Formulation = "sharp",
    area: options.Area = "lagrangian",
    epsilon: options.Epsilon = None,
    solver: options.Solver = "lbfgs",
    initial: options.Initial = "auto",
    strict: options.Strict = False,
) -> None:
    """Cut a mesh into charts, flatten them and write it with a texture.

    The charts are those of least energy, few and of short seams; with --levels they are the
    segments of equal area of the binary tree, to which --connected, --law, --area, --epsilon,
    --solver and --initial belong.
    """
    _check_ways(context, levels)
    given = texture if texture is not None and texture != _CHECKER else None
    check_output(output, [mesh] if given is None else [mesh, given], ".glb", ".obj")
    from ..atlas import build_atlas
    from ..atlas.bake import check_resolution

    check_resolution(resolution)
    image = None if given is None else _read_image(given)
    if levels is None:
        bounds: dict[str, Any] = {} if distortion is None else {"distortion": distortion}
        bounds |= {"max_distortion": max_distortion, "max_charts": max_charts}
        partition = partitioned(mesh, effort=effort, seed=seed, **bounds)
        charts = build_atlas(partition, flatten=flatten, resolution=resolution)
    else:
        tree = segmented(
            mesh,
            levels,
            connected=connected,
            distortion=0.0 if distortion is None else distortion,
            law=law,
            area=area,
            epsilon=epsilon,
            solver=solver,
            initial=initial,
            seed=seed,
        )
        charts = build_atlas(tree, flatten=flatten, resolution=resolution)
    charts.save(output, texture=image, resolution=resolution)
    if levels is None:
        say_partition(partition)
    else:
        say_tree(tree)
    say_metrics(charts)


def partitioned(mesh: Path | Surface, **options: Any) -> Partition:
    """Cut a surface or what a file holds into charts; the progress is shown on a terminal.

    Parameters
    ----------
    mesh : Path or Surface
        What to cut; a file is read after the options are checked.
    **options
        Of the library's `partition`.
    """
    from ..io import load
    from ..partitioning import check_options, partition

    check_options(**options)
    surface = load(mesh) if isinstance(mesh, Path) else mesh
    with phases() as report:
        return partition(surface, progress=report, **options)


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
