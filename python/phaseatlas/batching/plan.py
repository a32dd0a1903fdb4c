"""Which files a batch takes, and where each result goes."""

from __future__ import annotations

import glob
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import Literal, get_args

from ..scene.document import SUFFIXES

__all__ = ["Format", "Job", "plan"]

Format = Literal["glb", "gltf", "obj", "ply", "same"]

# These formats hold no texture coordinates.
_WITHOUT_PLACES = {".stl": ".ply", ".off": ".ply"}


@dataclass(frozen=True)
class Job:
    """A file and the place of its result.

    Attributes
    ----------
    source : Path
        Absolute.
    output : str
        Relative to the folder of the batch, with slashes.
    """

    source: Path
    output: str


def plan(
    inputs: Iterable[str | PathLike[str]], folder: Path, suffix: Format = "glb"
) -> tuple[Job, ...]:
    """Find the files of a batch and name their results.

    A result has the place below `folder` that its input has below the folder or the fixed part of
    the pattern that it was found by; where two inputs would meet so, all are placed by their paths
    below their common parent. Inputs whose results would share a name keep their old suffix in it:
    `chair.obj` and `chair.stl` become `chair.obj.glb` and `chair.stl.glb`.

    Parameters
    ----------
    inputs : iterable of str or PathLike
        Files; folders, which are searched with all below them for meshes; and patterns with `*`,
        `?`, `[...]` and `**`. Hidden files and what is in `folder` are not found in a folder.
    folder : Path
        Where the results go.
    suffix : {"glb", "gltf", "obj", "ply", "same"}, default "glb"
        Format of the results; "same" is that of the input, PLY for STL and OFF files.

    Returns
    -------
    tuple of Job
        In the order of the inputs, those of a folder by name; each file once.

    Raises
    ------
    ValueError
        For an input that is not there, a pattern that nothing matches, a folder without a mesh,
        an input inside of `folder`, and an unknown format.
    """
    if suffix not in get_args(Format):
        raise ValueError(f"format: value must be one of {get_args(Format)}, got {suffix!r}")
    target = folder.resolve()
    roots: dict[Path, Path] = {}
    for given in inputs:
        found = list(_found(os.fspath(given), target))
        if not found:
            raise ValueError(f"inputs: there is no mesh in {given}")
        for file, root in found:
            roots.setdefault(file, root)
    if not roots:
        raise ValueError("inputs: value must be a file, a folder or a pattern at least")
    for file in roots:
        if target in file.resolve().parents:
            raise ValueError(f"folder: {folder} must not hold an input, {file}")
    names = _names(roots)
    outputs = _outputs(list(names.values()), suffix)
    return tuple(Job(file, output) for file, output in zip(names, outputs, strict=True))


def _found(given: str, target: Path) -> Iterator[tuple[Path, Path]]:
    """Give the absolute paths of files, each with the folder that its place is relative to."""
    path = Path(os.path.abspath(given))
    if path.is_dir():
        yield from ((file, path) for file in _below(path, target))
    elif os.path.lexists(path):
        yield path, path.parent
    elif glob.has_magic(given):
        root = next(parent for parent in path.parents if not glob.has_magic(str(parent)))
        for name in sorted(glob.glob(str(path), recursive=True)):
            match = Path(name)
            if match.is_dir() or target in match.resolve().parents:
                continue
            if match.suffix.lower() in SUFFIXES:
                yield match, root
    else:
        raise ValueError(f"inputs: {given}: no such file or folder")


def _below(folder: Path, target: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        here = Path(parent)
        folders[:] = sorted(
            name for name in folders if name[0] != "." and (here / name).resolve() != target
        )
        for name in sorted(files):
            if name[0] != "." and Path(name).suffix.lower() in SUFFIXES:
                yield here / name


def _names(roots: dict[Path, Path]) -> dict[Path, PurePosixPath]:
    """Names of files relative to their roots, or to the common parent where two are the same."""
    names = {file: PurePosixPath(file.relative_to(root).as_posix()) for file, root in roots.items()}
    if len({os.path.normcase(name) for name in names.values()}) < len(names):
        parent = Path(os.path.commonpath([file.parent for file in roots]))
        return {file: PurePosixPath(file.relative_to(parent).as_posix()) for file in roots}
    return names


def _outputs(names: Sequence[PurePosixPath], suffix: Format) -> list[str]:
    """Names of the results, no two the same."""

    def ending(name: PurePosixPath) -> str:
        own = name.suffix.lower()
        return _WITHOUT_PLACES.get(own, own) if suffix == "same" else f".{suffix}"

    outputs = [str(name.with_name(name.stem + ending(name))) for name in names]
    while True:
        places = defaultdict(list)
        for k, output in enumerate(outputs):
            # All that belongs to a result has its stem.
            places[os.path.normcase(PurePosixPath(output).with_suffix(""))].append(k)
        before = list(outputs)
        for meeting in places.values():
            if len(meeting) > 1:
                for k in meeting:
                    outputs[k] = str(names[k].with_name(names[k].name + ending(names[k])))
        if outputs == before:
            return outputs
