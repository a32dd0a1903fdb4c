"""What a command says: lines, warnings, errors; and its exit codes."""

from __future__ import annotations

import functools
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec

from ..quality import QualityWarning

__all__ = ["FAILED", "USAGE", "WARNED", "UsageError", "checked", "complain", "say"]

FAILED, USAGE, WARNED = 1, 2, 3

P = ParamSpec("P")


class UsageError(ValueError):
    """An option whose value cannot be used."""


def checked(command: Callable[P, None]) -> Callable[P, int]:
    """Make a command return its exit code and tell bad options from other failures.

    The library's errors start with the name of the argument at fault, and the options have the
    names of the library's arguments.

    Parameters
    ----------
    command : callable
        The command; one with an option ``strict`` fails on warnings.

    Returns
    -------
    callable
        Of the same signature.
    """
    # A message about a file starts with its name, which may be that of the argument.
    options = set(inspect.signature(command).parameters) - {"mesh", "texture"}

    @functools.wraps(command)
    def run_checked(*args: P.args, **kwargs: P.kwargs) -> int:
        try:
            with _warnings_shown() as shown:
                command(*args, **kwargs)
        except ValueError as error:
            if str(error).partition(":")[0] in options:
                raise UsageError(str(error)) from error
            raise
        return WARNED if shown and kwargs.get("strict") else 0

    return run_checked


@contextmanager
def _warnings_shown() -> Iterator[list[str]]:
    """Print the package's warnings as lines, and no others; gives the list of them."""
    shown: list[str] = []

    def show(message: Warning | str, *_: object, **__: object) -> None:
        shown.append(str(message))
        complain(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", QualityWarning)
        warnings.showwarning = show
        yield shown


def complain(message: str) -> None:
    """Print one line on the error stream."""
    line = " ".join(message.split())
    try:
        print(f"phaseatlas: {line}", file=sys.stderr, flush=True)
    except BrokenPipeError:
        _let_go(sys.stderr)


def say(*lines: str) -> None:
    """Print lines for as long as anyone reads them.

    Parameters
    ----------
    *lines : str
        What to print.
    """
    try:
        print(*lines, sep="\n", flush=True)
    except BrokenPipeError:
        # Whoever reads has seen enough, as `head` does: that is no failure of the command.
        _let_go(sys.stdout)


def _let_go(stream: object) -> None:
    # What is left in the buffer would fail once more at exit.
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, stream.fileno())  # type: ignore[attr-defined]
