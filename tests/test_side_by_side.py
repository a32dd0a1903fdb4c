"""Nodes and pieces on an executor: the result is the same as without one."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas import datasets


def scene_of(folder, *surfaces):
    """A scene of pieces side by side."""
    text, first = [], 1
    for k, surface in enumerate(surfaces):
        text += [f"v {x + 5 * k!r} {y!r} {z!r}" for x, y, z in surface.vertices.tolist()]
        text += [f"f {a} {b} {c}" for a, b, c in (surface.faces + first).tolist()]
        first += surface.n_vertices
    (folder / "scene.obj").write_text("\n".join(text) + "\n")
    return pa.load_scene(folder / "scene.obj")


@pytest.fixture(scope="module")
def even(tmp_path_factory):
    """No piece has most of the faces."""
    pieces = (datasets.icosphere(2), datasets.torus(1.0, 0.4, 16, 9), datasets.sheet(10, 10))
    return scene_of(tmp_path_factory.mktemp("even"), *pieces, datasets.icosphere(0, radius=0.01))


@pytest.fixture(scope="module")
def uneven(tmp_path_factory):
    """One piece has most of the faces, and the nodes of its tree are shared out."""
    pieces = (datasets.icosphere(1), datasets.icosphere(3), datasets.sheet(8, 8))
    return scene_of(tmp_path_factory.mktemp("uneven"), *pieces)


@pytest.fixture(scope="module", params=["threads", "processes"])
def executor(request):
    if request.param == "threads":
        made = ThreadPoolExecutor(2)
    else:
        made = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))
    with made:
        yield made


def check_same(found, expected):
    np.testing.assert_array_equal(found.labels, expected.labels)
    for part, other in zip(found.parts, expected.parts, strict=True):
        assert part.surface is other.surface
        np.testing.assert_array_equal(part.weights, other.weights)


@pytest.mark.parametrize("kind", ["even", "uneven"])
def test_trees_of_pieces(executor, kind, request):
    scene = request.getfixturevalue(kind)
    expected = pa.segment(scene, 3)
    heard = []
    found = pa.segment(scene, 3, executor=executor, progress=heard.append)
    check_same(found, expected)
    for tree, other in zip(found.trees, expected.trees, strict=True):
        assert (tree is None) == (other is None)
        if tree is not None:
            np.testing.assert_array_equal(tree.fields, other.fields)
            assert tree.diagnostics == other.diagnostics
    # Each node is reported once.
    assert len(heard) == sum(len(tree.diagnostics) for tree in found.trees if tree is not None)


@pytest.mark.parametrize("bounds", [{}, {"max_charts": 5}, {"max_distortion": 0.05}])
def test_charts_of_pieces(executor, even, bounds):
    expected = pa.partition(even, **bounds)
    heard = []
    found = pa.partition(even, executor=executor, progress=heard.append, **bounds)
    check_same(found, expected)
    assert len(heard) >= len(even.pieces)
    for part, other in zip(found.parts, expected.parts, strict=True):
        figures = [(phase.name, phase.energy) for phase in part.diagnostics]
        assert figures == [(phase.name, phase.energy) for phase in other.diagnostics]


def test_corners_of_pieces(executor, even):
    for options in ({}, {"levels": 3}):
        expected = pa.unwrap(even, **options).corners
        np.testing.assert_array_equal(
            pa.unwrap(even, executor=executor, **options).corners, expected
        )


@pytest.mark.parametrize(("run", "options"), [(pa.segment, {"levels": 3}), (pa.partition, {})])
def test_progress_stops_it(executor, even, run, options):
    with pytest.raises(pa.StoppedError, match="stopped by the progress callback"):
        run(even, executor=executor, progress=lambda _: True, **options)


def test_warnings_come_from_all_processes(executor, even):
    short = {"max_iterations": 3, "initial": "random", "connected": False}
    with pytest.warns(pa.QualityWarning, match="not converged") as alone:
        pa.segment(even, 3, **short)
    with pytest.warns(pa.QualityWarning, match="not converged") as shared:
        pa.segment(even, 3, executor=executor, **short)
    assert [str(w.message) for w in shared] == [str(w.message) for w in alone]
    with pytest.warns(pa.QualityWarning, match="max_charts") as alone:
        pa.partition(even, max_charts=2)
    with pytest.warns(pa.QualityWarning, match="max_charts") as shared:
        pa.partition(even, max_charts=2, executor=executor)
    assert [str(w.message) for w in shared] == [str(w.message) for w in alone]
