"""Outlines as drawings: SVG, and DXF by ezdxf."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from ..arrays import Floats

if TYPE_CHECKING:
    from .outlines import Outlines

__all__ = ["UNITS", "check_drawing", "dxf", "svg"]

# Millimetres in each unit, and its number in DXF's $INSUNITS.
UNITS = {"mm": (1.0, 4), "cm": (10.0, 5), "m": (1000.0, 6), "in": (25.4, 1), "ft": (304.8, 2)}
_LAYERS = {"outlines": 7, "notches": 1, "labels": 5}
# Height of a chart's number, relative to the room around it.
_LABEL = 0.5


def check_drawing(path: Path, unit: str) -> None:
    """Refuse a drawing that cannot be written, before the work that comes first.

    Raises
    ------
    ValueError
        For a suffix that is neither `.svg` nor `.dxf`, and for an unknown unit.
    ImportError
        For a `.dxf` file where ezdxf is missing.
    """
    if path.suffix.lower() not in (".svg", ".dxf"):
        raise ValueError(f"outlines: {path} must end in .svg or .dxf")
    if unit not in UNITS:
        raise ValueError(f"unit: {unit!r} must be one of {tuple(UNITS)}")
    if path.suffix.lower() == ".dxf":
        try:
            import ezdxf  # noqa: F401
        except ImportError as error:
            raise ImportError("a .dxf file needs ezdxf: pip install 'phaseatlas[dxf]'") from error


def svg(outlines: Outlines, name: str, unit: str) -> bytes:
    """Return an SVG file whose user unit is that of the surface.

    Parameters
    ----------
    outlines : Outlines
    name : str
        Title of the drawing.
    unit : str
        A key of `UNITS`.
    """
    width, height = outlines.size
    millimetres, _ = UNITS[unit]
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{millimetres * width:.17g}mm" '
        f'height="{millimetres * height:.17g}mm" viewBox="0 0 {width:.17g} {height:.17g}">',
        f"<title>{escape(name)}</title>",
        f"<desc>Scale 1:1. A user unit is 1 {unit}.</desc>",
        "<style>path { fill: none; stroke-width: 1px; vector-effect: non-scaling-stroke } "
        "#outlines { stroke: #000 } #notches { stroke: #d00 } "
        "text { font-family: sans-serif; text-anchor: middle; dominant-baseline: central } "
        "#labels { fill: #04a }</style>",
        '<g id="outlines">',
    ]
    for number, piece in enumerate(outlines.pieces):
        loops = " ".join(f"M {_points(loop, height)} Z" for loop in piece.loops)
        lines.append(f'<path id="piece-{number}" d="{loops}"/>')
    lines += ["</g>", '<g id="notches">']
    for number, ends in enumerate(_marks(outlines)):
        strokes = " ".join(f"M {_points(mark, height)}" for mark in ends)
        lines.append(f'<path id="notch-{number}" d="{strokes}"/>')
    lines += ["</g>", '<g id="labels">']
    for text, place, size in _labels(outlines):
        x, y = place[0], height - place[1]
        lines.append(f'<text x="{x:.17g}" y="{y:.17g}" font-size="{size:.6g}">{text}</text>')
    lines += ["</g>", "</svg>", ""]
    return "\n".join(lines).encode()


def dxf(outlines: Outlines, name: str, unit: str) -> bytes:
    """Return a DXF file (R2010) in the unit of the surface.

    Closed polylines are on the layer ``outlines``, lines on ``notches``, texts on ``labels``.

    Parameters
    ----------
    outlines, name, unit
        As in `svg`.
    """
    import ezdxf
    from ezdxf.enums import TextEntityAlignment

    # Dates and random identifiers would make each file another.
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2010")
        document.units = UNITS[unit][1]
        document.header["$MEASUREMENT"] = 0 if unit in ("in", "ft") else 1
        for layer, colour in _LAYERS.items():
            document.layers.add(layer, color=colour)
        space = document.modelspace()
        for piece in outlines.pieces:
            for loop in piece.loops:
                space.add_lwpolyline(loop, close=True, dxfattribs={"layer": "outlines"})
        for ends in _marks(outlines):
            for start, end in ends:
                space.add_line(start, end, dxfattribs={"layer": "notches"})
        for text, place, size in _labels(outlines):
            entity = space.add_text(text, height=size, dxfattribs={"layer": "labels"})
            entity.set_placement(place, align=TextEntityAlignment.MIDDLE_CENTER)
        written = io.StringIO()
        document.write(written)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    return written.getvalue().encode()


def _points(points: Floats, height: float) -> str:
    """Points as text; y points down in SVG."""
    return " ".join(f"{x:.17g},{height - y:.17g}" for x, y in points)


def _marks(outlines: Outlines) -> Floats:
    """Ends of the strokes of each notch, (p, 2 sides, 2 ends, 2)."""
    points, inward = outlines.notches.points, outlines.notches.inward
    return np.stack([points, points + outlines.notch_length * inward], axis=2)


def _labels(outlines: Outlines) -> list[tuple[str, Floats, float]]:
    """Texts with their places and heights: the charts of the pieces, the numbers of notches."""
    length = outlines.notch_length
    found = [(f"{p.chart}", p.label, min(_LABEL * p.room, 3 * length)) for p in outlines.pieces]
    places = outlines.notches.points + 1.7 * length * outlines.notches.inward
    for number, sides in enumerate(places):
        found += [(f"{number}", place, 0.8 * length) for place in sides]
    return found
