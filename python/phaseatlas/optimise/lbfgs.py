"""Problems (4)/(6) and (8)/(10) by L-BFGS with an augmented Lagrangian."""

from __future__ import annotations

import numpy as np

from .. import _core
from ..arrays import Floats
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

__all__ = ["LIMITS", "solve"]

#: When a solve ends by default: the areas agree to 1e-5, and 1e-8 a step would change the energy of
#: real meshes by 1e-5 at most (benches/RESULTS.md).
LIMITS = Limits(tolerance=1e-7, feasibility=1e-5)

# Multiplier updates: the penalty grows where the violation has not fallen by _SHRINK.
_PENALTY_GROWTH = 4.0
_SHRINK = 0.25
# Pairs of L-BFGS; constants of the weak Wolfe conditions; bisections of a line search.
_MEMORY = 6
_DECREASE = 1e-4
_CURVATURE = 0.9
_MAX_TRIALS = 25
# A descent ends where so many steps together gain too little: single ones may be short.
_WINDOW = 5


class _Lagrangian:
    """E(u) + lambda g(u) + mu/2 g(u)^2 with g = A / target - 1, in the unknowns scale * u."""

    def __init__(self, problem: Problem, timers: Timers) -> None:
        self.problem = problem
        self.timers = timers
        # Products are cheaper than quotients.
        self.unscale = 1 / problem.scale
        self.multiplier = 0.0
        self.penalty = 0.0
        self.energy = np.inf
        self.violation = np.inf
        self.evaluations = 0

    def __call__(self, x: Floats) -> tuple[float, Floats]:
        u = x * self.unscale
        self.evaluations += 1
        energy, gradient = weighted_sum(self.problem.terms, u, self.timers)
        constraint = self.problem.constraint
        with self.timers.timed(type(constraint.functional).__name__):
            area, slope = constraint.functional.value_and_gradient(u)
        violation = area / constraint.target - 1
        force = self.multiplier + self.penalty * violation
        slope *= force / constraint.target
        gradient += slope
        gradient *= self.unscale
        self.energy = energy
        self.violation = violation
        value = energy + violation * (self.multiplier + 0.5 * self.penalty * violation)
        return value, gradient


class _Descent:
    """L-BFGS from one point on, through changes of what it descends on.

    Steps satisfy the weak Wolfe conditions, found by bisection (Lewis and Overton, 2013): at a
    kink of the connectedness functional, where a path switches, the strong ones cannot be met.
    """

    def __init__(
        self, lagrangian: _Lagrangian, x: Floats, max_iterations: int, callback: Report | None
    ) -> None:
        self.lagrangian = lagrangian
        self.memory = _core.LimitedMemory(len(x), _MEMORY)
        self.x = x
        self.max_iterations = max_iterations
        self.callback = callback
        self.iterations = 0
        self.energy = np.inf
        self.violation = np.inf

    @property
    def exhausted(self) -> bool:
        return self.iterations >= self.max_iterations

    def run(self, tolerance: float) -> Status:
        """Descend until steps gain little, and say why it ended."""
        timers = self.lagrangian.timers
        value, gradient = self.lagrangian(self.x)
        self._accept()
        values = [value]
        while not self.exhausted:
            with timers.timed("L-BFGS"):
                direction = self.memory.direction(gradient)
            slope = float(direction @ gradient)
            if slope >= 0 and len(self.memory) > 0:
                self.memory.clear()
                continue
            if slope >= -np.finfo(float).eps * max(abs(value), 1.0):
                return Status.CONVERGED
            step = self._line_search(value, direction, slope)
            if step is None:
                if len(self.memory) == 0:
                    return Status.NO_DESCENT
                self.memory.clear()
                continue
            x, value, new_gradient = step
            with timers.timed("L-BFGS"):
                self.memory.update(x - self.x, new_gradient - gradient)
            self.x, gradient = x, new_gradient
            self.iterations += 1
            if self.callback is not None and self.callback(
                Iteration(
                    self.iterations, self.energy, self.violation, self.x * self.lagrangian.unscale
                )
            ):
                return Status.STOPPED
            values.append(value)
            if len(values) > _WINDOW:
                gain = values.pop(0) - value
                if gain <= _WINDOW * tolerance * max(abs(value), 1.0):
                    return Status.STEP_LIMIT if self.exhausted else Status.CONVERGED
        return Status.STEP_LIMIT

    def _line_search(
        self, value: float, direction: Floats, slope: float
    ) -> tuple[Floats, float, Floats] | None:
        """Point of a step along `direction`, its value and gradient; None where all are higher."""
        step, low, high = 1.0, 0.0, np.inf
        found = None
        for _ in range(_MAX_TRIALS):
            x = self.x + step * direction
            trial, gradient = self.lagrangian(x)
            if not trial <= value + _DECREASE * step * slope:
                high = step
            else:
                low = step
                found = x, trial, gradient
                self._accept()
                if float(gradient @ direction) >= _CURVATURE * slope:
                    break
            step = 0.5 * (low + high) if high < np.inf else 2 * low
        return found

    def _accept(self) -> None:
        self.energy, self.violation = self.lagrangian.energy, self.lagrangian.violation


def solve(
    problem: Problem, start: Point, limits: Limits = LIMITS, callback: Report | None = None
) -> Solution:
    """Minimise by L-BFGS; the constraint by an augmented Lagrangian.

    Parameters
    ----------
    problem : Problem
        What to minimise.
    start : Point
        Field, multiplier and penalty to start with.
    limits : Limits
        When to end. A solve ends where five steps in a row lower the value by less than
        `tolerance` of it (or of 1) each.
    callback : callable, optional
        Called after each step with an `Iteration`; a true answer stops the solve.

    Returns
    -------
    Solution
    """
    timers = Timers()
    kind = problem.constraint.kind
    with timers.timed("driver"):
        lagrangian = _Lagrangian(problem, timers)
        if kind != "none":
            lagrangian.multiplier = start.multiplier
            lagrangian.penalty = start.penalty
        descent = _Descent(lagrangian, start.u * problem.scale, limits.max_iterations, callback)
        previous_violation = np.inf
        status = Status.INFEASIBLE
        for _ in range(limits.max_updates):
            status = descent.run(limits.tolerance)
            violation = abs(descent.violation)
            if kind != "lagrangian" or violation <= limits.feasibility or descent.exhausted:
                break
            if status is Status.STOPPED:
                break
            lagrangian.multiplier += lagrangian.penalty * descent.violation
            if violation > _SHRINK * previous_violation:
                lagrangian.penalty *= _PENALTY_GROWTH
            previous_violation = violation
        feasible = kind != "lagrangian" or abs(descent.violation) <= limits.feasibility
        if status is Status.CONVERGED and not feasible:
            status = Status.INFEASIBLE
        u = descent.x / problem.scale
    return Solution(
        point=Point(u, lagrangian.multiplier, lagrangian.penalty),
        energy=descent.energy,
        violation=descent.violation,
        status=status,
        iterations=descent.iterations,
        evaluations=lagrangian.evaluations,
        seconds=timers.seconds,
    )
