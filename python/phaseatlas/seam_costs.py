"""Where seams may run: factors on their length that are painted, and what they keep off or follow.

A factor g makes a seam cost the integral of g along it: in the phase fields by the perimeter, see
`functionals.Perimeter`, in charts by energy and in the cuts that open charts by the edges.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Bools, Floats
from .surface import Surface

__all__ = ["CREASE", "check_creases", "cost_arrays", "mask", "with_costs", "with_seam_cost"]

Some = TypeVar("Some", bound=Surface)

# Factors beyond these mean nothing beside others, and what is forbidden counts for the upper one.
_LEAST, _MOST = 1e-6, 1e6
#: What a seam along a crease costs for its length, as where whole faces are shared out.
CREASE = 0.2
# Factor inside a region to keep, for what does not see its edges: phase fields and simplified
# surfaces. A way around a disk is at most 1.6 times as long as one across.
_KEPT = 20.0


def with_seam_cost(
    surface: Some,
    seam_cost: ArrayLike | None = None,
    *,
    keep: ArrayLike | None = None,
    creases: float | None = None,
) -> Some:
    """Say where seams of a surface may run.

    Parameters
    ----------
    surface : Surface or Scene
        With n vertices and m faces. Factors that it has stay, and are multiplied.
    seam_cost : (n,) or (m, 3) array_like of float, optional
        Factor on the length of a seam, from 1e-6 to 1e6: at the vertices, linear in each face, or
        along edge (f[k], f[(k + 1) % 3]) of each face f, of whose two values the larger counts.
        An edge may have an infinite factor, and no seam then runs along it.
    keep : (m,) array_like of bool, or (k,) array_like of int, optional
        Faces that no seam separates where they are neighbours, as a mask or by their numbers. To
        keep them once more changes nothing.
    creases : float, optional
        Edges whose faces turn by more than this angle, in degrees, cost a fifth.

    Returns
    -------
    Surface or Scene
        The given one where nothing else is.

    Raises
    ------
    ValueError
        For an array of another shape, a factor out of range, a face that does not exist, and an
        angle that is not between 0 and 180.
    """
    if seam_cost is None and keep is None and creases is None:
        return surface
    at_vertices = surface.vertex_seam_costs
    of_edges = np.ones((surface.n_faces, 3)) if surface.seam_costs is None else surface.seam_costs
    if seam_cost is not None:
        painted = _checked(surface, seam_cost)
        if painted.ndim == 1:
            at_vertices = painted if at_vertices is None else at_vertices * painted
        else:
            of_edges = of_edges * painted
    if creases is not None:
        of_edges = np.where(_on_crease(surface, creases), CREASE, 1.0) * of_edges
    if keep is not None:
        kept = mask("keep", keep, surface.n_faces)
        neighbours = surface.face_neighbours
        inside = kept[:, None] & (neighbours >= 0) & kept[neighbours]
        of_edges = np.where(inside, np.inf, of_edges)
        around = np.ones(surface.n_vertices, dtype=np.bool_)
        around[surface.faces[~kept]] = False
        around &= ~_kept_before(surface)
        if around.any():
            factor = np.where(around, _KEPT, 1.0)
            at_vertices = factor if at_vertices is None else at_vertices * factor
    changed = (of_edges != 1).any()
    return surface.with_seam_costs(of_edges if changed else None, at_vertices)  # type: ignore[return-value]


def cost_arrays(surface: Surface, within: Bools | None = None) -> dict[str, Floats]:
    """What a file holds of where seams may run, by the names there.

    Parameters
    ----------
    surface : Surface
    within : (m, 3) array of bool, optional
        Edges whose factors it need not hold.
    """
    arrays: dict[str, Floats] = {}
    if surface.seam_costs is not None:
        of_edges = surface.seam_costs.copy()
        if within is not None:
            of_edges[within] = 1.0
        if (of_edges != 1).any():
            arrays["seam_costs"] = of_edges
    if surface.vertex_seam_costs is not None:
        arrays["vertex_seam_costs"] = surface.vertex_seam_costs
    return arrays


def with_costs(surface: Some, arrays: Mapping[str, Any]) -> Some:
    """Return the surface with what `cost_arrays` has made of it."""
    of_edges, at_vertices = (arrays.get(key) for key in ("seam_costs", "vertex_seam_costs"))
    if of_edges is None and at_vertices is None:
        return surface
    return surface.with_seam_costs(of_edges, at_vertices)  # type: ignore[return-value]


def mask(argument: str, values: ArrayLike, count: int) -> Bools:
    """Check a mask of faces, which may be given by their numbers, (k,); return it as a mask."""
    given = np.asarray(values)
    if given.dtype == np.bool_:
        if given.shape != (count,):
            raise ValueError(f"{argument}: shape {given.shape} must be ({count},)")
        return given
    if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
        raise ValueError(
            f"{argument}: shape {given.shape} of {given.dtype} must be ({count},) of bool or (k,) "
            "of int"
        )
    wrong = (given < 0) | (given >= count)
    if wrong.any():
        place = int(np.argmax(wrong))
        raise ValueError(f"{argument}[{place}]: {given[place]} must be in 0..{count - 1}")
    chosen = np.zeros(count, dtype=np.bool_)
    chosen[given.astype(np.int64)] = True
    return chosen


def check_creases(angle: float | None) -> None:
    """Raise ValueError for an angle that no crease has."""
    if angle is not None and not 0 < angle < 180:
        raise ValueError(f"creases: {angle} must be an angle in degrees between 0 and 180")


def _checked(surface: Surface, seam_cost: ArrayLike) -> Floats:
    costs = np.asarray(seam_cost, dtype=np.float64)
    n, m = surface.n_vertices, surface.n_faces
    if costs.shape not in ((n,), (m, 3)):
        raise ValueError(f"seam_cost: shape {costs.shape} must be ({n},) or ({m}, 3)")
    legal = (costs >= _LEAST) & (costs <= _MOST)
    if costs.ndim == 2:
        legal |= np.isposinf(costs)
    if not legal.all():
        where = np.argwhere(~legal)[0]
        place = ", ".join(map(str, where))
        raise ValueError(
            f"seam_cost[{place}]: {costs[tuple(where)]:g} must be a positive number from "
            f"{_LEAST:g} to {_MOST:g}"
        )
    return costs


def _kept_before(surface: Surface) -> Bools:
    """Whether a vertex has the factor of a region to keep, (n,): no inner edge there is open."""
    before = np.zeros(surface.n_vertices, dtype=np.bool_)
    if surface.seam_costs is None or surface.vertex_seam_costs is None:
        return before
    # A vertex at a corner may have no inner edge but a diagonal, and is told by its factor.
    before[surface.vertex_seam_costs >= _KEPT] = True
    open_edges = np.isfinite(surface.seam_costs) & (surface.face_neighbours >= 0)
    for k in (0, 1):
        before[np.roll(surface.faces, -k, axis=1)[open_edges]] = False
    return before


def _on_crease(surface: Surface, angle: float) -> Bools:
    """Whether the faces at each edge turn by more than an angle, (m, 3)."""
    check_creases(angle)
    neighbours = surface.face_neighbours
    cosines = np.einsum("fd,fkd->fk", surface.face_normals, surface.face_normals[neighbours])
    crease: Bools = (neighbours >= 0) & (cosines < np.cos(np.radians(angle)))
    return crease
