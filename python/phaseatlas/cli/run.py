"""One run of the command line: what is said of a failure, and the exit code."""

from __future__ import annotations

import logging
import os
import sys

import typer

from ..reasons import reason
from .app import app
from .process import FAILED, USAGE, UsageError, complain

__all__ = ["run"]


def run() -> int:
    """Run the command that the arguments name.

    Returns
    -------
    int
        The exit code.
    """
    # The readers of files log what they cannot use; it is said once, by the error.
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    # Pictures are files: no window system, wanted or mistyped, plays a part.
    os.environ["MPLBACKEND"] = "agg"
    if hasattr(sys.stdout, "reconfigure"):
        # A file's name may not be text in the encoding of the terminal.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        arguments = _json_last(sys.argv[1:])
        return app(arguments, prog_name="phaseatlas", standalone_mode=False) or 0
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = "phaseatlas" if context is None else context.command_path
        complain(f"{error.format_message().rstrip('.')}; see {command} --help")
        return error.exit_code
    except UsageError as error:
        complain(str(error))
        return USAGE
    except (OSError, ValueError, RuntimeError, ImportError, MemoryError) as error:
        complain(reason(error))
        return FAILED


def _json_last(arguments: list[str]) -> list[str]:
    """Give ``--json`` its operand where it was left out: ``-``, for standard output."""
    done: list[str] = []
    for argument, following in zip(arguments, [*arguments, ""][1:], strict=True):
        done.append(argument)
        if argument == "--json" and following != "-" and not following.endswith(".json"):
            done.append("-")
    return done
