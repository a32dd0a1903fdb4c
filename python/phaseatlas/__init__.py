"""Cut surfaces into connected segments by phase fields and turn them into texture atlases."""

import importlib
from typing import TYPE_CHECKING

from .remesh import remesh

if TYPE_CHECKING:
    from . import datasets, functionals
    from ._core import __version__
    from .atlas import Atlas, Chart, build_atlas
    from .batching import BatchProgress, BatchResult
    from .batching.batch import batch
    from .cutting import cut_along_seams
    from .file_atlas import AtlasOptions, FileAtlas, atlas_file
    from .io import load, save_mesh, save_ply
    from .partitioning import Partition
    from .partitioning.partition import partition
    from .quality import QualityWarning
    from .scene.scene import Scene, load_scene
    from .segmentation import (
        CollapsedError,
        Diagnostics,
        DisconnectedError,
        MergeTree,
        Progress,
        SceneSegmentation,
        Segmentation,
        SegmentTree,
        StoppedError,
    )
    from .segmentation.segment import segment
    from .surface import Surface
    from .transfer import Transfer
    from .unwrapping import Unwrapped, unwrap
    from .viewer import show

__all__ = [
    "Atlas",
    "AtlasOptions",
    "BatchProgress",
    "BatchResult",
    "Chart",
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "FileAtlas",
    "MergeTree",
    "Partition",
    "Progress",
    "QualityWarning",
    "Scene",
    "SceneSegmentation",
    "SegmentTree",
    "Segmentation",
    "StoppedError",
    "Surface",
    "Transfer",
    "Unwrapped",
    "__version__",
    "atlas_file",
    "batch",
    "build_atlas",
    "cut_along_seams",
    "datasets",
    "functionals",
    "load",
    "load_scene",
    "partition",
    "remesh",
    "save_mesh",
    "save_ply",
    "segment",
    "show",
    "unwrap",
]

# Where the names are that are imported when they are first asked for: all of the package takes
# half a second, most of it in scipy. `remesh` alone is imported above. A module has its name, and
# Python would put the module in the place of the function whenever it is imported later.
_MODULES = {
    "Atlas": "atlas",
    "AtlasOptions": "file_atlas",
    "BatchProgress": "batching",
    "BatchResult": "batching",
    "Chart": "atlas",
    "CollapsedError": "segmentation",
    "Diagnostics": "segmentation",
    "DisconnectedError": "segmentation",
    "FileAtlas": "file_atlas",
    "MergeTree": "segmentation",
    "Partition": "partitioning",
    "Progress": "segmentation",
    "QualityWarning": "quality",
    "Scene": "scene.scene",
    "SceneSegmentation": "segmentation",
    "SegmentTree": "segmentation",
    "Segmentation": "segmentation",
    "StoppedError": "segmentation",
    "Surface": "surface",
    "Transfer": "transfer",
    "Unwrapped": "unwrapping",
    "__version__": "_core",
    "atlas_file": "file_atlas",
    "batch": "batching",
    "build_atlas": "atlas",
    "cut_along_seams": "cutting",
    "load": "io",
    "load_scene": "scene.scene",
    "partition": "partitioning",
    "save_mesh": "io",
    "save_ply": "io",
    "segment": "segmentation",
    "show": "viewer",
    "unwrap": "unwrapping",
}

if not TYPE_CHECKING:

    def __getattr__(name):
        if name in _MODULES:
            value = getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
        elif name.startswith("__"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        else:
            try:
                value = importlib.import_module(f".{name}", __name__)
            except ModuleNotFoundError as error:
                if error.name != f"{__name__}.{name}":
                    raise
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *__all__})
