"""One call for any of the methods: `minimise`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

from ..arrays import Floats
from ..functionals import Functional
from . import ipopt, lbfgs
from .problem import AreaConstraint, Constraint, Limits, Point, Problem, Report, Solution

__all__ = ["LIMITS", "SOLVERS", "Solver", "minimise"]

Solver = Literal["lbfgs", "ipopt"]

#: The methods, each from a problem and a point to a solution.
SOLVERS: dict[Solver, Callable[[Problem, Point, Limits, Report | None], Solution]] = {
    "lbfgs": lbfgs.solve,
    "ipopt": ipopt.solve,
}
#: When each ends by default.
LIMITS: dict[Solver, Limits] = {"lbfgs": lbfgs.LIMITS, "ipopt": ipopt.LIMITS}


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
    solver: Solver = "lbfgs",
    feasibility: float | None = None,
    tolerance: float | None = None,
    max_iterations: int | None = None,
    max_updates: int | None = None,
    callback: Report | None = None,
) -> Solution:
    """Minimise a weighted sum of functionals of u under constraint(u) = target.

    Parameters
    ----------
    terms : sequence of (float, Functional)
        Factors and functionals of the objective.
    constraint : Functional
        The constrained quantity, such as an area.
    target : float
        Its value; not 0.
    u : (n,) array
        Start.
    scale : (n,) array
        Positive; the unknowns are scale * u. The root of an estimate of the diagonal of the
        Hessian makes them alike; `functionals.Perimeter.preconditioner` is one.
    area : {"lagrangian", "penalty", "none"}
        Meet the constraint to `feasibility`, add the quadratic penalty alone, which leaves a
        violation, or drop the constraint.
    multiplier, penalty : float
        First Lagrange multiplier and factor of the quadratic penalty.
    solver : {"lbfgs", "ipopt"}
        L-BFGS with an augmented Lagrangian, or Ipopt from the extra of that name.
    feasibility : float, optional
        Relative violation allowed; 1e-5 for L-BFGS, 1e-8 for Ipopt by default.
    tolerance : float, optional
        A solve ends where the last steps lower the value by less than this part of it each; 1e-7
        for L-BFGS, 1e-8 for Ipopt by default.
    max_iterations : int, default 5000
        Limit on the steps of all solves together.
    max_updates : int, default 30
        Limit on the updates of the multiplier.
    callback : callable, optional
        Called after each step with an `Iteration`, which holds the field; a true answer stops the
        solve.

    Returns
    -------
    Solution

    Raises
    ------
    ValueError
        For an unknown `area` or `solver`.
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver: {solver!r} must be one of {tuple(SOLVERS)}")
    problem = Problem(terms, Constraint(constraint, target, area), scale)
    given = {
        "feasibility": feasibility,
        "tolerance": tolerance,
        "max_iterations": max_iterations,
        "max_updates": max_updates,
    }
    limits = replace(LIMITS[solver], **{k: v for k, v in given.items() if v is not None})  # type: ignore[arg-type]
    return SOLVERS[solver](problem, Point(u, multiplier, penalty), limits, callback)
