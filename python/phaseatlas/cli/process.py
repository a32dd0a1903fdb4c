"""How a command runs: what it says, its record as JSON, its warnings and errors, its exit codes."""

from __future__ import annotations

import functools
import inspect
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from ..plain import plain
from ..quality import QualityWarning
from . import options

__all__ = [
    "FAILED",
    "USAGE",
    "WARNED",
    "Record",
    "UsageError",
    "checked",
    "complain",
    "on_terminal",
    "say",
    "verbose",
    "workers",
]

FAILED, USAGE, WARNED = 1, 2, 3

# What a command returns: what JSON can hold of its result.
Record: TypeAlias = dict[str, Any]


class UsageError(ValueError):
    """An option whose value cannot be used."""


@dataclass(frozen=True)
class _Voice:
    """How much a command says: on standard output, and of its progress."""

    silent: bool = False
    verbose: bool = False
    quiet: bool = False


_USUAL = _Voice()
_voice: ContextVar[_Voice] = ContextVar("voice", default=_USUAL)


# Options of every command, in the order of its help.
_COMMON = {
    "json": (options.Json, None),
    "quiet": (options.Quiet, False),
    "verbose": (options.Verbose, False),
    "threads": (options.Threads, None),
}


def checked(command: Callable[..., Record | None]) -> Callable[..., int]:
    """Make a command return its exit code, tell bad options from other failures, and add options.

    The library's errors start with the name of the argument at fault, and the options have the
    names of the library's arguments.

    Parameters
    ----------
    command : callable
        The command, which returns its record; one with an option ``strict`` fails on warnings.

    Returns
    -------
    callable
        Of the same signature with the options that all commands have: ``json``, ``quiet``,
        ``verbose`` and ``threads``.
    """
    signature = inspect.signature(command, eval_str=True)
    # A message about a file starts with its name, which may be that of the argument.
    names = {*signature.parameters, *_COMMON} - {"mesh", "file", "texture"}

    @functools.wraps(command)
    def run_checked(
        *args: Any,
        json: Path | None = None,
        quiet: bool = False,
        verbose: bool = False,
        threads: int | None = None,
        **kwargs: Any,
    ) -> int:
        if json is not None and str(json) != "-":
            _check_record(json, [value for value in kwargs.values() if isinstance(value, Path)])
        if threads is not None:
            _limit(threads)
        voice = _Voice(silent=quiet or str(json) == "-", verbose=verbose, quiet=quiet)
        token = _voice.set(voice)
        start = time.perf_counter()
        record: Record = {"command": command.__name__}
        shown: list[str] = []
        try:
            with _warnings_shown(shown):
                record |= command(*args, **kwargs) or {}
        except BaseException as error:
            record["error"] = " ".join(str(error).split()) or type(error).__name__
            if isinstance(error, ValueError) and str(error).partition(":")[0] in names:
                raise UsageError(str(error)) from error
            raise
        finally:
            _voice.set(replace(voice, silent=False))
            record["warnings"] = shown
            record["seconds"] = time.perf_counter() - start
            try:
                if json is not None:
                    _write_record(json, record)
            finally:
                _voice.reset(token)
        return WARNED if shown and kwargs.get("strict") else 0

    parameters = list(signature.parameters.values())
    for name, (kind, default) in _COMMON.items():
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters.append(inspect.Parameter(name, keyword, default=default, annotation=kind))
    run_checked.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run_checked.__annotations__ = {each.name: each.annotation for each in parameters}
    return run_checked


def _limit(threads: int) -> None:
    """Bound the threads of the core and of the libraries, which look when they are first used."""
    for name in ("RAYON", "OMP", "OPENBLAS", "MKL"):
        os.environ[f"{name}_NUM_THREADS"] = str(threads)


def _check_record(path: Path, taken: list[Path]) -> None:
    """Refuse before the work what could not be written after it."""
    if path.is_dir():
        raise UsageError(f"json: {path} is a folder")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"json: the folder of {path} does not exist")
    if any(path.resolve() == other.resolve() for other in taken):
        raise UsageError(f"json: {path} would overwrite another file of the command")


def _write_record(path: Path, record: Record) -> None:
    from json import dumps

    from .._core import __version__

    text = dumps({"version": __version__, **plain(record)}, allow_nan=False)
    if str(path) == "-":
        say(text)
    else:
        from ..files import write_bytes

        write_bytes(path, f"{text}\n".encode())


@contextmanager
def _warnings_shown(shown: list[str]) -> Iterator[None]:
    """Print the package's warnings as lines, and no others, and put them into a list."""

    def show(message: Warning | str, *_: object, **__: object) -> None:
        shown.append(str(message))
        complain(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", QualityWarning)
        warnings.showwarning = show
        yield


def complain(message: str) -> None:
    """Print one line on the error stream."""
    line = " ".join(message.split())
    try:
        print(f"phaseatlas: {line}", file=sys.stderr, flush=True)
    except BrokenPipeError:
        _let_go(sys.stderr)


def say(*lines: str) -> None:
    """Print lines for as long as anyone reads them, unless the command is to be quiet.

    Parameters
    ----------
    *lines : str
        What to print.
    """
    if _voice.get().silent:
        return
    try:
        print(*lines, sep="\n", flush=True)
    except BrokenPipeError:
        # Whoever reads has seen enough, as `head` does: that is no failure of the command.
        _let_go(sys.stdout)


def on_terminal() -> bool:
    """Whether a progress bar may be drawn: on a terminal, unless the command is to be quiet."""
    return sys.stderr.isatty() and not _voice.get().quiet


def verbose() -> bool:
    """Whether each step is to be told, in lines."""
    return _voice.get().verbose


@contextmanager
def workers() -> Iterator[Executor | None]:
    """Give threads for what can be done side by side; none where each step is to be told."""
    if verbose():
        yield None
        return
    from ..threads import pool

    with pool() as threads:
        yield threads


def _let_go(stream: object) -> None:
    # What is left in the buffer would fail once more at exit.
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, stream.fileno())  # type: ignore[attr-defined]
