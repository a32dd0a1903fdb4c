"""The file of a segmentation of a scene."""

import io
import zipfile

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas.scene.repair import repair
from phaseatlas.scene.scene import Scene


@pytest.fixture(scope="module")
def scene():
    """A mesh of two spheres of other sizes and two flaws, and a mesh of a sheet of quads."""
    sphere = pa.datasets.icosphere(2)
    vertices = np.concatenate([sphere.vertices, 3 * sphere.vertices + [9, 0, 0], [[1, 2, 3]]])
    faces = np.concatenate([sphere.faces, sphere.faces + sphere.n_vertices])
    faces[7] = faces[7, ::-1]
    faces = np.concatenate([faces, faces[[3]]])
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    grid = np.stack([x.ravel(), y.ravel(), 0 * x.ravel() - 5], axis=1)
    k = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1)
    quads = np.stack([k, k + 1, k + 10, k + 9], axis=1)
    return Scene(
        [
            ("two spheres", repair(vertices, faces)),
            ("", repair(grid, quads.reshape(-1), np.full(len(quads), 4))),
        ]
    )


def check_same(found, expected):
    assert np.array_equal(found.labels, expected.labels)
    assert np.array_equal(found.surface.vertices, expected.surface.vertices)
    assert np.array_equal(found.surface.faces, expected.surface.faces)
    assert len(found.pieces) == len(expected.pieces)
    for a, b in zip(found.pieces, expected.pieces, strict=True):
        assert np.array_equal(a.faces, b.faces)
        assert np.array_equal(a.surface.vertices, b.surface.vertices)
    for a, b in zip(found.surface.meshes, expected.surface.meshes, strict=True):
        assert (a.name, a.repaired.report) == (b.name, b.repaired.report)
    uv = np.random.default_rng(0).random((len(found.labels), 3, 2))
    for a, b in zip(found.surface.corners(uv), expected.surface.corners(uv), strict=True):
        assert np.array_equal(a, b)


def test_trees_come_back_with_their_fields(scene, tmp_path):
    expected = pa.segment(scene, 2)
    assert [tree is not None for tree in expected.trees].count(True) >= 1
    expected.save(tmp_path / "a.npz")
    found = pa.SceneSegmentation.load(tmp_path / "a.npz")
    check_same(found, expected)
    for a, b in zip(found.trees, expected.trees, strict=True):
        assert (a is None) == (b is None)
        if a is not None:
            assert np.array_equal(a.fields, b.fields)
            assert (a.diagnostics, a.epsilon) == (b.diagnostics, b.epsilon)
    assert found.surface.file is None


def test_partitions_come_back_as_labels(scene, tmp_path):
    expected = pa.partition(scene, effort="fast")
    expected.save(tmp_path / "a.npz")
    found = pa.SceneSegmentation.load(tmp_path / "a.npz")
    check_same(found, expected)
    assert found.trees == (None,) * len(found.pieces)
    for a, b in zip(found.parts, expected.parts, strict=True):
        assert a.epsilon == b.epsilon
        assert np.array_equal(a.weights, b.weights)


def test_a_scene_knows_its_file(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    file = pa.load_scene(tmp_path / "a.obj").file
    assert file.path == str(tmp_path / "a.obj")
    # What sha256sum says.
    assert file.sha256.startswith("697b00ab")


def refused(path, reader=pa.SceneSegmentation):
    with pytest.raises(ValueError, match=r": ") as caught:
        reader.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    return message


def test_the_two_formats_name_each_other(scene, tmp_path):
    pa.segment(scene, 1).save(tmp_path / "scene.npz")
    pa.segment(pa.datasets.icosphere(2), 1).save(tmp_path / "tree.npz")
    message = refused(tmp_path / "scene.npz", pa.SegmentTree)
    assert message.endswith("format 2 is what SceneSegmentation.load reads")
    message = refused(tmp_path / "tree.npz")
    assert message.endswith("format 1 is what SegmentTree.load reads")
    with pytest.raises(FileNotFoundError):
        pa.SceneSegmentation.load(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("labels", lambda labels: labels + 1),
        ("labels", lambda labels: labels[1:]),
        ("labels", lambda labels: labels.astype(float)),
        ("piece", lambda piece: piece[::-1].copy()),
        ("faces", lambda faces: faces + 1),
        ("epsilon", lambda epsilon: epsilon[1:]),
        ("mesh_faces", lambda faces: faces[::-1].copy()),
        ("mesh_names", lambda names: np.array("[")),
        ("mesh_component", None),
    ],
)
def test_damaged_files_are_refused(scene, tmp_path, key, change):
    pa.segment(scene, 2).save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        arrays = dict(file)
    if change is None:
        del arrays[key]
    else:
        arrays[key] = change(arrays[key])
    np.savez(tmp_path / "bad.npz", **arrays)
    assert "no segmentation: " in refused(tmp_path / "bad.npz")


def test_a_file_that_is_none(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("x.npy", io.BytesIO(b"noise").getvalue())
    assert "no segmentation: " in refused(tmp_path / "a.npz")
