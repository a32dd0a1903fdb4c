"""What a minimiser is given and what it returns: records without a method of solution."""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from ..arrays import Floats
from ..functionals import Functional

__all__ = [
    "AREA_CONSTRAINTS",
    "AreaConstraint",
    "Constraint",
    "Iteration",
    "Limits",
    "Point",
    "Problem",
    "Report",
    "Solution",
    "Status",
    "Timers",
    "weighted_sum",
]

AreaConstraint = Literal["lagrangian", "penalty", "none"]
AREA_CONSTRAINTS: tuple[AreaConstraint, ...] = get_args(AreaConstraint)


class Status(enum.StrEnum):
    """Why a solve ended; `sentence` says it to the user."""

    CONVERGED = "converged"
    STEP_LIMIT = "step_limit"
    NO_DESCENT = "no_descent"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"

    @property
    def sentence(self) -> str:
        """What happened, as a clause."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "the last steps gained next to nothing and the constraint is met",
    Status.STEP_LIMIT: "the limit on the steps was reached",
    Status.NO_DESCENT: "no step along the gradient lowers the energy",
    Status.INFEASIBLE: "the constraint is not met",
    Status.STOPPED: "the callback stopped the solve",
}


@dataclass(frozen=True)
class Constraint:
    """A functional that is to have a value.

    Attributes
    ----------
    functional : Functional
        The constrained quantity, such as an area.
    target : float
        Its value; not 0.
    kind : {"lagrangian", "penalty", "none"}
        Meet it, penalise its relative deviation by half of its square alone, or drop it.
    """

    functional: Functional
    target: float
    kind: AreaConstraint = "lagrangian"

    def __post_init__(self) -> None:
        if self.kind not in AREA_CONSTRAINTS:
            raise ValueError(f"area: {self.kind!r} must be one of {AREA_CONSTRAINTS}")


@dataclass(frozen=True, eq=False)
class Problem:
    """A weighted sum of functionals to minimise under a constraint.

    Attributes
    ----------
    terms : sequence of (float, Functional)
        Factors and functionals of the energy.
    constraint : Constraint
        What is to hold at the minimiser.
    scale : (n,) array
        Positive; the unknowns are scale * u. The root of an estimate of the diagonal of the
        Hessian makes them alike.
    """

    terms: Sequence[tuple[float, Functional]]
    constraint: Constraint
    scale: Floats


@dataclass(frozen=True, eq=False)
class Point:
    """Where a solve starts or ends: a field and what the constraint takes.

    Attributes
    ----------
    u : (n,) array
        Phase field.
    multiplier : float, default 0
        Lagrange multiplier of the constraint.
    penalty : float, default 100
        Factor of the quadratic penalty.
    """

    u: Floats
    multiplier: float = 0.0
    penalty: float = 100.0


@dataclass(frozen=True)
class Limits:
    """When a solve ends.

    Attributes
    ----------
    tolerance : float
        Relative gain below which a step counts as idle.
    feasibility : float
        Relative violation of the constraint that is allowed.
    max_iterations : int
        Limit on the steps.
    max_updates : int
        Limit on the updates of the multiplier, where the method has any.
    """

    tolerance: float
    feasibility: float
    max_iterations: int = 5000
    max_updates: int = 30


@dataclass(frozen=True, eq=False)
class Iteration:
    """One accepted step, as handed to a callback.

    Attributes
    ----------
    number : int
        Count of steps so far in this solve.
    energy : float
        The weighted sum of the functionals, without the constraint's terms.
    violation : float
        Relative violation of the constraint, value / target - 1.
    u : (n,) array
        The accepted field.
    """

    number: int
    energy: float
    violation: float
    u: Floats = field(repr=False)


#: Called after each step; a true answer stops the solve.
Report = Callable[[Iteration], object]


@dataclass(frozen=True, eq=False)
class Solution:
    """Minimiser and how it was reached.

    Attributes
    ----------
    point : Point
        The field, and multiplier and penalty to start the next solve with.
    energy : float
        The weighted sum of the functionals at the field.
    violation : float
        Relative violation of the constraint there.
    status : Status
        Why the solve ended.
    iterations, evaluations : int
        Steps taken, and evaluations of all functionals.
    seconds : dict of str to float
        Wall time by what it was spent on: a functional's name, or the method's own parts.
    """

    point: Point
    energy: float
    violation: float
    status: Status
    iterations: int
    evaluations: int
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def u(self) -> Floats:
        """Phase field, (n,)."""
        return self.point.u

    @property
    def multiplier(self) -> float:
        """Lagrange multiplier, to start the next solve with."""
        return self.point.multiplier

    @property
    def penalty(self) -> float:
        """Factor of the quadratic penalty, to start the next solve with."""
        return self.point.penalty

    @property
    def converged(self) -> bool:
        """Whether the last solve ended where steps gain nothing, with the constraint met."""
        return self.status is Status.CONVERGED


class Timers:
    """Seconds by what they were spent on; time within an inner block counts there alone.

    `with timers.timed("name"): ...` adds to `timers.seconds["name"]`.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._open: list[tuple[str, float]] = []
        self._inner = [0.0]

    def timed(self, name: str) -> Timers:
        """Begin to add what the block takes to `name`."""
        self._inner.append(0.0)
        self._open.append((name, time.perf_counter()))
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        name, start = self._open.pop()
        taken = time.perf_counter() - start
        own = taken - self._inner.pop()
        self._inner[-1] += taken
        self.seconds[name] = self.seconds.get(name, 0.0) + own


def weighted_sum(
    terms: Sequence[tuple[float, Functional]], u: Floats, timers: Timers | None = None
) -> tuple[float, Floats]:
    """Return the value and the (n,) gradient of a sum of factors times functionals at `u`."""
    timers = timers or Timers()
    energy, gradient = 0.0, np.empty(0)
    for k, (factor, functional) in enumerate(terms):
        with timers.timed(type(functional).__name__):
            value, slope = functional.value_and_gradient(u)
        if k == 0:
            energy, gradient = factor * value, factor * slope
        else:
            energy += factor * value
            slope *= factor
            gradient += slope
    return energy, gradient
