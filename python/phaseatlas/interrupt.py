"""Calls of libraries that take the process' signals for themselves."""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from collections.abc import Callable

__all__ = ["run_interruptible"]

# What MMG sets to a handler of its own, which ends the process, and then to the system's default.
_TAKEN = ("SIGABRT", "SIGFPE", "SIGILL", "SIGINT", "SIGSEGV", "SIGTERM")
# More than the `struct sigaction` of any system takes.
_SIZE = 512
_SHORTEST_WAIT, _LONGEST_WAIT = 0.001, 0.1

_one_at_a_time = threading.Lock()


def run_interruptible(call: Callable[[], object]) -> None:
    """Run a call that releases the GIL so that Ctrl-C is heard while it runs and after it.

    Only one call runs at a time; one that was interrupted goes on in the background to its end.

    Parameters
    ----------
    call : callable
        Its result is dropped; what it raises is raised here.
    """
    saved: list[_Handlers] = []
    errors: list[Exception] = []

    def target() -> None:
        with _one_at_a_time:
            handlers = _Handlers()
            saved.append(handlers)
            try:
                call()
            except Exception as error:
                errors.append(error)
            finally:
                handlers.restore()

    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    wait = _SHORTEST_WAIT
    while thread.is_alive():
        thread.join(wait)
        wait = min(2 * wait, _LONGEST_WAIT)
        for handlers in saved:
            handlers.restore()
    if errors:
        raise errors[0]


class _Handlers:
    """The handlers of the signals that may be taken, as they are now."""

    def __init__(self) -> None:
        self.numbers = [getattr(signal, name) for name in _TAKEN if hasattr(signal, name)]
        # Python knows only the handlers that were set by it, and sets them in the main thread
        # alone: where the system can tell them all, the system is asked.
        self.sigaction = ctypes.CDLL(None).sigaction if os.name == "posix" else None
        self.saved = [self._get(number) for number in self.numbers]

    def _get(self, number: int) -> object:
        if self.sigaction is None:
            return signal.getsignal(number)
        action = ctypes.create_string_buffer(_SIZE)
        self.sigaction(int(number), None, action)
        return action

    def restore(self) -> None:
        if self.sigaction is not None:
            for number, action in zip(self.numbers, self.saved, strict=True):
                self.sigaction(int(number), action, None)
        elif threading.current_thread() is threading.main_thread():
            for number, handler in zip(self.numbers, self.saved, strict=True):
                if handler is not None:
                    signal.signal(number, handler)  # type: ignore[arg-type]
