"""Views of surfaces and layouts as arrays, drawn without a display or a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..arrays import Floats, Ints
from ..atlas.bake import sample
from ..atlas.metrics import checked_uv
from ..points import SurfacePoints, barycentric, flat_areas
from ..surface import Surface
from .colours import check_labels, segment_colors

__all__ = [
    "Colour",
    "camera",
    "check_size",
    "corner_normals",
    "draw_layout",
    "linear",
    "pictured",
    "render",
    "render_textured",
    "render_views",
]

#: Colours (k, 3) at k points of a surface.
Colour = Callable[[SurfacePoints], Floats]

_SUPERSAMPLING = 2
_LIGHT = np.array([-0.42, 0.58, 0.70])
_BACK_COLOUR = np.array([0.62, 0.60, 0.58])
_SMOOTH_COSINE = 0.75


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
        check_labels(values)
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
            f"values: {values.dtype} of shape {values.shape} must be integers (m,), or (k, n), "
            f"(n, 3) or (m, 3) with m = {surface.n_faces}, n = {surface.n_vertices}"
        )
    return render_views(surface, linear(corner_colours), views, size, direction)


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
    return render_views(surface, pictured(uv, image), views, size, direction)


def linear(values: Floats) -> Colour:
    """Colours that are linear in every face, from (m, 3, 3) values at the corners."""
    return lambda points: points.interpolate(values)


def pictured(uv: Floats, image: NDArray[Any]) -> Colour:
    """Colours of an image at the texture coordinates (m, 3, 2) of the corners."""
    return lambda points: sample(image, points.interpolate(uv))


def render_views(
    surface: Surface,
    colour: Colour,
    views: int,
    size: int,
    direction: Sequence[float] | None,
) -> list[Floats]:
    """Views of the surface on white, (size, w, 3) each, all at one scale."""
    if views not in (1, 2):
        raise ValueError(f"views: {views} must be 1 or 2")
    check_size(size)
    centred = surface.vertices - 0.5 * (surface.vertices.max(axis=0) + surface.vertices.min(axis=0))
    first = camera(surface, direction)
    cameras = [first, first * [[-1.0], [1.0], [-1.0]]]
    if direction is None:
        # Seen slightly from above on both sides.
        cameras[1] = _frame(first[2] * [-1.0, 1.0, -1.0])
    projected = [centred @ camera.T for camera in cameras[:views]]
    span = np.max([np.ptp(points[:, :2], axis=0) for points in projected], axis=0)
    height = size * _SUPERSAMPLING
    scale = 0.96 * height / max(span[1], 0.4 * span[0], 1e-300)
    width = int(np.ceil((span[0] * scale + 0.04 * height) / _SUPERSAMPLING)) * _SUPERSAMPLING
    normals = corner_normals(surface)
    closed = bool((surface.face_neighbours >= 0).all())

    def view(points: Floats, camera: Floats) -> Floats:
        return _render_view(
            surface.faces, normals @ camera.T, points, colour, closed, scale, width, height
        )

    with ThreadPoolExecutor(views) as pool:
        return list(pool.map(view, projected, cameras))


def camera(surface: Surface, direction: Sequence[float] | None) -> Floats:
    """Rows right, up, towards the viewer."""
    if direction is not None:
        towards = np.asarray(direction, dtype=np.float64)
        if towards.shape != (3,) or not np.isfinite(towards).all() or not towards.any():
            raise ValueError(f"direction: {direction} must be a vector (3,) other than zero")
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


def corner_normals(surface: Surface) -> Floats:
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
    colour: Colour,
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
    centre = np.stack([column + 0.5, row + 0.5], axis=1)
    points_hit = SurfacePoints(hit, barycentric(corners, centre))
    shade = _shade(points_hit.interpolate(normals))
    colours = colour(points_hit)
    behind = flat_areas(corners, signed=True) > 0.0
    colours[behind] = 0.25 * colours[behind] + 0.75 * _BACK_COLOUR
    canvas = np.ones((height, width, 3))
    canvas[row, column] = np.clip(colours * shade[:, None], 0.0, 1.0)
    s = _SUPERSAMPLING
    view: Floats = canvas.reshape(height // s, s, width // s, s, 3).mean(axis=(1, 3))
    return view


def _visible_faces(corners: Floats, height: Floats, width: int, rows: int, closed: bool) -> Ints:
    """Nearest face at every pixel centre, (rows, width), -1 for none; a solid has no back."""
    # Pixels run down, so a face turned to the viewer runs clockwise in them.
    drawn = np.flatnonzero((flat_areas(corners, signed=True) < 0.0) | (not closed))
    side = max(width, rows)
    uv = (corners[drawn] * [1.0, -1.0] + [0.0, side]) / side
    found = _core.nearest(uv, np.ascontiguousarray(height[drawn]), side)[:rows, :width]
    # The last entry is that of no face.
    return np.append(drawn, -1)[found]


def _shade(normals: Floats) -> Floats:
    """Soft Lambert shading by a light over the viewer's left shoulder; both sides are lit."""
    normals = _unit(normals)
    normals = normals * np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    lambert = normals @ (_LIGHT / np.linalg.norm(_LIGHT))
    # Half the classic law, half its wrapped form, which keeps the dark side readable.
    soft = 0.5 * np.maximum(lambert, 0.0) + 0.5 * (0.5 + 0.5 * lambert)
    shade: Floats = 0.50 + 0.56 * soft
    return shade


def draw_layout(uv: Floats, colour: Colour, size: int) -> Floats:
    fine = size * _SUPERSAMPLING
    face, _ = _core.rasterize(np.ascontiguousarray(uv, dtype=np.float64), fine)
    row, column = np.nonzero(face >= 0)
    hit = face[row, column].astype(np.int64)
    centre = np.stack([column + 0.5, fine - 0.5 - row], axis=1) / fine
    points = SurfacePoints(hit, barycentric(uv[hit], centre))
    canvas = np.ones((fine, fine, 3))
    canvas[row, column] = np.clip(colour(points), 0.0, 1.0)
    s = _SUPERSAMPLING
    layout: Floats = canvas.reshape(size, s, size, s, 3).mean(axis=(1, 3))
    return layout


def check_size(size: int) -> None:
    if size < 16:
        raise ValueError(f"size: {size} must be at least 16 pixels")
