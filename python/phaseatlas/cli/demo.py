"""phaseatlas demo."""

from __future__ import annotations

import time
from pathlib import Path

from . import options
from .process import say
from .report import say_metrics, say_tree
from .segment import segmented

__all__ = ["demo"]

RESOLUTION = 2048


def demo(
    folder: options.Folder = Path("phaseatlas-demo"),
    levels: options.Levels = 3,
    strict: options.Strict = False,
) -> None:
    """Run the whole pipeline on a surface made here, with pictures."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder: {folder} must be a folder")
    folder.mkdir(parents=True, exist_ok=True)
    from .. import datasets, plot
    from ..atlas import build_atlas

    surface = datasets.starfish()
    start = time.perf_counter()
    tree = segmented(surface, levels)
    segmentation = time.perf_counter()
    atlas = build_atlas(tree, resolution=RESOLUTION)
    charts = time.perf_counter()
    image = atlas.bake(resolution=RESOLUTION)
    atlas.save(folder / "starfish.glb", image=image)
    plot.segments(surface, tree.weights, folder / "segments.png")
    plot.uv_layout(atlas, image, folder / "uv.png")
    pictures = time.perf_counter()
    say_tree(tree)
    say_metrics(atlas)
    say(
        f"seconds: segmentation {segmentation - start:.2f}, charts {charts - segmentation:.2f}, "
        f"texture and pictures {pictures - charts:.2f}"
    )
    for name in ("starfish.glb", "segments.png", "uv.png"):
        say(f"wrote {folder / name}")
