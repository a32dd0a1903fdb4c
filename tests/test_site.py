"""The site has a page for every public name, and says what every option and every figure means."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import phaseatlas as pa

DOCS = Path(__file__).parents[1] / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("plot_*.py"))


@pytest.fixture(scope="module")
def written():
    """The module that writes pages from the code."""
    sys.path.insert(0, str(DOCS / "_ext"))
    import written

    yield written
    sys.path.remove(str(DOCS / "_ext"))


def help_of(*command):
    run = [sys.executable, "-m", "phaseatlas", *command, "--help"]
    return subprocess.run(run, capture_output=True, text=True, check=True).stdout


def test_every_public_name_has_a_page(written):
    listed = re.findall(r"^   ([\w.]+)$", written.reference_page(), flags=re.MULTILINE)
    modules = {name.partition(".")[0] for name in listed if "." in name}
    missing = [n for n in pa.__all__ if n not in listed and n not in modules]
    assert missing == ["__version__"]
    assert len(listed) == len(set(listed))
    # Documented modules are listed by their own public names.
    for module in ("functionals", "datasets", "plot"):
        names = {name.removeprefix(f"{module}.") for name in listed if name.startswith(module)}
        assert names == set(getattr(pa, module).__all__)


def test_every_option_is_on_the_page_of_options(written):
    sections = re.split(r"^\.\. program:: (.*)$", written.options_page(), flags=re.MULTILINE)
    pages = dict(zip(sections[1::2], sections[2::2], strict=True))
    listed = help_of()
    commands = re.findall(r"^  (\w+)", listed.partition("Commands:")[2], flags=re.MULTILINE)
    assert {f"phaseatlas {name}" for name in commands} | {"phaseatlas"} == set(pages)
    for name, page in pages.items():
        options = re.findall(r"^\.\. option:: (.*)$", page, flags=re.MULTILINE)
        found = {word for line in options for word in re.findall(r"--?[a-z][a-z-]*", line)}
        lines = re.findall(r"^  (-.*?)(?:  |$)", help_of(*name.split()[1:]), flags=re.MULTILINE)
        said = {word for line in lines for word in re.findall(r"(?<!\w)--?[a-z][a-z-]*", line)}
        assert found == said
        # What an option means follows it.
        assert not re.search(r"option:: .*\n\n(?!   \S)", page)


def test_every_figure_is_defined():
    page = (DOCS / "metrics.md").read_text(encoding="utf-8")
    titles = re.findall(r"^### `(\w+)`\n\n\S", page, flags=re.MULTILINE)
    rows = re.findall(r"^\| \[`(\w+)`\]", page, flags=re.MULTILINE)
    surface = pa.datasets.rounded_cube(4)
    labels = (surface.face_mean(surface.vertices[:, 2]) > 0).astype(int)
    figures = pa.build_atlas(pa.Segmentation(surface, labels)).metrics()
    assert titles == rows == list(figures)


def test_every_key_of_a_file_is_defined(tmp_path):
    ball = pa.datasets.icosphere(2)
    ball = ball.with_seam_costs(np.full((ball.n_faces, 3), 2.0), np.full(ball.n_vertices, 2.0))
    two = trimesh.Trimesh(ball.vertices, ball.faces, process=False)
    two = trimesh.util.concatenate([two, two.copy().apply_translation([9, 0, 0])])
    two.export(tmp_path / "two.obj")
    scene = pa.load_scene(tmp_path / "two.obj")
    scene = scene.with_seam_costs(np.full((scene.n_faces, 3), 2.0), np.full(scene.n_vertices, 2.0))
    pa.segment(ball, 1).save(tmp_path / "1.npz")
    pa.segment(scene, 2).save(tmp_path / "2.npz")
    pa.build_atlas(pa.SceneSegmentation.load(tmp_path / "2.npz")).save(tmp_path / "3.npz")
    page = (DOCS / "files.md").read_text(encoding="utf-8")
    sections = re.split(r"^## ", page, flags=re.MULTILINE)
    sections = [section for section in sections if section.startswith("`.npz`")]
    for number, section in enumerate(sections, start=1):
        with np.load(tmp_path / f"{number}.npz") as file:
            assert file["format"] == number
            keys = {re.sub(r"^(tree_)\d+_.*|^(mesh_).*", r"\1\2", key) for key in file.files}
        column = "".join(re.findall(r"^\|([^|]*)\|", section, flags=re.MULTILINE))
        said = {re.sub(r"K?_?\.\.\.$", "", name) for name in re.findall(r"`([\w.]+)`", column)}
        assert {key.rstrip("_") for key in keys} == {name.rstrip("_") for name in said}
    assert len(sections) == 3


@pytest.mark.parametrize("script", TUTORIALS, ids=lambda path: path.stem)
def test_tutorials_run(script, tmp_path):
    environment = os.environ | {"MPLBACKEND": "agg", "TMPDIR": str(tmp_path)}
    run = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, env=environment
    )
    assert run.returncode == 0, run.stderr
