"""Cut surfaces into connected segments by phase fields and turn them into texture atlases."""

from . import datasets, functionals
from .atlas import Atlas, Chart, build_atlas
from .hierarchy import (
    CollapsedError,
    Diagnostics,
    DisconnectedError,
    Progress,
    SegmentTree,
    segment,
)
from .io import load, save_mesh, save_ply
from .remesh import remesh
from .segmentation import Segmentation
from .surface import Surface

__all__ = [
    "Atlas",
    "Chart",
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Progress",
    "SegmentTree",
    "Segmentation",
    "Surface",
    "build_atlas",
    "datasets",
    "functionals",
    "load",
    "remesh",
    "save_mesh",
    "save_ply",
    "segment",
]
