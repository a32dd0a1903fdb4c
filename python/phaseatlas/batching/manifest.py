"""The manifest of a batch: a line of JSON for each mesh that was tried."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..files import write_bytes
from ..plain import plain

__all__ = ["NAME", "Manifest", "Record", "locked"]

NAME = "manifest.jsonl"

# What a line says of a mesh; the keys are in the documentation of `batch`.
Record = dict[str, Any]


class Manifest:
    """Lines on disk, each written in one piece before the next mesh is told of.

    Parameters
    ----------
    folder : Path
        Of the batch.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME

    def read(self) -> list[Record]:
        """Read all lines that are whole, the last one of an output where there are several.

        Raises
        ------
        ValueError
            For a line before the last one that is no record of a batch.
        """
        if not self.path.exists():
            return []
        lines = self.path.read_bytes().split(b"\n")
        records: dict[str, Record] = {}
        for number, line in enumerate(lines, start=1):
            try:
                record = json.loads(line)
                if not all(isinstance(record[key], str) for key in ("input", "output")):
                    raise TypeError
                records.pop(record["output"], None)
                records[record["output"]] = record
            except (ValueError, TypeError, KeyError):
                # A killed process leaves a part of its last line, which has no end.
                if line.strip() and number < len(lines):
                    raise ValueError(
                        f"{self.path}: line {number} is no record of a batch"
                    ) from None
        return list(records.values())

    def write(self, records: Sequence[Record]) -> None:
        """Replace all lines, whole or not at all."""
        write_bytes(self.path, b"".join(map(_line, records)))

    def append(self, record: Record) -> None:
        """Add a line and see it on disk."""
        file = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            # One call, so that an interrupt comes before the line or after it.
            line = _line(record)
            if os.write(file, line) < len(line):
                raise OSError(f"{self.path}: cannot be written, the disk is full")
            os.fsync(file)
        finally:
            os.close(file)


def _line(record: Record) -> bytes:
    return json.dumps(plain(record), allow_nan=False, separators=(",", ":")).encode() + b"\n"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other batches out of a folder, where the system can.

    Raises
    ------
    ValueError
        Where another batch is at work.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        # Not all file systems have locks of folders.
        with suppress(OSError):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(f"folder: another batch is at work in {folder}") from None
        yield
    finally:
        os.close(handle)
