"""A file's own textures, carried from its old texture coordinates to new ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..arrays import Bools, Floats, Ints
from ..points import barycentric, interpolate
from .document import Document
from .looks import SLOTS, Baked, Look, TextureUse, gltf_looks, linear_light, plain_looks, shown
from .mesh import Corners
from .picture import Picture, read_picture
from .scene import Scene
from .sources import CutSource, GltfSource
from .tangents import corner_tangents, frames, in_frame, unit

__all__ = ["has_textures", "looks_of", "rebake"]

# Samples along the side of a texel.
_SAMPLES = 2
# Rows of samples that are worked on at once, in samples: some 100 MB with all that is made of them.
_BAND = 1 << 19
# Bytes a texel: faces and counts of the samples, the nearest texel, sums and pictures.
_BYTES_PER_TEXEL = 5 * _SAMPLES**2 + 8 + 8 + 20 * 5
# Slots that hold colours as they are shown.
_COLOURS = ("base", "emissive")
_FLAT = (0.5, 0.5, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class _Faces:
    """All faces of a file, in the winding of the file.

    Attributes
    ----------
    uv : (m, 3, 2) array
        New texture coordinates, v up.
    material : (m,) array of int
    old : list of (m, 3, 2) array
        Old sets of texture coordinates; NaN where there are none.
    colours : (m, 3, 4) array
        Linear.
    points, normals : (m, 3, 3) array
    tangents : (m, 3, 4) array
        Those of the file; NaN where there are none.
    """

    uv: Floats
    material: Ints
    old: list[Floats]
    colours: Floats
    points: Floats
    normals: Floats
    tangents: Floats

    def of(self, faces: Ints) -> _Faces:
        """Some of them."""
        return _Faces(
            self.uv[faces],
            self.material[faces],
            [uv[faces] for uv in self.old],
            self.colours[faces],
            self.points[faces],
            self.normals[faces],
            self.tangents[faces],
        )


def rebake(
    document: Document,
    scene: Scene,
    uvs: Sequence[Floats],
    *,
    resolution: int = 1024,
    faces: Ints | None = None,
) -> Baked:
    """Bake the textures of a file in new texture coordinates of its corners.

    Base colours are the texture times the factor times the colours of the vertices. Normal maps
    are turned from the old tangent frames to the new ones. Occlusion, metallic roughness and
    emission are those of the textures alone. Each texel is the mean of the samples in it that a
    face covers; the others copy the nearest one.

    Parameters
    ----------
    document : Document
    scene : Scene
        Of its meshes.
    uvs : sequence of (c, 2) array
        For each mesh the new coordinates at its corners, v up.
    resolution : int, default 1024
        Side of the pictures in texels.
    faces : (k,) array of int, optional
        Faces of the scene on the page to bake; by default all.

    Returns
    -------
    Baked

    Raises
    ------
    MemoryError
        If it would take more memory than there is.
    """
    if resolution * _SAMPLES > _core.MAX_RESOLUTION or (
        resolution**2 * _BYTES_PER_TEXEL > _core.available_memory()
    ):
        raise MemoryError(f"resolution: {resolution} takes more memory than there is to rebake")
    looks, linear = looks_of(document)
    drawn = _faces(document, scene, uvs, linear=linear)
    if faces is not None:
        drawn = drawn.of(faces)
    side = resolution * _SAMPLES
    cover, _ = _core.rasterize(np.ascontiguousarray(drawn.uv), side)
    cover = cover.reshape(side, side)
    notes: list[str] = []
    pictures: dict[tuple[str, int], tuple[TextureUse, Picture]] = {}
    for number in np.unique(drawn.material[drawn.material >= 0]).tolist():
        for slot, use in looks[number].textures.items():
            picture = _readable(drawn, number, slot, use, side, notes)
            if picture is not None:
                pictures[slot, number] = use, picture
    images, materials = {}, {}
    nearest: tuple[Ints, Ints] | None = None
    for slot in SLOTS:
        numbers = frozenset(number for found, number in pictures if found == slot)
        if slot != "base" and not numbers:
            continue
        mine = {number: pictures[slot, number] for number in numbers}
        values, painted = _painted(cover, resolution, _sampler(slot, drawn, looks, mine), drawn.uv)
        if nearest is None:
            nearest = _nearest(painted)
        if slot in _COLOURS:
            values[..., :3] = shown(values[..., :3])
        image = np.rint(255 * np.clip(values, 0.0, 1.0)).astype(np.uint8)[nearest]
        images[slot] = image if slot == "base" and image[..., 3].min() < 255 else image[..., :3]
        materials[slot] = numbers
    return Baked(
        {slot: np.ascontiguousarray(image) for slot, image in images.items()},
        materials,
        tuple(dict.fromkeys(notes)),
    )


def has_textures(document: Document) -> bool:
    """Whether a file has pictures or colours of its own."""
    looks, _ = looks_of(document)
    bases = [look.textures["base"] for look in looks if "base" in look.textures]
    return any(use.data is not None for use in bases) or any(
        mesh.vertex_colours for mesh in document.meshes
    )


def looks_of(document: Document) -> tuple[Sequence[Look], bool]:
    """Looks of the materials of a file, and whether its vertex colours are linear."""
    source = document.source.source if isinstance(document.source, CutSource) else document.source
    if isinstance(source, GltfSource):
        return gltf_looks(source.gltf), True
    return plain_looks(document.materials), False


def _faces(document: Document, scene: Scene, uvs: Sequence[Floats], *, linear: bool) -> _Faces:
    """Gather what all faces carry."""
    carried = [document.corners(k) for k in range(len(document.meshes))]
    n_sets = max((len(extra.uvs) for extra in carried), default=0)
    columns: list[list[Floats]] = [[] for _ in range(6 + n_sets)]
    for mesh, placed, extra, uv in zip(document.meshes, scene.meshes, carried, uvs, strict=True):
        repaired = placed.repaired
        turn = np.where(repaired.flipped[:, None], [0, 2, 1], [0, 1, 2])
        corner = np.take_along_axis(repaired.corner, turn, axis=1)
        points = mesh.positions[mesh.corners[corner]]
        lacking = np.full((len(mesh.corners), 2), np.nan)
        sets = [*extra.uvs, *[lacking] * (n_sets - len(extra.uvs))]
        tangents = extra.tangents
        if tangents is None:
            tangents = np.full((len(mesh.corners), 4), np.nan)
        found = [
            # As the file will hold them.
            uv[corner].astype(np.float32).astype(np.float64),
            mesh.material_of[repaired.polygon],
            _colours(extra, len(mesh.corners), linear)[corner],
            points,
            _normals(points, extra.normals, corner),
            tangents[corner],
            *(old[corner] for old in sets),
        ]
        for column, values in zip(columns, found, strict=True):
            column.append(values)
    uv, material, colours, points, normals, tangents, *old = (np.concatenate(c) for c in columns)
    return _Faces(uv, material.astype(np.int64), old, colours, points, normals, tangents)


def _colours(extra: Corners, count: int, linear: bool) -> Floats:
    if extra.colours is None:
        return np.ones((count, 4))
    if linear:
        return extra.colours
    return np.column_stack([linear_light(extra.colours[:, :3]), extra.colours[:, 3]])


def _normals(points: Floats, given: Floats | None, corner: Ints) -> Floats:
    """Normals at corners, those of the faces where the file has none."""
    flat = unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
    normals = np.repeat(flat[:, None], 3, axis=1)
    if given is None:
        return normals
    own = unit(given[corner])
    usable = np.isfinite(own).all(axis=2, keepdims=True) & (np.abs(own).max(axis=2) > 0)[..., None]
    return np.where(usable, own, normals)


def _readable(
    faces: _Faces, number: int, slot: str, use: TextureUse, side: int, notes: list[str]
) -> Picture | None:
    """The picture of a texture, made small where samples are coarse; None with a note."""
    if use.data is None:
        notes.append(f"the texture {use.name} is missing and was not baked")
        return None
    mine = faces.material == number
    old = faces.old[use.uv_set][mine] if use.uv_set < len(faces.old) else None
    if old is None or np.isnan(old).any():
        notes.append(f"the texture {use.name} has no texture coordinates and was not baked")
        return None
    picture = read_picture(use.data, linear_light if slot in _COLOURS else None)
    if picture is None:
        notes.append(f"the texture {use.name} cannot be read and was not baked")
        return None
    height, width = picture.pixels.shape[:2]
    texels = _area(old) * abs(np.linalg.det(use.matrix[:, :2])) * width * height
    samples = _area(faces.uv[mine]) * side**2
    return picture.reduced(float(np.sqrt(texels / samples)) if samples > 0 else 1.0)


def _area(uv: Floats) -> float:
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return float(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())


def _sampler(
    slot: str,
    faces: _Faces,
    looks: Sequence[Look],
    pictures: dict[int, tuple[TextureUse, Picture]],
) -> Callable[[Ints, Floats], Floats]:
    """A function from faces and barycentric coordinates of samples to values of a slot, (k, 4)."""
    neutral = _FLAT if slot == "normal" else (1.0, 1.0, 1.0, 1.0)
    if slot == "normal":
        new = corner_tangents(faces.points, faces.normals, faces.uv)
        old = {number: _tangents(faces, number, use) for number, (use, _) in pictures.items()}

    def sample(face: Ints, weights: Floats) -> Floats:
        values = np.empty((len(face), 4))
        values[:] = neutral
        material = faces.material[face]
        for number in np.unique(material).tolist():
            at = np.flatnonzero(material == number)
            f, w = face[at], weights[at]
            if number in pictures:
                use, picture = pictures[number]
                uv = interpolate(faces.old[use.uv_set][f], w) * [1.0, -1.0] + [0.0, 1.0]
                values[at] = picture.sample(uv @ use.matrix[:, :2].T + use.matrix[:, 2], use.wrap)
                if slot == "normal":
                    slopes = (2 * values[at, :3] - 1) * [use.scale, use.scale, 1.0]
                    t, b, n = frames(old[number], faces.normals, f, w)
                    x, y, z = slopes.T[:, :, None]
                    turned = in_frame(unit(x * t + y * b + z * n), frames(new, faces.normals, f, w))
                    values[at, :3] = unit(turned) * 0.5 + 0.5
            if slot == "base":
                if number >= 0:
                    values[at, :3] *= looks[number].colour[:3]
                values[at] *= interpolate(faces.colours[f], w)
        return values

    return sample


def _tangents(faces: _Faces, number: int, use: TextureUse) -> Floats:
    """Tangents that a material's normal map refers to, at the corners of all faces."""
    uv = np.nan_to_num(faces.old[use.uv_set])
    made = corner_tangents(faces.points, faces.normals, uv)
    given = np.isfinite(faces.tangents).all(axis=2, keepdims=True)
    return np.where(given, faces.tangents, made)


def _painted(
    cover: NDArray[np.int32],
    resolution: int,
    sample: Callable[[Ints, Floats], Floats],
    corners: Floats,
) -> tuple[NDArray[Any], Bools]:
    """Means of the samples of each texel, (r, r, 4), and which texels have some."""
    values: NDArray[Any] = np.zeros((resolution, resolution, 4), dtype=np.float32)
    painted = np.zeros((resolution, resolution), dtype=np.bool_)
    for first, last in _bands(resolution):
        rows, columns = np.nonzero(cover[first * _SAMPLES : last * _SAMPLES] >= 0)
        face = cover[first * _SAMPLES + rows, columns].astype(np.int64)
        side = resolution * _SAMPLES
        places = np.stack(
            [(columns + 0.5) / side, 1 - (first * _SAMPLES + rows + 0.5) / side], axis=1
        )
        found = sample(face, barycentric(corners[face], places))
        texel = rows // _SAMPLES * resolution + columns // _SAMPLES
        count = np.bincount(texel, minlength=(last - first) * resolution)
        for channel in range(4):
            sums = np.bincount(texel, found[:, channel], len(count))
            values[first:last, :, channel] = (sums / np.maximum(count, 1)).reshape(last - first, -1)
        painted[first:last] = count.reshape(last - first, -1) > 0
    return values, painted


def _bands(resolution: int) -> Iterator[tuple[int, int]]:
    step = max(_BAND // (resolution * _SAMPLES**2), 1)
    for first in range(0, resolution, step):
        yield first, min(first + step, resolution)


def _nearest(painted: Bools) -> tuple[Ints, Ints]:
    """Row and column of the nearest painted texel of each texel."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~painted, return_distances=False, return_indices=True)
    return rows, columns
