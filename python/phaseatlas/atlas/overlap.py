"""The overlapping charts as they are: a glTF file with a mesh for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from .. import _core
from ..arrays import Bools, Floats
from ..files import write_bytes
from ..points import flat_areas
from ..quality import warn
from ..scene.accessors import Gltf, Json
from ..scene.gltf import ruin_of_single_precision, translation
from ..scene.gltf_files import glb_bytes
from ..scene.gltf_slots import attribute, indices, settle
from .charts import Chart, Layout
from .packing import pack

__all__ = ["charts_glb", "injective", "pack_domains", "save_charts"]

# Least side in texels of the image of a domain in which no texel is to be covered twice. A domain
# is smaller in a texture of all of them, so that one as large as the texture is finer.
_TEXELS = 1024


def injective(layout: Layout, *, resolution: int = 1024) -> list[Chart]:
    """Return the charts of a layout without the faces that cover points of their planes twice.

    The map of a chart's labelled faces is a bijection, and all of them stay. Of other faces that
    cover the same texel those of most weight do. Over the edge of what is left out the weights
    fall to 0, and at every vertex of the surface they sum to 1 again.

    Parameters
    ----------
    layout : Layout
    resolution : int, default 1024
        Side in texels of the texture that is meant.
    """
    n = layout.surface.n_vertices
    charts, places, weights, labelled = [], [], [], []
    for chart in layout.charts:
        kept = _kept(chart, max(resolution, _TEXELS))
        # A vertex on a cut is there once a side, with one weight.
        vertices, number = np.unique(chart.vertices, return_inverse=True)
        weight = np.zeros(len(vertices))
        weight[number] = chart.weights
        own = np.zeros(len(vertices), dtype=np.bool_)
        own[number[chart.triangles[chart.labelled]]] = True
        at_edge = number[chart.triangles[~kept]]
        weight[at_edge] *= own[at_edge]
        places.append(vertices)
        weights.append(weight)
        labelled.append(own)
        used, triangles = np.unique(chart.triangles[kept], return_inverse=True)
        charts.append(
            replace(
                chart,
                faces=chart.faces[kept],
                labelled=chart.labelled[kept],
                vertices=chart.vertices[used],
                triangles=triangles.reshape(-1, 3),
                uv=chart.uv[used],
                log_scale=chart.log_scale[used],
            )
        )
    place, weight = np.concatenate(places), np.concatenate(weights)
    bare = np.bincount(place, weight, n)[place] == 0
    weight = np.where(bare, np.concatenate(labelled), weight)
    weight /= np.bincount(place, weight, n)[place]
    of_charts = np.split(weight, np.cumsum([len(vertices) for vertices in places])[:-1])
    return [
        replace(chart, weights=own[np.searchsorted(vertices, chart.vertices)])
        for chart, own, vertices in zip(charts, of_charts, places, strict=True)
    ]


def _kept(chart: Chart, resolution: int) -> Bools:
    """Faces of a chart that cover no texel twice and hang together with the labelled ones."""
    corners = chart.uv[chart.triangles]
    kept = chart.labelled | (flat_areas(corners, signed=True) > 0)
    weight = chart.weights[chart.triangles].mean(axis=1)
    # The first of the faces that cover a texel is told: the one of least weight.
    order = np.lexsort((weight, chart.labelled))
    unit = (corners - corners.min(axis=(0, 1))) / np.ptp(corners, axis=(0, 1)).max()
    while True:
        tried = order[kept[order]]
        first, count = _core.rasterize(np.ascontiguousarray(unit[tried]), resolution)
        twice = tried[np.unique(first[count > 1])]
        twice = twice[~chart.labelled[twice]]
        if not len(twice):
            break
        kept[twice] = False
    part = _core.edge_components(chart.triangles[kept])[1]
    kept[kept] = np.isin(part, part[chart.labelled[kept]])
    return kept


def pack_domains(
    charts: Sequence[Chart], *, padding: int = 4, resolution: int = 1024
) -> list[Floats]:
    """Lay the whole domains of charts side by side in the unit square, all on one scale.

    A face is there once for each chart that holds it. Domains do not overlap each other, and a
    domain overlaps itself as it does in the plane of its chart: `injective` ones do not.

    Parameters
    ----------
    charts : sequence of Chart
    padding, resolution
        As in `pack`.

    Returns
    -------
    list of (k, 3, 2) arrays
        UV of every corner of every face of each chart, in [0, 1], v up.

    Raises
    ------
    ValueError
        For a padding or resolution that cannot be used.

    Warns
    -----
    QualityWarning
        Where so many domains cannot be kept `padding` apart.
    """
    first = np.cumsum([0, *(len(chart.faces) for chart in charts)])
    whole = [
        replace(
            chart,
            faces=np.arange(start, start + len(chart.faces)),
            labelled=np.ones(len(chart.faces), dtype=np.bool_),
        )
        for chart, start in zip(charts, first[:-1], strict=True)
    ]
    uv = pack(whole, int(first[-1]), padding=padding, resolution=resolution)
    return np.split(uv, first[1:-1])


def save_charts(
    layout: Layout, path: str | PathLike[str], *, padding: int = 4, resolution: int = 1024
) -> None:
    """Write what `charts_glb` returns, whole or not at all.

    Parameters
    ----------
    layout : Layout
        The charts.
    path : str or PathLike
        A `.glb` file.
    padding, resolution
        As in `pack_domains`.

    Raises
    ------
    ValueError
        For another suffix, and for a padding or resolution that cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise ValueError(f"path: suffix {path.suffix!r} of {path} must be .glb")
    data = charts_glb(layout, path.stem, padding=padding, resolution=resolution)
    vertices = layout.surface.vertices
    if ruin := ruin_of_single_precision(vertices - translation(vertices)):
        warn(f"{path}: {ruin}")
    write_bytes(path, data)


def charts_glb(layout: Layout, name: str, *, padding: int = 4, resolution: int = 1024) -> bytes:
    """Return a binary glTF file with a mesh for each of the `injective` charts.

    The attributes of its vertices are

    - ``TEXCOORD_0``, the place in `pack_domains`, where a painter has room for every chart with all
      that it shares with its neighbours;
    - ``TEXCOORD_1``, the chart's own map, in the units of the surface, for textures that tile;
    - ``COLOR_0``, white, its alpha the blending weight;
    - ``_WEIGHT``, the same weight.

    The meshes lie on each other. Over all of them the weights sum to 1 at every vertex of the
    surface. ``extras`` of a node has the numbers ``chart`` and ``segment``, that of the scene
    ``side``, the length on the surface of a unit of ``TEXCOORD_0``.

    Parameters
    ----------
    layout : Layout
        The charts.
    name : str
        Of the material, and what the names of the meshes start with.
    padding, resolution
        As in `pack_domains`.

    """
    surface = layout.surface
    charts = injective(layout, resolution=resolution)
    packed = pack_domains(charts, padding=padding, resolution=resolution)
    flat = sum(flat_areas(chart.uv[chart.triangles]).sum() for chart in charts)
    side = float(np.sqrt(flat / sum(flat_areas(uv).sum() for uv in packed)))
    centre = translation(surface.vertices)
    nodes: list[Json] = []
    meshes: list[Json] = []
    for number, (chart, uv) in enumerate(zip(charts, packed, strict=True)):
        title = f"{name}_{number}"
        extras = {"chart": number, "segment": int(chart.segment)}
        node: Json = {"name": title, "mesh": number, "extras": extras}
        if centre.any():
            node["translation"] = centre.tolist()
        nodes.append(node)
        primitive = _primitive(layout, chart, uv, centre)
        meshes.append({"name": title, "primitives": [primitive]})
    document: Json = {
        "asset": {"version": "2.0", "generator": "phaseatlas"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes))), "extras": {"side": side}}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            {
                "name": name,
                "alphaMode": "BLEND",
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
            }
        ],
    }
    return glb_bytes(*settle(Gltf({}, (), Path(), True), document))


def _primitive(layout: Layout, chart: Chart, uv: Floats, centre: Floats) -> Json:
    # A domain that touches itself at a vertex alone is packed in two pieces.
    corners = np.column_stack([chart.triangles.reshape(-1), uv.reshape(-1, 2)])
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    vertex = unique[:, 0].astype(np.int64)
    origin = chart.vertices[vertex]
    positions = (layout.surface.vertices[origin] - centre).astype(np.float32)
    weights = chart.weights[vertex]
    colours = np.column_stack([np.ones((len(weights), 3)), weights])
    # v points down in glTF.
    places = [pair * [1.0, -1.0] + [0.0, 1.0] for pair in (unique[:, 1:], chart.uv[vertex])]
    extent = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    attributes = {
        "POSITION": attribute("VEC3", positions, **extent),
        "NORMAL": attribute("VEC3", layout.surface.vertex_normals[origin]),
        "TEXCOORD_0": attribute("VEC2", places[0]),
        "TEXCOORD_1": attribute("VEC2", places[1]),
        "COLOR_0": attribute("VEC4", colours),
        "_WEIGHT": attribute("SCALAR", weights[:, None]),
    }
    return {"attributes": attributes, "indices": indices(inverse), "material": 0}
