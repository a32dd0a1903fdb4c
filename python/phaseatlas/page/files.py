"""Files as subjects of a page: meshes with the texture coordinates they have, segmentations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..atlas import Atlas
from ..atlas.metrics import atlas_metrics, uv_topology
from ..points import flat_areas
from ..saved_arrays import format_of
from ..scene.document import Document, read_document
from ..scene.looks import Look, linear_light
from ..scene.rebake import looks_of
from ..scene.scene import Scene, scene_in
from ..segmentation import SceneSegmentation, SegmentTree
from .subject import Picture, Subject, subject

__all__ = ["subject_of_file"]

# What wrote each format of `.npz` files.
_SAVED: dict[int, type[SegmentTree | SceneSegmentation | Atlas]] = {
    1: SegmentTree,
    2: SceneSegmentation,
    3: Atlas,
}


def subject_of_file(path: str | PathLike[str]) -> Subject:
    """Read what a page shows of a file.

    Parameters
    ----------
    path : str or PathLike
        A mesh, or the `.npz` file of segments or of an atlas.

    Raises
    ------
    ValueError
        For a file that is neither; the message starts with its name.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        kind = _SAVED[format_of(path)]
        return subject(kind.load(path))
    document = read_document(path)
    return _of_document(document, scene_in(document))


def _of_document(document: Document, scene: Scene) -> Subject:
    looks, linear = looks_of(document)
    columns: list[list[Any]] = [[], [], []]
    for number, (mesh, placed) in enumerate(zip(document.meshes, scene.meshes, strict=True)):
        extra, repaired = document.corners(number), placed.repaired
        material = np.full(len(repaired.faces), -1)
        if len(mesh.material_of):
            material = mesh.material_of[repaired.polygon]
        colours = np.ones((len(repaired.faces), 3, 3))
        if extra.colours is not None:
            colours = extra.colours[repaired.corner][..., :3]
            colours = colours if linear else linear_light(colours)
        uv = _coordinates(extra.uvs, looks, material, repaired.corner)
        for column, values in zip(columns, (uv, material, colours), strict=True):
            column.append(values)
    uv, material, colours = (np.concatenate(column) for column in columns)
    pictures = [_picture(look) for look in looks]
    # The last one is that of faces without a material.
    pictures.append(Picture())
    lacking: Bools = np.asarray(np.isnan(uv).any(axis=(1, 2)))
    uv = np.where(lacking[:, None, None], 0.0, uv)
    plain = subject(scene)
    dressed = replace(
        plain,
        pictures=tuple(pictures),
        material=np.where(material < 0, len(looks), material),
        colours=None if bool(np.all(colours == 1)) else colours,
    )
    if not np.abs(flat_areas(uv)).sum() > 0:
        return dressed
    topology = uv_topology(scene, uv)
    words = f"{int(lacking.sum())} faces have no texture coordinates." if lacking.any() else ""
    return replace(
        dressed,
        chart=topology.chart,
        count=topology.n_charts,
        noun="chart",
        uv=uv,
        resolution=max((picture.side for picture in pictures), default=0) or dressed.resolution,
        metrics={**plain.metrics, **atlas_metrics(scene, uv)},
        notes=(words,) if words else (),
    )


def _coordinates(
    sets: Sequence[Floats], looks: Sequence[Look], material: Ints, corner: Ints
) -> Floats:
    """Places in the pictures of the faces' materials, (m, 3, 2), v up; NaN where there are none."""
    uv = sets[0][corner] if sets else np.full((*corner.shape, 2), np.nan)
    for number in np.unique(material[material >= 0]).tolist():
        use = looks[number].textures.get("base")
        if use is None or use.uv_set >= len(sets):
            continue
        mine = material == number
        down = sets[use.uv_set][corner[mine]] * [1.0, -1.0] + [0.0, 1.0]
        placed = down @ use.matrix[:, :2].T + use.matrix[:, 2]
        uv[mine] = placed * [1.0, -1.0] + [0.0, 1.0]
    return uv


def _picture(look: Look) -> Picture:
    """The base colour of a material, with its texture."""
    red, green, blue = look.colour[:3]
    use = look.textures.get("base")
    if use is None or use.data is None:
        return Picture(colour=(red, green, blue))
    return Picture.read(use.data, (red, green, blue))
