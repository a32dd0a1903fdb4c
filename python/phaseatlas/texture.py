"""Textures carried to the surface by overlapping charts and blended there."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt, map_coordinates

from . import _core

if TYPE_CHECKING:
    from .atlas import Atlas

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

#: An image (H, W, c) of bytes or of floats in [0, 1], its first row at v = 1, or a function from
#: UVs (k, 2) to values (k, c).
Texture = NDArray[Any] | Callable[[Floats], Floats]


def checker(
    size: int = 512,
    squares: int = 8,
    *,
    light: tuple[int, int, int] = (246, 242, 233),
    dark: tuple[int, int, int] = (52, 62, 86),
) -> Bytes:
    """Draw a checkerboard that tiles.

    Parameters
    ----------
    size
        Side of the image in texels.
    squares
        Squares along a side; even, or two of one colour meet where tiles do.
    light, dark
        Colours of the squares, bytes; light is at the lower left corner.

    Returns
    -------
    (size, size, 3) uint8 array
        The image, first row at the top.

    Raises
    ------
    ValueError
        If `squares` is odd or less than 2, or `size` is less than `squares`.
    """
    if squares < 2 or squares % 2:
        raise ValueError(f"squares must be even and at least 2, got {squares}")
    if size < squares:
        raise ValueError(f"size must be at least squares = {squares}, got {size}")
    index = np.arange(size) * squares // size
    odd = (index[::-1, None] + index[None, :]) % 2
    board: Bytes = np.array([light, dark], dtype=np.uint8)[odd]
    return board


def load_image(path: str | PathLike[str]) -> Bytes:
    """Read an image file as colours, transparency dropped.

    Parameters
    ----------
    path
        Any format that Pillow reads.

    Returns
    -------
    (H, W, 3) uint8 array
        The image, first row at the top.

    Raises
    ------
    OSError
        If the file does not exist or is not an image.
    """
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=np.uint8)


def sample(texture: Texture, uv: Floats) -> Floats:
    """Look a texture up, tiled over the plane.

    Parameters
    ----------
    texture
        Image or function. Images are interpolated bilinearly between texel centres.
    uv
        (k, 2) places; an image covers [0, 1]^2, v pointing up.

    Returns
    -------
    (k, c) float64 array
        Values; bytes become floats in [0, 1].

    Raises
    ------
    ValueError
        If an image is not (H, W, c) or a function returns anything but k rows.
    """
    uv = np.asarray(uv, dtype=np.float64)
    if callable(texture):
        values = np.asarray(texture(uv), dtype=np.float64)
        if values.ndim != 2 or len(values) != len(uv):
            raise ValueError(f"texture must return shape ({len(uv)}, c), got {values.shape}")
        return values
    image = _unit_image(texture)
    height, width, channels = image.shape
    # Whole tiles are taken off first: far from the origin the interpolation would lose digits.
    tile = uv - np.floor(uv)
    places = np.stack([(1.0 - tile[:, 1]) * height - 0.5, tile[:, 0] * width - 0.5])
    values = np.empty((len(uv), channels))
    for channel in range(channels):
        values[:, channel] = map_coordinates(
            image[..., channel], places, order=1, mode="grid-wrap", prefilter=False
        )
    return values


def blend_vertices(atlas: Atlas, texture: Texture, *, scale: float = 4.0) -> Floats:
    """Blend a texture over all charts at every vertex.

    The sum over the charts of weight times f(phi), phi the chart's map to the plane (the atlas
    formula of the phase-field segmentation; cf. Piponi and Borshukov 2000). A vertex that a chart
    holds several times, on a cut, counts with the mean over its copies.

    Parameters
    ----------
    atlas
        Charts with their blending weights.
    texture
        The function f: an image or a callable, see `sample`.
    scale
        Tiles of the texture per square root of the surface's area.

    Returns
    -------
    (n, c) float64 array
        One value per vertex, in the units of `sample`.

    Raises
    ------
    ValueError
        If `scale` is not positive or the weights of all charts vanish at a vertex.
    """
    tiles = _tiles_per_unit(atlas, scale)
    n = atlas.surface.n_vertices
    total = np.zeros(n)
    blend: Floats | None = None
    for chart in atlas.charts:
        copies = np.bincount(chart.vertices, minlength=n)
        weights = chart.weights / copies[chart.vertices]
        values = weights[:, None] * sample(texture, tiles * chart.uv)
        blend = np.zeros((n, values.shape[1])) if blend is None else blend
        np.add.at(blend, chart.vertices, values)
        np.add.at(total, chart.vertices, weights)
    if blend is None:
        raise ValueError("atlas.charts is empty")
    if not (total > 0.0).all():
        vertex = int(np.flatnonzero(~(total > 0.0))[0])
        raise ValueError(f"the weights of all charts at vertex {vertex} add up to {total[vertex]}")
    return blend / total[:, None]


def bake(
    atlas: Atlas,
    texture: Texture,
    *,
    resolution: int = 1024,
    scale: float = 4.0,
    padding: int | None = None,
    blend: bool = True,
    background: tuple[int, int, int] = (255, 255, 255),
) -> Bytes:
    """Write a blended texture into the packed layout of an atlas.

    Every texel that a face covers gets the blend, at its point of the surface, of f(phi) over all
    charts whose domain holds the face; weights and chart coordinates are linear in the face. The
    result looks seamless on the surface although its layout has seams.

    Parameters
    ----------
    atlas
        Charts with their blending weights and a packed layout ``atlas.uv``.
    texture
        The function f: an image or a callable with values in [0, 1], three channels or one.
    resolution
        Side of the result in texels.
    scale
        Tiles of the texture per square root of the surface's area.
    padding
        How far the colours of the charts are carried over their borders, in texels, so that
        filtering does not pull in the background; ``None`` fills the image.
    blend
        False takes each texel from the one chart whose segment the face belongs to (thresholding).
    background
        Colour beyond the padding, bytes.

    Returns
    -------
    (resolution, resolution, 3) uint8 array
        The image, first row at v = 1.

    Raises
    ------
    ValueError
        If `scale`, `resolution` or `padding` is out of range, the texture has two or more than
        three channels, or a covered texel is in no chart.
    """
    if resolution < 1:
        raise ValueError(f"resolution must be at least 1, got {resolution}")
    if padding is not None and padding < 0:
        raise ValueError(f"padding must not be negative, got {padding}")
    tiles = _tiles_per_unit(atlas, scale)
    face, _ = _core.rasterize(np.ascontiguousarray(atlas.uv, dtype=np.float64), resolution)
    row, column = np.nonzero(face >= 0)
    texel_face = face[row, column].astype(np.int64)
    centre = np.stack([column + 0.5, resolution - 0.5 - row], axis=1) / resolution
    bary = _barycentric(atlas.uv[texel_face], centre)

    colours = _blend_texels(atlas, texture, tiles, texel_face, bary, blend)
    image = np.empty((resolution, resolution, 3), dtype=np.uint8)
    image[:] = background
    image[row, column] = np.rint(np.clip(colours, 0.0, 1.0) * 255.0)
    return _fill_gutters(image, face >= 0, padding)


def _blend_texels(
    atlas: Atlas, texture: Texture, tiles: float, face: Ints, bary: Floats, blend: bool
) -> Floats:
    colours = np.zeros((len(face), 3))
    total = np.zeros(len(face))
    for chart in atlas.charts:
        local = np.full(atlas.surface.n_faces, -1, dtype=np.int64)
        kept = slice(None) if blend else chart.labelled
        local[chart.faces[kept]] = np.arange(len(chart.faces))[kept]
        hit = np.flatnonzero(local[face] >= 0)
        corners = chart.triangles[local[face[hit]]]
        weight = _interpolate(chart.weights[corners], bary[hit]) if blend else np.ones(len(hit))
        used = weight > 0.0
        hit, corners, weight = hit[used], corners[used], weight[used]
        if not len(hit):
            continue
        values = sample(texture, tiles * _interpolate(chart.uv[corners], bary[hit]))
        if values.shape[1] not in (1, 3):
            raise ValueError(f"texture must have 1 or 3 channels, got {values.shape[1]}")
        colours[hit] += weight[:, None] * values
        total[hit] += weight
    if not (total > 0.0).all():
        wrong = int(face[np.flatnonzero(~(total > 0.0))[0]])
        raise ValueError(f"face {wrong} is in no chart with a positive weight")
    return colours / total[:, None]


def _interpolate(values: Floats, bary: Floats) -> Floats:
    """Linear in the face, from values at the corners (k, 3) or (k, 3, d)."""
    result: Floats = np.einsum("kc...,kc->k...", values, bary)
    return result


def _barycentric(corners: Floats, points: Floats) -> Floats:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    second = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / area
    third = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / area
    # Covered texels lie inside up to rounding, which a sliver's small area magnifies.
    bary = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
    inside: Floats = bary / bary.sum(axis=1, keepdims=True)
    return inside


def _fill_gutters(image: Bytes, covered: NDArray[np.bool_], padding: int | None) -> Bytes:
    if not covered.any() or padding == 0:
        return image
    distance, nearest = distance_transform_edt(~covered, return_indices=True)
    filled: Bytes = image[nearest[0], nearest[1]]
    if padding is not None:
        beyond = distance > padding
        filled[beyond] = image[beyond]
    return filled


def _tiles_per_unit(atlas: Atlas, scale: float) -> float:
    if not (np.isfinite(scale) and scale > 0.0):
        raise ValueError(f"scale must be positive, got {scale}")
    return float(scale / np.sqrt(atlas.surface.area))


def _unit_image(texture: NDArray[Any]) -> Floats:
    texture = np.asarray(texture)
    if texture.ndim != 3 or 0 in texture.shape:
        raise ValueError(f"texture must have shape (H, W, c), got {texture.shape}")
    if texture.dtype == np.uint8:
        return texture / 255.0
    if not np.issubdtype(texture.dtype, np.floating):
        raise ValueError(f"texture: dtype {texture.dtype}, expected uint8 or floats in [0, 1]")
    if not ((texture >= 0) & (texture <= 1)).all():
        raise ValueError("texture: floats must be in [0, 1]")
    image: Floats = texture.astype(np.float64)
    return image
