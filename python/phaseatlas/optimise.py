"""The driver: problems (4)/(6) and (8)/(10) by L-BFGS with an augmented Lagrangian.

It adds weighted functionals and knows nothing of what they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

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
        Whether the constraint is met and the last solve ended neither at the step limit nor in
        a line search that failed twice.
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
    energy = 0.0
    gradient = np.zeros_like(u)
    for weight, functional in terms:
        value, slope = functional.value_and_gradient(u)
        energy += weight * value
        gradient += weight * slope
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
        self.scale = scale
        self.multiplier = 0.0
        self.penalty = 0.0
        self.energy = np.inf
        self.violation = np.inf
        self.evaluations = 0

    def __call__(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        u = x / self.scale
        self.evaluations += 1
        energy, gradient = weighted_sum(self.terms, u)
        area, slope = self.constraint.value_and_gradient(u)
        violation = area / self.target - 1
        force = self.multiplier + self.penalty * violation
        gradient += (force / self.target) * slope
        self.energy = energy
        self.violation = violation
        value = energy + violation * (self.multiplier + 0.5 * self.penalty * violation)
        return value, gradient / self.scale


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
    tolerance: float = 1e-8,
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
    tolerance : float, default 1e-8
        A solve ends where a step lowers the value by less than this part of it.
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
    x = u * scale
    iterations = 0

    def report(_: NDArray[np.float64]) -> None:
        nonlocal iterations
        iterations += 1
        if callback is not None:
            callback(Iteration(iterations, lagrangian.energy, lagrangian.violation))

    previous_violation = np.inf
    stopped_at_minimum = False
    for _ in range(max_updates):
        for _ in range(2):
            # A path of the connectedness functional that switches is a kink: a line search may
            # fail there, and starts again with an empty memory.
            solution = scipy.optimize.minimize(
                lagrangian,
                x,
                jac=True,
                method="L-BFGS-B",
                callback=report,
                options={
                    "maxcor": 10,
                    "maxiter": max(1, max_iterations - iterations),
                    "maxfun": 20 * max_iterations,
                    "ftol": tolerance,
                    "gtol": 1e-12,
                },
            )
            x = solution.x
            stopped_at_minimum = solution.status == 0
            if solution.status != 2:
                break
        lagrangian(x)
        violation = abs(lagrangian.violation)
        if area != "lagrangian" or violation <= feasibility or iterations >= max_iterations:
            break
        lagrangian.multiplier += lagrangian.penalty * lagrangian.violation
        if violation > _SHRINK * previous_violation:
            lagrangian.penalty *= _PENALTY_GROWTH
        previous_violation = violation
    return Result(
        u=x / scale,
        energy=lagrangian.energy,
        violation=lagrangian.violation,
        multiplier=lagrangian.multiplier,
        penalty=lagrangian.penalty,
        iterations=iterations,
        evaluations=lagrangian.evaluations,
        converged=stopped_at_minimum
        and iterations < max_iterations
        and (area != "lagrangian" or abs(lagrangian.violation) <= feasibility),
    )
