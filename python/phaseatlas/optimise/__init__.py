"""Minimisers of sums of functionals under one constraint.

They know nothing of what the functionals are: anything with a value and a gradient will do.
"""

from .minimise import LIMITS, SOLVERS, Solver, minimise
from .problem import (
    AREA_CONSTRAINTS,
    AreaConstraint,
    Constraint,
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

__all__ = [
    "AREA_CONSTRAINTS",
    "LIMITS",
    "SOLVERS",
    "AreaConstraint",
    "Constraint",
    "Iteration",
    "Limits",
    "Point",
    "Problem",
    "Report",
    "Solution",
    "Solver",
    "Status",
    "Timers",
    "minimise",
    "weighted_sum",
]
