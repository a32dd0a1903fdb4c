"""Colours of a page: of charts, told apart by the colour-blind, and of scales."""

from __future__ import annotations

import matplotlib
import numpy as np

from ..arrays import Bytes, Floats, Ints
from ..surface import Surface

__all__ = ["chart_colours", "scale_colours"]

# "Light" of Paul Tol's schemes for filled areas, which the colour-blind tell apart
# (https://personal.sron.nl/~pault), without its grey, neighbours in the list unlike each other.
_LIGHT = ("77aadd", "ee8866", "bbcc33", "ffaabb", "44bb99", "eedd88", "99ddff", "aaaa00")


def chart_colours(surface: Surface, chart: Ints, count: int) -> Bytes:
    """Choose colours so that neighbours differ, as far as eight colours allow.

    Parameters
    ----------
    surface : Surface
        With m faces.
    chart : (m,) array of int
        Chart of each face, in 0..count-1.
    count : int
        Number of charts.

    Returns
    -------
    (count, 3) array of uint8
    """
    colours = np.array([list(bytes.fromhex(code)) for code in _LIGHT], dtype=np.uint8)
    other = surface.face_neighbours
    face, side = np.nonzero(other >= 0)
    pairs = np.stack([chart[face], chart[other[face, side]]], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    bounds = np.searchsorted(pairs[:, 0], np.arange(count + 1))
    chosen = np.full(count, -1)
    used = np.zeros(len(colours), dtype=np.int64)
    for k in range(count):
        near = chosen[pairs[bounds[k] : bounds[k + 1], 1]]
        taken = np.bincount(near[near >= 0], minlength=len(colours))
        # The least used of those that fewest neighbours have.
        chosen[k] = int(np.lexsort((used, taken))[0])
        used[chosen[k]] += 1
    found: Bytes = colours[chosen]
    return found


def scale_colours(name: str) -> Bytes:
    """Return the 256 colours of a colour map of matplotlib, (256, 3) uint8."""
    colours: Floats = matplotlib.colormaps[name](np.linspace(0.0, 1.0, 256))[:, :3]
    rounded: Bytes = np.rint(255 * colours).astype(np.uint8)
    return rounded
