"""Straightened seams, and surfaces that are cut along them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import phaseatlas as pa
from phaseatlas import datasets


def voronoi(surface: pa.Surface, count: int, seed: int = 0) -> np.ndarray:
    """Labels of the nearest of some points of the surface."""
    rng = np.random.default_rng(seed)
    centres = surface.face_mean(surface.vertices)
    chosen = centres[rng.choice(len(centres), count, replace=False)]
    return ((centres[:, None] - chosen) ** 2).sum(axis=2).argmin(axis=1)


def pieces(segmentation: pa.Segmentation) -> list[tuple[int, int, int]]:
    """Segment, Euler characteristic and number of boundary loops of each connected piece."""
    surface = segmentation.surface
    parts = surface.label_components(segmentation.labels)
    found = []
    for part in range(parts.max() + 1):
        inside = parts == part
        faces = surface.faces[inside]
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
        edges, count = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
        loops = trimesh.graph.connected_components(edges[count == 1])
        euler = len(np.unique(faces)) - len(edges) + len(faces)
        found.append((int(segmentation.labels[inside][0]), euler, len(loops)))
    return sorted(found)


def normals(surface: pa.Surface) -> np.ndarray:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def check(given: pa.Segmentation, transfer: pa.Transfer, found: pa.Segmentation) -> None:
    source, target = transfer.source, transfer.target
    assert source is given.surface
    assert target is found.surface
    # The same shape: each face is a part of its origin, in its plane, and none is missing.
    origin = transfer.origin_face
    parts = np.bincount(origin, target.face_areas, source.n_faces)
    np.testing.assert_allclose(parts, source.face_areas, rtol=1e-10)
    assert (np.vecdot(normals(target), normals(source)[origin]) > 1 - 1e-6).all()
    assert target.euler_characteristic == source.euler_characteristic
    assert target.n_boundary_loops == source.n_boundary_loops
    np.testing.assert_array_equal(target.vertices[: source.n_vertices], source.vertices)
    np.testing.assert_allclose(
        transfer.corners.interpolate(source.vertices[source.faces]).reshape(-1, 3, 3),
        target.vertices[target.faces],
        atol=1e-12 * np.sqrt(source.area),
    )
    assert transfer.corners.barycentric.min() >= 0
    np.testing.assert_allclose(transfer.corners.barycentric.sum(axis=1), 1, rtol=1e-12)
    # And back.
    np.testing.assert_array_equal(transfer.backward @ target.vertices, source.vertices)
    parent = transfer.parent_face
    np.testing.assert_array_equal(origin[parent], np.arange(source.n_faces))
    largest = np.zeros(source.n_faces)
    np.maximum.at(largest, origin, target.face_areas)
    np.testing.assert_array_equal(target.face_areas[parent], largest)
    # The same segments.
    assert found.n_segments == given.n_segments
    assert pieces(found) == pieces(given)
    assert found.length <= given.length * (1 + 1e-12)


def test_zigzag_becomes_a_straight_line() -> None:
    n = 20
    sheet = datasets.sheet(n, n, amplitude=0.0)
    x = sheet.face_mean(sheet.vertices)[:, 0]
    # Through the middle of a column of squares, and so from corner to corner.
    given = pa.Segmentation(sheet, (x > (n // 2 + 0.5) / n).astype(np.int64))
    transfer, found = pa.cut_along_seams(given)
    check(given, transfer, found)
    ends = sheet.vertices[sheet.on_border & on_seam(given)]
    straight = np.linalg.norm(ends[0] - ends[1])
    assert given.length > 1.5 * straight
    assert found.length == pytest.approx(straight, rel=2e-3)


def on_seam(segmentation: pa.Segmentation) -> np.ndarray:
    faces = segmentation.surface.faces
    low = np.full(segmentation.surface.n_vertices, segmentation.n_segments)
    high = np.full(segmentation.surface.n_vertices, -1)
    np.minimum.at(low, faces, segmentation.labels[:, None])
    np.maximum.at(high, faces, segmentation.labels[:, None])
    return low < high


@pytest.mark.parametrize("height", [0.0, 0.52])
def test_cap_of_a_sphere(height: float) -> None:
    sphere = datasets.icosphere(5)
    above = sphere.face_mean(sphere.vertices)[:, 2] > height
    given = pa.Segmentation(sphere, above.astype(np.int64))
    transfer, found = pa.cut_along_seams(given)
    check(given, transfer, found)
    circle = 2 * np.pi * np.sqrt(1 - height**2)
    assert given.length > 1.05 * circle
    assert found.length == pytest.approx(circle, rel=0.025)
    assert found.areas[1] == pytest.approx(2 * np.pi * (1 - height), rel=0.01)


def test_creases_of_a_cube_stay() -> None:
    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    cube = pa.Surface(box.vertices, box.faces)
    outwards = normals(cube)
    given = pa.Segmentation(cube, np.abs(outwards).argmax(axis=1) + 3 * (outwards.sum(axis=1) > 0))
    transfer, found = pa.cut_along_seams(given, curvature=0.0)
    check(given, transfer, found)
    np.testing.assert_array_equal(found.surface.faces, cube.faces)
    np.testing.assert_array_equal(found.labels, given.labels)


def test_one_segment_is_left_alone() -> None:
    surface = datasets.icosphere(2)
    given = pa.Segmentation(surface, np.zeros(surface.n_faces, dtype=np.int64))
    transfer, found = pa.cut_along_seams(given)
    check(given, transfer, found)
    np.testing.assert_array_equal(found.surface.faces, surface.faces)


@pytest.mark.parametrize(
    "surface",
    [
        datasets.icosphere(3),
        datasets.torus(1.0, 0.4, 40, 16),
        datasets.sheet(24, 20, size=(1.3, 1.0), amplitude=0.15, periods=1),
        datasets.starfish(3),
    ],
    ids=["sphere", "torus", "sheet", "starfish"],
)
@pytest.mark.parametrize("count", [2, 9, 50])
def test_segments_keep_their_topology(surface: pa.Surface, count: int) -> None:
    for seed in range(3):
        for curvature in (0.0, 30.0):
            given = pa.Segmentation(surface, voronoi(surface, count, seed))
            transfer, found = pa.cut_along_seams(given, curvature=curvature)
            check(given, transfer, found)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5])
def test_ragged_labels_keep_their_topology(share: float) -> None:
    # Necks of a face, segments that touch in a vertex, faces with all corners on seams.
    surface = datasets.torus(1.0, 0.4, 40, 16)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        labels = voronoi(surface, 6, seed)
        changed = rng.random(surface.n_faces) < share
        around = surface.face_neighbours[np.arange(surface.n_faces), rng.integers(3, size=1280)]
        labels[changed] = labels[around[changed]]
        given = pa.Segmentation(surface, labels)
        transfer, found = pa.cut_along_seams(given, curvature=0.0)
        check(given, transfer, found)


def test_transfers_of_cuts_compose() -> None:
    surface = datasets.torus(1.0, 0.4, 40, 16)
    given = pa.Segmentation(surface, voronoi(surface, 5))
    first, once = pa.cut_along_seams(given, curvature=0.0)
    second, twice = pa.cut_along_seams(once, curvature=0.0)
    both = first.then(second)
    assert twice.length < once.length < given.length
    check(given, both, twice)
    assert np.mean(twice.back(both).labels == given.labels) > 0.9


def test_weights_that_were_given_are_interpolated() -> None:
    surface = datasets.icosphere(3)
    made = pa.Segmentation(surface, voronoi(surface, 5))
    given = pa.Segmentation(surface, made.labels, made.weights)
    transfer, found = pa.cut_along_seams(given)
    np.testing.assert_allclose(found.weights, (transfer.forward @ made.weights.T).T, atol=1e-15)
    assert pa.cut_along_seams(made)[1].epsilon == made.epsilon


@pytest.mark.parametrize("name", ["bunny", "hand"])
def test_energy_of_real_partitions_falls(mesh_path, name: str) -> None:
    surface = pa.load(mesh_path(name))
    given = pa.partition(surface, effort="fast")
    transfer, found = pa.cut_along_seams(given)
    check(given, transfer, found)
    assert found.length < 0.97 * given.length
    figures = []
    for segmentation in (given, found):
        core = segmentation.surface.one_chart(600.0)
        core.set_labels(segmentation.labels, 0.0)
        core.forbid_overlap()
        energy, _, cuts, *_, overlapping = core.figures()
        assert overlapping == 0
        figures.append(energy - cuts)
    assert figures[1] < figures[0]


@pytest.mark.parametrize("curvature", [-1.0, np.inf, np.nan])
def test_bad_curvatures_are_named(curvature: float) -> None:
    surface = datasets.icosphere(1)
    given = pa.Segmentation(surface, voronoi(surface, 2))
    with pytest.raises(ValueError, match=f"^curvature: {curvature} must be a finite number"):
        pa.cut_along_seams(given, curvature=curvature)


def test_corners_of_a_simplified_surface_are_no_points_of_its_source() -> None:
    from phaseatlas.coarsen import coarsen

    transfer = coarsen(datasets.icosphere(4))
    assert transfer is not None
    with pytest.raises(ValueError, match=r"^corners: the target must be made of parts"):
        _ = transfer.corners
