"""Atlases of many files: planned, made side by side, and written down line by line."""

from .batch import BatchProgress, BatchResult, batch

__all__ = ["BatchProgress", "BatchResult", "batch"]
