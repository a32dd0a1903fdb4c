"""Timing of contenders side by side, and what there is to say about the machine."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import shlex
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import threadpoolctl

__all__ = ["PACKAGES", "Timing", "about", "interleave", "with_default_blas"]

PACKAGES = ("phaseatlas", "numpy", "scipy", "scikit-sparse", "pypardiso", "mkl", "libigl")
_MOST_ROUNDS = 50


@dataclass(frozen=True)
class Timing:
    """Seconds of one contender over `rounds` calls."""

    minimum: float
    median: float
    rounds: int


def with_default_blas() -> None:
    """Start this process again without the variables that choose OpenBLAS' kernels."""
    chosen = [name for name in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE") if name in os.environ]
    if chosen:
        for name in chosen:
            del os.environ[name]
        os.execv(sys.executable, [sys.executable, *sys.argv])


def interleave(
    contenders: Mapping[str, Callable[[], object]], rounds: int, seconds: float, pause: float
) -> dict[str, Timing]:
    """Call all contenders one after the other, again and again, so that drift cancels.

    Parameters
    ----------
    contenders : mapping of str to callable
        Warmed up: the first call counts.
    rounds : int
        Least number of calls of each.
    seconds : float
        More rounds are added while they fit into this time, up to 50.
    pause : float
        Seconds to wait before each call.
    """
    samples: dict[str, list[float]] = {name: [] for name in contenders}
    begin = time.perf_counter()
    done = 0
    while done < rounds or (done < _MOST_ROUNDS and time.perf_counter() - begin < seconds):
        for name, call in contenders.items():
            time.sleep(pause)
            start = time.perf_counter()
            call()
            samples[name].append(time.perf_counter() - start)
        done += 1
    return {
        name: Timing(min(taken), statistics.median(taken), done) for name, taken in samples.items()
    }


def about() -> dict[str, Any]:
    """Machine, versions, date and command line of this run."""
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="minutes"),
        "command": shlex.join(["python", *sys.argv]),
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)),
        "load average": [round(load, 1) for load in os.getloadavg()],
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "blas": _blas(),
    }


def _cpu_model() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _blas() -> list[str]:
    """Library, version, kernel and threads of every BLAS that is loaded."""
    pools = (pool for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas")
    return [
        f"{Path(pool['filepath']).name}: {pool['internal_api']} {pool['version']}, "
        f"kernel {pool.get('architecture', 'unknown')}, {pool['num_threads']} threads"
        for pool in pools
    ]
