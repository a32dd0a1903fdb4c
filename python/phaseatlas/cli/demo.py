"""phaseatlas demo."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from . import options
from .process import say
from .report import say_metrics, say_segmentation, say_tree
from .segment import segmented

__all__ = ["demo"]

T = TypeVar("T")

# Height of the pictures in pixels.
SIZE = 560
# Each atlas with its layout, and the segments.
FILES = ("atlas.glb", "atlas.png", "segments.png", "blended.glb", "blended.png")


def demo(
    folder: options.Folder = Path("phaseatlas-demo"),
    levels: options.Levels = 3,
    strict: options.Strict = False,
) -> None:
    """Run all of it on a surface made here, with pictures: the atlas, and the paper's segments."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder: {folder} must be a folder")
    folder.mkdir(parents=True, exist_ok=True)
    from .. import datasets, plot
    from ..atlas import build_atlas
    from ..partitioning import partition

    surface = datasets.starfish()
    start = time.perf_counter()
    # The partition is mostly the core's work, the segments mostly Python's: together they take
    # little more than the longer of them.
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(_timed, lambda: partition(surface))
        tree, solving = _timed(lambda: segmented(surface, levels))
        blended = build_atlas(tree)
        charts, charting = waiting.result()
    atlas = build_atlas(charts)
    solved = time.perf_counter()
    for each, name in ((atlas, "atlas"), (blended, "blended")):
        image = each.bake()
        each.save(folder / f"{name}.glb", image=image)
        plot.uv_layout(each, image, folder / f"{name}.png", size=SIZE)
    plot.segments(surface, tree.weights, folder / "segments.png", size=SIZE)
    drawn = time.perf_counter()
    say("The charts of least energy, and their atlas:")
    say_segmentation(charts)
    say_metrics(atlas)
    say("", f"The {2**levels} segments of equal area, and the atlas of their blended charts:")
    say_tree(tree)
    say_metrics(blended)
    say(
        "",
        f"seconds: charts {charting:.2f}, segments {solving:.2f}, both side by side "
        f"{solved - start:.2f}, textures and pictures {drawn - solved:.2f}",
    )
    for name in FILES:
        say(f"wrote {folder / name}")


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    start = time.perf_counter()
    return work(), time.perf_counter() - start
