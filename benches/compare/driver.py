"""What each number of the driver is worth: `python benches/compare/driver.py MESH ...`.

Each mesh is cut in two, from several seeds, first with the numbers as they are, then with one of
them changed at a time. A line gives the ratios to the present numbers: mean and largest of the
energies, steps evaluated and CPU seconds, these over all solves together. Above 1, the present
number is better. The lines "as it is" at the beginning and the end say how far the CPU seconds
drift; RAYON_NUM_THREADS=1 keeps them steadier. Solves that fail are counted.
"""

from __future__ import annotations

import importlib
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

import phaseatlas as pa
from phaseatlas import optimise

# Module, name, and the values to compare with the present one.
_NUMBERS: list[tuple[str, str, tuple[Any, ...]]] = [
    ("grids", "COARSEST", (0.1, 0.4)),
    ("grids", "RESOLVED", (0.4, 1.0)),
    ("grids", "_MAJORITY", (0.25, 0.75)),
    ("stages", "_COARSEST_DISTORTED", (0.05, 0.2)),
    ("stages", "_RESOLVED_DISTORTED", (0.25, 0.65)),
    ("stages", "_COARSE_TOLERANCE", (1e-6, 1e-4)),
    ("stages", "_ROUGH_TOLERANCE", (1e-5, 1e-3)),
    ("stages", "_DISTORTED_TOLERANCE", (1e-6, 1e-5)),
    ("stages", "_PLATEAU", (0.4, 1.0)),
    ("stages", "REPAIR_ROUNDS", (1, 8)),
    ("stages", "_REPAIR_GROWTH", (3.0, 30.0)),
    ("stages", "_REPAIR_STEPS", (300, 3000)),
    ("stages", "_COARSE_REPAIR_STEPS", (50, 1000)),
    ("starts", "_SAME_ENERGY", (0.0, 1e-2)),
    ("starts", "_RANDOM_STARTS", (2, 4, 16)),
    ("starts", "_CHEAP", (1000, 16000)),
    ("starts", "_START_STEPS", (10, 40)),
    ("starts", "_NOISE_STEPS", (5, 45)),
    ("starts", "_SPLIT_SLOPE", (3.0, 12.0)),
    ("sharp", "THRESHOLD", (0.15, 0.45)),
    ("sharp", "_NEGLIGIBLE_SHARE", (1e-4, 1e-2)),
    ("sharp", "_NEGLIGIBLE_FACES", (1, 16)),
    ("lbfgs", "tolerance", (1e-6, 1e-8)),
    ("lbfgs", "feasibility", (1e-4, 1e-6)),
    ("lbfgs", "_PENALTY_GROWTH", (2.0, 10.0)),
    ("lbfgs", "_SHRINK", (0.1, 0.5)),
    ("lbfgs", "_MEMORY", (3, 12)),
    ("lbfgs", "_DECREASE", (1e-3, 1e-2)),
    ("lbfgs", "_CURVATURE", (0.5, 0.99)),
    ("lbfgs", "_MAX_TRIALS", (10, 50)),
    ("lbfgs", "_WINDOW", (1, 20)),
]
# Numbers that only solves with distortion feel, and only those without.
_DISTORTED = {
    "_COARSEST_DISTORTED",
    "_RESOLVED_DISTORTED",
    "_DISTORTED_TOLERANCE",
    "_START_STEPS",
    "_NOISE_STEPS",
    "_SPLIT_SLOPE",
}
_PLAIN = {"_RANDOM_STARTS", "tolerance"}
_MODULES = {
    "lbfgs": ["optimise.lbfgs"],
    **{
        name: [f"segmentation.{m}" for m in ("grids", "stages", "starts", "sharp", "bisect")]
        for name in ("grids", "stages", "starts", "sharp")
    },
}


@contextmanager
def _changed(module: str, name: str, value: Any) -> Iterator[None]:
    """Run a block with another value of a number, wherever a module holds it."""
    if name in ("tolerance", "feasibility"):
        before = optimise.LIMITS["lbfgs"]
        optimise.LIMITS["lbfgs"] = replace(before, **{name: value})
        try:
            yield
        finally:
            optimise.LIMITS["lbfgs"] = before
        return
    found = [importlib.import_module(f"phaseatlas.{path}") for path in _MODULES[module]]
    holders = [m for m in found if hasattr(m, name)]
    old = getattr(holders[0], name)
    try:
        for holder in holders:
            setattr(holder, name, value)
        yield
    finally:
        for holder in holders:
            setattr(holder, name, old)


def main(
    meshes: Annotated[list[Path], typer.Argument(help="Files of meshes, a few thousand vertices.")],
    distortion: Annotated[float, typer.Option(help="Factor omega.")] = 0.0,
    seeds: Annotated[int, typer.Option(help="Seeds of each mesh.")] = 3,
    only: Annotated[str, typer.Option(help="Names of numbers, with commas; all by default.")] = "",
) -> None:
    """Print a line for each other value of each number."""
    warnings.simplefilter("ignore")
    surfaces = [pa.load(mesh) for mesh in meshes]
    felt = {name for _, name, _ in _NUMBERS} - (_PLAIN if distortion else _DISTORTED)
    wanted = set(only.split(",")) if only else felt
    base = _solves(surfaces, seeds, distortion)
    heads = ("energy", "largest", "steps", "CPU", "failed")
    print(f"{'number':28s}" + "".join(f"{head:>9s}" for head in heads))
    _line("as it is", base, _solves(surfaces, seeds, distortion))
    for module, name, values in _NUMBERS:
        if name not in wanted:
            continue
        for value in values:
            with _changed(module, name, value):
                _line(f"{name.strip('_')} {value:g}", base, _solves(surfaces, seeds, distortion))
    _line("as it is", base, _solves(surfaces, seeds, distortion))


def _solves(surfaces: list[pa.Surface], seeds: int, distortion: float) -> NDArray[np.float64]:
    """Energy, evaluations and CPU seconds, (solves, 3); nan for what failed solves do not tell."""
    rows = []
    for surface in surfaces:
        for seed in range(seeds):
            start = time.process_time()
            energy = evaluations = np.nan
            try:
                (d,) = pa.segment(surface, 1, distortion=distortion, seed=seed).diagnostics
                energy, evaluations = d.energy, d.evaluations
            except (pa.DisconnectedError, pa.CollapsedError):
                pass
            rows.append((energy, evaluations, time.process_time() - start))
    return np.array(rows)


def _line(name: str, base: NDArray[np.float64], found: NDArray[np.float64]) -> None:
    """Print ratios to the base."""
    good = np.isfinite(found[:, 0] + base[:, 0])
    ratio = found[good, 0] / base[good, 0]
    steps, cpu = (found[good, k].sum() / base[good, k].sum() for k in (1, 2))
    cells = (f"{ratio.mean():.4f}", f"{ratio.max():.3f}", f"{steps:.2f}", f"{cpu:.2f}")
    print(
        f"{name:28s}" + "".join(f"{cell:>9s}" for cell in cells) + f"{(~good).sum():9d}", flush=True
    )


if __name__ == "__main__":
    typer.run(main)
