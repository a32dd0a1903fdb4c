"""Pictures of segmented and textured surfaces, drawn without a display or a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from . import _core
from .files import write_whole
from .metrics import checked_uv, uv_topology
from .texture import sample

if TYPE_CHECKING:
    from .atlas import Atlas
    from .surface import Surface

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
# Colours (p, 3) at p points given by face (p,) and barycentric coordinates (p, 3).
Lookup = Callable[[Ints, Floats], Floats]

# Tableau 10 without its grey, the order changed so that the first few differ most; further colours
# are picked to differ from these and from each other.
_FIRST_COLOURS = (
    "4e79a7", "f28e2b", "59a14f", "e15759", "76b7b2", "edc948", "b07aa1", "9c755f", "ff9da7",
)  # fmt: skip
_SUPERSAMPLING = 2
# Pixel candidates handled at once; bounds memory, not the result.
_CHUNK = 4_000_000
_LIGHT = np.array([-0.42, 0.58, 0.70])
_BACK_COLOUR = np.array([0.62, 0.60, 0.58])
_SMOOTH_COSINE = 0.75


def segments(
    surface: Surface,
    values: NDArray[Any],
    path: str | PathLike[str],
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> None:
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
        Image file; the suffix sets the format.
    views
        1, or 2 to show the other side as well.
    size
        Height of a view in pixels.
    direction
        From the surface towards the viewer, (3,); by default a three-quarter view with y up.
    title
        Line above the views.

    Raises
    ------
    ValueError
        If `values` has none of the shapes above or an option is out of range.
    """
    drawn = render(surface, values, views=views, size=size, direction=direction)
    _write(_panels(drawn, title), path)


def render(
    surface: Surface,
    values: NDArray[Any],
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
) -> list[Floats]:
    """Render what `segments` draws, as arrays, to put into a figure of one's own.

    Parameters
    ----------
    surface, values, views, size, direction
        As in `segments`.

    Returns
    -------
    list of (size, w, 3) float64 arrays
        One a view, colours in [0, 1] on white, all at one scale.

    Raises
    ------
    ValueError
        If `values` has none of the shapes `segments` takes or an option is out of range.
    """
    values = np.asarray(values)
    if values.shape == (surface.n_faces,) and np.issubdtype(values.dtype, np.integer):
        _check_labels(values)
        face_colours = segment_colors(surface, values)[values]
        corner_colours = np.repeat(face_colours[:, None], 3, axis=1)
    elif values.ndim == 2 and values.shape[1] == surface.n_vertices:
        labels = values[:, surface.faces].mean(axis=2).argmax(axis=0)
        colours = segment_colors(surface, labels, len(values))
        corner_colours = (values.T @ colours)[surface.faces]
    elif values.shape == (surface.n_vertices, 3):
        corner_colours = values[surface.faces]
    elif values.shape == (surface.n_faces, 3):
        corner_colours = np.repeat(values[:, None], 3, axis=1)
    else:
        raise ValueError(
            f"values must be (m,) integers, (k, n), (n, 3) or (m, 3) with m = {surface.n_faces}, "
            f"n = {surface.n_vertices}, got {values.dtype} {values.shape}"
        )
    return _render(surface, _corner_lookup(corner_colours), views, size, direction)


def textured(
    surface: Surface,
    uv: Floats,
    image: NDArray[Any],
    path: str | PathLike[str],
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> None:
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
        Image file; the suffix sets the format.
    views, size, direction, title
        As in `segments`.

    Raises
    ------
    ValueError
        If `uv` has another shape or an option is out of range.
    """
    drawn = render_textured(surface, uv, image, views=views, size=size, direction=direction)
    _write(_panels(drawn, title), path)


def render_textured(
    surface: Surface,
    uv: Floats,
    image: NDArray[Any],
    *,
    views: int = 2,
    size: int = 700,
    direction: Sequence[float] | None = None,
) -> list[Floats]:
    """Render what `textured` draws, as arrays, to put into a figure of one's own.

    Parameters
    ----------
    surface, uv, image, views, size, direction
        As in `textured`.

    Returns
    -------
    list of (size, w, 3) float64 arrays
        One a view, colours in [0, 1] on white, all at one scale.

    Raises
    ------
    ValueError
        If `uv` has another shape or an option is out of range.
    """
    uv = checked_uv(surface, uv)
    return _render(surface, _texture_lookup(uv, image), views, size, direction)


def uv_layout(
    atlas: Atlas,
    image: NDArray[Any],
    path: str | PathLike[str],
    *,
    views: int = 2,
    size: int = 700,
    tint: float = 0.45,
    direction: Sequence[float] | None = None,
    title: str | None = None,
) -> None:
    """Draw the packed charts of an atlas with a texture, and the textured surface beside them.

    Parameters
    ----------
    atlas
        Charts and their packed layout.
    image
        (H, W, 3) bytes or floats in [0, 1] over the layout, first row at v = 1, as `bake` returns
        it.
    path
        Image file; the suffix sets the format.
    views
        Views of the surface beside the layout: 0, 1 or 2.
    size
        Height of the picture in pixels.
    tint
        How strongly the charts take their segment's colour (that of `segments`), 0 to 1.
    direction, title
        As in `segments`.

    Raises
    ------
    ValueError
        If an option is out of range.
    """
    if not 0.0 <= tint <= 1.0:
        raise ValueError(f"tint must lie in [0, 1], got {tint}")
    _check_size(size)
    surface = atlas.surface
    labels = np.empty(surface.n_faces, dtype=np.int64)
    for index, chart in enumerate(atlas.charts):
        labels[chart.faces[chart.labelled]] = index
    tints = segment_colors(surface, labels, len(atlas.charts))
    lookup = _texture_lookup(atlas.uv, image)

    def colour(face: Ints, bary: Floats) -> Floats:
        return lookup(face, bary) * (1.0 - tint + tint * tints[labels[face]])

    layout = _layout_pixels(atlas.uv, colour, size)
    beside = _render(surface, colour, views, size, direction) if views else []
    figure = _panels([layout, *beside], title)
    _outline(figure, surface, atlas.uv, size)
    _write(figure, path)


def scalar_colors(
    values: Floats, *, low: float = -1.0, high: float = 1.0, colormap: str = "coolwarm"
) -> Floats:
    """Map a scalar field to colours; by default a phase field, from blue at -1 to red at 1.

    Parameters
    ----------
    values
        (k,) values, at the vertices or faces of a surface.
    low, high
        Values of the two ends of the colour map; what lies beyond takes their colours.
    colormap
        Name of a colour map of matplotlib.

    Returns
    -------
    (k, 3) float64 array
        Colours in [0, 1], as `segments` takes them.

    Raises
    ------
    ValueError
        If `values` is not one-dimensional or not finite, `low` is not below `high`, or the colour
        map is unknown.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 1:
        raise ValueError(f"values must be (k,), got {values.shape}")
    if not np.isfinite(values).all():
        index = int(np.argmin(np.isfinite(values)))
        raise ValueError(f"values[{index}] is not finite: {values[index]}")
    if not low < high:
        raise ValueError(f"low must be below high, got {low} and {high}")
    if colormap not in matplotlib.colormaps:
        raise ValueError(f"colormap must be one of matplotlib's, got {colormap!r}")
    colours: Floats = matplotlib.colormaps[colormap]((values - low) / (high - low))[:, :3]
    return colours


def segment_colors(surface: Surface, labels: Ints, count: int | None = None) -> Floats:
    """Choose colours for segments so that neighbours are told apart.

    Parameters
    ----------
    surface
        The surface, with m faces.
    labels
        (m,) segment of each face, from 0.
    count
        Number k of segments; by default the largest label plus 1.

    Returns
    -------
    (k, 3) float64 array
        Colours in [0, 1].

    Raises
    ------
    ValueError
        If a label is negative or not below `count`.
    """
    labels = np.asarray(labels)
    _check_labels(labels)
    count = int(labels.max()) + 1 if count is None else count
    if labels.max() >= count:
        raise ValueError(f"labels must be below count = {count}, got {labels.max()}")
    colours = palette(count)
    neighbours = _neighbours(surface, labels, count)
    lab = _oklab(colours)
    distance = np.linalg.norm(lab[:, None] - lab[None], axis=2)
    chosen = np.full(count, -1)
    for segment in range(count):
        near = chosen[neighbours[segment] & (chosen >= 0)]
        free = np.setdiff1d(np.arange(count), chosen)
        # The first of the colours that are far enough: keeps to the start of the palette.
        margin = distance[np.ix_(free, near)].min(axis=1) if near.size else np.ones(len(free))
        chosen[segment] = free[np.argmax(np.minimum(margin, 0.16))]
    ordered: Floats = colours[chosen]
    return ordered


def palette(count: int) -> Floats:
    """List colours that differ, the more so the fewer are used.

    Parameters
    ----------
    count
        Number of colours, at least 1.

    Returns
    -------
    (count, 3) float64 array
        Colours in [0, 1].

    Raises
    ------
    ValueError
        If `count` is less than 1.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    bytes_ = [bytes.fromhex(code) for code in _FIRST_COLOURS]
    first = np.array([list(code) for code in bytes_]) / 255.0
    if count <= len(first):
        return first[:count]
    levels = np.linspace(0.30, 0.98, 12)
    grid = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = _oklab(grid)
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    pleasant = (chroma > 0.05) & (chroma < 0.125) & (lab[:, 0] > 0.48) & (lab[:, 0] < 0.86)
    grid, lab = grid[pleasant], lab[pleasant]
    gap = np.linalg.norm(lab[:, None] - _oklab(first)[None], axis=2).min(axis=1)
    chosen = []
    for _ in range(count - len(first)):
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
    return np.concatenate([first, grid[chosen]])


def _oklab(srgb: Floats) -> Floats:
    """Colours in a space where distances match perception (Ottosson 2020)."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    lab: Floats = np.cbrt(cones) @ np.array(
        [
            [0.2104542553, 1.9779984951, 0.0259040371],
            [0.7936177850, -2.4285922050, 0.7827717662],
            [-0.0040720468, 0.4505937099, -0.8086757660],
        ]
    )
    return lab


def _check_size(size: int) -> None:
    if size < 16:
        raise ValueError(f"size must be at least 16 pixels, got {size}")


def _check_labels(labels: NDArray[Any]) -> None:
    if labels.size and labels.min() < 0:
        face = int(np.argmin(labels))
        raise ValueError(f"labels[{face}] is negative: {labels[face]}")


def _neighbours(surface: Surface, labels: Ints, count: int) -> NDArray[np.bool_]:
    other = surface.face_neighbours
    a = np.repeat(labels, 3)[other.ravel() >= 0]
    b = labels[other.ravel()[other.ravel() >= 0]]
    touch = np.zeros((count, count), dtype=bool)
    touch[a, b] = True
    np.fill_diagonal(touch, False)
    return touch | touch.T


def _corner_lookup(values: Floats) -> Lookup:
    """Linear in every face, from (m, 3, c) values at the corners."""

    def lookup(face: Ints, bary: Floats) -> Floats:
        result: Floats = np.einsum("pkc,pk->pc", values[face], bary)
        return result

    return lookup


def _texture_lookup(uv: Floats, image: NDArray[Any]) -> Lookup:
    place = _corner_lookup(uv)
    return lambda face, bary: sample(image, place(face, bary))


def _render(
    surface: Surface,
    colour: Lookup,
    views: int,
    size: int,
    direction: Sequence[float] | None,
) -> list[Floats]:
    """Views of the surface on white, (size, w, 3) each, all at one scale."""
    if views not in (1, 2):
        raise ValueError(f"views must be 1 or 2, got {views}")
    _check_size(size)
    centred = surface.vertices - 0.5 * (surface.vertices.max(axis=0) + surface.vertices.min(axis=0))
    first = _camera(surface, direction)
    cameras = [first, first * [[-1.0], [1.0], [-1.0]]]
    if direction is None:
        # Seen slightly from above on both sides.
        cameras[1] = _frame(first[2] * [-1.0, 1.0, -1.0])
    projected = [centred @ camera.T for camera in cameras[:views]]
    span = np.max([np.ptp(points[:, :2], axis=0) for points in projected], axis=0)
    height = size * _SUPERSAMPLING
    scale = 0.96 * height / max(span[1], 0.4 * span[0], 1e-300)
    width = int(np.ceil((span[0] * scale + 0.04 * height) / _SUPERSAMPLING)) * _SUPERSAMPLING
    normals = _corner_normals(surface)
    closed = bool((surface.face_neighbours >= 0).all())
    return [
        _render_view(
            surface.faces, normals @ camera.T, points, colour, closed, scale, width, height
        )
        for points, camera in zip(projected, cameras, strict=False)
    ]


def _camera(surface: Surface, direction: Sequence[float] | None) -> Floats:
    """Rows right, up, towards the viewer."""
    if direction is not None:
        towards = np.asarray(direction, dtype=np.float64)
        if towards.shape != (3,) or not np.isfinite(towards).all() or not towards.any():
            raise ValueError(f"direction must be a vector (3,) other than zero, got {direction}")
        return _frame(towards)
    centred = surface.vertices - np.average(surface.vertices, axis=0, weights=surface.mass)
    extent = np.ptp(centred, axis=0)
    ground = centred[:, [0, 2]]
    covariance = ground.T @ (ground * surface.mass[:, None])
    spread, axes = np.linalg.eigh(covariance)
    long_axis = axes[:, 1] if spread[1] > 1.1 * spread[0] else np.array([1.0, 0.0])
    # Animals carry their heads high: the end of the long axis with more mass up there is the front.
    lean = (ground @ long_axis) @ (surface.mass * centred[:, 1])
    head = long_axis if lean >= 0.0 else -long_axis
    angle = np.arctan2(head[1], head[0]) + np.radians(50.0)
    elevation = np.radians(60.0 if extent[1] < 0.2 * extent[[0, 2]].min() else 14.0)
    if extent[2] < 0.05 * extent[:2].min():
        angle, elevation = np.radians(70.0), np.radians(10.0)
    horizontal = np.cos(elevation) * np.array([np.cos(angle), np.sin(angle)])
    return _frame(np.array([horizontal[0], np.sin(elevation), horizontal[1]]))


def _frame(towards: Floats) -> Floats:
    towards = towards / np.linalg.norm(towards)
    up = np.array([0.0, 1.0, 0.0]) if abs(towards[1]) < 0.99 else np.array([0.0, 0.0, -1.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def _corner_normals(surface: Surface) -> Floats:
    """Normals at the corners, smooth except across sharp edges."""
    points = surface.vertices[surface.faces]
    flat = _unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))[:, None]
    smooth = surface.vertex_normals[surface.faces]
    sharp = (flat * smooth).sum(axis=2) < _SMOOTH_COSINE
    return np.where(sharp[..., None], flat, smooth)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _render_view(
    faces: Ints,
    normals: Floats,
    points: Floats,
    colour: Lookup,
    closed: bool,
    scale: float,
    width: int,
    height: int,
) -> Floats:
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    pixels = (points[:, :2] - middle[:2]) * [scale, -scale] + [0.5 * width, 0.5 * height]
    face = _visible_faces(pixels[faces], points[faces, 2], width, height, closed)
    row, column = np.nonzero(face >= 0)
    hit = face[row, column]
    corners = pixels[faces[hit]]
    bary = _barycentric(corners, np.stack([column + 0.5, row + 0.5], axis=1))
    shade = _shade(np.einsum("pkc,pk->pc", normals[hit], bary))
    colours = colour(hit, bary)
    # Pixels run down, so a face turned to the viewer runs clockwise in them.
    behind = _cross(corners) > 0.0
    colours[behind] = 0.25 * colours[behind] + 0.75 * _BACK_COLOUR
    canvas = np.ones((height, width, 3))
    canvas[row, column] = np.clip(colours * shade[:, None], 0.0, 1.0)
    s = _SUPERSAMPLING
    view: Floats = canvas.reshape(height // s, s, width // s, s, 3).mean(axis=(1, 3))
    return view


def _visible_faces(
    corners: Floats, depth: Floats, width: int, height: int, closed: bool
) -> NDArray[np.int64]:
    """Nearest face at every pixel centre, -1 for none."""
    limit = np.array([width, height])
    low = np.clip(np.ceil(corners.min(axis=1) - 0.5), 0, limit).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1) - 0.5) + 1, low, limit).astype(np.int64)
    box = high - low
    candidates = box.prod(axis=1)
    cross = _cross(corners)
    candidates[(cross >= 0.0) if closed else (cross == 0.0)] = 0
    order = np.flatnonzero(candidates)
    ends = np.cumsum(candidates[order])
    cuts = np.searchsorted(ends, np.arange(_CHUNK, candidates.sum(), _CHUNK))
    nearest = np.full(width * height, -np.inf)
    face = np.full(width * height, -1, dtype=np.int64)
    for chunk in np.split(order, cuts):
        counts = candidates[chunk]
        owner = np.repeat(chunk, counts)
        k = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        x, y = low[owner, 0] + k % box[owner, 0], low[owner, 1] + k // box[owner, 0]
        bary = _barycentric(corners[owner], np.stack([x + 0.5, y + 0.5], axis=1), clip=False)
        # A little over the edge: rounding must not leave gaps between neighbours.
        inside = bary.min(axis=1) >= -1e-6
        owner, pixel = owner[inside], (y * width + x)[inside]
        z = np.einsum("pk,pk->p", depth[owner], bary[inside])
        np.maximum.at(nearest, pixel, z)
        front = z >= nearest[pixel]
        face[pixel[front]] = owner[front]
    return face.reshape(height, width)


def _cross(corners: Floats) -> Floats:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross: Floats = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return cross


def _barycentric(corners: Floats, points: Floats, *, clip: bool = True) -> Floats:
    area = _cross(corners)
    a, b, p = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    second = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / area
    third = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / area
    bary = np.stack([1.0 - second - third, second, third], axis=1)
    if clip:
        bary = np.clip(bary, 0.0, 1.0)
        bary /= bary.sum(axis=1, keepdims=True)
    return bary


def _shade(normals: Floats) -> Floats:
    """Soft Lambert shading by a light over the viewer's left shoulder; both sides are lit."""
    normals = _unit(normals)
    normals = normals * np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    lambert = normals @ (_LIGHT / np.linalg.norm(_LIGHT))
    # Half the classic law, half its wrapped form, which keeps the dark side readable.
    soft = 0.5 * np.maximum(lambert, 0.0) + 0.5 * (0.5 + 0.5 * lambert)
    shade: Floats = 0.50 + 0.56 * soft
    return shade


def _layout_pixels(uv: Floats, colour: Lookup, size: int) -> Floats:
    fine = size * _SUPERSAMPLING
    face, _ = _core.rasterize(np.ascontiguousarray(uv, dtype=np.float64), fine)
    row, column = np.nonzero(face >= 0)
    hit = face[row, column].astype(np.int64)
    centre = np.stack([column + 0.5, fine - 0.5 - row], axis=1) / fine
    canvas = np.ones((fine, fine, 3))
    canvas[row, column] = np.clip(colour(hit, _barycentric(uv[hit], centre)), 0.0, 1.0)
    s = _SUPERSAMPLING
    layout: Floats = canvas.reshape(size, s, size, s, 3).mean(axis=(1, 3))
    return layout


def _outline(figure: Figure, surface: Surface, uv: Floats, size: int) -> None:
    """Draw the borders of the charts over the first panel."""
    open_edges = uv_topology(surface, uv).open_edges
    lines = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2)[open_edges]
    axes = figure.axes[0]
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
    FigureCanvasAgg(figure)
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


def _write(figure: Figure, path: str | PathLike[str]) -> None:
    suffix = Path(path).suffix.lstrip(".").lower()
    if suffix not in figure.canvas.get_supported_filetypes():
        raise ValueError(f"path must end in a known image suffix, got {str(path)!r}")
    with write_whole(path) as temporary:
        figure.savefig(temporary, format=suffix)
