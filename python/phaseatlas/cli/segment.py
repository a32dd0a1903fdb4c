"""phaseatlas segment, and the segmentation that other commands start with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import typer

from . import options
from .output import check_output
from .report import progress, say_tree

if TYPE_CHECKING:
    from ..scene.scene import Scene
    from ..segmentation import SceneSegmentation, SegmentTree
    from ..surface import Surface

__all__ = ["segment", "segmented"]


def segment(
    mesh: options.Mesh,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="OUT.npz: everything; OUT.ply: weights and labels."),
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
    strict: options.Strict = False,
) -> None:
    """Segment a mesh into 2^levels connected segments of equal area."""
    check_output(output, [mesh], ".npz", ".ply")
    from ..io import load, save_ply
    from ..segmentation import Options

    others: dict[str, Any] = {
        "connected": connected,
        "distortion": distortion,
        "law": law,
        "area": area,
        "epsilon": epsilon,
        "solver": solver,
        "initial": initial,
        "seed": seed,
    }
    Options(**others)
    tree = segmented(load(mesh), levels, **others)
    if output.suffix.lower() == ".npz":
        tree.save(output)
    else:
        save_ply(tree, output)
    say_tree(tree)


@overload
def segmented(surface: Scene, levels: int, **others: Any) -> SceneSegmentation: ...


@overload
def segmented(surface: Surface, levels: int, **others: Any) -> SegmentTree: ...


def segmented(surface: Surface, levels: int, **others: Any) -> SegmentTree | SceneSegmentation:
    """Segment a surface or the pieces of a scene; the progress is shown on a terminal.

    Parameters
    ----------
    surface : Surface or Scene
        What to segment.
    levels : int
        Depth of the tree.
    **others
        More options of the library's `segment`.
    """
    from ..segmentation import segment

    with progress(levels) as report:
        return segment(surface, levels, progress=report, **others)
