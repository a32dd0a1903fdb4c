"""The driver on problems whose minimisers are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas.optimise import Status, minimise

TARGET = 3.0


class Quadratic:
    """E(u) = 1/2 sum d (u - c)^2."""

    def __init__(self, d, c):
        self.d, self.c = d, c
        self.calls = 0

    def value_and_gradient(self, u):
        self.calls += 1
        return float(0.5 * self.d @ (u - self.c) ** 2), self.d * (u - self.c)


class Linear:
    """A(u) = a . u."""

    def __init__(self, a):
        self.a = a

    def value_and_gradient(self, u):
        return float(self.a @ u), self.a.copy()


class SquaredNorm:
    """A(u) = |u|^2."""

    def value_and_gradient(self, u):
        return float(u @ u), 2.0 * u


@pytest.fixture
def problem():
    """d spans four decades, so that only the scaling makes it easy."""
    rng = np.random.default_rng(0)
    d = 10.0 ** rng.uniform(-2.0, 2.0, 40)
    return d, rng.standard_normal(40), rng.uniform(0.5, 1.5, 40)


def solve(problem, **options):
    d, c, a = problem
    arguments = {"scale": np.sqrt(d), "tolerance": 1e-15, "feasibility": 1e-9, **options}
    return minimise([(1.0, Quadratic(d, c))], Linear(a), TARGET, np.zeros(len(d)), **arguments)


def test_linear_constraint_has_the_minimiser_and_multiplier_of_lagrange(problem):
    d, c, a = problem
    result = solve(problem)
    # Stationary: d (u - c) + multiplier a / target = 0 with a . u = target.
    multiplier = TARGET * (a @ c - TARGET) / (a @ (a / d))
    u = c - multiplier * a / (TARGET * d)
    assert result.converged
    assert abs(a @ result.u / TARGET - 1.0) <= 1e-9
    np.testing.assert_allclose(result.u, u, atol=1e-5)
    assert result.multiplier == pytest.approx(multiplier, rel=1e-5)
    assert result.energy == pytest.approx(0.5 * d @ (u - c) ** 2, rel=1e-6)
    assert result.violation == pytest.approx(a @ result.u / TARGET - 1.0, abs=1e-15)


def test_nonlinear_constraint_has_the_known_multiplier():
    # -b . u on the unit sphere: u = b / |b|, the multiplier |b| / 2.
    b = np.array([3.0, -4.0, 12.0])
    zero_curvature = Quadratic(np.zeros(3), np.zeros(3))
    result = minimise(
        [(-1.0, Linear(b)), (5.0, zero_curvature)],
        SquaredNorm(),
        1.0,
        np.array([1.0, 0.0, 0.0]),
        scale=np.ones(3),
        tolerance=1e-15,
        feasibility=1e-9,
    )
    assert result.converged
    np.testing.assert_allclose(result.u, b / 13.0, atol=1e-6)
    assert result.multiplier == pytest.approx(6.5, rel=1e-6)
    assert result.energy == pytest.approx(-13.0, rel=1e-8)


def test_weights_multiply_their_functionals(problem):
    d, c, a = problem
    # 2 E1 + 3 E2 of the same curvature has its free minimum at the weighted mean of the two.
    terms = [(2.0, Quadratic(d, c)), (3.0, Quadratic(d, -c))]
    mean = -0.2 * c
    result = minimise(
        terms, Linear(a), a @ mean, np.zeros(len(d)), scale=np.sqrt(d), tolerance=1e-15
    )
    np.testing.assert_allclose(result.u, mean, atol=1e-5)
    assert result.energy == pytest.approx(0.5 * d @ (2.0 * (1.2 * c) ** 2 + 3.0 * (0.8 * c) ** 2))


@pytest.mark.parametrize("penalty", [1.0, 100.0])
def test_penalty_leaves_the_predicted_violation(problem, penalty):
    d, c, a = problem
    result = solve(problem, area="penalty", penalty=penalty)
    # The force of the penalty, penalty * g, stands in for the multiplier.
    violation = (a @ c - TARGET) / (TARGET + penalty * (a @ (a / d)) / TARGET)
    assert abs(violation) > 1e-4
    assert result.violation == pytest.approx(violation, rel=1e-4)
    assert (result.multiplier, result.penalty) == (0.0, penalty)
    assert result.converged


def test_lagrangian_meets_the_feasibility_asked_for(problem):
    for feasibility in (1e-3, 1e-6):
        assert abs(solve(problem, feasibility=feasibility).violation) <= feasibility


def test_known_multiplier_needs_no_update(problem):
    cold = solve(problem)
    warm = solve(problem, multiplier=cold.multiplier, penalty=cold.penalty, max_updates=1)
    assert abs(warm.violation) <= 1e-7
    assert warm.iterations < cold.iterations
    once = solve(problem, max_updates=1)
    assert abs(once.violation) > 1e-4
    assert not once.converged


def test_scale_makes_the_unknowns_alike(problem):
    plain = solve(problem, scale=np.ones(len(problem[0])))
    scaled = solve(problem)
    np.testing.assert_allclose(plain.u, scaled.u, atol=1e-4)
    assert 2 * scaled.iterations < plain.iterations


def test_callback_hears_of_every_step(problem):
    d, c, a = problem
    quadratic = Quadratic(d, c)
    heard = []
    result = minimise(
        [(1.0, quadratic)],
        Linear(a),
        TARGET,
        np.zeros(len(d)),
        scale=np.sqrt(d),
        callback=heard.append,
    )
    assert [step.number for step in heard] == list(range(1, result.iterations + 1))
    assert result.iterations > 3
    assert heard[-1].energy == pytest.approx(result.energy, rel=1e-12)
    assert heard[-1].violation == pytest.approx(result.violation, abs=1e-12)
    assert result.evaluations == quadratic.calls >= result.iterations


def test_callback_can_stop_the_solve(problem):
    class Stop(Exception):  # noqa: N818
        pass

    def stop(step):
        if step.number == 2:
            raise Stop

    with pytest.raises(Stop):
        solve(problem, callback=stop)


def test_a_true_answer_of_the_callback_stops_the_solve(problem):
    heard = []

    def stop(step):
        heard.append(step)
        return step.number == 2

    result = solve(problem, scale=np.ones(len(problem[0])), callback=stop)
    assert result.status is Status.STOPPED
    assert not result.converged
    assert result.iterations == 2
    np.testing.assert_allclose(heard[-1].u, result.u, rtol=1e-12)


def test_status_says_why_a_solve_ended(problem):
    assert solve(problem).status is Status.CONVERGED
    assert solve(problem, scale=np.ones(40), max_iterations=4).status is Status.STEP_LIMIT
    assert solve(problem, max_updates=1).status is Status.INFEASIBLE
    assert all(status.sentence for status in Status)


def test_step_limit_is_kept_and_reported(problem):
    heard = []
    result = solve(problem, scale=np.ones(len(problem[0])), max_iterations=4, callback=heard.append)
    assert result.iterations == len(heard) == 4
    assert not result.converged
    assert solve(problem, scale=np.ones(len(problem[0]))).iterations > 4


def test_start_is_left_alone(problem):
    d, c, a = problem
    start = np.full(len(d), 0.25)
    minimise([(1.0, Quadratic(d, c))], Linear(a), TARGET, start, scale=np.sqrt(d))
    assert (start == 0.25).all()


def test_unknown_area_is_named(problem):
    with pytest.raises(ValueError, match="area: 'barrier' must be"):
        solve(problem, area="barrier")


def test_phase_field_halves_a_strip():
    # The flat interface across the short side is optimal, and its profile is known.
    surface = pa.datasets.sheet(60, 12, size=(2.0, 0.4))
    epsilon = 0.1
    x = surface.vertices[:, 0] - 1.0
    area = pa.functionals.Area(surface, epsilon, delta=0.0)
    result = minimise(
        [(1.0, pa.functionals.Perimeter(surface, epsilon))],
        area,
        0.5 * surface.area,
        np.where(x + 0.3 > 0.0, 1.0, -1.0),
        scale=np.sqrt(surface.mass / epsilon),
        tolerance=1e-12,
    )
    assert result.converged
    assert result.energy == pytest.approx(np.sqrt(2.0) * 0.4, rel=0.01)
    profile = np.tanh(3.0 * x / (2.0 * np.sqrt(2.0) * epsilon))
    # Cells of a third of epsilon: the steepest part of the profile is off by (h / epsilon)^2 / 4.
    assert np.abs(result.u - profile).max() < 0.03


class Kink:
    """E(u) = |a . u - 1|, as where two paths are of one length."""

    def __init__(self, a):
        self.a = a

    def value_and_gradient(self, u):
        beyond = self.a @ u - 1.0
        return float(abs(beyond)), np.sign(beyond) * self.a


@pytest.mark.parametrize("seed", range(5))
def test_a_kink_does_not_stop_a_descent(seed):
    rng = np.random.default_rng(seed)
    d, c = 10.0 ** rng.uniform(-0.5, 0.5, 30), rng.uniform(-2.0, 2.0, 30)
    a = rng.uniform(0.5, 1.5, 30)
    result = minimise(
        [(1.0, Quadratic(d, c)), (10.0, Kink(a))],
        Linear(a),
        TARGET,
        rng.standard_normal(30),
        scale=np.sqrt(d),
        area="none",
        tolerance=1e-9,
    )
    # The minimiser lies on the kink.
    u = c - a / d * (a @ c - 1.0) / (a @ (a / d))
    least = 0.5 * d @ (u - c) ** 2
    assert least <= result.energy <= 1.001 * least


def test_a_long_plateau_is_crossed():
    # The first steps are short beside the value: a test of single steps would stop there.
    n = 50
    d = np.full(n, 1e-3)
    shift = Quadratic(np.zeros(n), np.zeros(n))
    result = minimise(
        [(1.0, Quadratic(d, np.full(n, 10.0))), (1.0, shift)],
        Linear(np.ones(n)),
        TARGET,
        np.zeros(n),
        scale=np.ones(n),
        area="none",
        tolerance=1e-10,
    )
    np.testing.assert_allclose(result.u, 10.0, atol=1e-2)
