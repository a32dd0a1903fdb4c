"""phaseatlas batch."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from . import options
from .process import FAILED, WARNED, UsageError, complain, say
from .report import meshes

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
    """Give each of many meshes an atlas, as atlas does; one that fails does not stop the others.

    The atlases lie in the subfolders of their meshes, and manifest.jsonl has a line of JSON for
    each mesh. Whatever ends the command, --resume goes on where it was.
    """
    if dask is not None:
        for name, value in (("jobs", jobs), ("timeout", timeout), ("memory", memory)):
            if value is not None:
                raise UsageError(f"--{name}: value must not be given with --dask")
    from ..batching import batch as run_batch
    from ..file_atlas import AtlasOptions

    chosen = AtlasOptions(
        **{field.name: context.params[field.name] for field in fields(AtlasOptions)}
    )
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
    failed = result.failed
    warned = sum(bool(record.get("warnings")) for record in result.records)
    counts = {
        "finished before": result.skipped,
        "made": len(result.records) - len(failed) - result.skipped,
        "failed": len(failed),
        "with warnings": warned,
    }
    say(f"meshes {len(result.records)}, " + ", ".join(f"{n} {word}" for word, n in counts.items()))
    for record in failed:
        complain(f"{_shown(record['input'])}: {record['error']}")
    if failed:
        raise typer.Exit(FAILED)
    if strict and warned:
        raise typer.Exit(WARNED)


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
        import distributed
    except ImportError:
        raise ImportError(
            "--dask needs the package distributed: pip install 'phaseatlas[dask]'"
        ) from None
    try:
        client: Any = distributed.Client(address)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise UsageError(f"--dask: no scheduler answers at {address}: {error}") from None
    with client:
        yield client
