"""Files of arrays with names: segments and atlases that were saved."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar
from zipfile import is_zipfile

import numpy as np

from .files import check_input, write_whole
from .scene.scene import SceneFile

__all__ = ["format_of", "read_arrays", "source_of", "write_arrays"]

_Made = TypeVar("_Made")

# What reads each format.
_READERS = {1: "SegmentTree", 2: "SceneSegmentation", 3: "Atlas"}


def write_arrays(path: str | PathLike[str], arrays: dict[str, Any]) -> None:
    """Write an `.npz` file, whole or not at all."""
    with write_whole(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_arrays(
    path: str | PathLike[str], version: int, made: Callable[[dict[str, Any]], _Made]
) -> _Made:
    """Read an `.npz` file of a segmentation or an atlas; `made` makes something of its arrays.

    Parameters
    ----------
    path : str or PathLike
    version : int
        Format of the file: 1 for a tree, 2 for the segments of a scene, 3 for an atlas.
    made : callable
        From the arrays by their names to the result.

    Raises
    ------
    ValueError
        For a file that is no segmentation, or of another format.
    FileNotFoundError
        For a missing file.
    """
    try:
        if Path(path).is_file() and not is_zipfile(path):
            # NumPy would take it for a pickle, and say so.
            raise ValueError("it is no .npz file")
        with np.load(Path(path), allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        found = int(arrays["format"])
        if found == version:
            return made(arrays)
    except FileNotFoundError:
        raise
    except Exception as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        kind = "atlas" if version == 3 else "segmentation"
        raise ValueError(f"{path}: no {kind}: {reason}") from error
    if found in _READERS:
        raise ValueError(f"{path}: format {found} is what {_READERS[found]}.load reads")
    raise ValueError(f"{path}: format {found} is not known")


def format_of(path: Path) -> int:
    """Format of an `.npz` file; see `read_arrays`."""
    check_input(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            found = int(file["format"])
    except Exception as error:
        raise ValueError(f"{path}: neither segments nor an atlas") from error
    if found not in _READERS:
        raise ValueError(f"{path}: format {found} is not known")
    return found


def source_of(path: Path) -> SceneFile | None:
    """The file that the surface of a saved tree was read from."""
    with np.load(path, allow_pickle=False) as file:
        if "source" not in file.files or not str(file["source"]):
            return None
        return SceneFile(str(file["source"]), str(file["sha256"]))
