"""The paper, sections 3 to 5: segments of a surface, and the phase fields that find them.

`segment` makes a `SegmentTree`, node by node with `bisect`; `Segmentation` is what an atlas is made
of.
"""

from .node import CollapsedError, Diagnostics, DisconnectedError, Progress, StoppedError
from .options import Options
from .segment import segment
from .segmentation import MergeTree, Segmentation
from .tree import SegmentTree, TreeNode

__all__ = [
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "MergeTree",
    "Options",
    "Progress",
    "SegmentTree",
    "Segmentation",
    "StoppedError",
    "TreeNode",
    "segment",
]
