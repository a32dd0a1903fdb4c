"""One segmentation in a process of its own, and where its time went, as JSON.

`python one_solve.py SURFACE OPTIONS` with the vertices and faces in an `.npz` file, so that making
them takes no memory here, and the options of `phaseatlas.segment` as JSON; the option "plain" turns
the continuation in epsilon off. The times by part are those that the solve keeps of itself; what a
functional builds at its first evaluation counts for the functional.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import phaseatlas as pa


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
    start, cpu_start = time.perf_counter(), time.process_time()
    figures: dict[str, Any] = {"error": None}
    parts: dict[str, float] = {}
    try:
        (diagnostics,) = pa.segment(surface, 1, **options).diagnostics
    except (pa.CollapsedError, pa.DisconnectedError) as error:
        figures["error"] = str(error)
    else:
        parts = diagnostics.seconds
        figures |= {
            "iterations": diagnostics.iterations,
            "evaluations": diagnostics.evaluations,
            "energy": diagnostics.energy,
            "violation": abs(diagnostics.violation),
            "converged": diagnostics.converged,
        }
    figures["seconds"] = time.perf_counter() - start
    figures["CPU seconds"] = time.process_time() - cpu_start
    return figures | {
        "parts": parts | {"rest": figures["seconds"] - sum(parts.values())},
        "peak memory": _peak_memory(),
        "memory before": before,
    }


def _peak_memory() -> float:
    """MB. Not of getrusage, which begins with the peak of the process that started this one."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024
    raise RuntimeError("/proc/self/status: no VmHWM")


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], json.loads(sys.argv[2]))))
