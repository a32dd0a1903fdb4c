"""Segments of whole faces: labels of a working surface carried back to the surface as given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components

from .. import _core
from ..arrays import Floats, Ints
from ..surface import Surface
from ..transfer import Transfer

__all__ = ["coverage", "n_units", "share_out", "splits_units", "units"]

# What an infinite factor on the length of a seam counts for: no way around is so long.
_FORBIDDEN = 1e6
# What a seam costs on a sharp crease, for its length; on flat parts it costs its length.
_ON_CREASE = 0.2


def units(surface: Surface) -> Ints:
    """Polygon of each face, (m,), numbered from 0: what a seam must not split."""
    if surface.seam_costs is None:
        return np.arange(surface.n_faces)
    f, k = np.nonzero(np.isinf(surface.seam_costs) & (surface.face_neighbours >= 0))
    together = scipy.sparse.csr_array(
        (np.ones(len(f)), (f, surface.face_neighbours[f, k])),
        shape=(surface.n_faces, surface.n_faces),
    )
    return np.asarray(connected_components(together, directed=False)[1], dtype=np.int64)


def n_units(surface: Surface, enough: int) -> int:
    """Number of polygons, or at least `enough`."""
    # A polygon of more than four corners is rare, and no matter where there are many.
    if surface.seam_costs is None or surface.n_faces >= 64 * enough:
        return surface.n_faces
    return int(units(surface).max()) + 1


def splits_units(surface: Surface, labels: Ints) -> bool:
    """Whether some polygon has faces of several labels."""
    if surface.seam_costs is None:
        return False
    unit = units(surface)
    first = np.zeros(unit.max() + 1, dtype=np.int64)
    first[unit] = labels
    return bool((first[unit] != labels).any())


def coverage(step: Transfer | None, labels: Ints, surface: Surface, n_leaves: int) -> Any:
    """Area of each face that each leaf covers, an (m, leaves) CSR array.

    Parameters
    ----------
    step : Transfer or None
        From the surface to the one of the labels; None where it is the same.
    labels : array of int
        Leaf of each face.
    surface : Surface
        The surface as given, with m faces.
    n_leaves : int
    """
    if step is None:
        face, areas = np.arange(surface.n_faces), surface.face_areas
    elif step.origin_face is None:
        face, areas, labels = (
            np.arange(surface.n_faces),
            surface.face_areas,
            labels[step.parent_face],
        )
    else:
        face, areas = step.origin_face, step.target.face_areas
    return scipy.sparse.csr_array((areas, (face, labels)), shape=(surface.n_faces, n_leaves))


def share_out(
    surface: Surface,
    covered: Any,
    shares: Sequence[float] | Floats,
    splits: Ints,
    faces: Ints | None = None,
) -> Ints:
    """Give every face to a leaf: to the one that covers most of it, but for what follows.

    Every node of the tree is connected and has at least as many faces as leaves. Areas are as even
    as whole faces allow, and where that leaves a choice seams are short and on creases. Polygons
    stay whole. Few faces are tried in every way; many are moved across the seams until no move
    helps.

    Parameters
    ----------
    surface : Surface
    covered : (m, leaves) CSR array
        Area of each face that each leaf covers.
    shares : (leaves,) array_like of float
        Positive numbers, in proportion to which the leaves get their areas.
    splits : (leaves - 1, 3) array of int
        For each split node its first leaf, that of its second child, and one past its last.
    faces : (m,) array of int, optional
        The faces to share out, which connect; all m by default.

    Returns
    -------
    (m,) array of int
    """
    chosen = np.arange(surface.n_faces) if faces is None else faces
    _, unit = np.unique(units(surface)[chosen], return_inverse=True)
    unit = unit.reshape(-1)
    n = int(unit.max()) + 1
    areas = np.bincount(unit, weights=surface.face_areas[chosen], minlength=n).astype(np.float64)
    unit_of = np.full(surface.n_faces + 1, -1)
    unit_of[chosen] = unit
    f, k = np.nonzero(unit_of[surface.face_neighbours[chosen]] >= 0)
    a, b = unit[f], unit_of[surface.face_neighbours[chosen[f], k]]
    apart = a != b
    costs = _seam_lengths(surface)[chosen[f], k]
    borders = scipy.sparse.csr_array((costs[apart], (a[apart], b[apart])), shape=(n, n))
    of_units = scipy.sparse.csr_array(
        (np.ones(len(unit)), (unit, np.arange(len(unit)))), shape=(n, len(unit))
    )
    covered = scipy.sparse.csr_array(of_units @ covered)
    covered.sort_indices()
    parts = np.asarray(shares, dtype=np.float64)
    leaf = _core.share_out(
        *_rows(borders),
        areas,
        *_rows(covered),
        parts * (areas.sum() / parts.sum()),
        np.ascontiguousarray(splits, dtype=np.int64),
    )
    return leaf[unit]


def _rows(matrix: Any) -> tuple[Ints, Ints, Floats]:
    return matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data


def _seam_lengths(surface: Surface) -> Floats:
    """What a seam along each edge of each face costs, (m, 3): its length, less on creases."""
    corners = surface.vertices[surface.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    normals = surface.face_normals
    cosines = np.einsum("fd,fkd->fk", normals, normals[surface.face_neighbours])
    factor = _ON_CREASE + (1 - _ON_CREASE) * np.clip(cosines, 0, 1)
    lengths: Floats = np.linalg.norm(sides, axis=2) * factor
    if surface.total_seam_costs is not None:
        lengths *= np.minimum(surface.total_seam_costs, _FORBIDDEN)
    return lengths
