"""Cut surfaces into connected segments by phase fields and turn them into texture atlases."""

from . import datasets, functionals
from .atlas import Atlas, Chart, build_atlas
from .io import load, save_mesh, save_ply
from .quality import QualityWarning
from .remesh import remesh
from .segmentation import (
    CollapsedError,
    Diagnostics,
    DisconnectedError,
    Progress,
    Segmentation,
    SegmentTree,
    StoppedError,
    segment,
)
from .surface import Surface

__all__ = [
    "Atlas",
    "Chart",
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Progress",
    "QualityWarning",
    "SegmentTree",
    "Segmentation",
    "StoppedError",
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
