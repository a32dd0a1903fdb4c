"""What the surface of a page can show: pictures, charts, levels, weights, stretch, density."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bytes, Floats
from ..atlas.metrics import singular_values
from .colours import chart_colours, scale_colours
from .drawing import Drawing
from .subject import Subject

__all__ = ["Measured", "looks", "measured", "text"]

# Maps of even lightness steps, which the colour-blind read, too.
_STRETCH_MAP = "magma_r"
_DENSITY_MAP = "cividis"
# Part of the area that may lie beyond the end of a scale, at each end.
_BEYOND = 0.01
# The least end of the scale of the stretch, so that what is even looks even.
_LEAST_STRETCH = 1.5
_LEAST_DENSITY = 1.25
# Squares along the longest side of the layout.
_SQUARES = 32


@dataclass(frozen=True, eq=False)
class Measured:
    """How faces lie in the layout.

    Attributes
    ----------
    stretch : (m,) array
        The most that a length changes, as a factor of at least 1, at one scale for the layout.
    density : (m,) array
        Texels along a unit of length.
    """

    stretch: Floats
    density: Floats


def measured(subject: Subject) -> Measured | None:
    """Rate each face; None without a layout."""
    if subject.uv is None:
        return None
    s1, s2, signed = singular_values(subject.surface, subject.uv)
    # A face without area in the plane has no smaller value.
    with np.errstate(divide="ignore"):
        stretch = np.maximum(s1, np.where(s2 > 0, 1 / s2, np.inf))
    density = np.sqrt(np.abs(signed) / subject.surface.face_areas) * subject.resolution
    return Measured(stretch, density)


def looks(subject: Subject, drawing: Drawing, rated: Measured | None) -> list[dict[str, Any]]:
    """Say what the buttons of a page show, as its script reads it."""
    found: list[dict[str, Any]] = []
    if _dressed(subject):
        found.append(_texture(subject, drawing))
    if subject.uv is not None:
        side = float(np.ptp(subject.uv, axis=(0, 1)).max())
        caption = f"Squares of 1/{_SQUARES} of the layout: even squares are an even texture."
        found.append(
            {
                "id": "checker",
                "label": "Checker",
                "kind": "checker",
                "squares": _SQUARES / side,
                "caption": caption,
            }
        )
    if subject.noun:
        colours = chart_colours(subject.surface, subject.chart, subject.count)
        found.append(_charts(f"{subject.noun}s", f"{subject.noun.title()}s", colours, subject))
        # The last level is the segments themselves.
        for level, of_chart in enumerate(subject.levels[:-1], start=1):
            labels, count = of_chart[subject.chart], int(of_chart.max()) + 1
            of_level = chart_colours(subject.surface, labels, count)[of_chart]
            look = _charts(f"level-{level}", f"Level {level}", of_level, subject)
            look["caption"] = f"{count} segments on level {level} of the tree."
            found.append(look)
        if subject.weights is not None:
            blend = subject.weights.colours(colours)[drawing.origin[drawing.kept]]
            found.append(
                {
                    "id": "weights",
                    "label": "Weights",
                    "kind": "colours",
                    "colours": text(np.rint(blend).astype(np.uint8)),
                    "caption": f"The colours of the {subject.noun}s, blended by their weights.",
                }
            )
    if rated is not None:
        found += [_stretch(subject, drawing, rated), _density(subject, drawing, rated)]
    if not found:
        found.append(
            {"id": "surface", "label": "Surface", "kind": "plain", "caption": "The mesh as it is."}
        )
    return found


def _dressed(subject: Subject) -> bool:
    """Whether there are pictures or colours."""
    plain = all(p.data is None and set(p.colour) == {1.0} for p in subject.pictures)
    return subject.colours is not None or not plain


def _texture(subject: Subject, drawing: Drawing) -> dict[str, Any]:
    sides = sorted({picture.side for picture in subject.pictures if picture.data is not None})
    texels = f", {' and '.join(map(str, sides[-3:]))} texels a side" if sides else ""
    look: dict[str, Any] = {
        "id": "texture",
        "label": "Texture" if sides else "Colours",
        "kind": "picture",
        "caption": f"The texture{texels}." if sides else "The colours of the file.",
    }
    if subject.colours is not None:
        # Means over the corners that are one vertex.
        corners = drawing.index.reshape(-1)
        count = np.bincount(corners, minlength=len(drawing.origin))
        mean = np.stack(
            [
                np.bincount(corners, values, len(count)) / count
                for values in subject.colours.reshape(-1, 3).T
            ],
            axis=1,
        )[drawing.kept]
        look["tint"] = text(np.rint(255 * np.clip(mean, 0, 1)).astype(np.uint8))
    return look


def _charts(name: str, label: str, colours: Bytes, subject: Subject) -> dict[str, Any]:
    return {
        "id": name,
        "label": label,
        "kind": "charts",
        "colours": text(colours),
        "caption": f"{subject.count} {subject.noun}{'s' * (subject.count != 1)}; neighbours differ "
        "in colour.",
    }


def _stretch(subject: Subject, drawing: Drawing, rated: Measured) -> dict[str, Any]:
    finite = np.where(np.isfinite(rated.stretch), rated.stretch, np.finfo(np.float32).max)
    high = max(_quantile(finite, subject.surface.face_areas, 1 - _BEYOND), _LEAST_STRETCH)
    return {
        "id": "stretch",
        "label": "Stretch",
        "caption": "The most that a length changes between surface and layout; 1 is isometric.",
        **_scale(drawing, finite, 1.0, high, "times", _STRETCH_MAP),
    }


def _density(subject: Subject, drawing: Drawing, rated: Measured) -> dict[str, Any]:
    areas = subject.surface.face_areas
    positive = np.maximum(rated.density, np.finfo(np.float32).tiny)
    middle = float(np.sqrt((rated.density**2 @ areas) / areas.sum()))
    low = min(_quantile(positive, areas, _BEYOND), middle / _LEAST_DENSITY)
    high = max(_quantile(positive, areas, 1 - _BEYOND), middle * _LEAST_DENSITY)
    side = subject.resolution
    return {
        "id": "density",
        "label": "Texel density",
        "caption": f"Texels along a unit of length of the mesh, in a texture of {side} by {side}.",
        **_scale(drawing, positive, low, high, "texels / unit", _DENSITY_MAP),
    }


def _scale(
    drawing: Drawing, values: Floats, low: float, high: float, unit: str, colormap: str
) -> dict[str, Any]:
    """Values on a logarithmic scale, 256 steps of it."""
    place = (np.log(drawing.means(values)) - np.log(low)) / (np.log(high) - np.log(low))
    return {
        "kind": "scale",
        "values": text(np.rint(255 * np.clip(place, 0, 1)).astype(np.uint8)),
        "map": text(scale_colours(colormap)),
        "low": low,
        "high": high,
        "unit": unit,
    }


def _quantile(values: Floats, areas: Floats, part: float) -> float:
    """The value below which this part of the area lies."""
    order = np.argsort(values)
    sums = np.cumsum(areas[order])
    return float(values[order][min(np.searchsorted(sums, part * sums[-1]), len(order) - 1)])


def text(data: bytes | NDArray[Any]) -> str:
    """Bytes, or those of an array, in base 64."""
    raw = data if isinstance(data, bytes) else data.tobytes()
    return base64.b64encode(raw).decode()
