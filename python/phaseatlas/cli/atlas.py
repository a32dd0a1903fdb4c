"""phaseatlas atlas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .output import check_output
from .report import say_metrics, say_tree
from .segment import segmented

if TYPE_CHECKING:
    from ..arrays import Bytes

__all__ = ["atlas"]


def atlas(
    mesh: options.Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.glb, or OUT.obj with its .mtl and .png.")
    ],
    levels: options.Levels = 3,
    connected: options.Connected = True,
    distortion: options.Distortion = 0.0,
    law: options.Formulation = "sharp",
    area: options.Area = "lagrangian",
    epsilon: options.Epsilon = None,
    solver: options.Solver = "lbfgs",
    initial: options.Initial = "auto",
    seed: options.Seed = 0,
    flatten: options.Flatten = "bff",
    texture: options.Texture = None,
    resolution: options.Resolution = 1024,
    strict: options.Strict = False,
) -> None:
    """Segment a mesh, flatten the segments and write it with a blended texture."""
    check_output(output, [mesh] if texture is None else [mesh, texture], ".glb", ".obj")
    from ..atlas import build_atlas
    from ..atlas.bake import check_resolution

    check_resolution(resolution)
    image = None if texture is None else _read_image(texture)
    tree = segmented(
        mesh,
        levels,
        connected=connected,
        distortion=distortion,
        law=law,
        area=area,
        epsilon=epsilon,
        solver=solver,
        initial=initial,
        seed=seed,
    )
    charts = build_atlas(tree, flatten=flatten, resolution=resolution)
    charts.save(output, texture=image, resolution=resolution)
    say_tree(tree)
    say_metrics(charts)


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
