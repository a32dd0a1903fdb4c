"""The file of an atlas: what it takes to bake, pack or flatten it again without another solve."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats, Ints
from ..saved_arrays import read_arrays, write_arrays
from ..scene.arrays import scene_arrays, scene_of_arrays
from ..scene.scene import Scene
from ..seam_costs import cost_arrays, with_costs
from ..surface import Surface
from .charts import Chart, Layout

__all__ = ["FORMAT", "load_layout", "save_layout"]

FORMAT = 3
# Arrays of a chart with a row a face of its domain, and with a row a vertex.
_OF_FACES = ("faces", "labelled", "triangles")
_OF_VERTICES = ("vertices", "uv", "weights", "log_scale")
# Columns of those that have some.
_WIDTHS = {"triangles": (3,), "uv": (2,)}


def save_layout(layout: Layout, path: str | PathLike[str]) -> None:
    """Write a layout to an `.npz` file, whole or not at all; see `Atlas.save`."""
    surface, charts = layout.surface, layout.charts
    arrays: dict[str, Any] = (
        scene_arrays(surface)
        if isinstance(surface, Scene)
        else {"vertices": surface.vertices, "faces": surface.faces, **cost_arrays(surface)}
    )
    arrays |= {
        "format": FORMAT,
        "labels": layout.labels,
        "uv": layout.uv,
        "pages": layout.pages,
        "resolution": layout.resolution,
        "stack": layout.stack,
        "chart_segment": np.array([chart.segment for chart in charts]),
        "chart_cut_length": np.array([chart.cut_length for chart in charts]),
        "chart_n_faces": np.array([len(chart.faces) for chart in charts]),
        "chart_n_vertices": np.array([len(chart.vertices) for chart in charts]),
    }
    for name in (*_OF_FACES, *_OF_VERTICES):
        arrays[f"chart_{name}"] = np.concatenate([getattr(chart, name) for chart in charts])
    write_arrays(path, arrays)


def load_layout(path: str | PathLike[str]) -> Layout:
    """Read what `save_layout` wrote.

    Raises
    ------
    ValueError
        For a file that is no atlas.
    FileNotFoundError
        For a missing file.
    """
    return read_arrays(path, FORMAT, layout_of_arrays)


def layout_of_arrays(arrays: dict[str, Any]) -> Layout:
    """Return the layout of the arrays of a file, checked for what a damaged one may hold."""
    surface = (
        scene_of_arrays(arrays)
        if "mesh_names" in arrays
        else with_costs(Surface(arrays["vertices"], arrays["faces"]), arrays)
    )
    m = surface.n_faces
    labels: Ints = arrays["labels"]
    uv: Floats = arrays["uv"]
    for name, array, shape in (("labels", labels, (m,)), ("uv", uv, (m, 3, 2))):
        if array.shape != shape:
            raise ValueError(f"{name}: shape {array.shape} must be {shape}")
    sizes = {
        **dict.fromkeys(_OF_FACES, int(np.sum(arrays["chart_n_faces"]))),
        **dict.fromkeys(_OF_VERTICES, int(np.sum(arrays["chart_n_vertices"]))),
    }
    for name, size in sizes.items():
        shape = (size, *_WIDTHS.get(name, ()))
        if arrays[f"chart_{name}"].shape != shape:
            found = arrays[f"chart_{name}"].shape
            raise ValueError(f"chart_{name}: shape {found} must be {shape}")
    if arrays["chart_labelled"].dtype != np.bool_:
        raise ValueError("chart_labelled: must be true or false")
    for name, bound in (("faces", m), ("vertices", surface.n_vertices)):
        if not _whole(arrays[f"chart_{name}"], 0, bound):
            raise ValueError(f"chart_{name}: must be whole numbers in 0..{bound - 1}")
    own = np.repeat(arrays["chart_n_vertices"], arrays["chart_n_faces"])[:, None]
    if not _whole(arrays["chart_triangles"], 0, own):
        raise ValueError("chart_triangles: must be numbers of vertices of their charts")
    ends = {
        **dict.fromkeys(_OF_FACES, np.cumsum(arrays["chart_n_faces"])[:-1]),
        **dict.fromkeys(_OF_VERTICES, np.cumsum(arrays["chart_n_vertices"])[:-1]),
    }
    parts = {name: np.split(arrays[f"chart_{name}"], end) for name, end in ends.items()}
    charts = tuple(
        Chart(
            segment=int(arrays["chart_segment"][k]),
            cut_length=float(arrays["chart_cut_length"][k]),
            **{name: each[k] for name, each in parts.items()},
        )
        for k in range(len(arrays["chart_segment"]))
    )
    covered = np.concatenate([chart.faces[chart.labelled] for chart in charts])
    if not np.array_equal(np.sort(covered), np.arange(m)):
        raise ValueError("chart_labelled: every face must be labelled in one chart")
    # Files of before there were pages have one.
    pages = arrays.get("pages", np.zeros(len(charts), dtype=np.int64))
    if pages.shape != (len(charts),) or not _whole(pages, 0, np.inf):
        raise ValueError(f"pages: must be {len(charts)} whole numbers from 0")
    stack: Ints = arrays.get("stack", np.full((m, 3), -1, dtype=np.int64))
    if stack.shape != (m, 3) or not _whole(stack, -1, 3 * m):
        raise ValueError(f"stack: must be whole numbers of corners below {3 * m}, (m, 3)")
    side = int(arrays.get("resolution", 1024))
    return Layout(surface, labels, charts, uv, pages, side, stack)


def _whole(values: NDArray[Any], low: int, bound: float | Ints) -> bool:
    """Whether all are whole numbers from the least one on, and below a bound."""
    integers = np.issubdtype(values.dtype, np.integer)
    return bool(integers and ((values >= low) & (values < bound)).all())
