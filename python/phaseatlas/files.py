"""Files that can be read, and files that are written whole or not at all."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

__all__ = [
    "check_input",
    "digest",
    "remove_temporaries",
    "write_bytes",
    "write_files",
    "write_whole",
]

# What ends the name of a file that is being written.
_PART = ".part"


def check_input(path: Path) -> None:
    """Raise an error that starts with the path where there is no file with content.

    Raises
    ------
    ValueError
        For an empty file, and for what is no regular one.
    FileNotFoundError, IsADirectoryError
        For a missing file and for a folder.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: a folder, not a file")
    if not path.is_file():
        # A pipe would be waited for.
        raise ValueError(f"{path}: not a regular file")
    with path.open("rb") as file:
        if not file.read(1):
            raise ValueError(f"{path}: empty file")


def digest(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_bytes(path: str | PathLike[str], data: Any) -> None:
    """Write a file whole or not at all."""
    with write_whole(path) as temporary:
        temporary.write_bytes(data)


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write files that belong together: all are on disk before the first takes its place."""
    with ExitStack() as stack:
        for path, data in reversed(list(contents.items())):
            stack.enter_context(write_whole(path)).write_bytes(data)


@contextmanager
def write_whole(path: str | PathLike[str]) -> Iterator[Path]:
    """Give a temporary file beside `path` that takes its place when the block succeeds."""
    path = Path(path)
    try:
        descriptor, name = tempfile.mkstemp(_PART, f".{path.name}.", path.parent)
    except OSError as error:
        # The user knows nothing of the temporary file.
        error.filename = str(path)
        raise
    os.close(descriptor)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes private files; the result gets what a plain open would give.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def remove_temporaries(folder: Path) -> None:
    """Remove what killed processes were writing in a folder and below it."""
    for temporary in folder.rglob(f".*{_PART}"):
        temporary.unlink(missing_ok=True)
