"""Diffuse perimeter, equations (5), (7) and (9)."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phaseatlas as pa
import reference
from contract import (
    AGREE,
    check_agreement,
    check_gradient,
    check_gradient_of_every_vertex,
    random_directions,
    random_field,
)
from phaseatlas import datasets


@pytest.mark.parametrize("kind", ["random", "smooth"])
def test_agrees_with_reference(surfaces, smooth_field, kind):
    u = smooth_field(surfaces) if kind == "smooth" else random_field(surfaces)
    epsilon = 2.0 * surfaces.mean_edge_length
    actual = pa.functionals.Perimeter(surfaces, epsilon).value_and_gradient(u)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    check_agreement(actual, reference.perimeter(vertices, faces, u, epsilon))


@pytest.mark.parametrize(("eta", "sigma"), [(0.0, 1.0), (0.05, 4.0), (0.0, 0.3), (0.02, 0.07)])
def test_weighted_agrees_with_reference(surfaces, smooth_field, smooth_weight, eta, sigma):
    u, weight = random_field(surfaces), smooth_weight(surfaces)
    epsilon = 2.0 * surfaces.mean_edge_length
    functional = pa.functionals.Perimeter(surfaces, epsilon, weight=weight, eta=eta, sigma=sigma)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    expected = reference.weighted_perimeter(vertices, faces, u, epsilon, weight, eta, sigma)
    check_agreement(functional.value_and_gradient(u), expected)


@pytest.mark.parametrize("weighted", [False, True])
def test_gradient_is_the_derivative(surfaces, smooth_field, smooth_weight, weighted):
    epsilon = 2.0 * surfaces.mean_edge_length
    options = {"weight": smooth_weight(surfaces), "eta": 0.01, "sigma": 0.1} if weighted else {}
    functional = pa.functionals.Perimeter(surfaces, epsilon, **options)
    for u in (random_field(surfaces), smooth_field(surfaces)):
        # A quartic: the error of the central difference is h^2 = 1e-8 times a third derivative,
        # rounding adds 1e-16 |P| / h = 1e-12 |P|.
        check_gradient(functional, u, random_directions(surfaces), 1e-4, 1e-7)


def test_gradient_of_every_vertex():
    surface = datasets.sheet(3, 3, amplitude=0.2, periods=0.7)
    rng = np.random.default_rng(1)
    u, weight = rng.uniform(-1.0, 1.0, (2, surface.n_vertices))
    functional = pa.functionals.Perimeter(surface, 0.2, weight=np.abs(weight), eta=0.1, sigma=0.2)
    check_gradient_of_every_vertex(functional, u, 1e-4, 1e-7)


def test_hessian_agrees_with_reference(surfaces, smooth_field):
    u = smooth_field(surfaces)
    epsilon = 2.0 * surfaces.mean_edge_length
    hessian = pa.functionals.Perimeter(surfaces, epsilon).hessian(u)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    expected = reference.perimeter_hessian(vertices, faces, u, epsilon)
    assert hessian.format == "csr"
    assert np.abs(hessian.toarray() - expected).max() <= AGREE * np.abs(expected).max()


def test_weighted_hessian_agrees_with_reference(surfaces, smooth_weight):
    u, weight = random_field(surfaces), smooth_weight(surfaces)
    epsilon = 2.0 * surfaces.mean_edge_length
    functional = pa.functionals.Perimeter(surfaces, epsilon, weight=weight, eta=0.02, sigma=0.3)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    expected = reference.weighted_perimeter_hessian(vertices, faces, u, epsilon, weight, 0.02, 0.3)
    difference = functional.hessian(u).toarray() - expected
    assert np.abs(difference).max() <= AGREE * np.abs(expected).max()


@pytest.mark.parametrize("weighted", [False, True])
def test_hessian_is_the_derivative_of_the_gradient(surfaces, smooth_weight, weighted):
    epsilon = 2.0 * surfaces.mean_edge_length
    options = {"weight": smooth_weight(surfaces), "eta": 0.01, "sigma": 0.1} if weighted else {}
    functional = pa.functionals.Perimeter(surfaces, epsilon, **options)
    u = random_field(surfaces)
    direction = np.random.default_rng(1).standard_normal(surfaces.n_vertices)
    # The gradient is a cubic: the error of the difference is h^2 = 1e-8 times a third derivative.
    h = 1e-4
    plus = functional.value_and_gradient(u + h * direction)[1]
    minus = functional.value_and_gradient(u - h * direction)[1]
    product = functional.hessian(u) @ direction
    assert np.linalg.norm((plus - minus) / (2.0 * h) - product) < 1e-7 * np.linalg.norm(product)


def test_entries_of_the_hessian_do_not_depend_on_the_field():
    # The diagonals of the cells have stiffness 0, and psi'' vanishes at 1 / sqrt(3).
    surface = datasets.sheet(4, 4, size=(1.0, 1.0))
    functional = pa.functionals.Perimeter(surface, 0.2)
    flat = functional.hessian(np.full(surface.n_vertices, 1.0 / math.sqrt(3.0)))
    random = functional.hessian(random_field(surface))
    assert flat.nnz == random.nnz == surface.n_vertices + 2 * surface.n_edges
    assert (flat.indices == random.indices).all()
    assert (flat.indptr == random.indptr).all()
    assert abs(flat - flat.T).max() == 0.0


def test_pure_phases_cost_nothing(surfaces):
    functional = pa.functionals.Perimeter(surfaces, 0.1)
    for phase in (-1.0, 1.0):
        value, gradient = functional.value_and_gradient(np.full(surfaces.n_vertices, phase))
        assert abs(value) < 1e-13
        assert np.abs(gradient).max() < 1e-13


def test_mixed_phase_costs_the_area(surfaces):
    value, _ = pa.functionals.Perimeter(surfaces, 0.1).value_and_gradient(
        np.zeros(surfaces.n_vertices)
    )
    assert value == pytest.approx(9.0 / 16.0 * surfaces.area / 0.1, rel=1e-12)


def test_symmetric_in_the_phases(surfaces, smooth_field):
    functional = pa.functionals.Perimeter(surfaces, 0.1)
    u = smooth_field(surfaces)
    value, gradient = functional.value_and_gradient(u)
    mirrored, mirrored_gradient = functional.value_and_gradient(-u)
    assert mirrored == pytest.approx(value, rel=1e-14)
    assert np.allclose(mirrored_gradient, -gradient, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("length", [0.4, 1.0])
def test_optimal_profile_costs_root_two_per_length(length):
    surface = datasets.sheet(120, 10, size=(2.0, length))
    epsilon = 0.08
    x = np.asarray(surface.vertices)[:, 0] - 1.0
    profile = np.tanh(3.0 * x / (2.0 * math.sqrt(2.0) * epsilon))
    value, _ = pa.functionals.Perimeter(surface, epsilon).value_and_gradient(profile)
    # Cells of epsilon / 5 across the profile: the quadrature is off by (h / epsilon)^2 / 4 = 1 %.
    assert value == pytest.approx(math.sqrt(2.0) * length, rel=0.01)


def test_weight_counts_only_the_weighted_length():
    surface = datasets.sheet(120, 40, size=(2.0, 1.0))
    epsilon = 0.08
    x, y = np.asarray(surface.vertices)[:, 0] - 1.0, np.asarray(surface.vertices)[:, 1]
    profile = np.tanh(3.0 * x / (2.0 * math.sqrt(2.0) * epsilon))
    # A sigma that leaves nothing of the penalty, which would count the area outside the parent.
    functional = pa.functionals.Perimeter(surface, epsilon, weight=y, sigma=1e9)
    # The mean of the weight along the interface is one half.
    assert functional.value_and_gradient(profile)[0] == pytest.approx(math.sqrt(0.5), rel=0.01)


def test_equator_of_a_sphere():
    surface = datasets.icosphere(5)
    epsilon = 4.0 * surface.mean_edge_length
    latitude = np.arcsin(np.asarray(surface.vertices)[:, 2])
    profile = np.tanh(3.0 * latitude / (2.0 * math.sqrt(2.0) * epsilon))
    value, _ = pa.functionals.Perimeter(surface, epsilon).value_and_gradient(profile)
    # The parallels shrink like the cosine of the latitude across an interface of width epsilon, and
    # the quadrature adds (h / epsilon)^2: about 1 % each.
    assert value == pytest.approx(math.sqrt(2.0) * 2.0 * math.pi, rel=0.02)


@pytest.fixture(scope="module")
def small():
    return datasets.icosphere(1)


@pytest.mark.parametrize("sigma", [0.0, -0.1, math.nan])
def test_rejects_bad_sigma(small, sigma):
    with pytest.raises(ValueError, match="sigma"):
        pa.functionals.Perimeter(small, 0.1, weight=np.ones(small.n_vertices), sigma=sigma)


@pytest.mark.parametrize("eta", [-0.1, math.nan])
def test_rejects_bad_eta(small, eta):
    with pytest.raises(ValueError, match="eta"):
        pa.functionals.Perimeter(small, 0.1, weight=np.ones(small.n_vertices), eta=eta)


@pytest.mark.parametrize("options", [{}, {"eta": 0.3, "sigma": 0.2}])
def test_preconditioner_is_the_diagonal_of_the_hessian_at_the_pure_phases(
    surfaces, smooth_weight, options
):
    weight = smooth_weight(surfaces)
    perimeter = pa.functionals.Perimeter(surfaces, 0.1, weight=weight, **options)
    phases = np.where(np.arange(surfaces.n_vertices) % 2 == 0, 1.0, -1.0)
    expected = perimeter.hessian(phases).diagonal()
    # The stiffness of the Hessian is weighted face by face, the estimate vertex by vertex.
    uniform = pa.functionals.Perimeter(surfaces, 0.1)
    np.testing.assert_allclose(
        uniform.preconditioner(), uniform.hessian(phases).diagonal(), rtol=1e-10
    )
    ratio = perimeter.preconditioner() / expected
    assert np.median(ratio) == pytest.approx(1, abs=0.1)
    assert (perimeter.preconditioner() > 0).all()


def test_length_is_that_of_a_great_circle():
    sphere = datasets.icosphere(5)
    epsilon = 2 * sphere.mean_edge_length
    u = np.tanh(3 * sphere.vertices[:, 2] / (2 * math.sqrt(2) * epsilon))
    length = pa.functionals.Perimeter(sphere, epsilon).length(u)
    assert length == pytest.approx(2 * math.pi, rel=0.01)
    # Within a hemisphere half of it, whatever the field does outside.
    weight = (sphere.vertices[:, 0] > 0).astype(float)
    inside = pa.functionals.Perimeter(sphere, epsilon, weight=weight, sigma=0.5)
    assert inside.length(u) == pytest.approx(math.pi, rel=0.05)
