"""Cut surfaces into connected segments by phase fields and turn them into texture atlases."""

from . import datasets, functionals
from .surface import Surface

__all__ = ["Surface", "datasets", "functionals"]
