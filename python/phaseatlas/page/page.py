"""One page of HTML, whole in itself: the surface in model-viewer, the layout, the figures."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .._core import __version__
from ..arrays import Bytes, Floats
from ..atlas import Atlas
from ..atlas.metrics import uv_topology
from ..files import write_bytes
from ..meanings import METRICS, SEGMENTS, SURFACE
from ..plot.render import camera
from ..surface import Surface
from ..unwrapping import Unwrapped
from .drawing import drawing, outlines
from .looks import Measured, looks, measured, text
from .subject import Picture, Subject, subject

__all__ = ["as_frame", "html_of", "write_page"]

# Units along the side of the drawing of the layout, which is written in whole ones.
_SIDE = 10_000
_MEANINGS = METRICS | SEGMENTS | SURFACE
# Height of a page in a notebook, in pixels, and the faces above which there is none: 4 MB.
_FRAME = 680
_FRAME_FACES = 100_000
# Charts above which a page has no outlines and figures of each, to stay small.
_MOST_CHARTS = 5_000


def write_page(thing: object, path: str | PathLike[str], **options: Any) -> None:
    """Write a page that shows a surface, a segmentation, a tree or an atlas.

    It is one file that makes no request: it opens from a disk as from a server.

    Parameters
    ----------
    thing : Surface, Scene, Segmentation, SegmentTree, Atlas, Unwrapped or Subject
        What to show. Above 200,000 faces a simplified surface is drawn, and the page says so; the
        figures are those of the surface as it is.
    path : str or PathLike
        The file; written whole or not at all.
    **options
        As of `html_of`.
    """
    options.setdefault("title", Path(path).stem)
    write_bytes(path, html_of(thing, **options).encode())


def html_of(
    thing: object,
    *,
    title: str = "phaseatlas",
    image: Bytes | Sequence[Bytes] | None = None,
    of: object = None,
) -> str:
    """Return a page that shows a surface, a segmentation, a tree or an atlas.

    Parameters
    ----------
    thing : Surface, Scene, Segmentation, SegmentTree, Atlas, Unwrapped or Subject
        What to show.
    title : str
        Its heading.
    image : (r, r, 3) array of uint8, or a sequence of them, optional
        The texture of an atlas, first row on top; one for each page.
    of : SegmentTree or SceneSegmentation, optional
        What an atlas was made of, to show the levels of its tree.
    """
    thing = thing.atlas if isinstance(thing, Unwrapped) else thing
    shown = thing if isinstance(thing, Subject) else subject(thing)
    if image is not None:
        images = [image] if isinstance(image, np.ndarray) else list(image)
        pictures = tuple(Picture.of(each) for each in images)
        shown = replace(shown, pictures=pictures, resolution=images[0].shape[0])
        if isinstance(thing, Atlas) and thing.n_pages > 1:
            shown = replace(shown, material=thing.face_pages)
    if of is not None:
        shown = _with_levels(shown, thing, of)
    return _assembled(shown, title)


def _with_levels(shown: Subject, atlas: Any, of: object) -> Subject:
    """The levels of a tree, carried from its segments to the charts of an atlas."""
    of_charts = np.array([chart.segment for chart in atlas.charts])
    return replace(shown, levels=tuple(level[of_charts] for level in subject(of).levels))


def as_frame(thing: object) -> str | None:
    """Return a page as a frame for a notebook; None where there are too many faces for it."""
    of = thing.atlas if isinstance(thing, Unwrapped) else thing
    # What is large is not gathered first.
    surface = of if isinstance(of, Surface) else getattr(of, "surface", None)
    if surface is not None and surface.n_faces > _FRAME_FACES:
        return None
    escaped = html.escape(html_of(of, title=type(thing).__name__), quote=True)
    return (
        f'<iframe srcdoc="{escaped}" title="phaseatlas" style="width: 100%; height: {_FRAME}px; '
        'border: 0"></iframe>'
    )


def _assembled(shown: Subject, title: str) -> str:
    surface = shown.surface
    material = shown.material
    if material is None:
        material = np.zeros(surface.n_faces, dtype=np.int64)
    topology = None if shown.uv is None else uv_topology(surface, shown.uv)
    drawn = drawing(surface, shown.chart, material, shown.uv, topology)
    rated = measured(shown)
    notes = list(shown.notes)
    if drawn.simplified:
        notes.append(
            f"The surface is drawn with {len(drawn.faces):,} of its {surface.n_faces:,} faces; "
            "figures and outlines are those of all of them."
        )
    layout: dict[str, Any] | None = None
    if shown.uv is not None and topology is not None:
        low = np.minimum(shown.uv.min(axis=(0, 1)), 0.0)
        high = np.maximum(shown.uv.max(axis=(0, 1)), 1.0)
        side = float((high - low).max())
        paths = [""] * shown.count
        if shown.count <= _MOST_CHARTS:
            loops = outlines(shown.chart, topology, shown.uv, shown.count)
            paths = [_path(loop, low, side) for loop in loops]
        layout = {"low": low.tolist(), "side": side, "units": _SIDE, "outlines": paths}
    towards = camera(surface, None)[2]
    data = {
        "noun": shown.noun,
        "model": text(drawn.glb()),
        "chart": text(drawn.chart[drawn.kept].astype(np.uint32)),
        "charts": _charts(shown, rated),
        "layout": layout,
        "pictures": [
            {
                "data": picture.data and f"data:image/jpeg;base64,{text(picture.data)}",
                "colour": picture.colour,
            }
            for picture in shown.pictures
        ],
        "looks": looks(shown, drawn, rated),
        "orbit": [
            math.degrees(math.atan2(towards[0], towards[2])),
            math.degrees(math.acos(float(np.clip(towards[1], -1.0, 1.0)))),
        ],
    }
    faces = f"{surface.n_faces:,} faces"
    charts = f"{shown.count:,} {shown.noun}{'s' * (shown.count != 1)}" if shown.noun else ""
    pieces = {
        "TITLE": html.escape(title),
        "SUMMARY": html.escape(" · ".join(part for part in (faces, charts) if part)),
        "STYLE": _read("page.css"),
        "METRICS": _table(shown.metrics),
        "NOTES": "".join(f"<p>{html.escape(note)}</p>" for note in notes),
        "VERSION": __version__,
        "METRICS_JSON": _json(_finite(shown.metrics)),
        "DATA": _json(data),
        "VIEWER": _read("vendor/model-viewer-umd.min.js"),
        "SCRIPT": _read("page.js"),
    }
    # What is put in is not searched for places again.
    first, *rest = _read("page.html").split("{{")
    return first + "".join(
        pieces[name] + after for name, _, after in (part.partition("}}") for part in rest)
    )


def _charts(shown: Subject, rated: Measured | None) -> list[dict[str, float | None]]:
    """Share of the area, percent, and mean stretch of each chart."""
    if not shown.noun or shown.count > _MOST_CHARTS:
        return []
    areas = shown.surface.face_areas
    sums = np.bincount(shown.chart, areas, shown.count)
    shares = 100 * sums / areas.sum()
    stretches = np.full(shown.count, np.nan)
    if rated is not None:
        weighted = np.bincount(shown.chart, areas * rated.stretch, shown.count)
        stretches = weighted / np.maximum(sums, np.finfo(float).tiny)
    return [
        {"share": float(f"{share:.4g}"), "stretch": float(f"{stretch:.4g}")}
        if math.isfinite(stretch)
        else {"share": float(f"{share:.4g}")}
        for share, stretch in zip(shares.tolist(), stretches.tolist(), strict=True)
    ]


def _path(loops: list[Floats], low: Floats, side: float) -> str:
    """The outline of a chart as SVG draws it, v down."""
    drawn = []
    for loop in loops:
        places = np.rint((loop - low) / side * _SIDE).astype(np.int64)
        places[:, 1] = _SIDE - places[:, 1]
        steps = np.diff(places, axis=0)
        steps = steps[(steps != 0).any(axis=1)]
        moves = " ".join(f"{x} {y}" for x, y in steps.tolist())
        drawn.append(f"M{places[0, 0]} {places[0, 1]}l{moves}z" if moves else "")
    return "".join(drawn)


def _table(metrics: dict[str, float]) -> str:
    rows = (
        f"<tr><th scope=row>{html.escape(name)}</th><td>{_number(value)}</td>"
        f"<td>{html.escape(_MEANINGS.get(name, ''))}</td></tr>"
        for name, value in metrics.items()
    )
    return "".join(rows)


def _number(value: float) -> str:
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.4g}" if math.isfinite(value) else "none"


def _finite(metrics: dict[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in metrics.items()}


def _json(value: Any) -> str:
    """JSON that ends no script."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _read(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
