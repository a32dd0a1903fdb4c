"""How many threads there are to be."""

from __future__ import annotations

import os

__all__ = ["n_threads"]


def n_threads() -> int:
    """Number of the cores, or what the variable ``RAYON_NUM_THREADS`` asks for if it is less.

    The core goes by the same.
    """
    cores = os.cpu_count() or 1
    asked = os.environ.get("RAYON_NUM_THREADS", "")
    return min(cores, int(asked)) if asked.isdecimal() and int(asked) > 0 else cores
