"""Hashes of the fields and labels of small runs: what a change of form must leave alone.

Run it before and after. The hashes hold for one machine and one build; equal ones say that every
bit is the same. `python benches/field_hashes.py` prints a line a run, in about half a minute.
"""

from __future__ import annotations

import hashlib
import importlib.util
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import phaseatlas as pa
from phaseatlas import datasets


def _given_start() -> pa.SegmentTree:
    surface = datasets.icosphere(3)
    return pa.segment(surface, 2, initial=np.tile(np.sin(3 * surface.vertices[:, 0]), (3, 1)))


def _side_by_side() -> pa.SegmentTree:
    with ThreadPoolExecutor(2) as pool:
        return pa.segment(datasets.torus(1.0, 0.4, 40, 16), 2, executor=pool, seed=3)


RUNS: dict[str, Callable[[], pa.SegmentTree]] = {
    "sphere, three levels": lambda: pa.segment(datasets.icosphere(4), 3),
    "sheet": lambda: pa.segment(datasets.sheet(40, 30, amplitude=0.2, periods=2), 2),
    "torus, two threads": _side_by_side,
    "starfish, distortion": lambda: pa.segment(datasets.starfish(4), 2, distortion=3.0),
    "sphere, distortion as printed": lambda: pa.segment(
        datasets.icosphere(3), 1, distortion=1.0, law="paper", initial="random"
    ),
    "starfish, one random start": lambda: pa.segment(
        datasets.starfish(4), 2, initial="random", seed=5
    ),
    "cube, on the surface itself": lambda: pa.segment(
        datasets.rounded_cube(16), 2, coarse=False, kappa=0.5, eta=0.01, sigma=0.5, delta=0.05
    ),
    "cube, normals": lambda: pa.segment(
        datasets.rounded_cube(16), 2, initial="normals", epsilon=0.4, epsilon_start=1.0
    ),
    "starfish, free pieces": lambda: pa.segment(
        datasets.starfish(4), 2, connected=False, area="penalty", penalty=30.0
    ),
    "sphere, given start": _given_start,
}


def _digest(tree: pa.SegmentTree) -> str:
    sums = hashlib.sha256()
    for array in (tree.fields, tree.labels, np.array([d.energy for d in tree.diagnostics])):
        sums.update(np.ascontiguousarray(array).tobytes())
    return sums.hexdigest()[:16]


def main() -> None:
    warnings.simplefilter("ignore")
    runs = dict(RUNS)
    if importlib.util.find_spec("ipyopt") is not None:
        runs["sheet, Ipopt"] = lambda: pa.segment(
            datasets.sheet(24, 18, amplitude=0.2, periods=2), 1, solver="ipopt"
        )
    for name, run in runs.items():
        try:
            print(f"{_digest(run())}  {name}", flush=True)
        except (RuntimeError, ValueError) as error:
            print(f"{type(error).__name__:16s}  {name}: {error}", flush=True)


if __name__ == "__main__":
    main()
