"""Topology, areas, mass, curvature and stiffness of a surface."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse as sp

import reference
from phaseatlas import datasets

EXPECTED_TOPOLOGY = {
    # euler_characteristic, genus, n_boundary_loops
    "icosphere": (2, 0, 0),
    "torus": (0, 1, 0),
    "sheet": (1, 0, 1),
    "cylinder": (0, 0, 2),
    "starfish": (2, 0, 0),
    "rounded_cube": (2, 0, 0),
}


def make(name):
    return {
        "icosphere": lambda: datasets.icosphere(2),
        "torus": lambda: datasets.torus(n_major=20, n_minor=9),
        "sheet": lambda: datasets.sheet(7, 5, amplitude=0.1),
        "cylinder": lambda: datasets.cylinder(0.5, 2.0, 14, 6),
        "starfish": lambda: datasets.starfish(3),
        "rounded_cube": lambda: datasets.rounded_cube(8, 1.5, 0.4),
    }[name]()


def relative_error(actual, expected):
    return np.linalg.norm(np.asarray(actual) - expected) / np.linalg.norm(expected)


# Sums of a few thousand doubles in another order; 1e-10 leaves room for nothing else.
AGREE = 1e-10


@pytest.mark.parametrize("name", EXPECTED_TOPOLOGY)
def test_topology(name):
    surface = make(name)
    assert (
        surface.euler_characteristic,
        surface.genus,
        surface.n_boundary_loops,
    ) == EXPECTED_TOPOLOGY[name]
    assert surface.n_vertices - surface.n_edges + surface.n_faces == surface.euler_characteristic


def test_sizes_and_edges(surfaces):
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    assert vertices.shape == (surfaces.n_vertices, 3)
    assert vertices.dtype == np.float64
    assert faces.shape == (surfaces.n_faces, 3)
    corners = np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2)
    edges = {(min(a, b), max(a, b)) for a, b in corners.tolist()}
    assert surfaces.n_edges == len(edges)
    start, end = np.array(sorted(edges)).T
    mean = np.linalg.norm(vertices[start] - vertices[end], axis=1).mean()
    assert surfaces.mean_edge_length == pytest.approx(mean, rel=AGREE)


def test_face_neighbours(surfaces):
    neighbours = np.asarray(surfaces.face_neighbours)
    assert neighbours.shape == (surfaces.n_faces, 3)
    assert np.array_equal(neighbours, reference.face_neighbours(np.asarray(surfaces.faces)))


def test_areas_and_diameters(surfaces):
    expected = reference.face_areas(surfaces.vertices, surfaces.faces)
    assert relative_error(surfaces.face_areas, expected) < AGREE
    assert surfaces.area == pytest.approx(expected.sum(), rel=AGREE)
    expected = reference.face_diameters(surfaces.vertices, surfaces.faces)
    assert relative_error(surfaces.face_diameters, expected) < AGREE


def test_mass(surfaces):
    expected = reference.lumped_mass(surfaces.vertices, surfaces.faces)
    assert relative_error(surfaces.mass, expected) < AGREE
    assert np.sum(surfaces.mass) == pytest.approx(surfaces.area, rel=AGREE)


def test_angle_defects(surfaces):
    expected = reference.angle_defects(surfaces.vertices, surfaces.faces)
    # A defect is a small difference of angles of order one, hence an absolute bound.
    assert np.abs(np.asarray(surfaces.angle_defects) - expected).max() < AGREE


@pytest.mark.parametrize("name", EXPECTED_TOPOLOGY)
def test_gauss_bonnet(name):
    surface = make(name)
    total = np.sum(surface.angle_defects)
    # Thousands of angles, each good to a few 1e-16.
    assert total == pytest.approx(2.0 * math.pi * EXPECTED_TOPOLOGY[name][0], abs=1e-10)


def test_angle_defects_of_a_flat_sheet_sit_in_the_corners():
    surface = datasets.sheet(6, 4, size=(2.0, 1.0))
    expected = np.zeros((7, 5))
    expected[[0, 0, -1, -1], [0, -1, 0, -1]] = math.pi / 2.0
    assert np.abs(np.asarray(surface.angle_defects) - expected.ravel()).max() < 1e-13


def test_vertex_normals(surfaces):
    normals = surfaces.vertex_normals
    assert normals.shape == (surfaces.n_vertices, 3)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    sums = np.zeros_like(vertices)
    for a, b, c in faces:
        sums[[a, b, c]] += np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
    expected = sums / np.linalg.norm(sums, axis=1)[:, None]
    assert np.abs(normals - expected).max() < 1e-12


def test_normals_of_a_sphere_point_outwards():
    surface = datasets.icosphere(4)
    assert np.abs(surface.vertex_normals - surface.vertices).max() < 0.01


def test_stiffness(surfaces):
    actual = surfaces.stiffness
    assert sp.issparse(actual)
    assert actual.format == "csr"
    expected = reference.stiffness(np.asarray(surfaces.vertices), np.asarray(surfaces.faces))
    assert relative_error(actual.toarray(), expected) < AGREE


def test_stiffness_diagonal(surfaces):
    expected = reference.stiffness(surfaces.vertices, surfaces.faces).diagonal()
    np.testing.assert_allclose(surfaces.stiffness_diagonal, expected, rtol=1e-11)


def test_weighted_stiffness(surfaces, smooth_weight):
    weight = smooth_weight(surfaces)
    actual = surfaces.weighted_stiffness(weight)
    assert sp.issparse(actual)
    assert actual.format == "csr"
    expected = reference.weighted_stiffness(
        np.asarray(surfaces.vertices), np.asarray(surfaces.faces), weight
    )
    assert relative_error(actual.toarray(), expected) < AGREE
    # Twice, since buffers may be reused: the first answer and the plain matrix must not change.
    again = surfaces.weighted_stiffness(np.ones(surfaces.n_vertices))
    assert relative_error(again.toarray(), surfaces.stiffness.toarray()) < AGREE
    assert relative_error(actual.toarray(), expected) < AGREE


def test_stiffness_is_symmetric_and_kills_constants(surfaces):
    matrix = surfaces.stiffness
    size = np.abs(matrix.data).max()
    assert abs(matrix - matrix.T).max() <= 1e-14 * size
    # A row sums some six to a dozen entries of this size.
    assert np.abs(matrix @ np.ones(surfaces.n_vertices)).max() < 1e-13 * size


def test_stiffness_is_exact_on_linear_functions():
    surface = datasets.sheet(9, 7, size=(1.5, 1.0))
    x, y = np.asarray(surface.vertices)[:, 0], np.asarray(surface.vertices)[:, 1]
    linear = 0.3 + 2.0 * x - 1.5 * y
    flux = surface.stiffness @ linear
    assert linear @ flux == pytest.approx((2.0**2 + 1.5**2) * 1.5, rel=1e-12)
    inside = (x > 0.0) & (x < 1.5) & (y > 0.0) & (y < 1.0)
    assert np.abs(flux[inside]).max() < 1e-12
    # The midpoint rule is exact for a linear weight: the mean of 0.2 + 0.4 x is 0.5.
    energy = linear @ (surface.weighted_stiffness(0.2 + 0.4 * x) @ linear)
    assert energy == pytest.approx((2.0**2 + 1.5**2) * 1.5 * 0.5, rel=1e-12)


def test_weighted_stiffness_rejects_bad_weights():
    surface = datasets.icosphere(1)
    with pytest.raises(ValueError, match="weight"):
        surface.weighted_stiffness(np.ones(surface.n_vertices + 1))
    weight = np.ones(surface.n_vertices)
    weight[5] = np.nan
    with pytest.raises(ValueError, match="weight"):
        surface.weighted_stiffness(weight)


# The generators themselves


@pytest.mark.parametrize("name", ["icosphere", "torus", "starfish", "rounded_cube"])
def test_closed_datasets_point_outwards(name):
    surface = make(name)
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    volume = np.linalg.det(corners).sum() / 6.0
    assert volume > 0.0


def test_datasets_have_the_sizes_they_promise():
    # Polyhedra inscribed in smooth surfaces lose area like h^2: below 2 % at these sizes.
    assert datasets.icosphere(3, 2.0).area == pytest.approx(16.0 * math.pi, rel=0.02)
    torus = datasets.torus(1.0, 0.4, 48, 24)
    assert torus.area == pytest.approx(4.0 * math.pi**2 * 0.4, rel=0.02)
    assert datasets.cylinder(0.5, 2.0, 40, 5).area == pytest.approx(2.0 * math.pi, rel=0.02)
    assert datasets.sheet(4, 6, size=(2.0, 3.0)).area == pytest.approx(6.0, rel=1e-12)


@pytest.mark.parametrize(("cells", "radius"), [(24, 0.5), (31, 0.2), (12, 1.0), (2, 0.3)])
def test_rounded_cube_is_curved_on_its_corners_alone(cells, radius):
    surface = datasets.rounded_cube(cells, 2.0, radius)
    assert surface.n_vertices == 6 * cells**2 + 2
    assert surface.face_quality.min() > 0.75
    # Every vertex lies at `radius` from the cube that is left when the roundings are taken off.
    inner = np.clip(surface.vertices, radius - 1.0, 1.0 - radius)
    distance = np.linalg.norm(surface.vertices - inner, axis=1)
    np.testing.assert_allclose(distance, radius, rtol=1e-12)
    on_corner = (np.abs(surface.vertices) > 1.0 - radius + 1e-9).all(axis=1)
    if cells > 2:
        flat = 2.0 * (1.0 - radius)
        area = 6.0 * flat**2 + 6.0 * np.pi * radius * flat + 4.0 * np.pi * radius**2
        assert surface.area == pytest.approx(area, rel=0.02)
        assert surface.angle_defects[on_corner].sum() > 0.5 * 4.0 * np.pi
        neighbours = np.zeros(surface.n_vertices, dtype=bool)
        neighbours[surface.faces[on_corner[surface.faces].any(axis=1)]] = True
        np.testing.assert_allclose(surface.angle_defects[~neighbours], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["sheet", "cylinder"])
def test_open_datasets_are_oriented_as_promised(name):
    surface = make(name)
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    up = np.array([0.0, 0.0, 1.0])
    away = up if name == "sheet" else corners.mean(axis=1) * np.array([1.0, 1.0, 0.0])
    assert np.all((normals * away).sum(axis=1) > 0.0)


@pytest.mark.parametrize("subdivisions", [3, 4, 5])
def test_starfish_triangles_are_well_shaped(subdivisions):
    surface = datasets.starfish(subdivisions)
    corners = np.asarray(surface.vertices)[np.asarray(surface.faces)]
    squares = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=(1, 2))
    assert (4.0 * math.sqrt(3.0) * np.asarray(surface.face_areas) / squares).min() > 0.5
    # Every face keeps its side of the origin, so the radial graph does not fold over itself.
    assert np.linalg.det(corners).min() > 0.0


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: datasets.icosphere(-1), "subdivisions"),
        (lambda: datasets.icosphere(1, radius=0.0), "radius"),
        (lambda: datasets.torus(1.0, 1.0), "minor_radius"),
        (lambda: datasets.torus(n_minor=2), "n_minor"),
        (lambda: datasets.sheet(0, 3), "n_x"),
        (lambda: datasets.sheet(size=(1.0, math.inf)), "size"),
        (lambda: datasets.sheet(amplitude=math.nan), "amplitude"),
        (lambda: datasets.cylinder(1.0, -1.0, 8, 2), "height"),
        (lambda: datasets.starfish(2), "subdivisions"),
        (lambda: datasets.rounded_cube(0), "cells"),
        (lambda: datasets.rounded_cube(4, side=-1.0), "side"),
        (lambda: datasets.rounded_cube(4, 1.0, 0.6), "radius"),
    ],
)
def test_datasets_reject_bad_arguments(call, name):
    with pytest.raises(ValueError, match=name):
        call()
