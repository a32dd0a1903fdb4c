"""What is said of a result that is worse than asked for."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

__all__ = ["QualityWarning", "warn"]

_PACKAGE = str(Path(__file__).parent) + os.sep


class QualityWarning(RuntimeWarning):
    """The work is done, but its result is worse than asked for; the message names a cure."""


def warn(message: str) -> None:
    """Issue a `QualityWarning` that points at the line outside the package that asked for the work.

    Parameters
    ----------
    message : str
        One line: what is worse, by how much, and what helps.
    """
    # The first frame is this one; only the caller of the package can do something about it.
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, QualityWarning, stacklevel=level)
