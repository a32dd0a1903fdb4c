"""Atlases of many files, side by side; what was done survives whatever ends the batch."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from .. import _core
from ..file_atlas import CHECKER, AtlasOptions
from ..files import digest, remove_temporaries
from ..plain import plain
from ..reasons import reason
from ..threads import n_threads
from .job import failed, make
from .manifest import Manifest, Record, locked
from .memory import peak
from .plan import Format, Job, plan
from .workers import WorkerDiedError, Workers

__all__ = ["BatchProgress", "BatchResult", "batch"]

# Part of the free memory that the meshes in work may take together.
_SHARE = 0.8
# Seconds between two looks at how many workers a cluster has.
_LOOK = 1.0


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch is.

    Attributes
    ----------
    done, total : int
        Meshes.
    record : dict or None
        The line of the manifest of the mesh that was done last; None at the start.
    """

    done: int
    total: int
    record: Record | None


@dataclass(frozen=True)
class BatchResult:
    """What became of the meshes of a batch.

    Attributes
    ----------
    folder : Path
        With the atlases and the manifest.
    records : tuple of dict
        The lines of the manifest of these meshes, in the order of the inputs.
    skipped : int
        How many of them were finished before.
    """

    folder: Path
    records: tuple[Record, ...]
    skipped: int

    @property
    def failed(self) -> tuple[Record, ...]:
        """The lines with an `error`."""
        return tuple(record for record in self.records if "error" in record)


def batch(
    inputs: str | PathLike[str] | Iterable[str | PathLike[str]],
    folder: str | PathLike[str],
    *,
    options: AtlasOptions | None = None,
    format: Format = "glb",  # noqa: A002
    jobs: int | None = None,
    executor: Any = None,
    resume: bool = False,
    timeout: float | None = None,
    memory: float | None = None,
    progress: Callable[[BatchProgress], object] | None = None,
) -> BatchResult:
    """Give each of many files an atlas, side by side; no failure of one stops the others.

    `folder/manifest.jsonl` gets a line of JSON for each mesh as soon as it is done, with the keys
    input (absolute path), output (relative to the folder), sha256 (digest of the bytes of the
    input; not of the buffers, materials and images that it names), options, version, seconds, and
    either metrics, warnings and the rest of `FileAtlas.record`, or error. Once all are done the
    lines are in the order of the inputs. The results do not depend on how many are made at once.

    Parameters
    ----------
    inputs : path or iterable of paths
        Files; folders, which are searched with all below them; and patterns like `*.obj` and
        `**/*.glb`.
    folder : path
        Where the atlases go, in the subfolders that the inputs have below their folders; made
        where missing. Inputs whose atlases would share a name keep their suffix in it:
        `chair.obj` and `chair.stl` give `chair.obj.glb` and `chair.stl.glb`.
    options : AtlasOptions, optional
        Of all atlases.
    format : {"glb", "gltf", "obj", "ply", "same"}, default "glb"
        Of the results. "same" is that of the input, PLY for STL and OFF files.
    jobs : int, optional
        Meshes at once; by default one for each core, with an executor as many as it takes.
    executor : concurrent.futures.Executor or distributed.Client, optional
        Who works, instead of processes of this machine. The workers see the same files under the
        same paths. One process makes one atlas at a time. Dask starts a mesh again whose worker
        died.
    resume : bool, default False
        Go on with a batch in this folder: what is finished with the same digest, options and
        version stays, all else is done, failures too.
    timeout : float, optional
        Seconds that a mesh may take; not with an executor, whose calls cannot be ended.
    memory : float, optional
        Bytes that the meshes in work may take together, by the estimates of `batching.memory`; a
        mesh that takes more is made alone. By default 80 % of what is free, and with an executor
        there is no bound.
    progress : callable, optional
        Called with a `BatchProgress` at the start and after each mesh.

    Returns
    -------
    BatchResult

    Raises
    ------
    ValueError
        For an argument that cannot be used, a folder with a manifest where `resume` is false, a
        manifest that is none, and while another batch is at work in the folder.

    Notes
    -----
    A mesh whose worker is killed, as by the system for want of memory, is tried again once, with
    no other beside it. When the calling process is killed its workers end, too.
    """
    options = AtlasOptions() if options is None else options
    if options.texture is not None and str(options.texture) != CHECKER:
        # Workers may be in other folders.
        options = replace(options, texture=os.path.abspath(options.texture))
    for name in ("charts", "outlines"):
        if getattr(options, name) is not None:
            raise ValueError(f"{name}: value must be left out, it is one file for all meshes")
    _check(jobs, timeout, memory, executor)
    given = [inputs] if isinstance(inputs, (str, PathLike)) else inputs
    folder = Path(folder).absolute()
    planned = plan(given, folder, format)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        manifest = Manifest(folder)
        if manifest.path.exists() and not resume:
            raise ValueError(
                f"folder: {folder} has the manifest of a batch; resume goes on with it"
            )
        remove_temporaries(folder)
        others, records = _kept(manifest.read(), planned, folder, options)
        skipped = len(records)
        manifest.write([*others, *records.values()])
        _tell(progress, records, planned, None)
        todo = [job for job in planned if job.output not in records]
        bound = memory
        if bound is None:
            bound = math.inf if executor is not None else _SHARE * _core.available_memory()
        try:
            with (
                _engine(executor, jobs, len(todo), timeout) as (engine, room),
                closing(_made(todo, folder, options, engine, room, bound)) as made,
            ):
                for record in made:
                    manifest.append(record)
                    records[record["output"]] = record
                    _tell(progress, records, planned, record)
        finally:
            # Of workers that were killed.
            remove_temporaries(folder)
        ordered = tuple(records[job.output] for job in planned)
        manifest.write([*others, *ordered])
    return BatchResult(folder, ordered, skipped)


def _check(jobs: int | None, timeout: float | None, memory: float | None, executor: object) -> None:
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs: value must be at least 1, got {jobs}")
    for name, value in (("timeout", timeout), ("memory", memory)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name}: value must be a positive number, got {value}")
    if timeout is not None and executor is not None:
        raise ValueError("timeout: value must be left out with an executor")


def _tell(
    progress: Callable[[BatchProgress], object] | None,
    records: Mapping[str, Record],
    planned: Sequence[Job],
    record: Record | None,
) -> None:
    if progress is not None:
        progress(BatchProgress(len(records), len(planned), record))


def _kept(
    lines: Sequence[Record], planned: Sequence[Job], folder: Path, options: AtlasOptions
) -> tuple[list[Record], dict[str, Record]]:
    """The lines of other meshes, and those of the batch that need not be done again."""
    by_output = {line["output"]: line for line in lines}
    ours = {job.output for job in planned} | {str(job.source) for job in planned}
    others = [line for line in lines if not ours & {line["output"], line["input"]}]
    wanted = {"options": plain(options.given()), "version": _core.__version__}

    def good(job: Job) -> bool:
        line = by_output.get(job.output, {})
        try:
            return (
                "metrics" in line
                and line["input"] == str(job.source)
                and {name: line[name] for name in wanted} == wanted
                and (folder / job.output).exists()
                and digest(job.source) == line["sha256"]
            )
        except OSError:
            return False

    return others, {job.output: by_output[job.output] for job in planned if good(job)}


@contextmanager
def _engine(
    executor: Any, jobs: int | None, count: int, timeout: float | None
) -> Iterator[tuple[Executor, Callable[[], float]]]:
    """Give who works, and how many meshes it takes at once, which may change."""
    if executor is None:
        jobs = max(1, min(n_threads() if jobs is None else jobs, count))
        workers = Workers(jobs, timeout=timeout)
        try:
            yield workers, lambda: jobs
        except BaseException:
            workers.kill()
            raise
        workers.shutdown()
    elif hasattr(executor, "get_executor"):
        client = executor
        # As many as there are workers: where one dies with a mesh, no others were given to it.
        with client.get_executor(pure=False) as cluster:
            yield cluster, lambda: jobs or max(1, len(client.nthreads()))
    else:
        yield executor, lambda: jobs or math.inf


@dataclass(frozen=True)
class _Attempt:
    job: Job
    peak: float
    again: bool = False


def _made(
    jobs: Sequence[Job],
    folder: Path,
    options: AtlasOptions,
    engine: Executor,
    room: Callable[[], float],
    memory: float,
) -> Generator[Record, None, None]:
    """Make the atlases, and give the line of each as soon as it is done."""
    waiting = deque(_Attempt(job, peak(job.source, options)) for job in jobs)
    running: dict[Future[Record], _Attempt] = {}
    try:
        while waiting or running:
            most = room()
            while waiting and len(running) < most:
                taken = sum(attempt.peak for attempt in running.values())
                if running and taken + waiting[0].peak > memory:
                    break
                attempt = waiting.popleft()
                running[_submitted(engine, attempt.job, folder, options)] = attempt
            done, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
            for future in done:
                attempt = running.pop(future)
                error = CancelledError() if future.cancelled() else future.exception()
                if error is None:
                    yield future.result()
                elif isinstance(error, WorkerDiedError) and not attempt.again:
                    # The memory may not have sufficed: it gets all of it.
                    waiting.appendleft(_Attempt(attempt.job, math.inf, again=True))
                else:
                    yield _without(attempt.job, options, error)
    finally:
        for future in running:
            future.cancel()


def _submitted(engine: Executor, job: Job, folder: Path, options: AtlasOptions) -> Future[Record]:
    try:
        return engine.submit(make, job.source, folder, job.output, options)
    except Exception as error:
        # One that is broken takes nothing more.
        refused: Future[Record] = Future()
        refused.set_exception(error)
        return refused


def _without(job: Job, options: AtlasOptions, error: BaseException) -> Record:
    """The line of a mesh whose worker could not make one."""
    try:
        sha256 = digest(job.source) if job.source.is_file() else None
    except OSError:
        sha256 = None
    return failed(job.source, job.output, options, reason(error), sha256)
