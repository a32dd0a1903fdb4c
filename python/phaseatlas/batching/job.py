"""One mesh of a batch, from its file to its record; any process can do it."""

from __future__ import annotations

import logging
import os
import threading
import time
import warnings
from pathlib import Path

from .. import _core
from ..file_atlas import AtlasOptions, atlas_file
from ..files import digest
from ..reasons import reason
from .manifest import Record

__all__ = ["failed", "make"]

# Warnings are caught for the process as a whole, and one mesh has all its threads.
_one_at_a_time = threading.Lock()


def make(source: Path, folder: Path, output: str, options: AtlasOptions) -> Record:
    """Make the atlas of a file and return its line of the manifest; what fails is in the line."""
    with _one_at_a_time, warnings.catch_warnings():
        # They are in the record.
        warnings.simplefilter("ignore")
        # The readers of files log what they cannot use; it is said once, by the error.
        logging.getLogger("trimesh").setLevel(logging.CRITICAL)
        start = time.perf_counter()
        sha256 = None
        try:
            sha256 = digest(source)
            (folder / output).parent.mkdir(parents=True, exist_ok=True)
            made = atlas_file(source, folder / output, options).record()
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:
            # A panic of the core is no `Exception`.
            seconds = time.perf_counter() - start
            return failed(source, output, options, reason(error), sha256, seconds)
    head = _head(source, output, sha256, options)
    return {
        **head,
        **made,
        **head,
        "files": [os.path.relpath(file, folder).replace(os.sep, "/") for file in made["files"]],
    }


def failed(
    source: Path,
    output: str,
    options: AtlasOptions,
    error: str,
    sha256: str | None = None,
    seconds: float | None = None,
) -> Record:
    """The line of a mesh without an atlas."""
    words = error.removeprefix(f"{source}: ")
    return {**_head(source, output, sha256, options), "seconds": seconds, "error": words}


def _head(source: Path, output: str, sha256: str | None, options: AtlasOptions) -> Record:
    return {
        "input": str(source),
        "output": output,
        "sha256": sha256,
        "options": options.given(),
        "version": _core.__version__,
    }
