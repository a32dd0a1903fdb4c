"""The driver: problems (4)/(6) and (8)/(10) by L-BFGS with an augmented Lagrangian.

It adds weighted functionals and knows nothing of what they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from . import _core
from .functionals import Functional

__all__ = [
    "AREA_CONSTRAINTS",
    "AreaConstraint",
    "Iteration",
    "Result",
    "minimise",
    "weighted_sum",
]

AreaConstraint = Literal["lagrangian", "penalty", "none"]
AREA_CONSTRAINTS = get_args(AreaConstraint)

# Multiplier updates: the penalty grows where the violation has not fallen by _SHRINK.
_PENALTY_GROWTH = 4.0
_SHRINK = 0.25
_MAX_MULTIPLIER_UPDATES = 30
# Pairs of L-BFGS; constants of the weak Wolfe conditions; bisections of a line search.
_MEMORY = 6
_DECREASE = 1e-4
_CURVATURE = 0.9
_MAX_TRIALS = 25
# A descent ends where so many steps together gain too little: single ones may be short.
_WINDOW = 5


@dataclass(frozen=True)
class Iteration:
    """One accepted step, as handed to a progress callback.

    Attributes
    ----------
    number : int
        Count of steps so far in this call of `minimise`.
    energy : float
        The weighted sum of the functionals, without the constraint's terms.
    violation : float
        Relative violation of the constraint, A / target - 1.
    """

    number: int
    energy: float
    violation: float


@dataclass(frozen=True)
class Result:
    """Minimiser and how it was reached.

    Attributes
    ----------
    u : (n,) array
        Phase field.
    energy : float
        The weighted sum of the functionals at `u`.
    violation : float
        Relative violation of the constraint at `u`.
    multiplier, penalty : float
        Of the augmented Lagrangian, to start the next solve with.
    iterations, evaluations : int
        Steps taken, and evaluations of all functionals.
    converged : bool
        Whether the constraint is met and the last solve ended neither at the step limit nor where
        no step along the gradient lowers the value.
    """

    u: NDArray[np.float64]
    energy: float
    violation: float
    multiplier: float
    penalty: float
    iterations: int
    evaluations: int
    converged: bool


def weighted_sum(
    terms: Sequence[tuple[float, Functional]], u: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Return the value and the (n,) gradient of a sum of weights times functionals at `u`."""
    (weight, functional), *others = terms
    value, slope = functional.value_and_gradient(u)
    energy, gradient = weight * value, weight * slope
    for weight, functional in others:
        value, slope = functional.value_and_gradient(u)
        energy += weight * value
        slope *= weight
        gradient += slope
    return energy, gradient


class _Lagrangian:
    """E(u) + lambda g(u) + mu/2 g(u)^2 with g = A / target - 1, in the scaled unknowns."""

    def __init__(
        self,
        terms: Sequence[tuple[float, Functional]],
        constraint: Functional,
        target: float,
        scale: NDArray[np.float64],
    ) -> None:
        self.terms = terms
        self.constraint = constraint
        self.target = target
        # Products are cheaper than quotients.
        self.unscale = 1 / scale
        self.multiplier = 0.0
        self.penalty = 0.0
        self.energy = np.inf
        self.violation = np.inf
        self.evaluations = 0

    def __call__(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        u = x * self.unscale
        self.evaluations += 1
        energy, gradient = weighted_sum(self.terms, u)
        area, slope = self.constraint.value_and_gradient(u)
        violation = area / self.target - 1
        force = self.multiplier + self.penalty * violation
        slope *= force / self.target
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
        self,
        lagrangian: _Lagrangian,
        x: NDArray[np.float64],
        max_iterations: int,
        callback: Callable[[Iteration], None] | None,
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

    def run(self, tolerance: float) -> bool:
        """Descend until steps gain little; whether it ended there."""
        value, gradient = self.lagrangian(self.x)
        self._accept()
        values = [value]
        while not self.exhausted:
            direction = self.memory.direction(gradient)
            slope = float(direction @ gradient)
            if slope >= 0 and len(self.memory) > 0:
                self.memory.clear()
                continue
            if slope >= -np.finfo(float).eps * max(abs(value), 1.0):
                return True
            step = self._line_search(value, direction, slope)
            if step is None:
                if len(self.memory) == 0:
                    return False
                self.memory.clear()
                continue
            x, value, new_gradient = step
            self.memory.update(x - self.x, new_gradient - gradient)
            self.x, gradient = x, new_gradient
            self.iterations += 1
            if self.callback is not None:
                self.callback(Iteration(self.iterations, self.energy, self.violation))
            values.append(value)
            if len(values) > _WINDOW:
                gain = values.pop(0) - value
                if gain <= _WINDOW * tolerance * max(abs(value), 1.0):
                    return True
        return False

    def _line_search(
        self, value: float, direction: NDArray[np.float64], slope: float
    ) -> tuple[NDArray[np.float64], float, NDArray[np.float64]] | None:
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


def minimise(
    terms: Sequence[tuple[float, Functional]],
    constraint: Functional,
    target: float,
    u: NDArray[np.float64],
    *,
    scale: NDArray[np.float64],
    area: AreaConstraint = "lagrangian",
    multiplier: float = 0.0,
    penalty: float = 100.0,
    feasibility: float = 1e-5,
    tolerance: float = 1e-7,
    max_iterations: int = 5000,
    max_updates: int = _MAX_MULTIPLIER_UPDATES,
    callback: Callable[[Iteration], None] | None = None,
) -> Result:
    """Minimise a weighted sum of functionals of u under constraint(u) = target.

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
        Meet the constraint to `feasibility` by an augmented Lagrangian, add the quadratic
        penalty alone, which leaves a violation, or drop the constraint.
    multiplier, penalty : float
        First Lagrange multiplier and weight of the quadratic penalty.
    feasibility : float, default 1e-5
        Relative violation allowed.
    tolerance : float, default 1e-7
        A solve ends where the last steps lower the value by less than this part of it each.
    max_iterations : int, default 5000
        Limit on the steps of all solves together.
    max_updates : int, default 30
        Limit on the multiplier updates.
    callback : callable, optional
        Called after each step with an `Iteration`.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        For an unknown `area`.
    """
    if area not in AREA_CONSTRAINTS:
        raise ValueError(f"area: {area!r} must be one of {AREA_CONSTRAINTS}")
    lagrangian = _Lagrangian(terms, constraint, target, scale)
    if area != "none":
        lagrangian.multiplier = multiplier
        lagrangian.penalty = penalty
    descent = _Descent(lagrangian, u * scale, max_iterations, callback)
    previous_violation = np.inf
    stopped_at_minimum = False
    for _ in range(max_updates):
        stopped_at_minimum = descent.run(tolerance)
        violation = abs(descent.violation)
        if area != "lagrangian" or violation <= feasibility or descent.exhausted:
            break
        lagrangian.multiplier += lagrangian.penalty * descent.violation
        if violation > _SHRINK * previous_violation:
            lagrangian.penalty *= _PENALTY_GROWTH
        previous_violation = violation
    return Result(
        u=descent.x / scale,
        energy=descent.energy,
        violation=descent.violation,
        multiplier=lagrangian.multiplier,
        penalty=lagrangian.penalty,
        iterations=descent.iterations,
        evaluations=lagrangian.evaluations,
        converged=stopped_at_minimum
        and not descent.exhausted
        and (area != "lagrangian" or abs(descent.violation) <= feasibility),
    )
