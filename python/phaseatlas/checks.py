"""Checks of arrays that a user gives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats

__all__ = ["matrix", "positive", "vector"]


def vector(argument: str, values: ArrayLike, n: int) -> Floats:
    """Check and convert n finite numbers; `argument` names them in the error."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if np.shape(values) != (n,):
        raise ValueError(f"{argument}: shape {np.shape(values)} must be ({n},)")
    finite = np.isfinite(array)
    if not finite.all():
        index = int(np.argmin(finite))
        raise ValueError(f"{argument}[{index}]: {array[index]} is not a finite number")
    return array


def positive(argument: str, values: ArrayLike, n: int) -> Floats:
    """Check and convert n positive numbers, as `vector` does."""
    array = vector(argument, values, n)
    if (array <= 0).any():
        index = int(np.argmax(array <= 0))
        raise ValueError(f"{argument}[{index}]: {array[index]} must be a positive number")
    return array


def matrix(argument: str, values: ArrayLike, dtype: Any) -> Any:
    """Check and convert (k, 3) numbers of a type; integers may stand for floats."""
    array = np.asarray(values)
    if array.size and (array.ndim != 2 or array.shape[1] != 3):
        raise ValueError(f"{argument}: shape {array.shape} must be (k, 3)")
    if array.size and not (
        np.issubdtype(array.dtype, np.integer)
        or (dtype is np.float64 and np.issubdtype(array.dtype, np.floating))
    ):
        raise ValueError(f"{argument}: dtype {array.dtype} must be {np.dtype(dtype).name}")
    return np.array(array, dtype=dtype, order="C").reshape(-1, 3)
