"""Atlases of files as people have them, beside xatlas, in one run.

    python benches/compare/files.py FOLDER [--levels 3]

For each file that can be read: faces, pieces, charts and seconds of `pa.unwrap`, what is wrong with
the layout, and charts and seconds of xatlas on the same triangles where it is installed. Seconds
are of the CPU, without reading, start-up and imports.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
import warnings
from pathlib import Path

import numpy as np

import phaseatlas as pa
from phaseatlas.scene.document import SUFFIXES


def with_xatlas(scene: pa.Scene) -> tuple[int, float]:
    import xatlas

    start = time.process_time()
    atlas = xatlas.Atlas()
    atlas.add_mesh(scene.vertices.astype(np.float32), scene.faces.astype(np.uint32))
    atlas.generate()
    return int(atlas.chart_count), time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description="Atlases of files, beside xatlas.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--levels", type=int, help="of the tree, instead of charts by energy")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    peer = importlib.util.find_spec("xatlas") is not None
    print(
        "file  faces  pieces  charts  seconds  seconds a face/1e-3  flaws  xatlas: charts  seconds"
    )
    totals = np.zeros(2)
    for path in sorted(arguments.folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        try:
            scene = pa.load_scene(path)
        except ValueError as error:
            print(f"{path.name}  refused: {error}")
            continue
        start = time.process_time()
        report = pa.unwrap(scene, levels=arguments.levels).report
        seconds = time.process_time() - start
        flaws = report.flaws
        wrong = flaws.flips + flaws.crossing + (flaws.overlap > 0) + (flaws.sparse > 0.02)
        row = [path.name, scene.n_faces, report.pieces, report.charts, f"{seconds:.2f}"]
        row += [f"{1e3 * seconds / scene.n_faces:.2f}", int(wrong)]
        if peer:
            charts, theirs = with_xatlas(scene)
            row += [charts, f"{theirs:.2f}"]
            totals += seconds, theirs
        print(*row, sep="  ", flush=True)
    if peer:
        print(f"all: {totals[0]:.1f} s, xatlas {totals[1]:.1f} s")


if __name__ == "__main__":
    main()
