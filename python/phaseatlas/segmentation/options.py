"""Options of a segmentation: each once, with its default, its meaning and its check."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..optimise import AREA_CONSTRAINTS, SOLVERS, AreaConstraint, Solver
from ..optimise.ipopt import require
from ..surface import Surface

__all__ = ["INITIALS", "Initial", "Options", "Widths"]

Initial = Literal["auto", "random", "normals"]
INITIALS: tuple[Initial, ...] = get_args(Initial)
Law = Literal["sharp", "paper"]
LAWS: tuple[Law, ...] = get_args(Law)

# Beyond these no option means anything, and products of them leave double precision.
_RANGES = {
    "sigma": (1e-9, 1e9),
    "penalty": (1e-9, 1e12),
    "eta": (0.0, 1e9),
    "kappa": (0.0, 20.0),
    "distortion": (0.0, 1e12),
}
# Widths below this part of sqrt(area) have squares near the rounding of the areas.
_NARROWEST = 1e-6


@dataclass(frozen=True)
class Widths:
    """Lengths of a segmentation, relative to sqrt(area).

    Attributes
    ----------
    epsilon : float
        Interface width.
    start : float or None
        Where the continuation starts; None leaves it to each node.
    delta : float
        Half width of the plateaus of the indicator chi.
    """

    epsilon: float
    start: float | None
    delta: float


@dataclass(frozen=True)
class Options:
    """How the nodes of a tree are solved.

    Parameters
    ----------
    epsilon : float, optional
        Interface width in the units of the surface; twice the mean edge length by default. The
        profile takes 2.8 epsilon from -0.9 to 0.9.
    epsilon_start : float, optional
        Where the continuation starts, halving from there; a fifth of the square root of the
        segment's area by default, `epsilon` where `initial` is an array. `epsilon` itself turns
        continuation off.
    connected : bool, default True
        Use the connectedness functional, and require every sharp segment to be connected.
    kappa : float, default 1
        Exponent of the factor epsilon^-kappa of the connectedness functional.
    delta : float, optional
        Half width of the plateaus of the indicator chi; a tenth of epsilon / sqrt(area) by
        default.
    eta : float, default 0
        Added to the parent's indicator in the perimeter, equation (7).
    sigma : float, default 1
        Penalty outside the parent, equation (7), with the surface scaled to unit area. A field
        fades to 0 where its parent's indicator falls below about epsilon / sigma: with much
        less, siblings would mix along the whole boundary of their parent.
    area : {"lagrangian", "penalty", "none"}
        Meet the areas to 1e-5 by an augmented Lagrangian, or with Ipopt to 1e-8 as a constraint,
        only penalise their deviation, or leave them free.
    penalty : float, default 100
        Factor of the quadratic penalty on the relative deviation of the area, half of whose
        square it multiplies; the first factor of the augmented Lagrangian.
    distortion : float, default 0
        Factor omega of the conformal distortion, equation (13), with the surface scaled to unit
        area; 0 leaves it out.
    law : {"sharp", "paper"}
        Formulation of the distortion; see `functionals.Distortion`.
    initial : {"auto", "random", "normals"}, default "auto"
        Random values in [-1, 1] or two clusters of normals. "auto" tries several starts on coarse
        surfaces and goes on from the best, that of least energy and with no segment in pieces:
        eight of random values; with distortion one of them, the split along a principal axis of
        the normals that is best after a few steps, and the segments of least perimeter.
    seed : int, default 0
        Of the random values.
    solver : {"lbfgs", "ipopt"}
        L-BFGS, or Ipopt from the extra `ipopt`: Newton steps with the exact Hessian where neither
        connectedness nor distortion takes part, limited memory where they do.
    max_iterations : int, default 5000
        Limit on the steps of each stage of a node.
    coarse : bool, default True
        Solve the stages of wide interfaces on simplified surfaces, whose edges are still about
        half of the interface width.

    Raises
    ------
    ValueError
        For an option that cannot be used, in one line that starts with its name. What depends on
        the surface is checked by `widths`.
    """

    epsilon: float | None = None
    epsilon_start: float | None = None
    connected: bool = True
    kappa: float = 1.0
    delta: float | None = None
    eta: float = 0.0
    sigma: float = 1.0
    area: AreaConstraint = "lagrangian"
    penalty: float = 100.0
    distortion: float = 0.0
    law: Law = "sharp"
    initial: Initial = "auto"
    seed: int = 0
    solver: Solver = "lbfgs"
    max_iterations: int = 5000
    coarse: bool = True

    def __post_init__(self) -> None:
        for name in ("epsilon", "epsilon_start"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: {value} must be a positive number")
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ValueError(f"{name}: {value} must be in [{least:g}, {most:g}]")
        for name, least in {"seed": 0, "max_iterations": 1}.items():
            if getattr(self, name) < least:
                raise ValueError(f"{name}: {getattr(self, name)} must be at least {least}")
        if self.seed >= 2**64:
            raise ValueError(f"seed: {self.seed} must be less than 2^64")
        choices = {
            "solver": tuple(SOLVERS),
            "initial": INITIALS,
            "law": LAWS,
            "area": AREA_CONSTRAINTS,
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: {getattr(self, name)!r} must be one of {allowed}")
        if self.delta is not None and not 0 <= self.delta < 1:
            raise ValueError(f"delta: {self.delta} must be in [0, 1)")
        if None not in (self.epsilon, self.epsilon_start) and self.epsilon_start < self.epsilon:  # type: ignore[operator]
            raise ValueError(
                f"epsilon_start: {self.epsilon_start} must be at least epsilon, {self.epsilon}"
            )
        if self.solver == "ipopt":
            require()

    def widths(self, surface: Surface) -> Widths:
        """Return the lengths relative to sqrt(area), with the defaults for this surface.

        Raises
        ------
        ValueError
            For a width that is no width on this surface.
        """
        length = float(np.sqrt(surface.area))
        h = surface.mean_edge_length
        for name in ("epsilon", "epsilon_start"):
            value = getattr(self, name)
            if value is not None and not _NARROWEST * length <= value < length:
                raise ValueError(
                    f"{name}: {value} must be below {length:.6g}, the square root of the area, and "
                    f"at least {_NARROWEST:g} of it"
                )
        epsilon = (2 * h if self.epsilon is None else self.epsilon) / length
        if epsilon >= 1:
            raise ValueError(
                f"epsilon: twice the mean edge length, {2 * h:.6g}, must be below the square root "
                f"of the area, {length:.6g}; finer triangles are needed (phaseatlas remesh)"
            )
        start = None if self.epsilon_start is None else self.epsilon_start / length
        if start is not None and start < epsilon:
            raise ValueError(
                f"epsilon_start: {self.epsilon_start} must be at least epsilon, {2 * h:.6g}"
            )
        if self.connected and self.kappa * -math.log10(epsilon) > 100:
            raise ValueError(f"kappa: epsilon^-{self.kappa} must be below 1e100")
        delta = epsilon / 10 if self.delta is None else self.delta
        return Widths(epsilon, start, delta)
