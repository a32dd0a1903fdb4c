"""phaseatlas demo."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from . import options
from .process import Record, say
from .report import say_metrics, say_segmentation, say_tree, say_written
from .segment import segmented

if TYPE_CHECKING:
    from ..atlas import Atlas
    from ..partitioning import Partition

__all__ = ["demo"]

# Height of the pictures in pixels.
SIZE = 560
# Each atlas with its layout, and the segments.
FILES = ("atlas.glb", "atlas.png", "segments.png", "blended.glb", "blended.png")


def demo(
    folder: options.Folder = Path("phaseatlas-demo"),
    levels: options.Levels = 3,
    strict: options.Strict = False,
) -> Record:
    """Run all of it on a surface made here, with pictures: the atlas, and the paper's segments."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder: {folder} must be a folder")
    folder.mkdir(parents=True, exist_ok=True)
    from .. import datasets, plot
    from ..atlas import build_atlas
    from ..partitioning import partition

    surface = datasets.starfish()

    def draw(atlas: Atlas, name: str) -> None:
        image = atlas.bake()
        atlas.save(folder / f"{name}.glb", image=image)
        plot.uv_layout(atlas, image, folder / f"{name}.png", size=SIZE)

    def by_energy() -> tuple[Partition, Atlas, float]:
        start = time.perf_counter()
        charts = partition(surface)
        atlas = build_atlas(charts)
        draw(atlas, "atlas")
        return charts, atlas, time.perf_counter() - start

    start = time.perf_counter()
    # Neither keeps two cores busy by itself.
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(by_energy)
        tree = segmented(surface, levels)
        solved = time.perf_counter()
        blended = build_atlas(tree)
        draw(blended, "blended")
        plot.segments(surface, tree.weights, folder / "segments.png", size=SIZE)
        charts, atlas, seconds = waiting.result()
    done = time.perf_counter()
    say("The charts of least energy, and their atlas:")
    say_segmentation(charts)
    say_metrics(atlas)
    say("", f"The {2**levels} segments of equal area, and the atlas of their blended charts:")
    say_tree(tree)
    say_metrics(blended)
    say(
        "",
        f"seconds: the first atlas and its pictures {seconds:.2f}; beside it the segments "
        f"{solved - start:.2f}, and with their atlas and pictures {done - start:.2f}",
    )
    files = [folder / name for name in FILES]
    say_written(*files)
    return {
        "files": [str(file) for file in files],
        "metrics": {"atlas": atlas.metrics(), "blended": blended.metrics()},
    }
