"""How many threads there are to be, and a pool of them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from . import _core

__all__ = ["n_threads", "pool"]


def n_threads() -> int:
    """Number of usable cores, or what the variable ``RAYON_NUM_THREADS`` asks for if it is less.

    The core goes by the same.
    """
    return _core.n_threads()


@contextmanager
def pool() -> Iterator[ThreadPoolExecutor | None]:
    """Give a thread for each core, or None for one; what is left at the end is not waited for."""
    count = n_threads()
    if count == 1:
        yield None
        return
    threads = ThreadPoolExecutor(count)
    try:
        yield threads
    finally:
        # After Ctrl-C a solve would go on for minutes.
        threads.shutdown(wait=False, cancel_futures=True)
