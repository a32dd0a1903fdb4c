"""The driver with Ipopt: closed forms, the minimisers of L-BFGS, exceptions and interrupts."""

from __future__ import annotations

import functools
import signal
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse

import phaseatlas as pa
from phaseatlas import datasets, optimise
from phaseatlas.functionals import Area, Connectedness, Distortion, Perimeter

TARGET = 3.0


@pytest.fixture(scope="session")
def minimise():
    """The driver; the test is skipped without ipyopt."""
    pytest.importorskip("ipyopt", reason="needs the extra ipopt")
    return functools.partial(optimise.minimise, solver="ipopt")


class Quadratic:
    """E(u) = 1/2 sum d (u - c)^2."""

    def __init__(self, d, c):
        self.d, self.c = d, c

    def value_and_gradient(self, u):
        return float(0.5 * self.d @ (u - self.c) ** 2), self.d * (u - self.c)

    def hessian(self, u):
        return scipy.sparse.diags_array(self.d).tocsr()


class Linear:
    """A(u) = a . u."""

    def __init__(self, a):
        self.a = a

    def value_and_gradient(self, u):
        return float(self.a @ u), self.a.copy()

    def hessian(self, u):
        return scipy.sparse.csr_array((len(self.a), len(self.a)))


class SquaredNorm:
    """A(u) = |u|^2."""

    def value_and_gradient(self, u):
        return float(u @ u), 2.0 * u

    def hessian(self, u):
        return 2.0 * scipy.sparse.eye_array(len(u), format="csr")


class FirstOrder:
    """A functional without its Hessian, that may fail at one of its evaluations."""

    def __init__(self, functional, fail_at=0, fail=None):
        self.functional, self.fail_at, self.fail = functional, fail_at, fail
        self.calls = 0

    def value_and_gradient(self, u):
        self.calls += 1
        if self.calls == self.fail_at:
            self.fail()
        return self.functional.value_and_gradient(u)


@pytest.fixture
def problem():
    """d spans four decades, so that only the scaling makes it easy."""
    rng = np.random.default_rng(0)
    d = 10.0 ** rng.uniform(-2.0, 2.0, 40)
    return d, rng.standard_normal(40), rng.uniform(0.5, 1.5, 40)


@pytest.fixture
def solve(minimise, problem):
    """The constrained quadratic, with exact Hessians or of limited memory."""
    d, c, a = problem

    def run(exact=True, **options):
        arguments = {"scale": np.sqrt(d), "tolerance": 1e-12, **options}
        quadratic, linear = Quadratic(d, c), Linear(a)
        if not exact:
            quadratic = FirstOrder(quadratic)
        return minimise([(1.0, quadratic)], linear, TARGET, np.zeros(len(d)), **arguments)

    return run


class Setting:
    """Perimeter and area on a surface of unit area, and a start that is no minimiser."""

    def __init__(self, surface, wide=2.0):
        self.surface = surface = surface.scaled(surface.area**-0.5)
        self.epsilon = epsilon = wide * surface.mean_edge_length
        self.perimeter = Perimeter(surface, epsilon)
        self.area = Area(surface, epsilon)
        hessian = epsilon * surface.stiffness.diagonal() + 4.5 / epsilon * surface.mass
        self.scale = np.sqrt(hessian)
        x, y, z = surface.vertices.T / np.abs(surface.vertices).max()
        self.start = np.tanh(0.5 * (z + 0.3 * x * y + 0.1 * np.sin(9.0 * x) - 0.2) / epsilon)

    def terms(self, connected=False, distortion=0.0):
        terms = [(1.0, self.perimeter)]
        if connected:
            terms.append((1.0 / self.epsilon, Connectedness(self.surface, self.epsilon)))
        if distortion:
            terms.append((distortion, Distortion(self.surface, self.epsilon)))
        return terms

    def solve(self, driver, terms=None, **options):
        return driver(
            self.terms() if terms is None else terms,
            self.area,
            0.5 * self.area.total,
            self.start,
            scale=self.scale,
            **options,
        )


@pytest.fixture(scope="module")
def sphere():
    return Setting(datasets.icosphere(3))


@pytest.mark.parametrize("exact", [True, False])
def test_linear_constraint_has_the_minimiser_and_multiplier_of_lagrange(problem, solve, exact):
    d, c, a = problem
    result = solve(exact)
    multiplier = TARGET * (a @ c - TARGET) / (a @ (a / d))
    assert result.converged
    assert abs(result.violation) <= 1e-8
    np.testing.assert_allclose(result.u, c - multiplier * a / (TARGET * d), atol=1e-5)
    assert result.multiplier == pytest.approx(multiplier, rel=1e-5)
    assert result.violation == pytest.approx(a @ result.u / TARGET - 1.0, abs=1e-15)
    if exact:
        assert result.iterations == 1  # Newton's method on a quadratic


def test_nonlinear_constraint_takes_its_hessian(minimise):
    # -b . u on the unit sphere: u = b / |b|. All curvature is the constraint's.
    b = np.array([3.0, -4.0, 12.0])
    result = minimise(
        [(-1.0, Linear(b))], SquaredNorm(), 1.0, np.array([1.0, 0.0, 0.0]), scale=np.ones(3)
    )
    assert result.converged
    np.testing.assert_allclose(result.u, b / 13.0, atol=1e-7)
    assert result.multiplier == pytest.approx(6.5, rel=1e-6)
    assert result.energy == pytest.approx(-13.0, rel=1e-8)
    assert result.iterations < 20


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("penalty", [1.0, 100.0])
def test_penalty_leaves_the_predicted_violation(problem, solve, penalty, exact):
    d, c, a = problem
    result = solve(exact, area="penalty", penalty=penalty)
    violation = (a @ c - TARGET) / (TARGET + penalty * (a @ (a / d)) / TARGET)
    assert abs(violation) > 1e-4
    assert result.violation == pytest.approx(violation, rel=1e-4)
    assert result.energy == pytest.approx(0.5 * d @ (result.u - c) ** 2, rel=1e-12)
    assert (result.multiplier, result.penalty) == (0.0, penalty)
    assert result.converged
    if exact:
        assert result.iterations == 1


@pytest.mark.parametrize("exact", [True, False])
def test_no_constraint(problem, solve, exact):
    result = solve(exact, area="none")
    assert result.converged
    np.testing.assert_allclose(result.u, problem[1], atol=1e-5)
    assert result.multiplier == 0.0


def test_sphere_is_cut_along_a_great_circle(minimise):
    setting = Setting(datasets.icosphere(4))
    result = setting.solve(minimise)
    length = 2.0 * np.pi * np.sqrt(1.0 / (4.0 * np.pi))
    assert result.converged
    assert abs(result.violation) <= 1e-8
    assert result.energy / np.sqrt(2.0) == pytest.approx(length, rel=0.02)
    # Stationary: the gradient of the Lagrangian vanishes.
    gradient = setting.perimeter.value_and_gradient(result.u)[1]
    slope = setting.area.value_and_gradient(result.u)[1] / (0.5 * setting.area.total)
    assert np.abs((gradient + result.multiplier * slope) / setting.scale).max() < 1e-7
    assert np.abs(setting.perimeter.value_and_gradient(setting.start)[1]).max() > 1e-4


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("perimeter", {}),
        ("connectedness", {"connected": True}),
        ("distortion", {"distortion": 1.0}),
    ],
)
@pytest.mark.parametrize("kind", ["sphere", "torus", "starfish"])
def test_finds_the_minimiser_of_lbfgs(minimise, kind, name, options):
    surface = {
        "sphere": lambda: datasets.icosphere(3),
        "torus": lambda: datasets.torus(1.0, 0.4, 40, 18),
        "starfish": lambda: datasets.starfish(3),
    }[kind]()
    setting = Setting(surface)
    # A start in the basin of one minimiser.
    setting.start = setting.solve(optimise.minimise, tolerance=1e-3, max_updates=1).u
    terms = setting.terms(**options)
    expected = setting.solve(optimise.minimise, terms)
    result = setting.solve(minimise, terms)
    assert result.converged
    assert abs(result.violation) <= 1e-8
    assert result.energy == pytest.approx(expected.energy, rel=0.01)


def test_exact_hessians_need_few_steps(sphere, minimise):
    exact = sphere.solve(minimise)
    limited = sphere.solve(minimise, [(1.0, FirstOrder(sphere.perimeter))])
    assert limited.energy == pytest.approx(exact.energy, rel=1e-5)
    assert 3 * exact.iterations < limited.iterations


def test_known_multiplier_and_minimiser_need_no_step(minimise):
    setting = Setting(datasets.torus(1.0, 0.4, 30, 14))
    cold = setting.solve(minimise, area="lagrangian")
    setting.start = cold.u
    warm = setting.solve(minimise, multiplier=cold.multiplier)
    assert warm.converged
    assert warm.iterations == 0
    assert warm.energy == cold.energy


def test_penalty_and_none_on_a_surface(sphere, minimise):
    # Between a penalty that is too weak to hold half of the sphere and the constraint itself.
    strong = sphere.solve(minimise, area="penalty", penalty=1e4)
    exact = sphere.solve(minimise)
    assert strong.converged
    assert strong.energy == pytest.approx(exact.energy, rel=1e-3)
    heard = []
    free = sphere.solve(minimise, area="none", callback=heard.append)
    assert free.converged
    assert heard[-1].violation == free.violation
    assert free.energy < 1e-6
    assert abs(free.violation) == pytest.approx(1.0, abs=1e-6)


def test_callback_hears_of_every_step(sphere, minimise):
    heard = []
    result = sphere.solve(minimise, callback=heard.append)
    assert [step.number for step in heard] == list(range(1, result.iterations + 1))
    assert result.iterations > 3
    assert heard[-1].energy == result.energy
    assert heard[-1].violation == result.violation
    assert result.evaluations >= result.iterations


def test_step_limit_is_kept_and_reported(sphere, minimise):
    heard = []
    result = sphere.solve(minimise, max_iterations=3, callback=heard.append)
    assert result.iterations == len(heard) == 3
    assert not result.converged


def test_a_gradient_that_is_none_is_reported(minimise, problem):
    class Uphill(FirstOrder):
        def value_and_gradient(self, u):
            value, gradient = super().value_and_gradient(u)
            return value, -gradient

    d, c, a = problem
    uphill = Uphill(Quadratic(d, c))
    result = minimise([(1.0, uphill)], Linear(a), TARGET, np.zeros(len(d)), scale=np.sqrt(d))
    assert not result.converged


@pytest.mark.parametrize("at", [1, 2, 5])
@pytest.mark.parametrize("error", [ValueError, MemoryError, SystemExit, KeyboardInterrupt])
def test_exceptions_of_functionals_arrive(sphere, minimise, error, at):
    raised = error("from the functional")

    def fail():
        raise raised

    functional = FirstOrder(sphere.perimeter, at, fail)
    with pytest.raises(error) as caught:
        sphere.solve(minimise, [(1.0, functional)])
    assert caught.value is raised
    assert functional.calls == at


def test_exceptions_of_hessians_arrive(sphere, minimise):
    class Failing(FirstOrder):
        def hessian(self, u):
            if self.calls > 3:
                raise ZeroDivisionError
            return self.functional.hessian(u)

    with pytest.raises(ZeroDivisionError):
        sphere.solve(minimise, [(1.0, Failing(sphere.perimeter))])


def test_callback_can_stop_the_solve(sphere, minimise, capfd):
    class Stop(BaseException):
        pass

    heard = []

    def stop(step):
        heard.append(step.number)
        if step.number == 2:
            raise Stop

    with pytest.raises(Stop):
        sphere.solve(minimise, callback=stop)
    assert heard == [1, 2]
    assert capfd.readouterr() == ("", "")


def test_a_true_answer_of_the_callback_stops_the_solve(sphere, minimise):
    result = sphere.solve(minimise, callback=lambda step: step.number == 2)
    assert result.status is optimise.Status.STOPPED
    assert result.iterations == 2


@pytest.mark.parametrize("at", [1, 3])
def test_interrupt_ends_the_solve(sphere, minimise, at):
    handler = signal.getsignal(signal.SIGINT)

    def interrupt():
        signal.raise_signal(signal.SIGINT)

    functional = FirstOrder(sphere.perimeter, at, interrupt)
    with pytest.raises(KeyboardInterrupt):
        sphere.solve(minimise, [(1.0, functional)])
    assert functional.calls == at
    assert signal.getsignal(signal.SIGINT) is handler


def test_interrupt_goes_to_the_handler_that_was_set(sphere, minimise):
    heard = []
    before = signal.signal(signal.SIGINT, lambda *caught: heard.append(caught))
    try:
        functional = FirstOrder(sphere.perimeter, 3, lambda: signal.raise_signal(signal.SIGINT))
        result = sphere.solve(minimise, [(1.0, functional)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert result.converged
    assert [number for number, _ in heard] == [signal.SIGINT]


def test_nothing_is_printed(sphere, minimise, capfd):
    sphere.solve(minimise)
    sphere.solve(minimise, [(1.0, FirstOrder(sphere.perimeter))], max_iterations=4)
    assert capfd.readouterr() == ("", "")


def test_the_same_start_gives_the_same_field(sphere, minimise):
    for terms in (sphere.terms(), sphere.terms(connected=True, distortion=0.5)):
        first, second = sphere.solve(minimise, terms), sphere.solve(minimise, terms)
        assert (first.u == second.u).all()
        assert first.multiplier == second.multiplier


def test_start_is_left_alone(sphere, minimise):
    start = sphere.start.copy()
    sphere.solve(minimise)
    assert (sphere.start == start).all()


def test_unknown_area_is_named(sphere, minimise):
    with pytest.raises(ValueError, match="area: 'barrier' must be"):
        sphere.solve(minimise, area="barrier")


def test_tree_of_two_levels(minimise):
    surface = datasets.starfish(3)
    tree = pa.segment(surface, 2, solver="ipopt")
    assert all(d.converged for d in tree.diagnostics)
    assert max(abs(d.violation) for d in tree.diagnostics) <= 1e-8
    assert (tree.components == 1).all()
    weights = tree.weights @ surface.mass
    np.testing.assert_allclose(weights, surface.area / 4.0, rtol=1e-7)
    again = pa.segment(surface, 2, solver="ipopt")
    assert (again.fields == tree.fields).all()
    with ThreadPoolExecutor(2) as pool:
        assert (pa.segment(surface, 2, solver="ipopt", executor=pool).fields == tree.fields).all()


@pytest.mark.parametrize("area", ["penalty", "none"])
def test_tree_without_the_constraint(minimise, area):
    surface = datasets.starfish(3)
    options = {"area": area, "penalty": 10.0, "connected": False, "distortion": 3.0}
    tree = pa.segment(surface, 1, solver="ipopt", **options)
    assert tree.diagnostics[0].converged
    assert abs(tree.diagnostics[0].violation) > 1e-8


def test_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipyopt", None)
    with pytest.raises(ValueError, match=r'solver: "ipopt".*pip install "phaseatlas\[ipopt\]"'):
        pa.segment(datasets.icosphere(2), solver="ipopt")


def test_unknown_solver_names_both():
    with pytest.raises(ValueError, match=r"solver: 'newton' must be one of .*lbfgs.*ipopt"):
        pa.segment(datasets.icosphere(2), solver="newton")
