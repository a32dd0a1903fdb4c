"""phaseatlas segment, and the segmentation that other commands start with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .output import check_output
from .report import progress, say_tree

if TYPE_CHECKING:
    from ..segmentation import SegmentTree
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
    from ..io import save_ply

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
    if output.suffix.lower() == ".npz":
        tree.save(output)
    else:
        save_ply(tree, output)
    say_tree(tree)


def segmented(mesh: Path | Surface, levels: int, **others: Any) -> SegmentTree:
    """Segment a surface or what a file holds; the progress is shown on a terminal.

    Parameters
    ----------
    mesh : Path or Surface
        What to segment; a file is read after the options are checked.
    levels : int
        Depth of the tree.
    **others
        More options of the library's `segment`.
    """
    from ..io import load
    from ..segmentation import Options, segment

    Options(**others)
    surface = load(mesh) if isinstance(mesh, Path) else mesh
    with progress(levels) as report:
        return segment(surface, levels, progress=report, **others)
