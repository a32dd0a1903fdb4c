"""Calls that do not depend on each other, given to an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, TypeVar

__all__ = ["submitted"]

T = TypeVar("T")


@contextmanager
def submitted(
    executor: Executor, function: Callable[..., T], calls: Iterable[tuple[Any, ...]]
) -> Iterator[list[Future[T]]]:
    """Give the futures of calls in their order; an error in the block cancels what has not begun.

    Parameters
    ----------
    executor : Executor
    function : callable
        One that can be imported, so that other processes can call it.
    calls : iterable of tuple
        The arguments of each call.
    """
    futures: list[Future[T]] = []
    try:
        for call in calls:
            futures.append(executor.submit(function, *call))
        yield futures
    except BaseException:
        for future in futures:
            future.cancel()
        raise
