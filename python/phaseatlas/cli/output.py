"""What is checked of an output before the work that it is for."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

__all__ = ["check_output"]


def check_output(
    output: Path, inputs: Iterable[Path], *suffixes: str, name: str = "output"
) -> None:
    """Refuse before the work what could not be written after it.

    Parameters
    ----------
    output : Path
        The file to write; an OBJ file brings an MTL file and a PNG file.
    inputs : iterable of Path
        Files that must not be overwritten, those of other options among them.
    *suffixes : str
        What the name may end in, in lower case.
    name : str, default "output"
        The option that has it.

    Raises
    ------
    ValueError
        For an output that cannot be written; the message starts with `name`.
    """
    if output.suffix.lower() not in suffixes:
        raise ValueError(f"{name}: {output} must end in {' or '.join(suffixes)}")
    folder = output.absolute().parent
    if not folder.is_dir():
        raise ValueError(f"{name}: the folder of {output} does not exist")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"{name}: the folder of {output} must be writable")
    written = [output]
    if output.suffix.lower() == ".obj":
        written += [output.with_suffix(".mtl"), output.with_suffix(".png")]
    for path in written:
        if path.is_dir():
            raise ValueError(f"{name}: {path} is a folder")
        if any(path.resolve() == source.resolve() for source in inputs):
            what = "an input" if name == "output" else "another file"
            raise ValueError(f"{name}: {path} would overwrite {what}")
