"""What the commands print: surfaces, segments, figures of an atlas, the progress of a solve."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..meanings import METRICS
from .process import complain, on_terminal, say, verbose

if TYPE_CHECKING:
    from pathlib import Path

    from ..atlas import Atlas
    from ..batching import BatchProgress, BatchResult
    from ..partitioning import Phase
    from ..scene.mesh import Mesh
    from ..scene.scene import Scene
    from ..segmentation import Progress, Segmentation, SegmentTree
    from ..surface import Surface

__all__ = [
    "meshes",
    "phases",
    "progress",
    "say_batch",
    "say_meshes",
    "say_metrics",
    "say_pages",
    "say_segmentation",
    "say_surface",
    "say_tree",
    "say_written",
]

# What is drawn of a state: how much is done of how much, and words; without a total the bar pulses.
_Drawn = tuple[int, int | None, str]


@contextmanager
def progress(levels: int | None) -> Iterator[Callable[[Progress], None] | None]:
    """Give a callback that draws a bar on the error stream, or none where that is no terminal.

    Without levels the bar pulses.
    """

    def drawn(state: Progress) -> _Drawn:
        words = f"iteration {state.iteration}, energy {state.energy:.6f}"
        number, width = state.node + 1, 2 ** (state.level - 1)
        if levels is None:
            # Of segments of any shares some levels have fewer nodes.
            words = f"level {state.level}, node {number}, {words}"
            return 0, None, words
        words = f"level {state.level} of {levels}, node {number} of {width}, {words}"
        return width - 1 + state.node, 2**levels - 1, words

    with _bar() as draw:
        yield None if draw is None else lambda state: draw(drawn(state))


@contextmanager
def phases() -> Iterator[Callable[[Phase], None] | None]:
    """Give a callback that draws the phases of a partition, as `progress` does."""

    def drawn(phase: Phase) -> _Drawn:
        words = f"{phase.name}, {phase.n_charts} charts, energy {phase.energy:.3f}"
        return 0, None, words

    with _bar() as draw:
        yield None if draw is None else lambda phase: draw(drawn(phase))


@contextmanager
def meshes() -> Iterator[Callable[[BatchProgress], None]]:
    """Give a callback that draws how far a batch is, or prints a line for each mesh."""
    failures = 0

    with _bar() as draw:

        def tell(state: BatchProgress) -> None:
            nonlocal failures
            record = state.record
            failures += record is not None and "error" in record
            if draw is not None:
                bad = f", {failures} failed" if failures else ""
                draw((state.done, state.total, f"{state.done} of {state.total} meshes{bad}"))
            elif record is not None:
                made = (
                    record.get("error") or f"{record['charts']} charts, {record['seconds']:.1f} s"
                )
                say(f"{state.done}/{state.total} {' '.join(record['input'].split())}: {made}")

        yield tell


@contextmanager
def _bar() -> Iterator[Callable[[_Drawn], None] | None]:
    if verbose():
        yield _told()
        return
    if not on_terminal():
        yield None
        return
    # Imported for the bar alone.
    import rich.console
    import rich.progress

    bar = rich.progress.Progress(
        rich.progress.BarColumn(),
        rich.progress.TextColumn("{task.description}"),
        rich.progress.TimeElapsedColumn(),
        rich.progress.TimeRemainingColumn(),
        console=rich.console.Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("")

        def draw(drawn: _Drawn) -> None:
            completed, total, words = drawn
            bar.update(task, total=total, completed=completed, description=words)

        yield draw


def _told() -> Callable[[_Drawn], None]:
    """Give a callback that prints a line for each new step, and one a second within it."""
    start = last = time.perf_counter()
    step: tuple[int, str] | None = None

    def tell(drawn: _Drawn) -> None:
        nonlocal last, step
        completed, _, words = drawn
        now = time.perf_counter()
        reached = completed, words.partition(",")[0]
        if reached != step or now - last >= 1:
            complain(f"{now - start:.1f} s: {words}")
            last, step = now, reached

    return tell


def say_batch(result: BatchResult) -> None:
    """Print what became of the meshes of a batch."""
    made = len(result.records) - len(result.failed) - result.skipped
    _say_pairs(
        {
            "meshes": f"{len(result.records)}",
            "finished before": f"{result.skipped}",
            "made": f"{made}",
            "failed": f"{len(result.failed)}",
        }
    )


def say_surface(surface: Surface) -> None:
    """Print size, topology, area, edge lengths and quality of a surface."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    _say_pairs(
        {
            "vertices": f"{surface.n_vertices}",
            "faces": f"{surface.n_faces}",
            "genus": f"{surface.genus}",
            "boundary loops": f"{surface.n_boundary_loops}",
            "area": f"{surface.area:.6g}",
            "extent": " x ".join(f"{side:.6g}" for side in high - low),
            "mean edge length": f"{surface.mean_edge_length:.6g}",
            "worst face quality": f"{surface.face_quality.min():.3g} (1 = equilateral)",
            "default epsilon": f"{2 * surface.mean_edge_length:.6g}",
        }
    )


def say_meshes(meshes: Sequence[Mesh], scene: Scene) -> None:
    """Print a line for each mesh of a file: what it carries beside its surface."""
    _say_table(
        ("mesh", "faces", "components", "UV sets", "colours", "instances", "materials"),
        [
            (
                " ".join(mesh.name.split()) or f"{number}",
                f"{placed.repaired.report.faces}",
                f"{placed.repaired.report.components}",
                f"{mesh.uv_sets}",
                "yes" if mesh.vertex_colours else "no",
                f"{len(mesh.transforms)}",
                " ".join(", ".join(mesh.materials).split()) or "none",
            )
            for number, (mesh, placed) in enumerate(zip(meshes, scene.meshes, strict=True))
        ],
    )


def say_tree(tree: SegmentTree) -> None:
    """Print the segments of a tree, the length between them and what was repaired."""
    shares = 100 * tree.areas / tree.surface.area
    _say_table(
        ("segment", "area", "share %", "components"),
        [
            (f"{leaf}", f"{area:.6g}", f"{share:.3f}", f"{parts}")
            for leaf, (area, share, parts) in enumerate(
                zip(tree.areas, shares, tree.components, strict=True)
            )
        ],
    )
    length = sum(d.length for d in tree.diagnostics)
    steps = sum(d.iterations for d in tree.diagnostics)
    violation = max(abs(d.violation) for d in tree.diagnostics)
    say(
        f"interface length (diffuse) {length:.6g} "
        f"({length / math.sqrt(tree.surface.area):.3f} sqrt(area)), "
        f"{steps} iterations, area constraint met to {violation:.1e}"
    )
    for d in tree.diagnostics:
        if d.repairs or d.relabelled_faces:
            say(
                f"level {d.level + 1}, node {d.node}: {d.components[0]} + {d.components[1]} "
                f"components, {d.repairs} rounds of repair, {d.relabelled_faces} faces relabelled "
                f"({100 * d.relabelled_area:.2g} % of the area)"
            )


def say_segmentation(segmentation: Segmentation) -> None:
    """Print the charts of a partition, the segments of a tree, or how many each piece has."""
    from ..segmentation import SceneSegmentation

    parts = segmentation.parts if isinstance(segmentation, SceneSegmentation) else ()
    trees = segmentation.trees if isinstance(segmentation, SceneSegmentation) else ()
    if len(parts) > 1:
        _say_pieces(segmentation, parts, trees)
    elif trees and trees[0] is not None:
        say_tree(trees[0])
    else:
        _say_charts(parts[0] if parts else segmentation)


def _say_charts(part: Segmentation) -> None:
    """Print what was minimised and what it is made of."""
    from ..partitioning import Partition

    shares = ", ".join(f"{100 * share:.2g}" for share in part.areas / part.surface.area)
    say(f"charts {part.n_segments}, shares of the area {shares} %")
    if isinstance(part, Partition) and part.diagnostics:
        last = part.diagnostics[-1]
        say(
            f"energy {last.energy:.4g}, seam {last.seam:.4g} sqrt(area), cuts {last.cuts:.4g} "
            f"sqrt(area), root mean square log scale {math.sqrt(last.distortion):.3g}, "
            f"{last.seconds:.2f} s"
        )


def _say_pieces(
    segmentation: Segmentation,
    parts: Sequence[Segmentation],
    trees: Sequence[SegmentTree | None],
) -> None:
    shares = segmentation.areas / segmentation.surface.area
    line = (
        f"pieces {len(parts)}, segments {segmentation.n_segments}, shares of the area "
        f"{100 * shares.min():.2g} to {100 * shares.max():.2g} %"
    )
    if trees:
        # Whole segments are given out to the pieces: equal shares are those within each.
        off = max(
            float(abs(part.areas * part.n_segments / part.surface.area - 1).max()) for part in parts
        )
        line += (
            f", {100 / len(shares):.2g} % if equal; within a piece at most {100 * off:.2g} % off"
        )
    say(line)


def say_cut(before: Scene, after: Scene) -> None:
    """Print that the mesh is a new one, and what of the old one it has no more."""
    gone = sum(mesh.repaired.report.degenerate_faces for mesh in before.meshes)
    left_out = f"; {gone} without area are left out" if gone else ""
    say(
        f"cut: the mesh is a new one, {before.n_faces} triangles before and {after.n_faces} after"
        f"{left_out}"
    )


def say_metrics(atlas: Atlas) -> None:
    """Print the figures of an atlas, and on a terminal what each means."""
    found = {name: f"{value:.4g}" for name, value in atlas.metrics().items()}
    if not sys.stdout.isatty():
        _say_pairs(found)
        return
    names, values = (max(map(len, each)) for each in (found, found.values()))
    say(*(f"{name:{names}}  {value:>{values}}  {METRICS[name]}" for name, value in found.items()))


def say_pages(atlas: Atlas) -> None:
    """Print how many textures an atlas has, how large they are and how dense."""
    pairs = {
        "pages": f"{atlas.n_pages}",
        "resolution": f"{atlas.resolution} texels a side",
        "density": f"{atlas.density:.6g} texels a unit",
    }
    if stacked := atlas.diagnostics.stacked:
        pairs["stacked"] = f"{stacked} faces over their mirror images"
    _say_pairs(pairs)


def say_written(*files: Path) -> None:
    """Print the files that were written."""
    say(*(f"wrote {file}" for file in files))


def _say_pairs(pairs: Mapping[str, str]) -> None:
    if not sys.stdout.isatty():
        say(*(f"{name}: {value}" for name, value in pairs.items()))
        return
    width = max(map(len, pairs))
    say(*(f"{name:{width}}  {value}" for name, value in pairs.items()))


def _say_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on a terminal, and in a pipe a line a row, which starts with its name."""
    if not sys.stdout.isatty():
        kind, *others = headings
        for name, *cells in rows:
            said = (f"{head} {cell}" for head, cell in zip(others, cells, strict=True))
            say(f"{kind} {name}: {', '.join(said)}")
        return
    widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
    for row in (headings, *rows):
        say("  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)))
