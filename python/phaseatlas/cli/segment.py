"""phaseatlas segment, and the segmentation that other commands start with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import typer

from . import options
from .output import check_output
from .process import Record, workers
from .report import progress, say_segmentation, say_tree, say_written

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
    levels: options.SegmentLevels = None,
    shares: options.Shares = None,
    connected: options.Connected = True,
    distortion: options.Distortion = 0.0,
    law: options.Formulation = "sharp",
    area: options.Area = "lagrangian",
    epsilon: options.Epsilon = None,
    solver: options.Solver = "lbfgs",
    initial: options.Initial = "auto",
    seed: options.Seed = 0,
    seam_cost: options.SeamCost = None,
    seams: options.Seams = None,
    keep: options.Keep = None,
    creases: options.Creases = None,
    strict: options.Strict = False,
) -> Record:
    """Segment a mesh into 2^levels connected segments of equal area, or by --shares.

    Those of a file of several pieces are given out to the pieces by area, at least one each.
    """
    check_output(output, [mesh], ".npz", ".ply")
    parts = options.parsed_shares(shares)
    if levels is not None and parts is not None:
        raise ValueError("shares: value must not be given with levels")
    levels = 3 if levels is None and parts is None else levels
    from ..io import save_ply
    from ..scene.document import read_document
    from ..scene.scene import scene_file, scene_in
    from ..scene.wishes import Wishes, granted
    from ..segmentation import Options, SegmentTree

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
    wishes = Wishes(seam_cost, seams, tuple(keep or ()), creases)
    document = read_document(mesh)
    scene = scene_in(document)
    scene.file = scene_file(mesh)
    scene = granted(document, scene, wishes)
    # A file of one piece has a tree of its own, unless it was opened.
    alone = len(scene.pieces) == 1 and not any(m.repaired.report.aside for m in scene.meshes)
    alone &= seams is None
    segments: SegmentTree | SceneSegmentation = (
        segmented(scene.pieces[0].surface, levels, shares=parts, **others)
        if alone
        else segmented(scene, levels, shares=parts, **others)
    )
    if output.suffix.lower() == ".npz":
        if isinstance(segments, SegmentTree):
            segments.save(output, source=scene.file)
        else:
            segments.save(output)
    else:
        save_ply(segments, output)
    if isinstance(segments, SegmentTree):
        say_tree(segments)
    else:
        say_segmentation(segments)
    say_written(output)
    return {
        "input": str(mesh),
        "output": str(output),
        "files": [str(output)],
        **_figures(segments, scene),
    }


def _figures(segments: SegmentTree | SceneSegmentation, scene: Scene) -> Record:
    """Return what JSON can hold of segments."""
    from ..segmentation import SegmentTree

    trees = [segments] if isinstance(segments, SegmentTree) else segments.trees
    solved = [tree for tree in trees if tree is not None]
    nodes = [node for tree in solved for node in tree.diagnostics]
    areas = segments.areas
    return {
        "pieces": len(scene.pieces),
        "segments": len(areas),
        "areas": areas,
        "shares": areas / areas.sum(),
        "components": [int(parts) for tree in solved for parts in tree.components],
        "length": sum(node.length for node in nodes),
        "iterations": sum(node.iterations for node in nodes),
        "violation": max((abs(node.violation) for node in nodes), default=0.0),
    }


@overload
def segmented(surface: Scene, levels: int | None, **others: Any) -> SceneSegmentation: ...


@overload
def segmented(surface: Surface, levels: int | None, **others: Any) -> SegmentTree: ...


def segmented(
    surface: Surface, levels: int | None, **others: Any
) -> SegmentTree | SceneSegmentation:
    """Segment a surface or the pieces of a scene; the progress is shown on a terminal.

    Parameters
    ----------
    surface : Surface or Scene
        What to segment.
    levels : int, optional
        Depth of the tree; None where `shares` are among the others.
    **others
        More options of the library's `segment`.
    """
    from ..segmentation import segment

    with progress(levels) as report, workers() as executor:
        return segment(surface, levels, executor=executor, progress=report, **others)
