"""phaseatlas batch."""

from __future__ import annotations

import importlib
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..quality import QualityWarning
from . import options
from .atlas import chosen_options
from .process import Record, UsageError, complain
from .report import meshes, say_batch, say_written

__all__ = ["batch"]


def batch(
    context: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(metavar="INPUT", help="Meshes, folders of meshes, patterns in quotes."),
    ],
    folder: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the atlases; made where missing.")
    ],
    jobs: Annotated[
        int | None,
        typer.Option(help="Meshes at once.", show_default="one for each core", min=1),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster that does the work, which sees the same paths.",
            show_default="processes of this machine",
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on: do what is missing, has failed or has changed."),
    ] = False,
    timeout: Annotated[
        float | None,
        typer.Option(help="Seconds that a mesh may take.", show_default="no end", min=0),
    ] = None,
    memory: Annotated[
        float | None,
        typer.Option(
            help="GiB that the meshes in work may take together.",
            show_default="80 % of what is free",
            min=0,
        ),
    ] = None,
    format: Annotated[  # noqa: A002
        Literal["glb", "gltf", "obj", "ply", "same"],
        typer.Option(help="Of the atlases; same keeps that of each mesh."),
    ] = "glb",
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
    keep: options.Keep = None,
    creases: options.Creases = None,
    texture: options.Texture = None,
    rebake: options.Rebake = False,
    resolution: options.Resolution = None,
    density: options.Density = None,
    padding: options.Padding = 4,
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
    """Give each of many meshes an atlas, as atlas does; one that fails does not stop the others.

    The atlases lie in the subfolders of their meshes; a.obj and a.stl of one folder become
    a.obj.glb and a.stl.glb. manifest.jsonl has a line of JSON for each mesh. Whatever ends the
    command, --resume goes on where it was.
    """
    if dask is not None:
        for name, value in (("jobs", jobs), ("timeout", timeout), ("memory", memory)):
            if value is not None:
                raise UsageError(f"--{name}: value must not be given with --dask")
    from ..batching import batch as run_batch
    from ..batching.manifest import NAME

    chosen = chosen_options(context.params)
    with _cluster(dask) as client, meshes() as report:
        result = run_batch(
            inputs,
            folder,
            options=chosen,
            format=format,
            jobs=jobs,
            executor=client,
            resume=resume,
            timeout=timeout,
            memory=None if memory is None else memory * 2**30,
            progress=report,
        )
    say_batch(result)
    say_written(folder / NAME)
    for record in result.records:
        name = _shown(record["input"])
        for message in record.get("warnings", ()):
            warnings.warn(f"{name}: {message}", QualityWarning, stacklevel=1)
        if "error" in record:
            complain(f"{name}: {record['error']}")
    if result.failed:
        failures = f"{len(result.failed)} of {len(result.records)} meshes failed"
        raise RuntimeError(f"{failures}; --resume tries them again")
    return {
        "output": str(folder),
        "files": [str(folder / NAME)],
        "meshes": len(result.records),
        "skipped": result.skipped,
    }


def _shown(path: str) -> str:
    """A path from here, where the file is below."""
    here = os.path.join(os.getcwd(), "")
    return path.removeprefix(here)


@contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    """Give a client of a Dask cluster, or none."""
    if address is None:
        yield None
        return
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise ImportError(
            "--dask needs the package distributed: pip install 'phaseatlas[dask]'"
        ) from None
    try:
        client = distributed.Client(address)
    except (OSError, ValueError) as error:
        raise UsageError(f"--dask: no scheduler answers at {address}: {error}") from None
    with client:
        yield client
