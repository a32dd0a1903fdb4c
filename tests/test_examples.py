"""The gallery's scripts run, draw, and print numbers that show what their figures claim."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def run(tmp_path):
    """``run("figure2")`` is what the script prints; its picture is there and has content."""

    def script(figure, *options):
        (path,) = EXAMPLES.glob(f"plot_{figure}_*.py")
        command = [sys.executable, path, tmp_path / "out", "--quick", *options]
        printed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert printed.returncode == 0, printed.stderr
        assert [entry.name for entry in (tmp_path / "out").iterdir()] == [f"{figure}.png"]
        with Image.open(tmp_path / "out" / f"{figure}.png") as image:
            assert len(image.convert("RGB").getcolors(1 << 24)) > 64
        return printed.stdout

    return script


def tables(printed):
    """Tables of a script's output, each a list of rows {column: cell}."""
    lines = [re.split(r" {2,}", line) for line in printed.splitlines()]
    groups = [list(group) for _, group in itertools.groupby(lines, key=len)]
    return [
        [dict(zip(names, cells, strict=True)) for cells in rows]
        for names, *rows in groups
        if len(names) > 1 and rows
    ]


def numbers(rows, column):
    return [float(row[column]) for row in rows]


def test_charts_are_bijections_of_little_stretch(run):
    (rows,) = tables(run("charts"))
    assert numbers(rows, "flips") == numbers(rows, "overlap") == [0]
    assert numbers(rows, "charts")[0] <= 6
    assert numbers(rows, "seam")[0] < 8
    assert numbers(rows, "hencky")[0] < 2e-3


def test_figure2_width_follows_epsilon_and_pieces_join(run):
    sweep, flow = tables(run("figure2"))
    assert numbers(sweep, "width/epsilon") == pytest.approx([2.8, 2.8, 2.8], rel=0.08)
    assert numbers(sweep, "length") == pytest.approx([6.283] * 3, rel=0.03)
    pieces = [int(row["red pieces"]) + int(row["blue pieces"]) for row in flow]
    assert pieces[0] > 2
    assert pieces[-1] == 2


def test_figure3_segments_halve(run):
    (rows,) = tables(run("figure3"))
    assert numbers(rows, "segments") == numbers(rows, "pieces") == [2, 4, 8]
    assert min(numbers(rows, "smallest area x 2^K")) > 0.99


def test_figure4_connectedness_joins_the_rings(run):
    torus, level = tables(run("figure4"))
    assert [(row["red pieces"], row["blue pieces"]) for row in torus] == [("2", "2"), ("1", "1")]
    assert numbers(torus, "length")[0] == pytest.approx(2 * numbers(torus, "length")[1], rel=0.01)
    assert int(level[0]["red pieces"]) + int(level[0]["blue pieces"]) > 2
    assert (level[-1]["red pieces"], level[-1]["blue pieces"]) == ("1", "1")


def test_figure5_blending_hides_the_seams(run):
    atlases, textures, steps = tables(run("figure5"))
    assert numbers(atlases, "charts") == numbers(atlases, "pieces") == [4, 8, 16]
    assert numbers(atlases, "flips") == [0, 0, 0]
    # More charts, less distortion.
    assert numbers(atlases, "hencky") == sorted(numbers(atlases, "hencky"), reverse=True)
    thresholded, blended = numbers(textures, "jump at the seams")
    assert blended < 0.4 * thresholded
    assert (steps[-1]["red pieces"], steps[-1]["blue pieces"]) == ("1", "1")


def test_figure6_trades_length_for_distortion(run):
    (rows,) = tables(run("figure6", "--law", "sharp"))
    for connected in ("without", "with"):
        series = [row for row in rows if row["C"] == connected]
        assert numbers(series, "length") == sorted(numbers(series, "length"))
        assert numbers(series, "J") == sorted(numbers(series, "J"), reverse=True)
    assert [(row["red pieces"], row["blue pieces"]) for row in series] == [("1", "1")] * 3


def test_figure7_the_border_moves_to_the_bumps(run):
    (rows,) = tables(run("figure7"))
    straight = [row for row in rows if row["start"] == "straight"]
    assert numbers(straight, "J")[-1] < 0.9 * numbers(straight, "J")[0]
    curvature = numbers(straight, "mean |K| on the interface")
    assert curvature[-1] > 1.2 * curvature[0]


def test_figure8_the_border_crosses_the_corners(run):
    (rows,) = tables(run("figure8"))
    assert numbers(rows, "pieces") == [2, 2]
    # A border that does not care would meet the mean curvature of the cube.
    assert numbers(rows, "mean K on the interface")[0] < 0.01
    assert numbers(rows, "mean K on the interface")[1] > 0.706
    assert numbers(rows, "hencky")[1] < 0.5 * numbers(rows, "hencky")[0]


def test_figure9_the_border_seeks_negative_curvature(run, mesh_path):
    (rows,) = tables(run("figure9", "--model", mesh_path("fertility")))
    plain, distorted = rows
    assert float(distorted["mean K there"]) < float(plain["mean K there"])


def test_figure9_says_that_the_mesh_is_missing(tmp_path):
    script = EXAMPLES / "plot_figure9_fertility.py"
    command = [sys.executable, script, tmp_path, "--model", "nothing.obj"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed == "skipped: there is no nothing.obj; give the mesh with --model\n"
    assert not list(tmp_path.iterdir())
