"""phaseatlas beside SciPy, CHOLMOD, MKL Pardiso and libigl: `python benches/compare/run.py`."""

from __future__ import annotations

import gc
from typing import Annotated, Any

import typer
from rich.progress import track

import measure
import report
import surfaces
from work import OURS, Work, check, works


def main(
    sizes: Annotated[
        str, typer.Option(help="Subdivisions of the icosahedron; 6 has 40,962 vertices.")
    ] = "5,6,7",
    rounds: Annotated[int, typer.Option(help="Least number of calls of each contender.")] = 5,
    seconds: Annotated[
        float, typer.Option(help="Quick contenders are called up to 50 times within this.")
    ] = 2.0,
) -> None:
    """Time every piece of work, print the ratios and write them to benches/."""
    # The load before this run adds its own.
    about = measure.about()
    rows: list[dict[str, Any]] = []
    for subdivisions in track([int(size) for size in sizes.split(",")], "sizes"):
        for make in (surfaces.icosphere, surfaces.irregular):
            is_sphere = make is surfaces.icosphere
            surface = make(subdivisions)
            table = f"{make.__name__}, {surface.n_vertices:,} vertices"
            for work in works(surface, subdivisions, is_sphere=is_sphere):
                authors = work.authors if is_sphere and subdivisions == 6 else None
                rows += _rows(table, work, authors, rounds, seconds)
                # Factors of a piece of work that is done would stay with its closures.
                del work
                gc.collect()
    # Every peer's BLAS is loaded only now.
    about["blas"] = measure.about()["blas"]
    report.publish("work", about, rows)


def _rows(
    table: str, work: Work, authors: float | None, rounds: int, seconds: float
) -> list[dict[str, Any]]:
    check(work)
    calls = {name: call for name, call in work.contenders.items() if not isinstance(call, str)}
    timings = measure.interleave(calls, rounds, seconds, work.pause)
    ours = timings[OURS].minimum
    rows = []
    for name, call in work.contenders.items():
        timing = timings.get(name)
        rows.append(
            {
                "table": table,
                "work": work.name,
                "contender": name if timing else f"{name}: {call}",
                "minimum": 1e3 * timing.minimum if timing else None,
                "median": 1e3 * timing.median if timing else None,
                "ratio": timing.minimum / ours if timing else None,
                "rounds": timing.rounds if timing else None,
                "the authors' C++": 1e3 * authors if authors and name == OURS else None,
            }
        )
    return rows


if __name__ == "__main__":
    measure.with_default_blas()
    typer.run(main)
