"""Textures carried to the surface by overlapping charts and blended there."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import _core
from ..arrays import Bytes, Floats, Ints
from ..scene.picture import MOST_16_BIT, grey_values
from .charts import Layout

#: An image (H, W, c) of bytes, of 16 bits or of floats in [0, 1], its first row at v = 1, or a
#: function from UVs (k, 2) to values (k, c).
Texture = NDArray[Any] | Callable[[Floats], Floats]

# Memory that an image takes, in bytes a texel, while it is baked and written: the image and the
# reach of its gutters, Pillow's copy (four bytes), the compressed data (three at most) and the file
# around it. Measured, 8192 texels a side and their GLB file take 12.
_BYTES_PER_TEXEL = _core.BYTES_PER_TEXEL + 9
# And besides: a tile in work with the places and values of a function there.
_WORKING_BYTES = 128 * 2**20


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
        raise ValueError(f"squares: {squares} must be even and at least 2")
    if size < squares:
        raise ValueError(f"size: {size} must be at least squares, {squares}")
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
    ValueError
        If an image of floats has values outside [0, 1].
    """
    with Image.open(path) as image:
        grey = grey_values(image)
        if grey is None:
            return np.asarray(image.convert("RGB"), dtype=np.uint8)
    if not ((grey >= 0) & (grey <= 1)).all():
        raise ValueError(f"{path}: floats must be in [0, 1]")
    return np.repeat(np.rint(255 * grey).astype(np.uint8)[..., None], 3, axis=2)


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
        If an image is not (H, W, c) or a function returns anything but k rows of finite values.
    """
    uv = np.asarray(uv, dtype=np.float64)
    if callable(texture):
        values = np.asarray(texture(uv), dtype=np.float64)
        if values.ndim != 2 or len(values) != len(uv):
            raise ValueError(f"texture: returned shape {values.shape} must be ({len(uv)}, c)")
        if not np.isfinite(values).all():
            raise ValueError("texture: returned values must be finite numbers")
        return values
    return _core.sample(_image(texture), np.ascontiguousarray(uv))


def blend_vertices(atlas: Layout, texture: Texture, *, scale: float = 4.0) -> Floats:
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
        raise ValueError("atlas.charts: must not be empty")
    if not (total > 0.0).all():
        vertex = int(np.flatnonzero(~(total > 0.0))[0])
        raise ValueError(f"the weights of all charts at vertex {vertex} add up to {total[vertex]}")
    return blend / total[:, None]


def bake(
    atlas: Layout,
    texture: Texture,
    *,
    resolution: int = 1024,
    scale: float = 4.0,
    padding: int | None = None,
    blend: bool = True,
    background: tuple[int, int, int] = (255, 255, 255),
    page: int | None = None,
) -> Bytes:
    """Write a blended texture into the packed layout of an atlas.

    Every texel that a face covers gets the blend, at its point of the surface, of f(phi) over all
    charts whose domain holds the face; weights and chart coordinates are linear in the face. The
    result looks seamless on the surface although its layout has seams. The image is made in tiles
    of some rows, between which Ctrl-C stops the work.

    Parameters
    ----------
    atlas
        Charts with their blending weights and a packed layout ``atlas.uv``.
    texture
        The function f: an image or a callable with values in [0, 1], three channels or one. A
        callable is asked once a tile, for all charts together.
    resolution
        Side of the result in texels.
    scale
        Tiles of the texture per square root of the surface's area.
    padding
        How far the colours of the charts are carried over their boundaries, in texels, so that
        filtering does not pull in the background; ``None`` fills the image. Each texel copies the
        nearest covered one; of several the leftmost, and of these the uppermost.
    blend
        False takes each texel from the one chart whose segment the face belongs to (thresholding).
    background
        Colour beyond the padding, bytes.
    page
        Which page of the layout to write, where it has several.

    Returns
    -------
    (resolution, resolution, 3) uint8 array
        The image, first row at v = 1.

    Raises
    ------
    ValueError
        If `scale`, `resolution`, `padding`, `background` or `page` is out of range, the texture has
        two or more than three channels, or a covered texel is in no chart.
    MemoryError
        If memory does not suffice for `resolution`; see `check_resolution`.
    """
    check_resolution(resolution)
    if padding is not None and padding < 0:
        raise ValueError(f"padding: {padding} must be at least 0")
    if len(background) != 3 or not all(0 <= channel <= 255 for channel in background):
        raise ValueError(f"background: {background} must be three bytes")
    image = None if callable(texture) else _image(texture)
    if image is not None:
        _check_channels(image.shape[2])
    faces = _faces_of(atlas, page)
    layout = np.ascontiguousarray(atlas.uv[faces], dtype=np.float64)
    charts = _concatenated(atlas, blend, faces)
    scale = _tiles_per_unit(atlas, scale)
    work = _core.Bake(layout, *charts, scale, resolution, background)
    for tile in range(work.n_tiles):
        if image is not None:
            work.paint_image(tile, image)
            continue
        places = work.places(tile)
        if len(places):
            values = sample(texture, places)
            _check_channels(values.shape[1])
            colours = np.broadcast_to(values, (len(places), 3))
            work.paint_values(tile, np.ascontiguousarray(colours))
    return work.finish(padding)


def check_resolution(resolution: int) -> None:
    """Refuse a resolution that cannot be baked, before the work that comes first.

    Parameters
    ----------
    resolution : int
        Side of the image in texels.

    Raises
    ------
    ValueError
        If `resolution` is not in 1..32768.
    MemoryError
        If baking and writing the image would take more memory than there is.
    """
    if not 1 <= resolution <= _core.MAX_RESOLUTION:
        raise ValueError(f"resolution: {resolution} must be in 1..{_core.MAX_RESOLUTION}")
    needed = _WORKING_BYTES + resolution**2 * _BYTES_PER_TEXEL
    if needed > _core.available_memory() or not _can_allocate(needed):
        raise MemoryError(
            f"resolution: {resolution} takes {needed / 2**30:.1f} GiB of memory; must be smaller"
        )


def _can_allocate(size: int) -> bool:
    """Whether a process whose address space is limited may take so many bytes."""
    try:
        np.empty(size, dtype=np.uint8)
    except MemoryError:
        return False
    return True


def _faces_of(atlas: Layout, page: int | None) -> Ints:
    """Faces on a page."""
    if page is None and atlas.n_pages > 1:
        raise ValueError(f"page: value must be given, for there are {atlas.n_pages} of them")
    if page is not None and not 0 <= page < atlas.n_pages:
        raise ValueError(f"page: {page} must be in 0..{atlas.n_pages - 1}")
    # What is stacked shows what lies below.
    own = ~atlas.stacked
    return np.flatnonzero(own if atlas.n_pages == 1 else own & (atlas.face_pages == page))


def _concatenated(
    atlas: Layout, blend: bool, faces: Ints
) -> tuple[Ints, Ints, Floats, Floats | None]:
    """Faces, corners, places and weights of all charts; with `blend` or the labelled faces alone.

    The faces are those of a page, by their place among them. The corners count through the vertices
    of all charts.
    """
    charts = atlas.charts
    if not charts:
        raise ValueError("atlas.charts: must not be empty")
    place = np.full(atlas.surface.n_faces, -1, dtype=np.int64)
    place[faces] = np.arange(len(faces))
    kept = [(place[chart.faces] >= 0) & (True if blend else chart.labelled) for chart in charts]
    first = np.cumsum([0, *(len(chart.vertices) for chart in charts)])
    pairs = list(zip(charts, kept, strict=True))
    corners = [chart.triangles[k] + start for (chart, k), start in zip(pairs, first, strict=False)]
    return (
        place[np.concatenate([chart.faces[k] for chart, k in pairs])],
        np.concatenate(corners),
        np.concatenate([chart.uv for chart in charts]),
        np.concatenate([chart.weights for chart in charts]) if blend else None,
    )


def _check_channels(count: int) -> None:
    if count not in (1, 3):
        raise ValueError(f"texture: {count} channels must be 1 or 3")


def _tiles_per_unit(atlas: Layout, scale: float) -> float:
    if not (np.isfinite(scale) and scale > 0.0):
        raise ValueError(f"scale: {scale} must be a positive number")
    return float(scale / np.sqrt(atlas.surface.area))


def _image(texture: NDArray[Any]) -> Bytes | Floats:
    texture = np.asarray(texture)
    if texture.ndim != 3 or 0 in texture.shape:
        raise ValueError(f"texture: shape {texture.shape} must be (H, W, c)")
    if texture.dtype == np.uint8:
        return np.ascontiguousarray(texture)
    if texture.dtype == np.uint16:
        return np.ascontiguousarray(texture / float(MOST_16_BIT))
    if not np.issubdtype(texture.dtype, np.floating):
        raise ValueError(
            f"texture: dtype {texture.dtype} must be uint8, uint16 or floats in [0, 1]"
        )
    if not ((texture >= 0) & (texture <= 1)).all():
        raise ValueError("texture: floats must be in [0, 1]")
    return np.ascontiguousarray(texture, dtype=np.float64)
