"""Files of segments and of atlases, which are baked, packed and flattened without another solve."""

import dataclasses
import os

import numpy as np
import pytest
from PIL import Image

import phaseatlas as pa
from phaseatlas.atlas import Atlas
from phaseatlas.file_atlas import AtlasOptions, atlas_file


@pytest.fixture
def two(tmp_path):
    """An OBJ file of two spheres with names, materials and a second copy of a face."""
    sphere = pa.datasets.icosphere(2)
    lines = []
    for k, name in enumerate(("small", "large")):
        lines += [f"v {x + 4 * k} {y} {z}" for x, y, z in (1 + k) * sphere.vertices]
        lines += [f"o {name}", f"usemtl {name}"]
        lines += [
            "f " + " ".join(str(v + 1 + k * sphere.n_vertices) for v in face)
            for face in sphere.faces
        ]
    path = tmp_path / "two.obj"
    path.write_text("\n".join([*lines, lines[-1]]) + "\n")
    return path


def made(source, output, **options):
    return atlas_file(source, output, AtlasOptions(**options))


def test_an_atlas_comes_back_as_it_was(tmp_path):
    surface = pa.datasets.starfish(3)
    atlas = pa.build_atlas(pa.partition(surface, effort="fast"))
    atlas.save(tmp_path / "a.npz")
    again = Atlas.load(tmp_path / "a.npz")
    assert np.array_equal(again.surface.vertices, surface.vertices)
    assert np.array_equal(again.uv, atlas.uv)
    assert np.array_equal(again.labels, atlas.labels)
    for one, other in zip(atlas.charts, again.charts, strict=True):
        for field in dataclasses.fields(one):
            a, b = getattr(one, field.name), getattr(other, field.name)
            assert np.array_equal(a, b)
            assert np.asarray(a).dtype == np.asarray(b).dtype
    assert np.array_equal(again.bake(resolution=64), atlas.bake(resolution=64))
    assert again.metrics() == atlas.metrics()


def test_an_atlas_of_a_painted_surface_keeps_the_factors(tmp_path):
    surface = pa.datasets.icosphere(2)
    rng = np.random.default_rng(0)
    painted = surface.with_seam_costs(
        rng.uniform(1, 2, surface.faces.shape), rng.uniform(1, 2, surface.n_vertices)
    )
    for name, given in (("both", painted), ("none", surface)):
        path = tmp_path / f"{name}.npz"
        pa.build_atlas(pa.partition(given, effort="fast")).save(path)
        again = made(path, tmp_path / f"{name}.obj")
        for found in (Atlas.load(path).surface, again.scene, again.atlas.surface):
            if given is surface:
                assert found.seam_costs is found.vertex_seam_costs is None
            else:
                np.testing.assert_array_equal(found.seam_costs, painted.seam_costs)
                np.testing.assert_array_equal(found.vertex_seam_costs, painted.vertex_seam_costs)


@pytest.mark.parametrize("options", [{}, {"padding": 9, "resolution": 256}, {"texture": "checker"}])
def test_a_saved_atlas_gives_the_file_that_a_solve_gives(two, tmp_path, options):
    """Names, materials and second copies included."""
    made(two, tmp_path / "a.npz", effort="fast")
    made(tmp_path / "a.npz", tmp_path / "again.obj", **options)
    made(two, tmp_path / "once.obj", effort="fast", **options)
    again, once = ((tmp_path / f"{name}.obj").read_text() for name in ("again", "once"))
    assert again.replace("again.", "once.") == once
    assert "o small" in once


def test_saved_segments_give_the_file_that_a_solve_gives(two, tmp_path):
    pa.segment(pa.load_scene(two), 2, seed=1).save(tmp_path / "s.npz")
    made(tmp_path / "s.npz", tmp_path / "again.obj")
    made(two, tmp_path / "once.obj", levels=2, seed=1)
    assert (tmp_path / "again.obj").read_bytes() == (tmp_path / "once.obj").read_bytes()


def test_another_map_of_a_saved_atlas(two, tmp_path):
    """Charts are those of the labels, flattened anew."""
    first = made(two, tmp_path / "a.npz", effort="fast")
    other = made(tmp_path / "a.npz", tmp_path / "b.obj", flatten="lscm")
    assert np.array_equal(other.segmentation.labels, first.segmentation.labels)
    assert not np.array_equal(other.atlas.uv, first.atlas.uv)


def test_a_file_of_meshes_that_is_gone_or_has_changed(two, tmp_path):
    made(two, tmp_path / "a.npz", effort="fast")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    moved = two.rename(elsewhere / two.name)
    found = made(tmp_path / "a.npz", tmp_path / "b.obj")
    words = f"{two} is missing: what it held beside its triangles is left out"
    assert found.notes[0] == words
    faces = [
        line for line in (tmp_path / "b.obj").read_text().splitlines() if line.startswith("f ")
    ]
    assert len(faces) == 2 * pa.datasets.icosphere(2).n_faces
    # Beside what was saved it is found.
    (tmp_path / "a.npz").rename(elsewhere / "a.npz")
    assert made(elsewhere / "a.npz", tmp_path / "c.obj").notes == ()
    moved.write_text(moved.read_text() + "# more\n")
    with pytest.raises(ValueError, match=r"a\.npz: .*two\.obj has changed since"):
        made(elsewhere / "a.npz", tmp_path / "d.obj")
    assert not (tmp_path / "d.obj").exists()


def test_a_tree_of_a_surface_without_a_file(tmp_path):
    surface = pa.datasets.starfish(3)
    pa.segment(surface, 1).save(tmp_path / "t.npz")
    for output in ("t.glb", "t.obj", "t.ply"):
        found = made(tmp_path / "t.npz", tmp_path / output)
        assert found.notes == ()
        assert found.scene.n_faces == surface.n_faces
        assert found.record()["segments"] == 2
        assert pa.load_scene(tmp_path / output).n_faces == surface.n_faces
    assert made(tmp_path / "t.npz", tmp_path / "c.obj", cut=True).scene.n_faces > surface.n_faces


def test_a_tree_of_a_file_keeps_the_factors(tmp_path):
    pa.save_mesh(pa.datasets.icosphere(2), tmp_path / "a.obj")
    scene = pa.load_scene(tmp_path / "a.obj")
    cost = 2 + scene.vertices[:, 2]
    found = pa.segment(scene, 1, seam_cost=cost, creases=5.0)
    found.trees[0].save(tmp_path / "t.npz", source=scene.file)
    again = made(tmp_path / "t.npz", tmp_path / "b.obj").scene
    np.testing.assert_array_equal(again.seam_costs, found.surface.seam_costs)
    np.testing.assert_array_equal(again.vertex_seam_costs, cost)


def test_what_cannot_be_reopened(two, tmp_path):
    made(two, tmp_path / "a.npz", effort="fast")
    for name, value in (("levels", 2), ("distortion", 300.0), ("weld", 0.1), ("seed", 1)):
        with pytest.raises(ValueError, match=f"{name}: value must not be given with an"):
            made(tmp_path / "a.npz", tmp_path / "b.obj", **{name: value})
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    wrong = {
        "format": (4, "format 4 is not known"),
        "uv": (arrays["uv"][1:], "no atlas: uv: shape"),
        "chart_faces": (arrays["chart_faces"] + 1, "no atlas: chart_faces: must be"),
        "chart_labelled": (~arrays["chart_labelled"], "no atlas: chart_labelled: every face"),
        "chart_weights": (arrays["chart_weights"][1:], "no atlas: chart_weights: shape"),
        "chart_triangles": (
            # Vertices of all charts, but not of their own.
            arrays["chart_triangles"] + arrays["chart_n_vertices"][0],
            "no atlas: chart_triangles: must be",
        ),
        "pages": (arrays["pages"] + 0.5, "no atlas: pages: must be"),
        "stack": (arrays["stack"] + 0.5, "no atlas: stack: must be"),
    }
    for name, (value, words) in wrong.items():
        np.savez(tmp_path / "w.npz", **{**arrays, name: value})
        with pytest.raises(ValueError, match=words):
            made(tmp_path / "w.npz", tmp_path / "b.obj")
    (tmp_path / "w.npz").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="neither segments nor an atlas"):
        made(tmp_path / "w.npz", tmp_path / "b.obj")
    with pytest.raises(ValueError, match=r"no atlas: it is no \.npz file"):
        Atlas.load(tmp_path / "w.npz")
    with pytest.raises(ValueError, match=r"vertices: .*two\.obj is a path; load_scene reads it"):
        pa.unwrap(two)
    with pytest.raises(ValueError, match=r"what Atlas\.load reads"):
        pa.SegmentTree.load(tmp_path / "a.npz")
    assert not (tmp_path / "b.obj").exists()


def test_an_npz_file_has_no_place_for_a_texture(two, tmp_path):
    for name, value in (("texture", "checker"), ("rebake", True), ("uv_set", 1), ("udim", True)):
        with pytest.raises(ValueError, match=f"{name}: value must not be given for an"):
            made(two, tmp_path / "a.npz", **{name: value})


def test_nothing_that_is_read_is_overwritten(two, tmp_path):
    """The file, its textures, lists of seams and of faces, and what goes beside the output."""
    before = two.read_bytes()
    with pytest.raises(ValueError, match=r"output: .*two\.obj would overwrite an input"):
        made(two, two)
    picture = tmp_path / "out.1001.png"
    Image.new("RGB", (4, 4)).save(picture)
    held = picture.read_bytes()
    with pytest.raises(ValueError, match=r"output: .*out\.1001\.png would overwrite an input"):
        made(two, tmp_path / "out.obj", texture=picture, udim=True, effort="fast")
    seams = tmp_path / "cuts.obj"
    seams.write_text(two.read_text() + "l 1 2\n")
    with pytest.raises(ValueError, match=r"output: .*cuts\.obj would overwrite an input"):
        made(two, seams, seams=seams)
    assert (two.read_bytes(), picture.read_bytes()) == (before, held)
    assert not (tmp_path / "out.obj").exists()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("levels", -1),
        ("levels", 99),
        ("levels", 2.5),
        ("shares", ()),
        ("shares", (-1, 2)),
        ("weld", -1.0),
        ("uv_set", -5),
        ("keep", "abc"),
        ("seed", 2**64),
    ],
)
def test_options_are_checked_at_once(name, value):
    with pytest.raises(ValueError, match=f"^{name}"):
        AtlasOptions(**{name: value})


def test_pages_and_stacks_of_a_saved_atlas_stay(two, tmp_path):
    first = made(two, tmp_path / "a.npz", effort="fast", pages=2)
    again = made(tmp_path / "a.npz", tmp_path / "b.npz")
    assert np.array_equal(again.atlas.pages, first.atlas.pages)
    assert np.array_equal(again.atlas.uv, first.atlas.uv)
    wider = made(tmp_path / "a.npz", tmp_path / "b.obj", padding=9)
    assert wider.atlas.n_pages == 2
    lines = (tmp_path / "b.obj").read_text().splitlines()
    assert {"usemtl small.1001", "usemtl small.1002"} & set(lines)
    assert "usemtl small" not in lines
    surface = pa.datasets.icosphere(2)
    pa.save_mesh(surface, tmp_path / "ball.obj")
    options = {"effort": "fast", "symmetry": "x", "stack": True}
    stacked = made(tmp_path / "ball.obj", tmp_path / "s.npz", **options)
    assert stacked.atlas.stacked.any()
    with pytest.raises(ValueError, match="cut: value must not be given for stacked charts"):
        made(tmp_path / "s.npz", tmp_path / "c.obj", cut=True)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "x.obj")
    with pytest.raises(ValueError, match=r"x\.obj: not a regular file"):
        made(tmp_path / "x.obj", tmp_path / "y.obj")


def test_a_weld_that_leaves_nothing_is_refused(two, tmp_path):
    with pytest.raises(ValueError, match=r"weld: 1e\+09 leaves no face with an area"):
        made(two, tmp_path / "y.obj", weld=1e9)
    assert not (tmp_path / "y.obj").exists()
