"""Maps of domains to the plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from .. import _core
from ..arrays import Floats
from ..points import flat_areas
from .charts import Chart, Domain

__all__ = ["FLATTENINGS", "Flattening", "Map", "chart", "flatten", "spread"]

Flattening = Literal["bff", "lscm"]
FLATTENINGS: tuple[Flattening, ...] = get_args(Flattening)

_METHODS: dict[Flattening, Callable[[_core.TriangleMesh], Floats]] = {
    "bff": lambda disk: _core.bff(disk).uv,
    "lscm": _core.lscm,
}
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Map:
    """A domain and its map to the plane, in any unit of length.

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


def flatten(domain: Domain, method: Flattening) -> Map:
    """Map a domain to the plane.

    Parameters
    ----------
    domain : Domain
        What to map.
    method : {"bff", "lscm"}
        Boundary-first with scale 1 on the boundary (Sawhney and Crane 2017), or least-squares
        conformal in its spectral form (Mullen et al. 2008).
    """
    uv = _METHODS[method](domain.disk)
    return Map(domain, uv, flat_areas(uv[domain.triangles]))


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


def chart(mapped: Map, face_areas: Floats, weight: Floats) -> Chart:
    """The chart of a map, scaled so that its labelled faces keep their total area.

    Parameters
    ----------
    mapped : Map
        A map.
    face_areas : (m,) array
        Areas of the faces of the surface.
    weight : (n,) array
        Blending weight of the chart at the vertices of the surface.
    """
    domain = mapped.domain
    given = face_areas[domain.faces][domain.labelled].sum()
    scale = np.sqrt(given / mapped.areas[domain.labelled].sum())
    mass = np.bincount(domain.triangles.reshape(-1), weights=np.repeat(mapped.areas, 3))
    return Chart(
        segment=domain.segment,
        faces=domain.faces,
        labelled=domain.labelled,
        vertices=domain.vertices,
        triangles=domain.triangles,
        uv=mapped.uv * scale,
        weights=weight[domain.vertices],
        log_scale=0.5 * np.log(scale**2 * mass / (3 * domain.disk.mass())),
        cut_length=domain.cut_length,
    )
