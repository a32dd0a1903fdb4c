"""phaseatlas demo."""

from __future__ import annotations

import time
from pathlib import Path

from . import options
from .atlas import partitioned
from .process import say
from .report import say_metrics, say_partition, say_tree
from .segment import segmented

__all__ = ["demo"]

RESOLUTION = 2048
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

    seconds: dict[str, float] = {}
    start = time.perf_counter()

    def lap(name: str) -> None:
        seconds[name] = time.perf_counter() - start - sum(seconds.values())

    surface = datasets.starfish()
    partition = partitioned(surface)
    atlas = build_atlas(partition, resolution=RESOLUTION)
    lap("atlas")
    tree = segmented(surface, levels)
    lap("segments")
    blended = build_atlas(tree, resolution=RESOLUTION)
    lap("blended charts")
    for charts, name in ((atlas, "atlas"), (blended, "blended")):
        image = charts.bake(resolution=RESOLUTION)
        charts.save(folder / f"{name}.glb", image=image)
        plot.uv_layout(charts, image, folder / f"{name}.png")
    plot.segments(surface, tree.weights, folder / "segments.png")
    lap("textures and pictures")
    say("The charts of least energy, and their atlas:")
    say_partition(partition)
    say_metrics(atlas)
    say("", f"The {2**levels} segments of equal area, and the atlas of their blended charts:")
    say_tree(tree)
    say_metrics(blended)
    say("", "seconds: " + ", ".join(f"{name} {spent:.2f}" for name, spent in seconds.items()))
    for name in FILES:
        say(f"wrote {folder / name}")
