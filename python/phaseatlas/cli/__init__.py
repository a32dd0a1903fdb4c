"""The command line: segment, atlas, batch, view, remesh, info, demo."""

# Nothing is imported here that takes time: Ctrl-C is heard from the first moment on.
import os
import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from .app import app

__all__ = ["app", "main"]

INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command line and end the process.

    The exit code is 0 for success, 1 for a failure, 2 for arguments that cannot be used, 3 for
    warnings under ``--strict``, and 130 after Ctrl-C. Errors and warnings are one line each.
    """
    # There are none where the process was started without them.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    # MMG's bindings put something else in the place of the error stream while MMG runs.
    errors = os.dup(sys.stderr.fileno())

    def stop() -> NoReturn:
        os.write(errors, b"phaseatlas: interrupted\n")
        # Without the rest of Python's exit: MMG may still run in a thread of its own.
        os._exit(INTERRUPTED)

    def interrupt(number: int, frame: FrameType | None) -> None:
        # An import that is broken off fails in many ways, some of them not by an exception. There
        # is nothing to clean up either.
        caller = frame
        while caller is not None:
            if caller.f_code.co_filename.startswith("<frozen importlib"):
                stop()
            caller = caller.f_back
        signal.default_int_handler(number, frame)

    # Not where whoever started the process wants it to go on, as `nohup` does.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        from .run import run

        code = run()
    except KeyboardInterrupt:
        code = INTERRUPTED
    if code == INTERRUPTED:
        stop()
    sys.exit(code)


if not TYPE_CHECKING:

    def __getattr__(name):
        if name != "app":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from .app import app

        return app
