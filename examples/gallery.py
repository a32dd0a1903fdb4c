"""What the gallery's scripts share: arguments, a descent that is watched, tables and pictures."""

from __future__ import annotations

import argparse
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import phaseatlas as pa
from phaseatlas import optimise
from phaseatlas.functionals import Area, Connectedness, Distortion, Perimeter


def parser(script: str, description: str) -> argparse.ArgumentParser:
    """Arguments of every script: where the picture goes, and whether a small one will do."""
    result = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    result.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path(Path(script).stem),
        help="where the picture is written; %(default)s by default",
    )
    result.add_argument("--quick", action="store_true", help="coarse meshes, in seconds")
    return result


def descend(
    surface,
    epsilon,
    u,
    steps,
    *,
    connected=True,
    distortion=0.0,
    law="sharp",
    area="lagrangian",
    weight=None,
):
    """Minimise problem (6), (10) or (13) at one epsilon and keep the fields on the way.

    Parameters
    ----------
    surface : Surface
        Of unit area, or epsilon and omega mean something else.
    epsilon, u
        Interface width and start (n,).
    steps : sequence of int
        Numbers of the steps after which the field is kept; 0 is the start.
    connected, distortion, law, area, weight
        As in `segment` and the functionals.

    Returns
    -------
    list of (n,) arrays
        One for each of the steps that were reached, and the minimiser.
    int
        Number of the last step.
    """
    perimeter = Perimeter(surface, epsilon, weight=weight)
    terms = [(1.0, perimeter)]
    if connected:
        terms.append((1.0 / epsilon, Connectedness(surface, epsilon, weight=weight)))
    if distortion > 0:
        terms.append((distortion, Distortion(surface, epsilon, law=law, weight=weight)))
    halves = Area(surface, epsilon, weight=weight)
    kept = {0: np.array(u)}

    def keep(iteration):
        if iteration.number in steps:
            kept[iteration.number] = iteration.u

    result = optimise.minimise(
        terms,
        halves,
        0.5 * halves.total,
        u,
        scale=np.sqrt(perimeter.preconditioner()),
        area=area,
        callback=keep,
    )
    return [kept[step] for step in steps if step in kept] + [result.u], result.iterations


def count_pieces(surface, labels):
    """Number of connected pieces of each segment, given the label of each face (m,)."""
    near = surface.face_neighbours
    face, side = np.nonzero((near >= 0) & (labels[near] == labels[:, None]))
    graph = coo_array(
        (np.ones(len(face)), (face, near[face, side])), shape=(surface.n_faces, surface.n_faces)
    )
    _, piece = connected_components(graph, directed=False)
    _, first = np.unique(piece, return_index=True)
    return np.bincount(labels[first])


def phase_pieces(surface, u, faces=None):
    """Pieces of the faces with u >= 0 on average and of the others, among `faces` (m,) bool."""
    labels = np.where(surface.face_mean(u) >= 0, 0, 1)
    if faces is not None:
        labels[~faces] = 2
    return count_pieces(surface, labels)[:2]


def table(rows: Sequence[dict[str, object]]) -> None:
    """Print rows of named numbers in columns."""
    cells = [list(rows[0])] + [
        [f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows
    ]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        print("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip())


def planar(chart) -> pa.Surface:
    """A chart of an atlas as a flat surface, to draw its map to the plane."""
    return pa.Surface(np.column_stack([chart.uv, np.zeros(len(chart.uv))]), chart.triangles)


def save(folder: Path, name: str, rows: Sequence[Sequence[tuple[np.ndarray, str]]]) -> None:
    """Write rows of images with captions to `folder`/`name`.png, with a palette, and say so.

    All rows get the width of the widest.
    """
    gap, text, dpi = 16, 30, 100.0
    width = max(sum(image.shape[1] + gap for image, _ in row) + gap for row in rows)
    height = sum(max(image.shape[0] for image, _ in row) + gap + text for row in rows)
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    top = 0
    for row in rows:
        tallest = max(image.shape[0] for image, _ in row)
        space = (width - sum(image.shape[1] for image, _ in row)) / (len(row) + 1)
        left = space
        for image, caption in row:
            h, w = image.shape[:2]
            below = height - top - gap - tallest + (tallest - h) / 2
            axes = figure.add_axes((left / width, below / height, w / width, h / height))
            axes.imshow(image, interpolation="none", aspect="auto")
            axes.set_axis_off()
            foot = 1 - (top + gap + tallest + text / 2) / height
            figure.text((left + w / 2) / width, foot, caption, ha="center", va="center", size=11)
            left += w + space
        top += tallest + gap + text
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    # A palette makes a third of the file; it is dithered, or shading shows as rings.
    picture = Image.open(buffer).convert("RGB")
    palette = picture.quantize(256, method=Image.Quantize.MAXCOVERAGE)
    picture.quantize(palette=palette).save(path, optimize=True)
    print(f"wrote {path}")
