"""What is said of a failure."""

from __future__ import annotations

__all__ = ["reason"]


def reason(error: BaseException) -> str:
    """What went wrong, in one line."""
    if isinstance(error, OSError) and error.strerror is not None:
        words = error.strerror.lower()
        words = words if error.filename is None else f"{error.filename}: {words}"
    elif isinstance(error, (ValueError, RuntimeError, OSError, ImportError, MemoryError)):
        words = str(error) or type(error).__name__
    else:
        words = f"{type(error).__name__}: {error}"
    return " ".join(words.split())
