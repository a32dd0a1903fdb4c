"""Maps of domains to the plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from .. import _core
from ..arrays import Floats, Ints
from ..points import flat_areas
from ..surface import Surface
from .charts import Chart, Domain
from .metrics import THIN

__all__ = ["FLATTENINGS", "Flattening", "Map", "chart", "flatten", "spread"]

Flattening = Literal["bff", "lscm", "isometric"]
FLATTENINGS: tuple[Flattening, ...] = get_args(Flattening)

_METHODS: dict[Flattening, Callable[[_core.TriangleMesh], Floats]] = {
    "bff": lambda disk: _core.bff(disk).uv,
    "lscm": _core.lscm,
    "isometric": _core.isometric,
}
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Map:
    """A domain and its map to the plane, whose labelled faces keep their total area.

    Attributes
    ----------
    domain : Domain
        What is mapped.
    uv : (p, 2) array
        Point of each vertex of its disk.
    areas : (k,) array
        Areas of its faces in the plane.
    """

    domain: Domain
    uv: Floats
    areas: Floats


def flatten(domain: Domain, method: Flattening, surface: Surface) -> Map | None:
    """Map a domain to the plane.

    Parameters
    ----------
    domain : Domain
        What to map.
    method : {"bff", "lscm", "isometric"}
        Boundary-first with scale 1 on the boundary (Sawhney and Crane 2017), least-squares
        conformal in its spectral form (Mullen et al. 2008), or of least symmetric Dirichlet energy
        (Smith and Schaefer 2015).
    surface : Surface
        What the domain is of.

    Returns
    -------
    Map or None
        None where the labelled faces are not connected or no disk, or their map is no bijection.
    """
    sharp = domain.disk if domain.sharp is None else domain.sharp
    try:
        # A flat piece with holes is left as it is.
        uv = _core.in_plane(sharp) if sharp.n_boundary_loops > 1 else _METHODS[method](sharp)
        labelled = np.flatnonzero(domain.labelled)
        if domain.sharp is None and not _are_disk(domain.disk, labelled):
            return None
        triangles = np.ascontiguousarray(domain.triangles[labelled])
        given = surface.face_areas[domain.faces[labelled]].sum()
        with np.errstate(all="ignore"):
            uv *= np.sqrt(given / flat_areas(uv[triangles]).sum())
        # The layout is at least as large as the surface.
        flips, crosses, _ = _core.faults(triangles, uv, THIN * np.sqrt(surface.area))
        if flips or crosses or not np.isfinite(uv).all():
            return None
        if domain.sharp is not None:
            uv = _core.extend(domain.disk, uv)
    except ValueError:
        # Rounding spoils the factorisation of extreme needles.
        return None
    return Map(domain, uv, flat_areas(uv[domain.triangles]))


def _are_disk(disk: _core.TriangleMesh, faces: Ints) -> bool:
    """Whether faces of a disk are one; ValueError where they are not connected."""
    return _core.cut_chart(disk, faces).euler_characteristic == 1


def spread(mapped: Map, face_areas: Floats) -> float:
    """Integral of the squared deviation of the log scale over the labelled faces.

    Parameters
    ----------
    mapped : Map
        A map.
    face_areas : (m,) array
        Areas of the faces of the surface.
    """
    labelled = mapped.domain.labelled
    areas = face_areas[mapped.domain.faces][labelled]
    log_scale = 0.5 * np.log(np.maximum(mapped.areas[labelled], _TINY) / areas)
    mean = areas @ log_scale / areas.sum()
    return float(areas @ (log_scale - mean) ** 2)


def chart(mapped: Map, weight: Floats) -> Chart:
    """The chart of a map.

    Parameters
    ----------
    mapped : Map
        A map.
    weight : (n,) array
        Blending weight of the chart at the vertices of the surface.
    """
    domain = mapped.domain
    mass = np.bincount(domain.triangles.reshape(-1), weights=np.repeat(mapped.areas, 3))
    return Chart(
        segment=domain.segment,
        faces=domain.faces,
        labelled=domain.labelled,
        vertices=domain.vertices,
        triangles=domain.triangles,
        uv=mapped.uv,
        weights=weight[domain.vertices],
        log_scale=0.5 * np.log(np.maximum(mass, _TINY) / (3 * domain.disk.mass())),
        cut_length=domain.cut_length,
    )
