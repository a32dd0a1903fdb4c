"""Isotropic remeshing: triangles of even size and shape on the same surface.

Around the library that does it, this module puts what that leaves to its user: a unit of length,
bounds on what can be asked for, and a check of the result.
"""

# Imported with the package, which must not take long: no arrays up here.
from __future__ import annotations

import math
from typing import TYPE_CHECKING

from . import quality

if TYPE_CHECKING:
    from .surface import Surface

__all__ = ["remesh"]

DEFAULT_VERTICES = 10_000
FEWEST_FACES = 20
MOST_VERTICES = 5_000_000
# Share of the area that may be cut off, or added, by the chords of long edges.
AREA_TOLERANCE = 0.1
# Relative difference of the mean edge length from the one asked for that goes without saying.
LENGTH_TOLERANCE = 0.1


def remesh(
    surface: Surface, edge_length: float | None = None, feature_angle: float = 45.0
) -> Surface:
    """Remesh a surface with nearly equilateral triangles of one size.

    Edges are split, collapsed and swapped, and vertices moved, by the library MMG, on a smooth
    surface through the input (Dapogny, Dobrzynski and Frey 2014). Long edges are halved first, so
    that a coarse input is not rounded by more than a fraction of the new edge length. Creases and
    corners of the boundary sharper than `feature_angle` are kept where they are longer than three
    edge lengths and far enough from each other to leave room for triangles. The topology is that
    of the input.

    Parameters
    ----------
    surface : Surface
        Any surface; its triangles may be coarse and uneven.
    edge_length : float, optional
        Target edge length, in the unit of the vertices; the mean comes out within about a tenth
        of it, unless the surface bends too much for that. By default the mean edge length of the
        surface, or shorter where that would give less than about 10,000 vertices.
    feature_angle : float, default 45
        Angle in degrees between the normals of two faces, or between two edges of the boundary,
        from which on their common edge or vertex is kept; 180 keeps none.

    Returns
    -------
    Surface
        Of the same genus and with as many boundary loops.

    Raises
    ------
    ImportError
        Where the extra ``remesh`` is not installed.
    ValueError
        For an edge length that is not a positive number, is so large that it leaves fewer than 20
        faces or changes the topology or a tenth of the area, or so small that it gives more than
        5 million vertices; for an angle that is not in (0, 180].
    RuntimeError
        Where MMG gives up.

    Warns
    -----
    QualityWarning
        Where the mean edge length differs from the target by more than a tenth, and where
        faces are left with a quality below 0.2.
    """
    edge_length = _checked(surface, edge_length, feature_angle)
    # Here, because scipy takes as long to import as all the rest.
    from .mmg import LONGEST_INPUT, MEAN_TOLERANCE, WORST_QUALITY, remesh_unit, split
    from .surface import Surface

    centre = surface.vertices.mean(axis=0)
    vertices = (surface.vertices - centre) / edge_length
    results = []
    for longest in LONGEST_INPUT:
        fine = Surface(*split(vertices, surface.faces, longest))
        results.append(remesh_unit(fine, feature_angle))
        if abs(results[-1].mean_edge_length - 1) < MEAN_TOLERANCE:
            break
    result = min(results, key=lambda unit: abs(unit.mean_edge_length - 1))
    if (result.genus, result.n_boundary_loops) != (surface.genus, surface.n_boundary_loops):
        raise ValueError(
            f"edge_length: {edge_length:.6g} must be smaller to keep the topology: genus "
            f"{result.genus} instead of {surface.genus}, {result.n_boundary_loops} boundary loops "
            f"instead of {surface.n_boundary_loops}"
        )
    remeshed = Surface(result.vertices * edge_length + centre, result.faces)
    change = remeshed.area / surface.area - 1
    if abs(change) > AREA_TOLERANCE:
        raise ValueError(
            f"edge_length: {edge_length:.6g} must be smaller to follow the surface: the area "
            f"changes by {100 * change:.1f} %"
        )
    if abs(result.mean_edge_length - 1) > LENGTH_TOLERANCE:
        quality.warn(
            f"the mean edge length is {remeshed.mean_edge_length:.6g}, not {edge_length:.6g}: the "
            "surface bends too much for that; a smaller edge length follows it"
        )
    worst = float(remeshed.face_quality.min())
    if worst < WORST_QUALITY:
        quality.warn(
            f"the worst face has a quality of {worst:.2g}; a smaller edge length or a larger "
            "feature angle leaves room for better ones"
        )
    return remeshed


def _checked(surface: Surface, edge_length: float | None, feature_angle: float) -> float:
    """The target edge length, after a check of both options against the surface."""
    if not 0 < feature_angle <= 180:
        raise ValueError(f"feature_angle: {feature_angle:g} must be in (0, 180] degrees")
    if edge_length is None:
        # Two equilateral triangles of sqrt(3) / 4 edge lengths squared to a vertex.
        even = math.sqrt(2 / math.sqrt(3) * surface.area / DEFAULT_VERTICES)
        edge_length = min(surface.mean_edge_length, even)
    if not 0 < edge_length < math.inf:
        raise ValueError(f"edge_length: {edge_length:g} must be a positive number")
    n_faces = surface.area / edge_length**2 * 4 / math.sqrt(3)
    if n_faces < FEWEST_FACES:
        raise ValueError(
            f"edge_length: {edge_length:.6g} must be smaller: on a surface of area "
            f"{surface.area:.6g} it leaves {n_faces:.1f} faces, the fewest are {FEWEST_FACES}"
        )
    if n_faces > 2 * MOST_VERTICES:
        raise ValueError(
            f"edge_length: {edge_length:.6g} must be larger: on a surface of area "
            f"{surface.area:.6g} it gives {n_faces / 2:.3g} vertices, the most are {MOST_VERTICES}"
        )
    return edge_length
