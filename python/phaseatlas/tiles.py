"""UDIM tiles of pages: ten a row, numbered from 1001."""

from __future__ import annotations

import numpy as np

from .arrays import Floats, Ints

__all__ = ["tile_number", "tile_offsets"]

_COLUMNS = 10


def tile_offsets(pages: Ints) -> Floats:
    """Columns and rows of the tiles of pages, (k, 2)."""
    return np.stack([pages % _COLUMNS, pages // _COLUMNS], axis=-1).astype(np.float64)


def tile_number(page: int) -> int:
    """Number of the tile of a page: 1001 + column + 10 times the row."""
    return 1001 + page
