import os
import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import phaseatlas as pa
from phaseatlas import segmentation


def run(*arguments, **options):
    command = [sys.executable, "-m", "phaseatlas", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def write_obj(path, vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def model(tmp_path):
    surface = pa.datasets.starfish(3)
    path = tmp_path / "model.obj"
    write_obj(path, surface.vertices, surface.faces)
    return path


TETRAHEDRON = (
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
)


def bad_meshes():
    vertices, faces = TETRAHEDRON
    shifted = [[x + 5, y, z] for x, y, z in vertices]
    return {
        "nan": ([[0, 0, "nan"], *vertices[1:]], faces, r"vertices\[0\]"),
        "non-manifold": (
            [*vertices, [1, 1, 1]],
            [*faces, [0, 1, 4]],
            r"edge \(0, 1\)",
        ),
        "flipped": (vertices, [*faces[:3], [1, 3, 2]], "orientation"),
        "degenerate": (vertices, [*faces, [1, 1, 2]], r"faces\[4\]: degenerate"),
        "two": (vertices + shifted, faces + [[v + 4 for v in f] for f in faces], "2 components"),
        "points": (vertices, [], "no faces"),
    }


@pytest.mark.parametrize("kind", sorted(bad_meshes()))
@pytest.mark.parametrize("command", ["segment", "atlas", "remesh", "info"])
def test_bad_meshes_give_one_line_and_no_file(tmp_path, kind, command):
    vertices, faces, culprit = bad_meshes()[kind]
    mesh = tmp_path / "bad.obj"
    write_obj(mesh, vertices, faces)
    check_refused(tmp_path, mesh, command, culprit)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
@pytest.mark.parametrize("content", ["empty", "random"])
def test_bad_files_give_one_line_and_no_file(tmp_path, suffix, content):
    mesh = tmp_path / f"bad.{suffix}"
    mesh.write_bytes(b"" if content == "empty" else np.random.default_rng(0).bytes(5000))
    check_refused(tmp_path, mesh, "segment", "empty file" if content == "empty" else "bad")


def check_refused(folder, mesh, command, culprit):
    suffixes = {"segment": "npz", "atlas": "glb", "remesh": "ply"}
    output = {name: ["-o", folder / f"out.{suffix}"] for name, suffix in suffixes.items()}
    result = run(command, mesh, *output.get(command, []))
    assert result.returncode == 1
    assert "panic" not in result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"phaseatlas: {mesh}")
    assert re.search(culprit, lines[0])
    assert sorted(p.name for p in folder.iterdir()) == [mesh.name]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["segment", "missing.obj", "-o", "a.npz"], "no such file"),
        (["segment", "model.obj", "-o", "a.txt"], "must end in"),
        (["atlas", "model.obj", "-o", "nowhere/a.glb"], "does not exist"),
        (["segment", "model.obj", "-o", "a.npz", "--levels", "0"], "levels"),
        (["segment", "model.obj", "-o", "a.npz", "--epsilon", "-1"], "epsilon"),
        (["segment", "model.obj", "-o", "a.npz", "--epsilon", "nan"], "epsilon"),
        (["atlas", "model.obj", "-o", "a.glb", "--texture", "missing.png"], "missing.png"),
    ],
)
def test_bad_arguments(model, arguments, words):
    before = sorted(model.parent.iterdir())
    result = run(*arguments, cwd=model.parent)
    assert result.returncode != 0
    assert words in result.stderr
    assert sorted(model.parent.iterdir()) == before


def test_segment_and_atlas(model):
    folder = model.parent
    result = run("segment", model, "-o", folder / "a.npz", "--levels", 2, "--seed", 3)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    tree = segmentation.SegmentTree.load(folder / "a.npz")
    expected = pa.segment(pa.load(model), 2, seed=3)
    assert np.array_equal(tree.labels, expected.labels)
    assert run("segment", model, "-o", folder / "a.ply", "--levels", 1).returncode == 0
    assert len(trimesh.load(folder / "a.ply", process=False).faces) == tree.surface.n_faces
    result = run("atlas", model, "-o", folder / "a.glb", "--levels", 1, "--resolution", 128)
    assert result.returncode == 0, result.stderr
    assert "flips 0" in result.stdout
    assert (folder / "a.glb").stat().st_size > 0


def test_segment_with_ipopt(model):
    pytest.importorskip("ipyopt", reason="needs the extra ipopt")
    output = model.parent / "a.npz"
    result = run("segment", model, "-o", output, "--levels", 1, "--solver", "ipopt")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    expected = pa.segment(pa.load(model), 1, solver="ipopt")
    assert np.array_equal(segmentation.SegmentTree.load(output).fields, expected.fields)


def test_demo(tmp_path):
    result = run("demo", tmp_path / "out", "--levels", 1)
    assert result.returncode == 0, result.stderr
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["segments.png", "starfish.glb", "uv.png"]
    for word in ("segment", "interface length", "hencky", "seconds"):
        assert word in result.stdout


def test_missing_extra_is_one_line(model):
    (model.parent / "mmgpy.py").write_text("raise ImportError\n")
    environment = {**os.environ, "PYTHONPATH": str(model.parent)}
    result = run("remesh", model, "-o", model.parent / "a.obj", env=environment)
    assert result.returncode == 1
    assert len(result.stderr.strip().splitlines()) == 1
    assert "pip install 'phaseatlas[remesh]'" in result.stderr
    assert not (model.parent / "a.obj").exists()


@pytest.mark.parametrize("command", ["segment", "atlas", "remesh", "info", "demo"])
def test_help(command):
    result = run(command, "--help", env={"COLUMNS": "200", "PATH": ""})
    assert result.returncode == 0
    assert command in result.stdout


def test_distortion_with_free_areas_and_the_printed_law(tmp_path, model):
    out = tmp_path / "out.npz"
    options = ["--levels", 1, "--distortion", 3, "--no-connected"]
    result = run("segment", model, "-o", out, *options)
    assert result.returncode == 0, result.stderr
    kept = pa.SegmentTree.load(out)
    result = run("segment", model, "-o", out, *options, "--area", "none", "--law", "paper")
    assert result.returncode == 0, result.stderr
    free = pa.SegmentTree.load(out)
    assert abs(kept.diagnostics[0].violation) < 1e-5 < abs(free.diagnostics[0].violation)
