"""Where seams may run, read from files: attributes, lists of edges, regions by name or number."""

from __future__ import annotations

import json
import struct
import subprocess
import sys

import numpy as np
import pytest

import gltf_samples as samples
import phaseatlas as pa
from phaseatlas.scene.document import read_document
from phaseatlas.scene.scene import scene_in
from phaseatlas.scene.wishes import Wishes, granted


def run(*arguments):
    command = [sys.executable, "-m", "phaseatlas", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def ball():
    return pa.datasets.icosphere(2)


def cost_of(vertices):
    return 2.0 + np.asarray(vertices)[:, 2]


def write_ply(path, **columns):
    """A sphere with properties of its vertices and, by names that start with face_, its faces."""
    surface = ball()
    of_faces = {k[5:]: v for k, v in columns.items() if k.startswith("face_")}
    of_vertices = {k: v for k, v in columns.items() if not k.startswith("face_")}
    lines = ["ply", "format ascii 1.0", f"element vertex {surface.n_vertices}"]
    lines += [f"property double {name}" for name in ("x", "y", "z", *of_vertices)]
    lines += [f"element face {surface.n_faces}", "property list uchar int vertex_indices"]
    lines += [f"property int {name}" for name in of_faces] + ["end_header"]
    rows = np.column_stack([surface.vertices, *of_vertices.values()])
    lines += [" ".join(map(repr, row)) for row in rows.tolist()]
    rows = np.column_stack([np.full(surface.n_faces, 3), surface.faces, *of_faces.values()])
    lines += [" ".join(map(str, row)) for row in rows.astype(int).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return surface


def write_glb(path, **attributes):
    surface = ball()
    build = samples.Builder()
    accessors = {"POSITION": build.add(np.asarray(surface.vertices, dtype=np.float32))}
    accessors |= {name: build.add(values) for name, values in attributes.items()}
    indices = build.add(surface.faces.reshape(-1).astype(np.uint32))
    primitives = [{"attributes": accessors, "indices": indices, "material": 0}]
    document = build.document(
        meshes=[{"name": "ball", "primitives": primitives}],
        materials=[{"name": "skin"}],
        nodes=[{"mesh": 0}],
        scenes=[{"nodes": [0]}],
    )
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob = build.blob + bytes(-len(build.blob) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text
    parts += struct.pack("<II", len(blob), 0x004E4942) + blob
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(parts)) + parts)
    return surface


def scene_with(path, **wishes):
    document = read_document(path)
    return granted(document, scene_in(document), Wishes(**wishes))


def test_a_property_of_a_ply_file_is_the_factor(tmp_path):
    path = tmp_path / "ball.ply"
    surface = write_ply(path, cost=cost_of(ball().vertices))
    scene = scene_with(path, seam_cost="cost")
    np.testing.assert_array_equal(scene.vertex_seam_costs, cost_of(surface.vertices))
    assert scene.seam_costs is None


@pytest.mark.parametrize("name", ["_COST", "COST", "cost"])
def test_an_attribute_of_a_glb_file_is_the_factor(tmp_path, name):
    path = tmp_path / "ball.glb"
    cost = cost_of(ball().vertices).astype(np.float32)
    write_glb(path, _COST=cost)
    scene = scene_with(path, seam_cost=name)
    np.testing.assert_array_equal(scene.vertex_seam_costs, cost)


def test_the_red_of_colours_is_the_factor(tmp_path):
    path = tmp_path / "ball.glb"
    colours = np.random.default_rng(0).uniform(0.1, 1.0, (162, 3)).astype(np.float32)
    write_glb(path, COLOR_0=colours)
    scene = scene_with(path, seam_cost="COLOR_0")
    np.testing.assert_array_equal(scene.vertex_seam_costs, colours[:, 0])
    path = tmp_path / "ball.ply"
    red, green, blue = colours.T.astype(np.float64)
    write_ply(path, red=red, green=green, blue=blue)
    for name in ("red", "COLOR_0"):
        np.testing.assert_array_equal(scene_with(path, seam_cost=name).vertex_seam_costs, red)


def test_meshes_without_the_attribute_have_the_length(tmp_path):
    path = tmp_path / "two.glb"
    write_glb(path, _COST=np.full(162, 3.0, dtype=np.float32))
    gltf = read_document(path).source.gltf
    assert gltf.json["meshes"][0]["name"] == "ball"
    scene = scene_with(path, seam_cost="_COST")
    assert (scene.vertex_seam_costs == 3).all()


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("seam_cost", "weight", r"seam_cost: 'weight' must be a vertex attribute of the file; it"),
        ("seam_cost", "bad", r"seam_cost: bad is -1 somewhere; must be positive"),
        ("keep", ("lid",), r"keep: 'lid' must be a file of polygon numbers, or the name of a"),
    ],
)
def test_bad_names_are_said(tmp_path, option, value, message):
    path = tmp_path / "ball.ply"
    write_ply(path, bad=np.r_[np.ones(161), -1.0])
    with pytest.raises(ValueError, match=message):
        scene_with(path, **{option: value})


def test_regions_by_name_and_by_number(tmp_path):
    path = tmp_path / "ball.ply"
    upper = ball().face_mean(ball().vertices)[:, 2] > 0.5
    write_ply(path, face_lid=upper)
    numbers = tmp_path / "lid.txt"
    numbers.write_text("# the lid\n" + "\n".join(map(str, np.flatnonzero(upper))))
    inside = upper[:, None] & upper[ball().face_neighbours]
    for region in ("lid", str(numbers)):
        scene = scene_with(path, keep=(region,))
        np.testing.assert_array_equal(np.isinf(scene.seam_costs), inside)
        # Phase fields and simplified surfaces see it at the vertices.
        assert set(np.unique(scene.vertex_seam_costs)) == {1.0, 20.0}
    glb = tmp_path / "ball.glb"
    write_glb(glb)
    for region in ("skin", "ball"):
        assert np.isinf(scene_with(glb, keep=(region,)).seam_costs).all()


def test_regions_that_overlap_have_the_factor_once(tmp_path):
    path = tmp_path / "ball.ply"
    height = ball().face_mean(ball().vertices)[:, 2]
    write_ply(path, face_lid=height > 0.2, face_cap=height > 0.5, face_band=abs(height) < 0.6)
    scene = scene_with(path, keep=("lid", "cap", "band"))
    assert set(np.unique(scene.vertex_seam_costs)) == {1.0, 20.0}


def equator():
    surface = ball()
    upper = surface.face_mean(surface.vertices)[:, 2] > 0
    f, k = np.nonzero(upper[:, None] & ~upper[surface.face_neighbours])
    return np.stack([surface.faces[f, k], surface.faces[f, (k + 1) % 3]], axis=1), upper


def test_edges_by_number_and_by_place(tmp_path):
    path = tmp_path / "ball.ply"
    surface = write_ply(path)
    pairs, _ = equator()
    text = tmp_path / "seams.txt"
    text.write_text("\n".join(f"{a} {b}  # an edge" for a, b in pairs))
    drawn = tmp_path / "seams.obj"
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in surface.vertices]
    drawn.write_text("\n".join([*lines, *(f"l {a + 1} {b + 1}" for a, b in pairs)]))
    for file in (text, drawn):
        scene = scene_with(path, seams=file)
        assert len(scene.pieces) == 2
        assert scene.n_vertices == surface.n_vertices + len(pairs)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", "0 1\n0 999\n", r"a\.txt, line 2: vertex 999 must be in 0\.\.161$"),
        ("b.txt", "\n\n3\n", r"b\.txt, line 3: must have at least two vertices$"),
        ("c.txt", "0 x\n", r"c\.txt, line 1: must have whole numbers alone$"),
        ("d.txt", "# none\n", r"d\.txt must have numbers$"),
        ("e.txt", "0 1 161\n", r"e\.txt, line 1: no edge joins 0 and 1$"),
        ("f.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n", r"f\.obj: no vertex is where its vertex 1 is$"),
        ("g.obj", "v 0 0 0\n", r"g\.obj must have lines, elements l$"),
        ("h.obj", "v 0 0 0\nl 1 9\n", r"h\.obj, line 2: cannot be read$"),
        ("i.obj", "v 0 0 0\nv 0 0\nl 1 2\n", r"i\.obj, line 2: cannot be read$"),
        ("j.obj", "v nan 0 0\nv 0 0 1\nl 1 2\n", r"j\.obj, line 1: cannot be read$"),
    ],
)
def test_bad_lists_of_edges_are_one_line(tmp_path, name, content, message):
    path, file = tmp_path / "ball.ply", tmp_path / name
    write_ply(path)
    file.write_text(content)
    with pytest.raises(ValueError, match=f"^seams: .*{message}"):
        scene_with(path, seams=file)


def test_edges_to_cut_and_regions_to_keep_exclude_each_other(tmp_path):
    path, file, region = tmp_path / "ball.ply", tmp_path / "cut.txt", tmp_path / "keep.txt"
    write_ply(path)
    pairs, _ = equator()
    file.write_text("\n".join(f"{a} {b}" for a, b in pairs))
    region.write_text(" ".join(map(str, range(320))))
    with pytest.raises(ValueError, match=r"^keep: .*keep\.txt must not have edges of .*cut\.txt"):
        scene_with(path, seams=file, keep=(str(region),))


def test_commands_take_the_wishes(tmp_path):
    path, file = tmp_path / "ball.ply", tmp_path / "cut.txt"
    pairs, upper = equator()
    write_ply(path, cost=cost_of(ball().vertices), face_lid=upper)
    file.write_text("\n".join(f"{a} {b}" for a, b in pairs))
    wishes = ["--seam-cost", "cost", "--seams", file, "--keep", "lid", "--creases", "60"]
    found = run("atlas", path, "-o", tmp_path / "out.ply", "--effort", "fast", *wishes)
    assert found.returncode == 0, found.stderr
    assert "pieces 2" in found.stdout
    found = run("segment", path, "-o", tmp_path / "out.npz", "--levels", "2", *wishes)
    assert found.returncode == 0, found.stderr
    loaded = pa.SceneSegmentation.load(tmp_path / "out.npz")
    assert np.isinf(loaded.surface.seam_costs).any()
    assert len(np.unique(loaded.labels[upper])) == 1
    assert loaded.surface.vertex_seam_costs.max() > 2
    for wrong in (
        ["--seam-cost", "no"],
        ["--seams", tmp_path / "none.txt"],
        ["--keep", "no"],
        ["--creases", "0"],
    ):
        found = run("atlas", path, "-o", tmp_path / "bad.ply", *wrong)
        assert found.returncode in (1, 2)
        assert len(found.stderr.splitlines()) == 1
        assert not (tmp_path / "bad.ply").exists()


def test_a_tree_file_keeps_the_factors(tmp_path):
    surface = ball()
    cost = cost_of(surface.vertices)
    tree = pa.segment(surface, 1, seam_cost=cost, creases=5.0)
    tree.save(tmp_path / "tree.npz")
    again = pa.SegmentTree.load(tmp_path / "tree.npz").surface
    np.testing.assert_array_equal(again.vertex_seam_costs, cost)
    np.testing.assert_array_equal(again.seam_costs, tree.surface.seam_costs)


@pytest.mark.parametrize(
    ("line", "words"), [("l 1 162", "1 and 162"), ("l -162/7 -1", "-162 and -1")]
)
def test_vertices_that_no_edge_joins_are_named_as_they_are_written(tmp_path, line, words):
    path, file = tmp_path / "ball.ply", tmp_path / "drawn.obj"
    write_ply(path)
    rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in ball().vertices]
    file.write_text("\n".join([*rows, line]))
    with pytest.raises(ValueError, match=rf"drawn\.obj, line 163: no edge joins {words}$"):
        scene_with(path, seams=file)
