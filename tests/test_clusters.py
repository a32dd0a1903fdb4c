"""Cluster trees: permutation, ranges, boxes and adjacency against a count by hand."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest

import phaseatlas as pa


@pytest.fixture(scope="module", params=["halves", "shares", "strip"])
def tree(request):
    if request.param == "strip":
        return pa.segment(pa.datasets.sheet(24, 8, size=(3.0, 1.0)), shares=[1, 2, 3])
    if request.param == "halves":
        return pa.segment(pa.datasets.starfish(3), 3)
    return pa.segment(pa.datasets.starfish(3), shares=[1, 2, 4, 1])


def leaves_below(tree, node):
    """Leaves under a node, by a walk over the nodes."""
    below = [k for k, other in enumerate(tree.nodes) if other.parent == node]
    if not below:
        return [node]
    # The positive child comes first.
    below.sort(key=lambda k: not tree.nodes[k].positive)
    return [leaf for child in below for leaf in leaves_below(tree, child)]


def leaf_of_vertices(tree):
    around = defaultdict(lambda: defaultdict(float))
    for face, label, area in zip(
        tree.surface.faces, tree.labels, tree.surface.face_areas, strict=True
    ):
        for vertex in face:
            around[vertex][label] += area
    found = []
    for vertex in range(tree.surface.n_vertices):
        most = max(around[vertex].values())
        found.append(min(k for k, area in around[vertex].items() if area > most * (1 - 1e-9)))
    return np.array(found)


@pytest.mark.parametrize("of", ["faces", "vertices"])
def test_nodes_hold_what_their_leaves_hold(tree, of):
    clusters = tree.cluster_tree(of)
    surface = tree.surface
    leaf = tree.labels if of == "faces" else leaf_of_vertices(tree)
    size = surface.face_areas if of == "faces" else surface.mass
    assert sorted(clusters.permutation) == list(range(len(leaf)))
    order = leaves_below(tree, 0)
    assert clusters.leaves.tolist() == order
    for node, parent in enumerate(clusters.parents):
        below = [order.index(k) for k in leaves_below(tree, node)]
        members = np.flatnonzero(np.isin(leaf, below))
        assert sorted(clusters.members(node)) == members.tolist()
        assert clusters.areas[node] == pytest.approx(size[members].sum(), rel=1e-12)
        faces = surface.faces[members]
        if of == "vertices":
            faces = surface.faces[np.isin(surface.faces, members).any(axis=1)]
        support = surface.vertices[faces.reshape(-1)]
        assert np.array_equal(clusters.boxes[node], [support.min(axis=0), support.max(axis=0)])
        assert clusters.levels[node] == (0 if parent < 0 else clusters.levels[parent] + 1)
        if parent >= 0:
            assert node in clusters.children[parent]
            assert clusters.ranges[parent, 0] <= clusters.ranges[node, 0]
            assert clusters.ranges[node, 1] <= clusters.ranges[parent, 1]
        first, second = clusters.children[node]
        if first < 0:
            assert second < 0
            assert node in clusters.leaves
        else:
            assert clusters.ranges[first, 1] == clusters.ranges[second, 0]


def test_shares_of_the_leaves(tree):
    clusters = tree.cluster_tree()
    shares = clusters.areas[clusters.leaves] / tree.surface.area
    # To the size of a face or two.
    slack = 2 * tree.surface.face_areas.max() / tree.surface.area
    np.testing.assert_allclose(shares, tree.shares, atol=slack)


def test_adjacency_is_that_of_the_edges(tree):
    lengths = defaultdict(float)
    owner = {}
    for face, label in zip(tree.surface.faces.tolist(), tree.labels.tolist(), strict=True):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            other = owner.setdefault((b, a), None)
            if other is not None and other != label:
                points = tree.surface.vertices[[a, b]]
                lengths[tuple(sorted((label, other)))] += np.linalg.norm(points[0] - points[1])
            owner[a, b] = label
    for of in ("faces", "vertices"):
        clusters = tree.cluster_tree(of)
        assert list(map(tuple, clusters.neighbours.tolist())) == sorted(lengths)
        expected = [lengths[pair] for pair in sorted(lengths)]
        np.testing.assert_allclose(clusters.lengths, expected, rtol=1e-12)
    assert clusters.lengths.sum() == pytest.approx(tree.interface_length, rel=1e-12)


def test_file_holds_all_attributes(tree, tmp_path):
    clusters = tree.cluster_tree("vertices")
    clusters.save(tmp_path / "clusters.npz")
    with np.load(tmp_path / "clusters.npz", allow_pickle=False) as file:
        assert set(file.files) == set(vars(clusters))
        for name in file.files:
            assert np.array_equal(file[name], getattr(clusters, name))


def test_what_is_clustered_is_checked(tree):
    with pytest.raises(ValueError, match="of: 'edges' must be one of"):
        tree.cluster_tree("edges")


def run(*arguments):
    command = [sys.executable, "-m", "phaseatlas", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


def test_shares_on_the_command_line(tmp_path):
    model, output = tmp_path / "model.obj", tmp_path / "model.npz"
    pa.save_mesh(pa.datasets.starfish(3), model)
    result = run("segment", model, "-o", output, "--shares", "1,2,4")
    assert result.returncode == 0, result.stderr
    shares = pa.SegmentTree.load(output).shares
    np.testing.assert_allclose(shares, np.array([1, 2, 4]) / 7)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("segment model.obj -o a.npz --shares 1,x", "shares: '1,x' must be two or more positive"),
        ("segment model.obj -o a.npz --shares 1", "shares: '1' must be two or more positive"),
        ("atlas model.obj -o a.obj --shares=1,-2", "shares: '1,-2' must be two or more positive"),
        ("atlas model.obj -o a.obj --shares 1,nan", "shares: '1,nan' must be two or more"),
        ("segment model.obj -o a.npz --shares 1,2 --levels 2", "shares: value must not be given"),
        ("atlas model.obj -o a.obj --shares 1,2 --levels 2", "shares: value must not be given"),
        ("atlas model.obj -o a.obj --shares 1,2 --max-charts 2", "max_charts: value must not be"),
        ("atlas model.obj -o a.obj --charts a.obj", "charts: a.obj must end in .glb"),
        ("atlas model.obj -o a.glb --charts a.glb", "charts: a.glb would overwrite another file"),
        ("atlas model.obj -o a.obj --outlines a.pdf", "outlines: a.pdf must end in .svg or .dxf"),
        ("atlas model.obj -o a.obj --unit mm", "unit: value must be given with outlines alone"),
    ],
)
def test_options_are_refused_before_the_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments.split())
    assert result.returncode == 2, result.stderr
    assert result.stderr.startswith(f"phaseatlas: {words}")
    assert not list(tmp_path.iterdir())


def test_shares_of_a_scene_are_those_of_its_one_piece(tmp_path):
    surface = pa.datasets.icosphere(2)
    pa.save_mesh(surface, tmp_path / "one.obj")
    segments = pa.segment(pa.load_scene(tmp_path / "one.obj"), shares=[1, 3])
    np.testing.assert_allclose(segments.areas / surface.area, [0.25, 0.75], atol=0.02)
    text = (tmp_path / "one.obj").read_text()
    moved = [
        " ".join([key, str(float(x) + 9), *rest]) if key == "v" else None
        for key, x, *rest in (line.split() for line in text.splitlines() if line[:2] == "v ")
    ]
    faces = [
        "f " + " ".join(str(int(v) + 1 + surface.n_vertices) for v in face)
        for face in surface.faces
    ]
    (tmp_path / "two.obj").write_text(text + "\n".join([*moved, *faces]) + "\n")
    with pytest.raises(ValueError, match="shares: value must be left out for a scene of several"):
        pa.segment(pa.load_scene(tmp_path / "two.obj"), shares=[1, 3])
