"""Diffuse area, equation (2) and the constraint of (10)."""

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


def make_field(kind, surface, smooth_field):
    if kind == "smooth":
        return smooth_field(surface)
    # Beyond [-1, 1] as well: an optimiser goes there, and chi is constant there.
    return random_field(surface, 1.3)


@pytest.mark.parametrize("kind", ["random", "smooth"])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("delta", [None, 0.0, 0.2])
def test_agrees_with_reference(surfaces, smooth_field, smooth_weight, kind, weighted, delta):
    u = make_field(kind, surfaces, smooth_field)
    weight = smooth_weight(surfaces) if weighted else None
    epsilon = 0.3
    functional = pa.functionals.Area(surfaces, epsilon, delta=delta, weight=weight)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    used = epsilon / np.sqrt(surfaces.area) / 10.0 if delta is None else delta
    expected = reference.area(vertices, faces, u, used, weight)
    check_agreement(functional.value_and_gradient(u), expected)


@pytest.mark.parametrize("weighted", [False, True])
def test_gradient_is_the_derivative(surfaces, smooth_field, smooth_weight, weighted):
    weight = smooth_weight(surfaces) if weighted else None
    functional = pa.functionals.Area(surfaces, 0.3, weight=weight)
    for kind in ("random", "smooth"):
        u = make_field(kind, surfaces, smooth_field)
        # chi'' jumps at |u| = 1 - delta: a vertex within h of it is off by h, others by h^2.
        check_gradient(functional, u, random_directions(surfaces), 1e-6, 1e-6)


def test_gradient_of_every_vertex():
    surface = datasets.sheet(3, 3, amplitude=0.2, periods=0.7)
    u = np.random.default_rng(1).uniform(-1.2, 1.2, surface.n_vertices)
    functional = pa.functionals.Area(surface, 0.5)
    # Rounding of the difference: 1e-16 / h = 1e-11, and the gradient is of order 0.1.
    check_gradient_of_every_vertex(functional, u, 1e-5, 1e-8)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("delta", [0.0, 0.1])
def test_hessian_agrees_with_reference(surfaces, smooth_weight, weighted, delta):
    # Beyond the plateaus too.
    u = np.random.default_rng(3).uniform(-1.5, 1.5, surfaces.n_vertices)
    weight = smooth_weight(surfaces) if weighted else None
    functional = pa.functionals.Area(surfaces, 0.1, delta=delta, weight=weight)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    expected = reference.area_hessian(vertices, faces, u, delta, weight)
    hessian = functional.hessian(u)
    assert hessian.format == "csr"
    assert hessian.nnz == surfaces.n_vertices
    assert np.abs(hessian.toarray() - expected).max() <= AGREE * np.abs(expected).max()


def test_hessian_is_the_derivative_of_the_gradient(surfaces, smooth_weight):
    functional = pa.functionals.Area(surfaces, 0.1, delta=0.05, weight=smooth_weight(surfaces))
    h = 1e-5
    # No vertex within h of the jumps of chi'' at |u| = 0.95.
    u = np.random.default_rng(4).uniform(-1.5, 1.5, surfaces.n_vertices)
    u = np.where(np.abs(np.abs(u) - 0.95) < 2.0 * h, 0.5, u)
    plus = functional.value_and_gradient(u + h)[1]
    minus = functional.value_and_gradient(u - h)[1]
    diagonal = functional.hessian(u).diagonal()
    assert np.abs((plus - minus) / (2.0 * h) - diagonal).max() < 1e-8 * np.abs(diagonal).max()


def test_hessian_jumps_at_the_plateaus():
    surface = datasets.icosphere(1)
    functional = pa.functionals.Area(surface, 0.1, delta=0.2)
    inside = functional.hessian(np.full(surface.n_vertices, 0.8 - 1e-12)).diagonal()
    np.testing.assert_allclose(inside, -1.5 / 0.8**2 * surface.mass, rtol=1e-9)
    assert (functional.hessian(np.full(surface.n_vertices, 0.8)).data == 0.0).all()


def test_pure_phases(surfaces):
    functional = pa.functionals.Area(surfaces, 0.1)
    one = np.ones(surfaces.n_vertices)
    assert functional.value_and_gradient(one)[0] == pytest.approx(surfaces.area, rel=1e-12)
    assert functional.value_and_gradient(-one)[0] == 0.0
    assert not functional.value_and_gradient(one)[1].any()


def test_mixed_phase_is_half(surfaces, smooth_weight):
    zero = np.zeros(surfaces.n_vertices)
    assert pa.functionals.Area(surfaces, 0.1).value_and_gradient(zero)[0] == pytest.approx(
        0.5 * surfaces.area, rel=1e-12
    )
    weight = smooth_weight(surfaces)
    assert pa.functionals.Area(surfaces, 0.1, weight=weight).value_and_gradient(zero)[
        0
    ] == pytest.approx(0.5 * np.dot(surfaces.mass, weight), rel=1e-12)


def test_the_two_phases_fill_the_surface(surfaces, smooth_field):
    functional = pa.functionals.Area(surfaces, 0.2)
    u = smooth_field(surfaces)
    value, gradient = functional.value_and_gradient(u)
    other, other_gradient = functional.value_and_gradient(-u)
    assert 0.05 * surfaces.area < value < 0.95 * surfaces.area
    assert value + other == pytest.approx(surfaces.area, rel=1e-12)
    assert np.allclose(gradient, other_gradient, rtol=0.0, atol=1e-14)


def test_half_of_a_sheet():
    surface = datasets.sheet(100, 8, size=(2.0, 1.5))
    x = np.asarray(surface.vertices)[:, 0] - 1.0
    for epsilon in (0.05, 0.2):
        profile = np.tanh(3.0 * x / (2.0 * math.sqrt(2.0) * epsilon))
        value, _ = pa.functionals.Area(surface, epsilon).value_and_gradient(profile)
        # Odd profile, symmetric in pairs of vertices; the masses pair up except in the corners,
        # where chi is 0 or 1 and a corner cell of 0.02 x 0.19 shares 1/3 + 1/6 unevenly.
        assert value == pytest.approx(1.5, abs=0.02 * 0.19)


def test_indicator_stays_in_the_unit_interval_and_is_exact_on_its_plateaus():
    rng = np.random.default_rng(0)
    deltas = np.concatenate(
        [[0.0, 0.5, np.nextafter(1, 0)], rng.random(3000), rng.random(3000) / 10]
    )
    for delta in deltas:
        r = 1 - delta
        # The last values below the plateau, where the cubic rounds.
        steps = np.concatenate([np.arange(1, 40) * 1e-16, np.geomspace(1e-16, 1e-6, 60)])
        below = r - r * steps
        chi = pa.functionals.indicator(np.concatenate([below, -below]), delta)
        assert chi.min() >= 0
        assert chi.max() <= 1
        plateaus = pa.functionals.indicator(
            [r, np.nextafter(r, 2), 1.5, -r, -np.nextafter(r, 2)], delta
        )
        assert plateaus.tolist() == [1, 1, 1, 0, 0]


def test_products_of_indicators_are_weights():
    sphere = datasets.icosphere(3)
    rng = np.random.default_rng(1)
    for delta in rng.random(200) / 20:
        weight = np.ones(sphere.n_vertices)
        for _ in range(4):
            field = np.clip(rng.normal(0, 2, sphere.n_vertices), delta - 1 + 1e-9, 1 - delta)
            chi = pa.functionals.indicator(field, delta)
            weight = weight * (chi if rng.random() < 0.5 else 1 - chi)
            pa.functionals.Area(sphere, 0.1, weight=weight)
            pa.functionals.Perimeter(sphere, 0.1, weight=weight)
