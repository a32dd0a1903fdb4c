"""Whole solves, each in a process of its own: `python benches/compare/solves.py`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track

import measure
import report
from surfaces import icosphere

# Options of phaseatlas.segment, and the seconds and MB of the authors' program.
_CASES: dict[str, tuple[dict[str, Any], float | None, float | None]] = {
    "perimeter + area": ({"connected": False}, 8.2, None),
    "perimeter + area + connectedness": ({"connected": True}, 66.0, 525.0),
    "perimeter + area + 10 x distortion": ({"connected": False, "distortion": 10.0}, 195.0, None),
    "perimeter + area + connectedness + 10 x distortion": (
        {"connected": True, "distortion": 10.0},
        None,
        None,
    ),
    "perimeter + area + 10 x distortion, one random start": (
        {"connected": False, "distortion": 10.0, "initial": "random"},
        195.0,
        None,
    ),
    "perimeter + area + 10 x distortion, 300 steps without continuation": (
        {
            "connected": False,
            "distortion": 10.0,
            "initial": "random",
            "plain": True,
            "max_iterations": 300,
        },
        None,
        None,
    ),
}
_PARTS = (
    "L-BFGS",
    "driver",
    "Perimeter",
    "Area",
    "Connectedness",
    "Distortion",
    "coarsening",
    "set-up",
    "rest",
)


def main(
    runs: Annotated[
        str,
        typer.Option(
            help="Subdivisions of the icosahedron, 8 has 655,362 vertices, with the numbers of the "
            "cases: " + "; ".join(_CASES)
        ),
    ] = "5:1,2,3,5,6 6:1,2,3,5,6 7:1,2,3 8:1,2",
) -> None:
    """Segment icospheres in two from random values, print where the time goes, write it."""
    about = measure.about()
    names = list(_CASES)
    chosen = [
        (int(size), names[int(number) - 1])
        for size, _, numbers in (run.partition(":") for run in runs.split())
        for number in numbers.split(",")
    ]
    rows = [_row(subdivisions, name) for subdivisions, name in track(chosen, "solves")]
    report.publish("solves", about, rows)


def _row(subdivisions: int, name: str) -> dict[str, Any]:
    options, seconds, memory = _CASES[name]
    child = Path(__file__).with_name("one_solve.py")
    surface = icosphere(subdivisions)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "surface.npz"
        np.savez(path, vertices=surface.vertices, faces=surface.faces)
        command = [sys.executable, str(child), str(path), json.dumps(options)]
        figures = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    parts = figures["parts"]
    authors = subdivisions == 6
    return {
        "table": f"icosphere, {10 * 4**subdivisions + 2:,} vertices, two segments from random u",
        "solve": name + (f": {figures['error']}" if figures["error"] else ""),
        "seconds": figures["seconds"],
        "CPU seconds": figures["CPU seconds"],
        "authors' seconds": seconds if authors else None,
        "iterations": figures.get("iterations"),
        "evaluations": figures.get("evaluations"),
        "energy": f"{figures['energy']:.6g}" if "energy" in figures else None,
        "violation": figures.get("violation"),
        "converged": figures.get("converged"),
        "peak MB": figures["peak memory"],
        "MB before": figures["memory before"],
        "authors' MB": memory if authors else None,
        **{part: parts.get(part) for part in _PARTS},
    }


if __name__ == "__main__":
    measure.with_default_blas()
    typer.run(main)
