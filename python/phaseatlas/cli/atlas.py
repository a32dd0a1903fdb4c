"""phaseatlas atlas."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .output import check_output
from .process import Record, say, workers
from .report import phases, progress, say_cut, say_metrics, say_pages, say_segmentation, say_written

if TYPE_CHECKING:
    from ..atlas_options import AtlasOptions

__all__ = ["atlas", "chosen_options"]

_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".npz", ".html")


def atlas(
    context: typer.Context,
    mesh: options.MeshOrNpz,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="OUT.glb, .gltf, .obj, .ply of such a file, .npz for atlas again; .html: a page.",
        ),
    ],
    distortion: options.AtlasDistortion = None,
    max_distortion: options.MaxDistortion = None,
    max_charts: options.MaxCharts = None,
    effort: options.Effort = "normal",
    symmetry: options.Symmetry = None,
    stack: options.Stack = False,
    seed: options.Seed = 0,
    flatten: options.Flatten = None,
    weld: options.Weld = 0.0,
    cut: options.Cut = False,
    uv_set: options.UvSet = None,
    seam_cost: options.SeamCost = None,
    seams: options.Seams = None,
    keep: options.Keep = None,
    creases: options.Creases = None,
    texture: options.Texture = None,
    rebake: options.Rebake = False,
    resolution: options.Resolution = None,
    density: options.Density = None,
    padding: options.Padding = 4,
    charts: options.Charts = None,
    outlines: options.Outlines = None,
    unit: options.Unit = None,
    mips: options.Mips = 0,
    pages: options.Pages = 1,
    udim: options.Udim = False,
    levels: options.AtlasLevels = None,
    shares: options.Shares = None,
    connected: options.Connected = True,
    law: options.Formulation = "sharp",
    area: options.Area = "lagrangian",
    epsilon: options.Epsilon = None,
    solver: options.Solver = "lbfgs",
    initial: options.Initial = "auto",
    strict: options.Strict = False,
) -> Record:
    """Give all meshes of a file one atlas: cut them into charts and write them with their places.

    The file keeps all else that it holds. An .npz file of segment or atlas is solved already: it is
    flattened, packed and baked alone. The charts are those of least energy, few and of short
    seams; with --levels or --shares they are the segments of the binary tree, to which
    --connected, --law, --area, --epsilon, --solver and --initial belong.
    """
    given = texture if texture is not None and str(texture) != "checker" else None
    named = (given, seams, *map(Path, keep or ()))
    inputs = [mesh, *(path for path in named if path is not None)]
    check_output(output, inputs, *_SUFFIXES)
    if charts is not None:
        check_output(charts, [*inputs, output], ".glb", name="charts")
    if outlines is not None:
        check_output(outlines, [*inputs, output], ".svg", ".dxf", name="outlines")
    from ..file_atlas import atlas_file

    options_of_file = chosen_options(context.params)
    shown = progress(levels) if options_of_file.by_tree else phases()
    with shown as report, workers() as executor:
        made = atlas_file(mesh, output, options_of_file, executor=executor, progress=report)
    for note in made.notes:
        say(f"note: {note}")
    if made.scene is not None and made.segmentation is not None and made.atlas is not None:
        if cut and made.before is not None:
            say_cut(made.before, made.scene)
        say_segmentation(made.segmentation)
        if density is not None or pages > 1 or stack:
            say_pages(made.atlas)
        say_metrics(made.atlas)
    say_written(*made.files)
    return made.record()


def chosen_options(given: dict[str, Any]) -> AtlasOptions:
    """Return the options of the library for those of a command, by their names."""
    from ..atlas_options import AtlasOptions

    changed = {
        "shares": options.parsed_shares(given["shares"]),
        "keep": tuple(given["keep"] or ()),
    }
    names = [field.name for field in fields(AtlasOptions)]
    return AtlasOptions(
        **{name: value for name, value in {**given, **changed}.items() if name in names}
    )
