"""Colours of segments and of scalar fields."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats, Ints
from ..surface import Surface

__all__ = ["check_labels", "palette", "scalar_colors", "segment_colors"]

# Tableau 10 without its grey, the order changed so that the first few differ most; further colours
# are picked to differ from these and from each other.
_FIRST_COLOURS = (
    "4e79a7", "f28e2b", "59a14f", "e15759", "76b7b2", "edc948", "b07aa1", "9c755f", "ff9da7",
)  # fmt: skip


def scalar_colors(
    values: Floats, *, low: float = -1.0, high: float = 1.0, colormap: str = "coolwarm"
) -> Floats:
    """Map a scalar field to colours; by default a phase field, from blue at -1 to red at 1.

    Parameters
    ----------
    values
        (k,) values, at the vertices or faces of a surface.
    low, high
        Values of the two ends of the colour map; what lies beyond takes their colours.
    colormap
        Name of a colour map of matplotlib.

    Returns
    -------
    (k, 3) float64 array
        Colours in [0, 1], as `segments` takes them.

    Raises
    ------
    ValueError
        If `values` is not one-dimensional or not finite, `low` is not below `high`, or the colour
        map is unknown.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 1:
        raise ValueError(f"values: shape {values.shape} must be (k,)")
    if not np.isfinite(values).all():
        index = int(np.argmin(np.isfinite(values)))
        raise ValueError(f"values[{index}]: {values[index]} must be a finite number")
    if not low < high:
        raise ValueError(f"low: {low} must be below high, {high}")
    if colormap not in matplotlib.colormaps:
        raise ValueError(f"colormap: {colormap!r} must be one of matplotlib's")
    colours: Floats = matplotlib.colormaps[colormap]((values - low) / (high - low))[:, :3]
    return colours


def segment_colors(surface: Surface, labels: Ints, count: int | None = None) -> Floats:
    """Choose colours for segments so that neighbours are told apart.

    Parameters
    ----------
    surface
        The surface, with m faces.
    labels
        (m,) segment of each face, from 0.
    count
        Number k of segments; by default the largest label plus 1.

    Returns
    -------
    (k, 3) float64 array
        Colours in [0, 1].

    Raises
    ------
    ValueError
        If a label is negative or not below `count`.
    """
    labels = np.asarray(labels)
    check_labels(labels)
    count = int(labels.max()) + 1 if count is None else count
    if labels.max() >= count:
        raise ValueError(f"labels: {labels.max()} must be below count, {count}")
    colours = palette(count)
    neighbours = _neighbours(surface, labels, count)
    lab = _oklab(colours)
    distance = np.linalg.norm(lab[:, None] - lab[None], axis=2)
    chosen = np.full(count, -1)
    for segment in range(count):
        near = chosen[neighbours[segment] & (chosen >= 0)]
        free = np.setdiff1d(np.arange(count), chosen)
        # The first of the colours that are far enough: keeps to the start of the palette.
        margin = distance[np.ix_(free, near)].min(axis=1) if near.size else np.ones(len(free))
        chosen[segment] = free[np.argmax(np.minimum(margin, 0.16))]
    ordered: Floats = colours[chosen]
    return ordered


def palette(count: int) -> Floats:
    """List colours that differ, the more so the fewer are used.

    Parameters
    ----------
    count
        Number of colours, at least 1.

    Returns
    -------
    (count, 3) float64 array
        Colours in [0, 1].

    Raises
    ------
    ValueError
        If `count` is less than 1.
    """
    if count < 1:
        raise ValueError(f"count: {count} must be at least 1")
    bytes_ = [bytes.fromhex(code) for code in _FIRST_COLOURS]
    first = np.array([list(code) for code in bytes_]) / 255.0
    if count <= len(first):
        return first[:count]
    levels = np.linspace(0.30, 0.98, 12)
    grid = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = _oklab(grid)
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    pleasant = (chroma > 0.05) & (chroma < 0.125) & (lab[:, 0] > 0.48) & (lab[:, 0] < 0.86)
    grid, lab = grid[pleasant], lab[pleasant]
    gap = np.linalg.norm(lab[:, None] - _oklab(first)[None], axis=2).min(axis=1)
    chosen = []
    for _ in range(count - len(first)):
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
    return np.concatenate([first, grid[chosen]])


def _oklab(srgb: Floats) -> Floats:
    """Colours in a space where distances match perception (Ottosson 2020)."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    lab: Floats = np.cbrt(cones) @ np.array(
        [
            [0.2104542553, 1.9779984951, 0.0259040371],
            [0.7936177850, -2.4285922050, 0.7827717662],
            [-0.0040720468, 0.4505937099, -0.8086757660],
        ]
    )
    return lab


def check_labels(labels: NDArray[Any]) -> None:
    """Raise ValueError for a negative label."""
    if labels.size and labels.min() < 0:
        face = int(np.argmin(labels))
        raise ValueError(f"labels[{face}]: {labels[face]} must be at least 0")


def _neighbours(surface: Surface, labels: Ints, count: int) -> Bools:
    other = surface.face_neighbours
    a = np.repeat(labels, 3)[other.ravel() >= 0]
    b = labels[other.ravel()[other.ravel() >= 0]]
    touch = np.zeros((count, count), dtype=bool)
    touch[a, b] = True
    np.fill_diagonal(touch, False)
    return touch | touch.T
