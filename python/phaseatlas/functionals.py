"""The functionals of the paper, each a value and a gradient of the phase field.

They work in the coordinates of the surface they are given: epsilon is a length, and the sharp
limit of the perimeter is sqrt(2) times the length of the interface. sqrt(epsilon) and the weights
of a sum of functionals are not free of scale: `surface.scaled(surface.area**-0.5)` has unit area.
"""

from __future__ import annotations

from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike

from . import _core
from .arrays import Floats
from .checks import positive
from .surface import Surface

__all__ = [
    "Area",
    "Connectedness",
    "Distortion",
    "Functional",
    "Perimeter",
    "TwiceDifferentiable",
    "indicator",
]


class Functional(Protocol):
    """What the driver minimises: anything with this one method."""

    def value_and_gradient(self, u: ArrayLike) -> tuple[float, Floats]:
        """Return the value and the (n,) gradient at the (n,) phase field `u`."""
        ...


@runtime_checkable
class TwiceDifferentiable(Functional, Protocol):
    """A functional that has a sparse Hessian as well."""

    def hessian(self, u: ArrayLike) -> Any:
        """Return the symmetric (n, n) scipy.sparse.csr_array of the second derivatives at `u`.

        Its stored entries, zeros among them, are the same at every `u`.
        """
        ...


def indicator(u: ArrayLike, delta: float) -> Floats:
    """Diffuse indicator chi(u) of the positive phase, section 3 of the paper.

    Parameters
    ----------
    u : array_like of float
        Phase field.
    delta : float
        Half width of the plateaus, in [0, 1): chi is 0 below -1 + delta, 1 above 1 - delta.

    Returns
    -------
    array of float, shape of `u`
        Values in [0, 1], exactly 0 and 1 on the plateaus, with chi(-u) = 1 - chi(u).

    Raises
    ------
    ValueError
        For `delta` outside [0, 1).
    """
    if not 0 <= delta < 1:
        raise ValueError(f"delta: {delta} must be in [0, 1)")
    r = 1 - delta
    v = np.clip(np.asarray(u, dtype=np.float64), -r, r)
    # Just below the plateau the cubic rounds to more than 1, on it to less.
    chi: Floats = np.minimum((v + r) ** 2 * (2 * r - v) / (4 * r**3), 1.0)
    return np.where(v == r, 1.0, chi)


def _delta(surface: Surface, epsilon: float, delta: float | None) -> float:
    return epsilon / float(np.sqrt(surface.area)) / 10 if delta is None else delta


class Perimeter:
    """Modica-Mortola perimeter, equation (5), or (9) within a parent's indicator.

    Parameters
    ----------
    surface : Surface
    epsilon : float
        Interface width, a length; about twice the edge length resolves the profile
        tanh(3 x / (2 sqrt(2) epsilon)).
    weight : (n,) array_like of float, optional
        Indicator of the parent segment at the vertices, in [0, 1].
    eta : float, default 0
        Added to `weight`, equation (7).
    sigma : float, default 1
        The penalty on u outside the parent is (1 - weight) u^2 / sigma, equation (7).
    seam_cost : (n,) array_like of float, optional
        Positive factor on the length of the interface at the vertices. All integrands take it, and
        the sharp limit is sqrt(2) times its integral along the interface.

    Raises
    ------
    ValueError
        For `epsilon` or `sigma` not positive, `eta` negative, `weight` of another shape or
        outside [0, 1], `seam_cost` of another shape or not positive.
    """

    def __init__(
        self,
        surface: Surface,
        epsilon: float,
        *,
        weight: ArrayLike | None = None,
        eta: float = 0.0,
        sigma: float = 1.0,
        seam_cost: ArrayLike | None = None,
    ) -> None:
        self._surface = surface
        self._weight = None if weight is None else surface.vector("weight", weight)
        self._seam_cost = (
            None if seam_cost is None else positive("seam_cost", seam_cost, surface.n_vertices)
        )
        self._epsilon, self._eta, self._sigma = epsilon, eta, sigma
        self._core = _core.Perimeter(
            surface._mesh, epsilon, self._weight, eta, sigma, self._seam_cost
        )

    def value_and_gradient(self, u: ArrayLike) -> tuple[float, Floats]:
        """Return the value and the (n,) gradient at the (n,) phase field `u`."""
        return self._core.value_and_gradient(self._surface.vector("u", u))

    def hessian(self, u: ArrayLike) -> Any:
        """Hessian, that of equation (5) or (9): the weighted stiffness and a diagonal.

        Parameters
        ----------
        u : (n,) array_like of float
            Phase field.

        Returns
        -------
        scipy.sparse.csr_array, (n, n)
            Symmetric, and indefinite where u is far from the pure phases. It has an entry for
            every edge, in both orders, and every vertex, zeros among them, at any `u`.

        Raises
        ------
        ValueError
            For `u` of another shape or with a value that is not finite.
        """
        return self._surface._symmetric(*self._core.hessian(self._surface.vector("u", u)))

    def preconditioner(self) -> Floats:
        """Return the diagonal of the Hessian at the pure phases, (n,), all of it positive.

        There Psi''(1) = 9/2; unknowns scaled by its root are alike.
        """
        mass = self._surface.mass
        inside = self._inside()
        diagonal: Floats = (inside + self._eta) * (
            self._epsilon * self._surface.stiffness_diagonal + 4.5 / self._epsilon * mass
        )
        diagonal += 2 / self._sigma * (1 - inside) * mass
        return diagonal if self._seam_cost is None else diagonal * self._seam_cost

    def length(self, u: ArrayLike) -> float:
        """Return the length of the interface of the (n,) phase field `u`.

        It is the perimeter without the penalty outside the parent, over sqrt(2), the constant of
        the sharp limit. With a `seam_cost` it is the integral of that along the interface.
        """
        field = self._surface.vector("u", u)
        outside = 1 - self._inside()
        if self._seam_cost is not None:
            outside = outside * self._seam_cost
        confinement = outside @ (self._surface.mass * field**2)
        value, _ = self._core.value_and_gradient(field)
        return float(value - confinement / self._sigma) / float(np.sqrt(2))

    def _inside(self) -> Floats:
        return np.ones(self._surface.n_vertices) if self._weight is None else self._weight


class Area:
    """Area of the positive phase, equation (2), or (10) within a parent's indicator.

    Parameters
    ----------
    surface : Surface
    epsilon : float
        Interface width; sets the default of `delta` only.
    delta : float, optional
        Half width of the plateaus of the indicator chi, in [0, 1); epsilon / 10 by default, with
        epsilon relative to the square root of the area.
    weight : (n,) array_like of float, optional
        Indicator of the parent segment at the vertices, in [0, 1].

    Raises
    ------
    ValueError
        For `epsilon` not positive, `delta` outside [0, 1), `weight` of another shape or outside
        [0, 1].
    """

    def __init__(
        self,
        surface: Surface,
        epsilon: float,
        *,
        delta: float | None = None,
        weight: ArrayLike | None = None,
    ) -> None:
        if not (np.isfinite(epsilon) and epsilon > 0):
            raise ValueError(f"epsilon: {epsilon} must be a positive number")
        self._surface = surface
        w = None if weight is None else surface.vector("weight", weight)
        self._core = _core.Area(surface._mesh, _delta(surface, epsilon, delta), w)

    @property
    def total(self) -> float:
        """Area of both phases together."""
        return self._core.total

    def value_and_gradient(self, u: ArrayLike) -> tuple[float, Floats]:
        """Return the value and the (n,) gradient at the (n,) phase field `u`."""
        return self._core.value_and_gradient(self._surface.vector("u", u))

    def hessian(self, u: ArrayLike) -> Any:
        """Hessian, a diagonal: the masses, times `weight`, times chi''(u).

        Parameters
        ----------
        u : (n,) array_like of float
            Phase field.

        Returns
        -------
        scipy.sparse.csr_array, (n, n)
            With an entry on all of the diagonal, zeros among them. chi is C1: chi'' jumps from 0
            to 3 / (2 (1 - delta)^2) and back where abs(u) passes 1 - delta, and is 0 there.

        Raises
        ------
        ValueError
            For `u` of another shape or with a value that is not finite.
        """
        diagonal = self._core.hessian(self._surface.vector("u", u))
        n = len(diagonal)
        return scipy.sparse.csr_array((diagonal, np.arange(n), np.arange(n + 1)), shape=(n, n))


class Connectedness:
    """Connectedness functional C[u] + C[-u], equation (3), zero where both phases connect.

    Parameters
    ----------
    surface : Surface
    epsilon : float
        Interface width, below 1; sets the default of `threshold` only.
    weight : (n,) array_like of float, optional
        Indicator of the parent segment at the vertices, in [0, 1]; paths that leave the parent
        pay by its inverse.
    phase : {"both", "positive", "negative"}
        Evaluate both phases, C[u] alone or C[-u] alone.
    threshold : float, optional
        Faces whose mean of u is at least this form the components; in (0, 1), by default
        1 - sqrt(epsilon), which takes a surface of about unit area.
    form : {"pairs", "tree"}
        Measure the distances between components along the shortest paths, equation (3), which
        takes a search from each of them, or along their shortest spanning tree, which takes one
        search from all of them together. The tree's C is zero exactly where the other is, and
        no smaller.
    saturation : float, optional
        Area w: for the mass W of a component, the integral of H (in "tree" over either part that
        an edge of the tree joins), counts W / (W + w), so that components small beside the
        whole, but not beside w, are held as firmly as large ones. By default W itself counts.
    plateau : float, default 1
        H rises from 0 at `threshold` to 1 here; in (`threshold`, 1].
    inside : (m,) array_like of bool, optional
        Faces of the parent segment, to which the components belong; by default those where the
        mean of `weight` is at least 1/4.

    Raises
    ------
    ValueError
        For `epsilon` or `threshold` outside (0, 1), `weight` of another shape or outside
        [0, 1], `saturation` not positive, `plateau` not in (`threshold`, 1], an unknown `phase`
        or `form`.

    Notes
    -----
    Discretised after Dondl and Wojtowytsch (2018), with the complementary supports of F and H
    of Dondl, Novaga, Wojtowytsch and Wolff-Vorbeck (2021). The tree over the regions nearest to
    each component after Mehlhorn (1988).
    """

    def __init__(
        self,
        surface: Surface,
        epsilon: float,
        *,
        weight: ArrayLike | None = None,
        phase: Literal["both", "positive", "negative"] = "both",
        threshold: float | None = None,
        form: Literal["pairs", "tree"] = "pairs",
        saturation: float | None = None,
        plateau: float = 1.0,
        inside: ArrayLike | None = None,
    ) -> None:
        if not 0 < epsilon < 1:
            raise ValueError(
                f"epsilon: {epsilon} must be in (0, 1); scale the surface to unit area"
            )
        self._surface = surface
        w = None if weight is None else surface.vector("weight", weight)
        a = 1 - float(np.sqrt(epsilon)) if threshold is None else threshold
        faces = None if inside is None else np.ascontiguousarray(inside, dtype=np.bool_)
        self._core = _core.Connectedness(
            surface._mesh, a, w, phase, form, saturation, plateau, faces
        )

    def value_and_gradient(self, u: ArrayLike) -> tuple[float, Floats]:
        """Return the value and the (n,) gradient at the (n,) phase field `u`."""
        return self._core.value_and_gradient(self._surface.vector("u", u))

    def components(self, u: ArrayLike) -> tuple[int, int]:
        """Return the number of components of the positive and of the negative phase."""
        return self._core.components(self._surface.vector("u", u))


class Distortion:
    """Conformal distortion of both phases, equation (13): the integral of s[u]^2 + s[-u]^2.

    s solves the diffuse Yamabe equation (12) of its phase: e^{-2 s} g is flat where the phase
    prevails, and s fades to 0 where the other one does.

    Parameters
    ----------
    surface : Surface
    epsilon : float
        Interface width, a length.
    law : {"sharp", "paper"}
        How the phase enters the equation. "sharp" penalises s by 30 max(0, 1 - 4 chi)^2 /
        epsilon^2, which tends to s = 0 on the interface and never rewards a mixed phase;
        "paper" is (12) as printed, penalty (1 - chi) / epsilon and diffusion chi + eta, whose
        limit is a Robin condition.
    delta : float, optional
        Half width of the plateaus of the indicator chi, in [0, 1); epsilon / 10 by default, with
        epsilon relative to the square root of the area.
    eta : float, optional
        Regularisation: of the diffusion in "paper" (1e-3 by default), of the penalty in units
        of 1 / epsilon^2 in "sharp" (1e-6 by default).
    weight : (n,) array_like of float, optional
        Indicator w of the parent segment at the vertices, in [0, 1]: w chi(u) takes the place
        of chi(u).

    Raises
    ------
    ValueError
        For `epsilon` not positive, `delta` outside [0, 1), `eta` negative, an unknown `law`,
        `weight` of another shape or outside [0, 1]. Evaluation raises it where the matrix is
        not numerically positive definite, and names the vertex.

    Notes
    -----
    Yamabe equation after Springborn, Schroeder and Pinkall (2008) and Sharp and Crane (2018);
    the penalty of "sharp" after Angot, Bruneau and Fabrie (1999).
    """

    def __init__(
        self,
        surface: Surface,
        epsilon: float,
        *,
        law: Literal["sharp", "paper"] = "sharp",
        delta: float | None = None,
        eta: float | None = None,
        weight: ArrayLike | None = None,
    ) -> None:
        self._surface = surface
        w = None if weight is None else surface.vector("weight", weight)
        delta = _delta(surface, epsilon, delta)
        eta = {"sharp": 1e-6, "paper": 1e-3}.get(law, 0.0) if eta is None else eta
        self._core = _core.Distortion(surface._mesh, epsilon, law, delta, eta, w)

    def value_and_gradient(self, u: ArrayLike) -> tuple[float, Floats]:
        """Return the value and the (n,) gradient at the (n,) phase field `u`."""
        return self._core.value_and_gradient(self._surface.vector("u", u))

    def log_scale(self, u: ArrayLike) -> tuple[Floats, Floats]:
        """Return the log scale factors of the two phases, (n,) each, with their true sign.

        They are -s: negative inside a cap of a sphere, which shrinks when it is flattened with
        its rim kept.
        """
        return self._core.log_scale(self._surface.vector("u", u))
