"""The command line: segment, atlas, remesh, info, demo."""

from __future__ import annotations

import enum
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import rich.progress
import rich.table
import typer
from rich.console import Console

from . import datasets, plot
from .atlas import Atlas, build_atlas
from .io import MESH_SUFFIXES, load, save_mesh, save_ply
from .remesh import remesh
from .segmentation import Progress, SegmentTree, segment
from .surface import Surface
from .texture import load_image

__all__ = ["app", "main"]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Cut surfaces into connected segments of equal area and turn them into texture atlases.",
)


class Solver(enum.StrEnum):
    lbfgs = "lbfgs"
    ipopt = "ipopt"


class Flatten(enum.StrEnum):
    bff = "bff"
    lscm = "lscm"


class Law(enum.StrEnum):
    sharp = "sharp"
    paper = "paper"


class Area(enum.StrEnum):
    lagrangian = "lagrangian"
    penalty = "penalty"
    none = "none"


class Initial(enum.StrEnum):
    auto = "auto"
    random = "random"
    normals = "normals"


Mesh = Annotated[
    Path, typer.Argument(metavar="MESH", help="Triangle mesh: OBJ, PLY, STL, OFF, GLB, ...")
]
Levels = Annotated[int, typer.Option(help="Depth of the binary tree: 2^levels segments.")]
Connected = Annotated[
    bool, typer.Option("--connected/--no-connected", help="Keep every segment in one piece.")
]
Epsilon = Annotated[
    float | None,
    typer.Option(
        help="Interface width in the units of the mesh.", show_default="2 mean edge lengths"
    ),
]
DistortionOption = Annotated[
    float,
    typer.Option(
        min=0,
        help="Weight of the conformal distortion against the interface length, for unit area.",
    ),
]
SolverOption = Annotated[Solver, typer.Option(help="Optimiser.")]
LawOption = Annotated[Law, typer.Option(help="Of the distortion: how a phase confines its map.")]
AreaOption = Annotated[
    Area, typer.Option(help="Meet equal areas, only penalise their deviation, or leave them free.")
]
Start = Annotated[
    Initial,
    typer.Option(
        help="Start: random values, two clusters of normals, or, with distortion, the best of some."
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the random start.", min=0)]
FlattenOption = Annotated[
    Flatten, typer.Option(help="Chart map: least-squares conformal, or boundary-first.")
]


@app.command("segment")
def segment_command(
    mesh: Mesh,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="OUT.npz: everything; OUT.ply: weights and labels."),
    ],
    levels: Levels = 3,
    connected: Connected = True,
    distortion: DistortionOption = 0.0,
    law: LawOption = Law.sharp,
    area: AreaOption = Area.lagrangian,
    epsilon: Epsilon = None,
    solver: SolverOption = Solver.lbfgs,
    initial: Start = Initial.auto,
    seed: Seed = 0,
) -> None:
    """Segment a mesh into 2^levels connected segments of equal area."""
    _check_output(output, [mesh], ".npz", ".ply")
    tree = _segment(
        load(mesh),
        levels,
        connected=connected,
        distortion=distortion,
        law=law.value,
        area=area.value,
        epsilon=epsilon,
        solver=solver.value,
        initial=initial.value,
        seed=seed,
    )
    if output.suffix.lower() == ".npz":
        tree.save(output)
    else:
        save_ply(tree, output)
    _print_tree(tree)


@app.command("atlas")
def atlas_command(
    mesh: Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.glb, or OUT.obj with its .mtl and .png.")
    ],
    levels: Levels = 3,
    connected: Connected = True,
    distortion: DistortionOption = 0.0,
    law: LawOption = Law.sharp,
    area: AreaOption = Area.lagrangian,
    epsilon: Epsilon = None,
    solver: SolverOption = Solver.lbfgs,
    initial: Start = Initial.auto,
    seed: Seed = 0,
    flatten: FlattenOption = Flatten.bff,
    texture: Annotated[
        Path | None,
        typer.Option(help="Image repeated over the charts and blended.", show_default="a checker"),
    ] = None,
    resolution: Annotated[
        int, typer.Option(help="Side of the baked texture in texels.", min=32, max=16384)
    ] = 1024,
) -> None:
    """Segment a mesh, flatten the segments and write it with a blended texture."""
    _check_output(output, [mesh] if texture is None else [mesh, texture], ".glb", ".obj")
    image = None if texture is None else load_image(texture)
    tree = _segment(
        load(mesh),
        levels,
        connected=connected,
        distortion=distortion,
        law=law.value,
        area=area.value,
        epsilon=epsilon,
        solver=solver.value,
        initial=initial.value,
        seed=seed,
    )
    atlas = build_atlas(tree, flatten=flatten.value, resolution=resolution)
    atlas.save(output, texture=image, resolution=resolution)
    _print_tree(tree)
    _print_metrics(atlas)


@app.command("remesh")
def remesh_command(
    mesh: Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.obj, .ply, .glb, .off or .stl.")
    ],
    edge_length: Annotated[
        float | None,
        typer.Option(
            help="Target edge length in the units of the mesh.",
            show_default="the mean, or less for 10,000 vertices",
        ),
    ] = None,
    feature_angle: Annotated[
        float,
        typer.Option(help="Keep creases sharper than this, in degrees; 180 keeps none."),
    ] = 45.0,
) -> None:
    """Remesh a mesh with even triangles; coarse or uneven ones segment better for it."""
    _check_output(output, [mesh], *MESH_SUFFIXES)
    surface = remesh(load(mesh), edge_length, feature_angle)
    save_mesh(surface, output)
    _print_surface(surface)


@app.command()
def info(mesh: Mesh) -> None:
    """Print what a mesh is: size, topology, area, edge lengths, quality."""
    _print_surface(load(mesh))


@app.command()
def demo(
    folder: Annotated[
        Path, typer.Argument(metavar="[FOLDER]", help="Where to write; made where missing.")
    ] = Path("phaseatlas-demo"),
    levels: Levels = 3,
) -> None:
    """Run the whole pipeline on a surface made here, with pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    surface = datasets.starfish()
    start = time.perf_counter()
    tree = _segment(surface, levels)
    segmented = time.perf_counter()
    atlas = build_atlas(tree, resolution=2048)
    flattened = time.perf_counter()
    image = atlas.bake(resolution=2048)
    atlas.save(folder / "starfish.glb", image=image)
    plot.segments(surface, tree.weights, folder / "segments.png")
    plot.uv_layout(atlas, image, folder / "uv.png")
    drawn = time.perf_counter()
    _print_tree(tree)
    _print_metrics(atlas)
    console = Console()
    console.print(
        f"seconds: segmentation {segmented - start:.2f}, charts {flattened - segmented:.2f}, "
        f"texture and pictures {drawn - flattened:.2f}"
    )
    for name in ("starfish.glb", "segments.png", "uv.png"):
        console.print(f"wrote {folder / name}", soft_wrap=True)


def main() -> None:
    """Run the command line; errors are one line and a non-zero exit code."""
    # What did not converge is printed with the result.
    warnings.simplefilter("ignore", RuntimeWarning)
    try:
        app()
    except (ValueError, OSError, RuntimeError, ImportError, MemoryError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        print(f"phaseatlas: {message}", file=sys.stderr)
        sys.exit(1)


def _check_output(output: Path, inputs: list[Path], *suffixes: str) -> None:
    """Refuse before the work what could not be written after it."""
    if output.suffix.lower() not in suffixes:
        raise ValueError(f"output: {output} must end in {' or '.join(suffixes)}")
    if not output.absolute().parent.is_dir():
        raise ValueError(f"output: the folder of {output} does not exist")
    written = [output]
    if output.suffix.lower() == ".obj":
        written += [output.with_suffix(".mtl"), output.with_suffix(".png")]
    for path in written:
        if path.is_dir():
            raise ValueError(f"output: {path} is a folder")
        if any(path.resolve() == source.resolve() for source in inputs):
            raise ValueError(f"output: {path} would overwrite an input")


def _segment(surface: Surface, levels: int, **options: Any) -> SegmentTree:
    with _progress(levels) as report:
        return segment(surface, levels, progress=report, **options)


@contextmanager
def _progress(levels: int) -> Iterator[Callable[[Progress], None]]:
    console = Console(stderr=True)
    bar = rich.progress.Progress(
        rich.progress.BarColumn(),
        rich.progress.TextColumn("{task.description}"),
        rich.progress.TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )
    with bar:
        task = bar.add_task("", total=2**levels - 1 if levels > 0 else None)

        def report(state: Progress) -> None:
            bar.update(
                task,
                completed=2 ** (state.level - 1) - 1 + state.node,
                description=(
                    f"level {state.level} of {levels}, node {state.node + 1} of "
                    f"{2 ** (state.level - 1)}, iteration {state.iteration}, "
                    f"energy {state.energy:.6f}"
                ),
            )

        yield report


def _print_surface(surface: Surface) -> None:
    table = rich.table.Table(show_header=False, box=None)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    for name, value in {
        "vertices": f"{surface.n_vertices}",
        "faces": f"{surface.n_faces}",
        "genus": f"{surface.genus}",
        "boundary loops": f"{surface.n_boundary_loops}",
        "area": f"{surface.area:.6g}",
        "extent": " x ".join(f"{side:.6g}" for side in high - low),
        "mean edge length": f"{surface.mean_edge_length:.6g}",
        "worst face quality": f"{surface.face_quality.min():.3g} (1 = equilateral)",
        "default epsilon": f"{2 * surface.mean_edge_length:.6g}",
    }.items():
        table.add_row(name, value)
    Console().print(table)


def _print_tree(tree: SegmentTree) -> None:
    table = rich.table.Table(box=None)
    for heading in ("segment", "area", "share %", "components"):
        table.add_column(heading, justify="right")
    shares = 100 * tree.areas / tree.surface.area
    for leaf, (area, share, parts) in enumerate(
        zip(tree.areas, shares, tree.components, strict=True)
    ):
        table.add_row(f"{leaf}", f"{area:.6g}", f"{share:.3f}", f"{parts}")
    console = Console()
    console.print(table)
    length = sum(d.length for d in tree.diagnostics)
    steps = sum(d.iterations for d in tree.diagnostics)
    violation = max(abs(d.violation) for d in tree.diagnostics)
    relative = length / np.sqrt(tree.surface.area)
    console.print(
        f"interface length (diffuse) {length:.6g} ({relative:.3f} sqrt(area)), "
        f"{steps} iterations, area constraint met to {violation:.1e}"
    )
    for d in tree.diagnostics:
        if not d.converged:
            console.print(f"level {d.level + 1}, node {d.node}: not converged")
    repaired = [d for d in tree.diagnostics if d.repairs or d.relabelled_faces]
    for d in repaired:
        console.print(
            f"level {d.level + 1}, node {d.node}: {d.components[0]} + {d.components[1]} "
            f"components, {d.repairs} rounds of repair, {d.relabelled_faces} faces relabelled "
            f"({100 * d.relabelled_area:.2g} % of the area)"
        )


def _print_metrics(atlas: Atlas) -> None:
    values = (f"{name} {value:.4g}" for name, value in atlas.metrics().items())
    Console().print(", ".join(values))
