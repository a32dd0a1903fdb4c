"""Figures: views side by side, layouts with the outlines of their charts."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..arrays import Bools, Bytes, Floats
from ..atlas.charts import Layout
from ..atlas.metrics import uv_topology
from ..files import write_whole
from ..points import SurfacePoints
from ..surface import Surface
from .colours import segment_colors
from .render import check_size, draw_layout, pictured, render, render_textured, render_views

__all__ = ["segments", "textured", "uv_layout"]


def segments(
    surface: Surface,
    values: NDArray[Any],
    path: str | PathLike[str] | None = None,
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> Bytes:
    """Draw a surface with its segments in distinct colours.

    Parameters
    ----------
    surface
        The surface, with n vertices and m faces.
    values
        What to show: labels, (m,) integers counted from 0; blending weights, (k, n) floats, drawn
        as the weighted mean of the segments' colours; or colours in [0, 1], (m, 3) or (n, 3)
        floats. Floats of shape (3, n) are weights.
    path
        Image file, where one is to be written; the suffix sets the format.
    views
        1, or 2 to show the other side as well.
    size
        Height of a view in pixels.
    direction
        From the surface towards the viewer, (3,); by default a three-quarter view with y up.
    title
        Line above the views.

    Returns
    -------
    (h, w, 3) array of uint8
        The picture.

    Raises
    ------
    ValueError
        If `values` has none of the shapes above or an option is out of range.
    """
    drawn = render(surface, values, views=views, size=size, direction=direction)
    return _drawn(_panels(drawn, title), path)


def textured(
    surface: Surface,
    uv: Floats,
    image: NDArray[Any],
    path: str | PathLike[str] | None = None,
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> Bytes:
    """Draw a surface with a texture.

    Parameters
    ----------
    surface
        The surface, with m faces.
    uv
        (m, 3, 2) UV of every corner of every face.
    image
        (H, W, 3) bytes or floats in [0, 1], first row at v = 1; tiled outside [0, 1]^2.
    path
        Image file, where one is to be written; the suffix sets the format.
    views, size, direction, title
        As in `segments`.

    Returns
    -------
    (h, w, 3) array of uint8
        The picture.

    Raises
    ------
    ValueError
        If `uv` has another shape or an option is out of range.
    """
    drawn = render_textured(surface, uv, image, views=views, size=size, direction=direction)
    return _drawn(_panels(drawn, title), path)


def uv_layout(
    atlas: Layout,
    image: NDArray[Any] | Sequence[NDArray[Any]],
    path: str | PathLike[str] | None = None,
    *,
    views: int = 2,
    size: int = 700,
    tint: float = 0.45,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> Bytes:
    """Draw the packed charts of an atlas with a texture, and the textured surface beside them.

    Parameters
    ----------
    atlas
        Charts and their packed layout.
    image
        (H, W, 3) bytes or floats in [0, 1] over the layout, first row at v = 1, as `bake` returns
        it; a sequence of them where there are several pages, which are drawn side by side.
    path
        Image file, where one is to be written; the suffix sets the format.
    views
        Views of the surface beside the layout: 0, 1 or 2.
    size
        Height of the picture in pixels.
    tint
        How strongly the charts take their segment's colour (that of `segments`), 0 to 1.
    direction, title
        As in `segments`.

    Returns
    -------
    (h, w, 3) array of uint8
        The picture.

    Raises
    ------
    ValueError
        If an option is out of range.
    """
    if not 0.0 <= tint <= 1.0:
        raise ValueError(f"tint: {tint} must be in [0, 1]")
    check_size(size)
    surface = atlas.surface
    labels = atlas.face_charts
    tints = segment_colors(surface, labels, len(atlas.charts))
    images = [image] if isinstance(image, np.ndarray) else list(image)
    if len(images) != atlas.n_pages:
        raise ValueError(f"image: {len(images)} images must be {atlas.n_pages}, one a page")
    pictures = [pictured(atlas.uv, each) for each in images]
    pages = atlas.face_pages

    def colour(points: SurfacePoints) -> Floats:
        found = pictures[0](points)
        for page, picture in enumerate(pictures[1:], start=1):
            mine = pages[points.face] == page
            found[mine] = picture(SurfacePoints(points.face[mine], points.barycentric[mine]))
        tinted: Floats = found * (1.0 - tint + tint * tints[labels[points.face]])
        return tinted

    def on_page(page: int) -> Floats:
        faces = np.flatnonzero(pages == page)

        def of_page(points: SurfacePoints) -> Floats:
            return colour(SurfacePoints(faces[points.face], points.barycentric))

        return draw_layout(atlas.uv[faces], of_page, size)

    layouts = [on_page(page) for page in range(atlas.n_pages)]
    beside = render_views(surface, colour, views, size, direction) if views else []
    figure = _panels([*layouts, *beside], title)
    open_edges = uv_topology(surface, atlas.udim).open_edges
    for page in range(atlas.n_pages):
        _outline(figure.axes[page], atlas.uv, open_edges & (pages == page)[:, None], size)
    return _drawn(figure, path)


def _outline(axes: Axes, uv: Floats, open_edges: Bools, size: int) -> None:
    """Draw the boundaries of charts over the panel of their page."""
    lines = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2)[open_edges]
    pixels = lines * [size, -size] + [-0.5, size - 0.5]
    axes.add_collection(LineCollection(list(pixels), colors="#2b2b2b", linewidths=0.7))
    for spine in axes.spines.values():
        spine.set(visible=True, edgecolor="#b8b8b8", linewidth=0.8)


def _panels(images: Sequence[Floats], title: str | None) -> Figure:
    """Images of one height side by side, pixel for pixel."""
    gap, top = 24, 44 if title else 0
    height = images[0].shape[0]
    total = (
        sum(image.shape[1] for image in images) + gap * (len(images) + 1),
        height + 2 * gap + top,
    )
    dpi = 100.0
    figure = Figure(figsize=(total[0] / dpi, total[1] / dpi), dpi=dpi, facecolor="white")
    left = gap
    for image in images:
        width = image.shape[1]
        axes = figure.add_axes(
            (left / total[0], gap / total[1], width / total[0], height / total[1])
        )
        axes.imshow(image, interpolation="none", aspect="auto")
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_visible(False)
        left += width + gap
    if title:
        figure.text(
            0.5, 1.0 - 0.6 * (top + gap) / total[1], title, ha="center", va="center", size=15
        )
    return figure


def _drawn(figure: Figure, path: str | PathLike[str] | None) -> Bytes:
    """The pixels of a figure, which is written where there is a path."""
    canvas: Any = FigureCanvasAgg(figure)
    if path is not None:
        suffix = Path(path).suffix.lstrip(".").lower()
        if suffix not in canvas.get_supported_filetypes():
            raise ValueError(f"path: {path} must end in a known image suffix")
        with write_whole(path) as temporary:
            figure.savefig(temporary, format=suffix)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
