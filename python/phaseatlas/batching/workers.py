"""Processes of this machine that run one call each at a time, and may die without the rest.

`concurrent.futures.ProcessPoolExecutor` is broken as a whole when one of its processes dies. Here
that is the failure of one call, and another process takes the place.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import IO, Any, ParamSpec, TypeVar

from ..threads import n_threads

__all__ = ["WorkerDiedError", "Workers", "serve"]

P = ParamSpec("P")
T = TypeVar("T")

# What a worker runs. Its modules are found where those of this process are; the main module is not
# imported again, so that scripts need no guard.
_PROGRAM = """
import sys
sys.path[:] = {path!r}
from phaseatlas.batching.workers import serve
serve()
"""
_LENGTH = struct.Struct("<Q")


class WorkerDiedError(RuntimeError):
    """The process that ran a call ended before the call did."""


class Workers(Executor):
    """An executor of processes that are started when they are needed.

    Parameters
    ----------
    count : int
        Calls that run at once.
    timeout : float, optional
        Seconds after which a call fails with `TimeoutError` and its process is killed.
    """

    def __init__(self, count: int, *, timeout: float | None = None) -> None:
        self._timeout = timeout
        self._calls: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._alive: set[_Worker] = set()
        self._killed = False
        # So that the processes do not fight for the cores.
        threads = str(max(1, n_threads() // count))
        self._environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        self._threads = [threading.Thread(target=self._run, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Schedule a call of a function that can be imported."""
        future: Future[T] = Future()
        self._calls.put((future, pickle.dumps((fn, args, kwargs))))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the processes end after the calls that are scheduled."""
        if cancel_futures:
            self._cancel()
        for _ in self._threads:
            self._calls.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def kill(self) -> None:
        """End all processes at once."""
        with self._lock:
            self._killed = True
            for worker in self._alive:
                worker.process.kill()
        self.shutdown(cancel_futures=True)

    def _cancel(self) -> None:
        with suppress(queue.Empty):
            while True:
                call = self._calls.get_nowait()
                if call is not None:
                    call[0].cancel()

    def _run(self) -> None:
        """Serve calls, one after the other, by one process and its successors."""
        if hasattr(signal, "pthread_sigmask"):
            # Ctrl-C is for the main thread. The processes inherit the mask.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        worker: _Worker | None = None
        while (call := self._calls.get()) is not None:
            future, request = call
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if worker is not None and worker.process.poll() is not None:
                    # Killed while it had nothing to do, which is no failure.
                    self._end(worker)
                    worker = None
                worker = worker or self._start()
                good, answer = worker.ask(request, self._timeout)
            except BaseException as error:
                if worker is not None:
                    self._end(worker)
                worker = None
                future.set_exception(error)
            else:
                (future.set_result if good else future.set_exception)(answer)
        if worker is not None:
            self._end(worker)

    def _start(self) -> _Worker:
        with self._lock:
            if self._killed:
                raise WorkerDiedError("the workers were killed")
            worker = _Worker(self._environment)
            self._alive.add(worker)
        return worker

    def _end(self, worker: _Worker) -> None:
        with self._lock:
            self._alive.discard(worker)
        worker.close()


class _Worker:
    """A process that answers requests."""

    def __init__(self, environment: dict[str, str]) -> None:
        # Python's own imports pass over all else.
        path = [str(entry) for entry in sys.path if isinstance(entry, str)]
        self.process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM.format(path=path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        self._ready = False

    def ask(self, request: bytes, timeout: float | None) -> tuple[bool, Any]:
        """Return whether a call succeeded, and its result or error."""
        requests, answers = self.process.stdin, self.process.stdout
        assert requests is not None
        assert answers is not None
        late = threading.Event()

        def stop() -> None:
            late.set()
            self.process.kill()

        timer = None
        try:
            if not self._ready:
                # Its imports are no part of the time of a call.
                _receive(answers)
                self._ready = True
            if timeout is not None:
                timer = threading.Timer(timeout, stop)
                timer.start()
            _send(requests, request)
            answer: tuple[bool, Any] = pickle.loads(_receive(answers))
            return answer
        except (EOFError, OSError):
            code = self.process.wait()
            if late.is_set():
                raise TimeoutError(f"took longer than {timeout:g} s") from None
            how = f"was killed (signal {-code})" if code < 0 else f"ended with code {code}"
            raise WorkerDiedError(f"worker {how}") from None
        finally:
            if timer is not None:
                timer.cancel()

    def close(self) -> None:
        """End the process, which does nothing."""
        self.process.kill()
        # What is left to be sent goes nowhere.
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        self.process.wait()


def serve() -> None:
    """Answer requests from the standard input until it ends; the main program of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # What libraries print must not come between the answers.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    calls: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    # Whoever asks may be gone, and with it the reason to go on.
    def listen() -> None:
        try:
            while True:
                calls.put(_receive(requests))
        finally:
            os._exit(0)

    def answer(message: bytes) -> None:
        try:
            _send(answers, message)
        except OSError:
            os._exit(0)

    answer(b"ready")
    threading.Thread(target=listen, daemon=True).start()
    while True:
        result: tuple[bool, Any]
        try:
            function, args, kwargs = pickle.loads(calls.get())
            result = True, function(*args, **kwargs)
        except BaseException as error:
            result = False, error
        try:
            message = pickle.dumps(result)
        except Exception as error:
            message = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
        answer(message)


def _send(stream: IO[bytes], message: bytes) -> None:
    stream.write(_LENGTH.pack(len(message)) + message)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes:
    return _read(stream, _LENGTH.unpack(_read(stream, _LENGTH.size))[0])


def _read(stream: IO[bytes], size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data
