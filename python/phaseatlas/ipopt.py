"""The driver with Ipopt: problems (4)/(6) and (8)/(10), the area as an equality constraint.

Ipopt (Waechter and Biegler 2006) takes Newton steps on the Lagrangian with a filter line search.
The Hessian is exact and sparse where every functional has one, of limited memory otherwise. The
wheels of ipyopt bring a sequential MUMPS: no result depends on the number of threads.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .functionals import Functional, TwiceDifferentiable
from .optimise import AREA_CONSTRAINTS, AreaConstraint, Iteration, Result, weighted_sum

__all__ = ["minimise", "require"]

Floats = NDArray[np.float64]

_OPTIONS: dict[str, int | float | str] = {
    "print_level": 0,
    "sb": "yes",
    # A callback that failed leaves NaN, also in the derivatives.
    "check_derivatives_for_naninf": "yes",
    # The unknowns come scaled.
    "nlp_scaling_method": "none",
    "warm_start_init_point": "yes",
    # B0 = y.y / s.y, the common choice: that of Ipopt, s.y / s.s, takes several times the trials.
    "limited_memory_initialization": "scalar2",
    # Plain minimum degree puts the dense row of the constraint last; MUMPS' own choice, QAMD,
    # takes three times as long where the Hessian is of limited memory, and as long where not.
    "mumps_pivot_order": 0,
    # The test of `_Problem._step` is in its place.
    "acceptable_iter": 0,
}
_UNBOUNDED = 2e19

# A solve ends after so many idle steps in a row. Steps below this part of their full length do not
# count: a line search that fails makes short ones.
_IDLE_STEPS = 3
_SHORT = 0.1

# Return codes of Ipopt.
_SOLVED = 0
_AT_STEP_LIMIT = -1
_BROKEN = -100


def require() -> Any:
    """Return the module `ipyopt`.

    Raises
    ------
    ValueError
        Where it cannot be imported; the message names the extra to install.
    """
    try:
        import ipyopt
    except ImportError as error:
        raise ValueError(
            'solver: "ipopt" needs the extra of that name, pip install "phaseatlas[ipopt]" '
            f"({error})"
        ) from error
    return ipyopt


class _Last:
    """A value and gradient that is not evaluated twice in a row at the same point."""

    def __init__(self, function: Callable[[Floats], tuple[float, Floats]]) -> None:
        self.function = function
        self.at: Floats = np.empty(0)
        self.result: tuple[float, Floats] = (np.nan, np.empty(0))
        self.evaluations = 0

    def __call__(self, u: Floats) -> tuple[float, Floats]:
        if not np.array_equal(self.at, u):
            self.result = self.function(u)
            self.at = u
            self.evaluations += 1
        return self.result


class _Triangle:
    """Lower triangle of a Hessian in the unknowns scale * u, on its fixed pattern."""

    def __init__(self, functional: TwiceDifferentiable, u: Floats, scale: Floats) -> None:
        self.functional = functional
        pattern = functional.hessian(u).tocoo()
        self.entries = np.flatnonzero(pattern.row >= pattern.col)
        self.rows = pattern.row[self.entries]
        self.columns = pattern.col[self.entries]
        self.factors = 1 / (scale[self.rows] * scale[self.columns])

    def __call__(self, u: Floats) -> Floats:
        values: Floats = self.functional.hessian(u).data[self.entries] * self.factors
        return values


class _Interrupts:
    """Holds Ctrl-C back until a callback asks for it.

    Python would raise it on the way into a callback, where nothing of ours can catch it, and
    Ipopt takes any exception for a point where the functional has no value.
    """

    def __init__(self) -> None:
        self.handler: Any = signal.getsignal(signal.SIGINT)
        self.pending: list[tuple[Any, ...]] = []
        self.active = callable(self.handler) and (
            threading.current_thread() is threading.main_thread()
        )

    def __enter__(self) -> _Interrupts:
        if self.active:
            signal.signal(signal.SIGINT, lambda *caught: self.pending.append(caught))
        return self

    def __exit__(self, *_: object) -> None:
        if self.active:
            signal.signal(signal.SIGINT, self.handler)
        self.deliver()

    def deliver(self) -> None:
        if self.pending:
            self.handler(*self.pending.pop())


class _Problem:
    """E(u) under g(u) = A(u) / target - 1 = 0 as callbacks of Ipopt, in the unknowns scale * u.

    The Hessian of the penalty mu/2 g^2 would be dense: instead of it, E + t^2 / 2 is minimised
    under g(u) = t / sqrt(mu), with one more unknown t.

    The first exception is kept, and every later callback fails, which ends the solve.
    """

    def __init__(
        self,
        terms: Sequence[tuple[float, Functional]],
        constraint: Functional,
        target: float,
        u: Floats,
        scale: Floats,
        area: AreaConstraint,
        penalty: float,
        feasibility: float,
        tolerance: float,
        callback: Callable[[Iteration], None] | None,
    ) -> None:
        self.terms = terms
        self.constraint = constraint
        self.target = target
        self.scale = scale
        self.constrained = area != "none"
        self.root = np.sqrt(penalty) if area == "penalty" else np.inf
        self.feasibility = feasibility
        self.tolerance = tolerance
        self.callback = callback
        self.energy = _Last(lambda u: weighted_sum(terms, u))
        self.area = _Last(constraint.value_and_gradient)
        self.iterations = 0
        self.value = np.inf
        self.idle_steps = 0
        self.error: BaseException | None = None
        self.interrupts = _Interrupts()

        self.x = scale * u
        if area == "penalty":
            self.x = np.append(self.x, self.root * self.violation(self.x))
        functionals = [functional for _, functional in terms]
        functionals += [constraint] if self.constrained else []
        smooth = [f for f in functionals if isinstance(f, TwiceDifferentiable)]
        self.exact = len(smooth) == len(functionals)
        self.triangles = [_Triangle(f, u, scale) for f in smooth] if self.exact else []

    def solve(self, multipliers: Floats, max_iterations: int) -> int:
        """Solve from `x` and `multipliers`, which are overwritten; return the code of Ipopt."""
        n, m = len(self.x), len(multipliers)
        t = np.arange(len(self.scale), n)
        rows = np.concatenate([*(triangle.rows for triangle in self.triangles), t])
        columns = np.concatenate([*(triangle.columns for triangle in self.triangles), t])
        problem = require().Problem(
            n,
            np.full(n, -_UNBOUNDED),
            np.full(n, _UNBOUNDED),
            m,
            np.zeros(m),
            np.zeros(m),
            (np.zeros(m * n, dtype=np.int64), np.arange(m * n)),
            (rows, columns),
            self._guarded(self._objective, np.nan),
            self._guarded(self._gradient),
            self._guarded(self._constraint),
            self._guarded(self._jacobian),
            self._guarded(self._hessian) if self.exact else None,
            self._guarded(self._step, False),
            ipopt_options={
                **_OPTIONS,
                "tol": self.tolerance,
                "constr_viol_tol": self.feasibility,
                "max_iter": max_iterations,
            },
        )
        bounds = np.zeros((2, n))
        with self.interrupts:
            _, _, status = problem.solve(
                self.x, mult_g=multipliers, mult_x_L=bounds[0], mult_x_U=bounds[1]
            )
        if self.error is not None:
            raise self.error
        if status <= _BROKEN:
            raise RuntimeError(f"Ipopt failed with its return code {status}")
        return _SOLVED if self.idle_steps == _IDLE_STEPS else int(status)

    def u(self, x: Floats) -> Floats:
        """Return the phase field of the unknowns."""
        return x[: len(self.scale)] / self.scale

    def violation(self, x: Floats) -> float:
        return self.area(self.u(x))[0] / self.target - 1

    def _guarded(self, function: Callable[..., Any], failure: Any = None) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            try:
                self.interrupts.deliver()
                if self.error is None:
                    return function(*arguments)
            except BaseException as error:
                self.error = error
            if failure is None:
                arguments[-1].fill(np.nan)
            return failure

        return call

    def _objective(self, x: Floats) -> float:
        t = x[len(self.scale) :]
        return self.energy(self.u(x))[0] + 0.5 * float(t @ t)

    def _gradient(self, x: Floats, out: Floats) -> None:
        n = len(self.scale)
        out[:n] = self.energy(self.u(x))[1] / self.scale
        out[n:] = x[n:]

    def _constraint(self, x: Floats, out: Floats) -> None:
        if self.constrained:
            out[0] = self.violation(x) - x[len(self.scale) :].sum() / self.root

    def _jacobian(self, x: Floats, out: Floats) -> None:
        if self.constrained:
            n = len(self.scale)
            out[:n] = self.area(self.u(x))[1] / (self.target * self.scale)
            out[n:] = -1 / self.root

    def _hessian(self, x: Floats, multipliers: Floats, factor: float, out: Floats) -> None:
        u = self.u(x)
        factors = [factor * weight for weight, _ in self.terms]
        factors += [multipliers[0] / self.target] if self.constrained else []
        parts = [f * triangle(u) for f, triangle in zip(factors, self.triangles, strict=True)]
        np.concatenate([*parts, np.full(len(x) - len(u), factor)], out=out)

    def _step(
        self, mode: int, number: int, value: float, infeasibility: float, *rest: float
    ) -> bool:
        change = abs(value - self.value)
        self.value = value
        if number == 0:
            self.idle_steps = 0
            return True
        self.iterations += 1
        if self.callback is not None:
            violation = self.area(self.energy.at)[0] / self.target - 1
            self.callback(Iteration(self.iterations, self.energy.result[0], violation))
        length = rest[5]
        idle = (
            mode == 0  # 1 is the restoration of feasibility
            and length >= _SHORT
            and infeasibility <= self.feasibility
            and change <= self.tolerance * max(1.0, abs(value))
        )
        self.idle_steps = self.idle_steps + 1 if idle else 0
        return self.idle_steps < _IDLE_STEPS


def minimise(
    terms: Sequence[tuple[float, Functional]],
    constraint: Functional,
    target: float,
    u: Floats,
    *,
    scale: Floats,
    area: AreaConstraint = "lagrangian",
    multiplier: float = 0.0,
    penalty: float = 100.0,
    feasibility: float = 1e-8,
    tolerance: float = 1e-8,
    max_iterations: int = 5000,
    callback: Callable[[Iteration], None] | None = None,
) -> Result:
    """Minimise a weighted sum of functionals of u under constraint(u) = target with Ipopt.

    Parameters
    ----------
    terms : sequence of (float, Functional)
        Weights and functionals of the objective.
    constraint : Functional
        The constrained quantity, such as an area.
    target : float
        Its value; not 0.
    u : (n,) array
        Start.
    scale : (n,) array
        Positive; the unknowns are scale * u. The root of an estimate of the diagonal of the
        Hessian makes them alike.
    area : {"lagrangian", "penalty", "none"}
        Meet the constraint to `feasibility`, add a quadratic penalty instead, which leaves a
        violation, or drop the constraint.
    multiplier : float, default 0
        First Lagrange multiplier.
    penalty : float, default 100
        Weight of the quadratic penalty, half of the square of the violation; not used otherwise.
    feasibility : float, default 1e-8
        Relative violation allowed.
    tolerance : float, default 1e-8
        The solve ends where the gradient of the Lagrangian in the scaled unknowns is below this
        in every entry, or where three steps in a row change the value by less than this part of
        it (or of 1), each at least a tenth of a full step.
    max_iterations : int, default 5000
        Limit on the steps.
    callback : callable, optional
        Called after each step with an `Iteration`.

    Returns
    -------
    Result
        `multiplier` is Ipopt's, 0 without a constraint, and `penalty` as given.

    Raises
    ------
    ValueError
        For an unknown `area`, and where ipyopt is not installed.
    RuntimeError
        Where Ipopt fails other than by not converging.

    Notes
    -----
    The Hessian of the Lagrangian is exact where `constraint` and all functionals of `terms` are
    `functionals.TwiceDifferentiable`; Ipopt shifts it where it has a wrong inertia. Otherwise it
    is of limited memory (BFGS), and a solve that ends in a failing line search, as at a kink of
    the connectedness functional, starts once again with an empty memory. Ipopt holds the GIL but
    for the functionals.
    """
    if area not in AREA_CONSTRAINTS:
        raise ValueError(f"area: {area!r} must be one of {AREA_CONSTRAINTS}")
    problem = _Problem(
        terms, constraint, target, u, scale, area, penalty, feasibility, tolerance, callback
    )
    for _ in range(2):
        multipliers = np.full(1 if problem.constrained else 0, multiplier)
        status = problem.solve(multipliers, max(1, max_iterations - problem.iterations))
        if status in (_SOLVED, _AT_STEP_LIMIT):
            break
    u = problem.u(problem.x)
    violation = problem.violation(problem.x)
    return Result(
        u=u,
        energy=problem.energy(u)[0],
        violation=violation,
        multiplier=float(multipliers[0]) if area == "lagrangian" else 0.0,
        penalty=penalty,
        iterations=problem.iterations,
        evaluations=problem.energy.evaluations,
        converged=status == _SOLVED and (area != "lagrangian" or abs(violation) <= feasibility),
    )
