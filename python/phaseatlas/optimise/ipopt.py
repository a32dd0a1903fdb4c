"""Problems (4)/(6) and (8)/(10) with Ipopt, the area as an equality constraint.

Ipopt (Waechter and Biegler 2006) takes Newton steps on the Lagrangian with a filter line search.
The Hessian is exact and sparse where every functional has one, of limited memory otherwise. The
wheels of ipyopt bring a sequential MUMPS: no result depends on the number of threads.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import Floats
from ..functionals import TwiceDifferentiable
from .problem import (
    Iteration,
    Limits,
    Point,
    Problem,
    Report,
    Solution,
    Status,
    Timers,
    weighted_sum,
)

__all__ = ["LIMITS", "require", "solve"]

#: When a solve ends by default: Newton steps reach this as soon as any tolerance.
LIMITS = Limits(tolerance=1e-8, feasibility=1e-8)

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
    # The test of `_Callbacks._step` is in its place.
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


class _Callbacks:
    """E(u) under g(u) = A(u) / target - 1 = 0 as callbacks of Ipopt, in the unknowns scale * u.

    The Hessian of the penalty mu/2 g^2 would be dense: instead of it, E + t^2 / 2 is minimised
    under g(u) = t / sqrt(mu), with one more unknown t.

    The first exception is kept, and every later callback fails, which ends the solve.
    """

    def __init__(
        self,
        problem: Problem,
        start: Point,
        limits: Limits,
        callback: Report | None,
        timers: Timers,
    ) -> None:
        constraint, scale = problem.constraint, problem.scale
        self.terms = problem.terms
        self.target = constraint.target
        self.scale = scale
        self.constrained = constraint.kind != "none"
        self.root = np.sqrt(start.penalty) if constraint.kind == "penalty" else np.inf
        self.limits = limits
        self.callback = callback
        self.energy = _Last(lambda u: weighted_sum(problem.terms, u, timers))
        self.area = _Last(lambda u: weighted_sum([(1.0, constraint.functional)], u, timers))
        self.iterations = 0
        self.value = np.inf
        self.idle_steps = 0
        self.stopped = False
        self.error: BaseException | None = None
        self.interrupts = _Interrupts()

        self.x = scale * start.u
        if constraint.kind == "penalty":
            self.x = np.append(self.x, self.root * self.violation(self.x))
        functionals = [functional for _, functional in problem.terms]
        functionals += [constraint.functional] if self.constrained else []
        smooth = [f for f in functionals if isinstance(f, TwiceDifferentiable)]
        self.exact = len(smooth) == len(functionals)
        self.triangles = [_Triangle(f, start.u, scale) for f in smooth] if self.exact else []

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
                "tol": self.limits.tolerance,
                "constr_viol_tol": self.limits.feasibility,
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
            u = self.energy.at
            if self.callback(Iteration(self.iterations, self.energy.result[0], violation, u)):
                self.stopped = True
                return False
        length = rest[5]
        idle = (
            mode == 0  # 1 is the restoration of feasibility
            and length >= _SHORT
            and infeasibility <= self.limits.feasibility
            and change <= self.limits.tolerance * max(1.0, abs(value))
        )
        self.idle_steps = self.idle_steps + 1 if idle else 0
        return self.idle_steps < _IDLE_STEPS


def solve(
    problem: Problem, start: Point, limits: Limits = LIMITS, callback: Report | None = None
) -> Solution:
    """Minimise with Ipopt; the constraint as an equality.

    Parameters
    ----------
    problem : Problem
        What to minimise.
    start : Point
        Field and multiplier to start with; `penalty` counts where it takes the place of the
        constraint.
    limits : Limits
        When to end. The solve ends where the gradient of the Lagrangian in the scaled unknowns is
        below `tolerance` in every entry, or where three steps in a row change the value by less
        than this part of it (or of 1), each at least a tenth of a full step. `max_updates` has
        no meaning here.
    callback : callable, optional
        Called after each step with an `Iteration`; a true answer stops the solve.

    Returns
    -------
    Solution
        Its multiplier is Ipopt's, 0 without a constraint, and its penalty as given.

    Raises
    ------
    ValueError
        Where ipyopt is not installed.
    RuntimeError
        Where Ipopt fails other than by not converging.

    Notes
    -----
    The Hessian of the Lagrangian is exact where the constraint and all functionals of the terms
    are `functionals.TwiceDifferentiable`; Ipopt shifts it where it has a wrong inertia. Otherwise
    it is of limited memory (BFGS), and a solve that ends in a failing line search, as at a kink of
    the connectedness functional, starts once again with an empty memory. Ipopt holds the GIL but
    for the functionals.
    """
    timers = Timers()
    kind = problem.constraint.kind
    with timers.timed("Ipopt"):
        callbacks = _Callbacks(problem, start, limits, callback, timers)
        for _ in range(2):
            multipliers = np.full(1 if callbacks.constrained else 0, start.multiplier)
            left = max(1, limits.max_iterations - callbacks.iterations)
            code = callbacks.solve(multipliers, left)
            if code in (_SOLVED, _AT_STEP_LIMIT) or callbacks.stopped:
                break
        u = callbacks.u(callbacks.x)
        violation = callbacks.violation(callbacks.x)
        energy = callbacks.energy(u)[0]
    if callbacks.stopped:
        status = Status.STOPPED
    elif code == _SOLVED:
        feasible = kind != "lagrangian" or abs(violation) <= limits.feasibility
        status = Status.CONVERGED if feasible else Status.INFEASIBLE
    else:
        status = Status.STEP_LIMIT if code == _AT_STEP_LIMIT else Status.NO_DESCENT
    return Solution(
        point=Point(u, float(multipliers[0]) if kind == "lagrangian" else 0.0, start.penalty),
        energy=energy,
        violation=violation,
        status=status,
        iterations=callbacks.iterations,
        evaluations=callbacks.energy.evaluations,
        seconds=timers.seconds,
    )
