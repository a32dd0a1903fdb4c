"""One segmentation in a process of its own, and where its time went, as JSON.

`python one_solve.py SURFACE OPTIONS` with the vertices and faces in an `.npz` file, so that making
them takes no memory here, and the options of `phaseatlas.segment` as JSON; the option "plain" turns
the continuation in epsilon off.
"""

from __future__ import annotations

import functools
import itertools
import json
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np

import phaseatlas as pa
from phaseatlas import _core, bisection, coarsen

_FUNCTIONALS = ("Perimeter", "Area", "Connectedness", "Distortion")


class _Clock:
    """Seconds by what they were spent on; a call within another counts for itself alone."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.evaluations: dict[tuple[str, int], list[float]] = defaultdict(list)
        self._inner = [0.0]

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            self._inner.append(0.0)
            start = time.perf_counter()
            try:
                return function(*args, **options)
            finally:
                taken = time.perf_counter() - start
                own = taken - self._inner.pop()
                self._inner[-1] += taken
                self.seconds[name] += own
                if name in _FUNCTIONALS:
                    self.evaluations[name, args[0].serial].append(own)

        return call

    def move_first_evaluations(self) -> None:
        """Count what the first evaluation of an object takes beyond the median as set-up.

        It is where matrices are analysed and buffers made.
        """
        for (name, _), taken in self.evaluations.items():
            extra = max(0.0, taken[0] - statistics.median(taken))
            self.seconds[name] -= extra
            self.seconds["set-up"] += extra


def main(path: str, options: dict[str, Any]) -> dict[str, Any]:
    """Segment the surface and return figures of the solve.

    Returns
    -------
    dict
        Seconds of the whole, of wall and of CPU, and of its parts, iterations, evaluations,
        energy, violation and peak memory in MB; "error" where there is no segmentation.
    """
    with np.load(path) as arrays:
        surface = pa.Surface(arrays["vertices"], arrays["faces"])
    if options.pop("plain", False):
        options["epsilon"] = options["epsilon_start"] = 2 * surface.mean_edge_length
    before = _peak_memory()
    clock = _Clock()
    numbers = itertools.count()
    for name in _FUNCTIONALS:
        functional = getattr(pa.functionals, name)
        functional.__init__ = clock.timed("set-up", _numbered(functional.__init__, numbers))
        functional.value_and_gradient = clock.timed(name, functional.value_and_gradient)
    pa.Surface.__init__ = clock.timed("set-up", pa.Surface.__init__)  # type: ignore[method-assign]

    bisection.coarsen = clock.timed("coarsening", coarsen.coarsen)  # type: ignore[attr-defined]
    bisection.SOLVERS["lbfgs"] = clock.timed("driver", bisection.SOLVERS["lbfgs"])
    memory = _core.LimitedMemory

    def timed_memory(n: int, capacity: int) -> Any:
        inner = memory(n, capacity)
        timed = MagicMock(wraps=inner)
        timed.__len__.side_effect = inner.__len__
        timed.update = clock.timed("L-BFGS", inner.update)
        timed.direction = clock.timed("L-BFGS", inner.direction)
        return timed

    _core.LimitedMemory = timed_memory  # type: ignore[misc, assignment]

    start, cpu_start = time.perf_counter(), time.process_time()
    figures: dict[str, Any] = {"error": None}
    try:
        (diagnostics,) = clock.timed("rest", pa.segment)(surface, 1, **options).diagnostics
    except (pa.CollapsedError, pa.DisconnectedError) as error:
        figures["error"] = str(error)
    else:
        figures |= {
            "iterations": diagnostics.iterations,
            "evaluations": diagnostics.evaluations,
            "energy": diagnostics.energy,
            "violation": abs(diagnostics.violation),
            "converged": diagnostics.converged,
        }
    figures["seconds"] = time.perf_counter() - start
    figures["CPU seconds"] = time.process_time() - cpu_start
    clock.move_first_evaluations()
    return figures | {
        "parts": dict(clock.seconds),
        "peak memory": _peak_memory(),
        "memory before": before,
    }


def _numbered(initialise: Callable[..., None], numbers: Iterator[int]) -> Callable[..., None]:
    """Constructor that also numbers the objects: their addresses are used again."""

    def numbered(self: Any, *args: Any, **options: Any) -> None:
        initialise(self, *args, **options)
        self.serial = next(numbers)

    return numbered


def _peak_memory() -> float:
    """MB. Not of getrusage, which begins with the peak of the process that started this one."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024
    raise RuntimeError("/proc/self/status: no VmHWM")


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], json.loads(sys.argv[2]))))
