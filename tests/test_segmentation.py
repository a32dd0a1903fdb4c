"""Weights that are made of labels, labels that go back, and the tree of merges."""

from __future__ import annotations

import pickle
from itertools import combinations

import numpy as np
import pytest

import phaseatlas as pa
import reference
from phaseatlas import datasets
from phaseatlas.coarsen import coarsen
from phaseatlas.segmentation import MergeTree


def halves(surface: pa.Surface, axis: int = 0, at: float = 0.0) -> np.ndarray:
    return (surface.face_mean(surface.vertices)[:, axis] > at).astype(np.int64)


def voronoi(surface: pa.Surface, count: int, seed: int = 0) -> np.ndarray:
    """Labels of the nearest of some points of the surface."""
    rng = np.random.default_rng(seed)
    centres = surface.face_mean(surface.vertices)
    chosen = centres[rng.choice(len(centres), count, replace=False)]
    return ((centres[:, None] - chosen) ** 2).sum(axis=2).argmin(axis=1)


# --------------------------------------------------------------------------------------------------
# weights
# --------------------------------------------------------------------------------------------------


def test_profile_across_a_straight_boundary() -> None:
    # u - epsilon^2 u'' = 0 left of the boundary, 1 right of it.
    strip = datasets.sheet(400, 20, size=(4.0, 0.2), amplitude=0.0)
    strip = pa.Surface(strip.vertices - [2.0, 0.0, 0.0], strip.faces)
    for epsilon in (0.1, 0.15):
        found = pa.Segmentation(strip, halves(strip), epsilon=epsilon)
        x = strip.vertices[:, 0]
        # cosh, as nothing leaves through the ends; exp(-|x| / epsilon) / 2 on a longer strip.
        outside = np.cosh((2.0 - np.abs(x)) / epsilon) / np.cosh(2.0 / epsilon) / 2
        expected = np.where(x > 0, 1 - outside, outside)
        assert np.abs(found.weights[1] - expected).max() < 2e-3
        assert np.abs(outside - np.exp(-np.abs(x) / epsilon) / 2).max() < 2e-3


def test_weight_in_the_middle_of_a_disk() -> None:
    # 1 - z K_1(z), z the radius over epsilon, as I_0(0) = 1.
    from scipy.special import k1

    sheet = datasets.sheet(121, 121, size=(2.0, 2.0), amplitude=0.0)
    centres = sheet.face_mean(sheet.vertices) - [1.0, 1.0, 0.0]
    labels = (np.linalg.norm(centres, axis=1) < 0.4).astype(np.int64)
    found = pa.Segmentation(sheet, labels, epsilon=0.15)
    middle = np.linalg.norm(sheet.vertices - [1.0, 1.0, 0.0], axis=1).argmin()
    z = np.sqrt(found.areas[1] / np.pi) / 0.15
    assert found.weights[1, middle] == pytest.approx(1 - z * k1(z), abs=2e-3)


@pytest.mark.parametrize(
    "surface",
    [
        datasets.icosphere(3),
        datasets.torus(1.0, 0.4, 40, 16),
        # Needles: most edges face obtuse angles.
        pa.Surface(
            datasets.sheet(30, 30).vertices * [1.0, 30.0, 1.0], datasets.sheet(30, 30).faces
        ),
    ],
    ids=["sphere", "torus", "needles"],
)
@pytest.mark.parametrize("epsilon", [None, 1e-6, 0.2, 50.0])
def test_weights_are_a_partition_of_unity(surface: pa.Surface, epsilon: float | None) -> None:
    found = pa.Segmentation(surface, voronoi(surface, 37), epsilon=epsilon)
    assert found.weights.shape == (37, surface.n_vertices)
    np.testing.assert_allclose(found.weights.sum(axis=0), 1.0, rtol=0, atol=1e-11)
    assert found.weights.min() >= 0.0
    assert found.weights.max() <= 1.0
    # At its own faces each is positive.
    assert (found.weights[found.labels[:, None], surface.faces] > 0).all()
    np.testing.assert_array_equal(found.weight(5), found.weights[5])


@pytest.mark.parametrize(
    "surface",
    [datasets.icosphere(2), datasets.sheet(14, 9, size=(1.0, 20.0))],
    ids=["sphere", "needles"],
)
@pytest.mark.parametrize("epsilon", [0.05, 0.4])
def test_weights_agree_with_their_twin(surface: pa.Surface, epsilon: float) -> None:
    found = pa.Segmentation(surface, voronoi(surface, 6), epsilon=epsilon)
    widths = np.minimum(epsilon, np.sqrt(found.areas) / 4)
    expected = reference.diffuse_weights(
        surface.vertices, surface.faces, found.labels, widths[found.labels]
    )
    np.testing.assert_allclose(found.weights, expected, atol=1e-12)


def test_weights_follow_the_scale_and_the_shares() -> None:
    surface = datasets.icosphere(3)
    labels = voronoi(surface, 5)
    small = pa.Segmentation(surface, labels)
    large = pa.Segmentation(surface.scaled(1e3), labels)
    assert large.epsilon == pytest.approx(1e3 * small.epsilon, rel=1e-12)
    np.testing.assert_allclose(large.weights, small.weights, atol=1e-12)
    # Spreading keeps the integral.
    np.testing.assert_allclose(small.weights @ surface.mass, small.areas, rtol=1e-10)


def test_small_segments_keep_their_weight() -> None:
    surface = datasets.icosphere(4)
    labels = halves(surface, axis=2, at=0.985)
    found = pa.Segmentation(surface, labels, epsilon=0.5)
    assert found.weights[1].max() > 0.5
    assert found.weights[0].max() > 0.999


def test_weights_are_made_when_they_are_asked_for() -> None:
    surface = datasets.icosphere(3)
    # A segment for each face.
    found = pa.Segmentation(surface, np.arange(surface.n_faces))
    assert found.n_segments == surface.n_faces
    assert found.components.max() == 1
    assert "weights" not in vars(found)
    given = pa.Segmentation(surface, found.labels * 0, np.ones((1, surface.n_vertices)))
    assert given.weights.min() == 1.0


def test_segmentations_are_pickled() -> None:
    surface = datasets.icosphere(3)
    found = pa.Segmentation(surface, voronoi(surface, 5))
    weights = found.weights
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.weights, weights)
    del again.__dict__["weights"]
    np.testing.assert_array_equal(again.weights, weights)


def test_partition_blends() -> None:
    found = pa.partition(datasets.rounded_cube(12), effort="fast")
    assert found.epsilon == pytest.approx(2 * found.surface.mean_edge_length)
    atlas = pa.build_atlas(found)
    assert sum(len(chart.faces) for chart in atlas.charts) > found.surface.n_faces
    image = atlas.bake(lambda uv: np.full((len(uv), 3), 0.4), resolution=64, blend=True)
    assert (image == 102).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"epsilon": 0.0}, r"epsilon: 0\.0 must be a positive number"),
        ({"epsilon": np.nan}, "epsilon: nan must be a positive number"),
        ({"labels": [0, 0, 4, 0]}, r"labels\[2\]: 4 must be in 0\.\.3"),
        ({"labels": [0, 0, -1, 0]}, r"labels\[2\]: -1 must be in 0\.\.3"),
        ({"labels": [0, 0, 0]}, r"labels: shape \(3,\) must be \(4,\)"),
        ({"weights": [[1, 1, 1]]}, r"weights: shape \(1, 3\) must be \(k, 4\)"),
    ],
)
def test_bad_arguments_are_named(arguments: dict, message: str) -> None:
    surface = pa.Surface(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    )
    with pytest.raises(ValueError, match=f"^{message}"):
        pa.Segmentation(surface, **{"labels": [0, 0, 0, 0]} | arguments)
    with pytest.raises(ValueError, match=r"^segment: 1 must be in 0\.\.0"):
        pa.Segmentation(surface, [0] * 4).weight(1)


# --------------------------------------------------------------------------------------------------
# labels that go back
# --------------------------------------------------------------------------------------------------


def test_labels_go_back_without_weights() -> None:
    fine = datasets.icosphere(5)
    transfer = coarsen(fine)
    assert transfer is not None
    coarse = pa.Segmentation(transfer.target, halves(transfer.target))
    found = coarse.back(transfer)
    assert "weights" not in vars(coarse)
    assert found.surface is fine
    assert found.epsilon == coarse.epsilon
    assert np.mean(found.labels == halves(fine)) > 0.97


def test_two_sides_of_a_thin_plate_stay_apart() -> None:
    plate = datasets.icosphere(5)
    plate = pa.Surface(plate.vertices * [1.0, 1.0, 0.003], plate.faces)
    transfer = coarsen(plate, 2000)
    assert transfer is not None
    labels = halves(transfer.target, axis=2)
    back = labels[transfer.parent_face]
    flat = np.linalg.norm(plate.face_mean(plate.vertices)[:, :2], axis=1) < 0.9
    assert np.mean((back == halves(plate, axis=2))[flat]) == 1.0


@pytest.mark.parametrize("n_faces", [300, 1000])
def test_as_many_faces_as_asked_for(n_faces: int) -> None:
    transfer = coarsen(datasets.icosphere(4), n_faces)
    assert transfer is not None
    assert transfer.target.n_faces == pytest.approx(n_faces, rel=0.05)
    assert coarsen(transfer.target, n_faces) is None


# --------------------------------------------------------------------------------------------------
# the tree of merges
# --------------------------------------------------------------------------------------------------


def energy(surface: pa.Surface, labels: np.ndarray, distortion: float) -> float:
    core = surface.one_chart(distortion)
    core.set_labels(labels, 0.0)
    return core.figures()[0]


def test_merges_are_the_cheapest() -> None:
    surface = datasets.starfish(3)
    segmentation = pa.Segmentation(surface, pa.partition(surface, effort="fast").labels)
    tree = segmentation.merge_tree(300.0)
    assert isinstance(tree, MergeTree)
    k = segmentation.n_segments
    assert k >= 4
    assert tree.merges.shape == (k - 1, 2)
    np.testing.assert_array_equal(tree.at(k).labels, segmentation.labels)
    assert tree.at(1).n_segments == 1
    for n in range(k, 1, -1):
        before, after = tree.at(n), tree.at(n - 1)
        assert (before.components == 1).all()
        # Each is made of whole charts of the one before.
        pairs = np.unique(np.stack([before.labels, after.labels]), axis=1)
        assert pairs.shape[1] == n
        found = tree.energies[k - n]
        assert found == pytest.approx(energy(surface, before.labels, 300.0), rel=1e-12)
        neighbours = surface.face_neighbours
        adjacent = {
            tuple(sorted(pair))
            for pair in zip(
                np.repeat(before.labels, 3), before.labels[neighbours].reshape(-1), strict=True
            )
        }
        best = min(
            energy(surface, np.where(before.labels == b, a, before.labels), 300.0)
            for a, b in combinations(range(n), 2)
            if (a, b) in adjacent
        )
        assert tree.energies[k - n + 1] == pytest.approx(best, rel=1e-12)


def test_pieces_are_leaves() -> None:
    sheet = datasets.sheet(30, 10, size=(3.0, 1.0), amplitude=0.0)
    x = sheet.face_mean(sheet.vertices)[:, 0]
    # Three strips, the outer two of one segment.
    tree = pa.Segmentation(sheet, ((x > 1) & (x < 2)).astype(np.int64)).merge_tree()
    assert tree.n_leaves == 3
    assert set(tree.labels[x < 1]) == {0}
    assert set(tree.labels[(x > 1) & (x < 2)]) == {2}
    # A flat sheet costs its seams and a tenth for each chart.
    np.testing.assert_allclose(tree.energies, 3**-0.5 * np.array([2, 1, 0]) + [0.3, 0.2, 0.1])


def test_bad_heights_are_named() -> None:
    surface = datasets.icosphere(1)
    tree = pa.Segmentation(surface, halves(surface)).merge_tree()
    for n in (0, 3, 1.5):
        with pytest.raises(ValueError, match=rf"^n_charts: {n} must be a whole number in 1\.\.2"):
            tree.at(n)
    with pytest.raises(ValueError, match=r"^distortion: 0 must be a positive number"):
        pa.Segmentation(surface, halves(surface)).merge_tree(0)
