"""What must hold of texture coordinates before they are written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .. import quality
from ..arrays import Floats
from ..tiles import tile_offsets

if TYPE_CHECKING:
    from ..atlas import Atlas
    from .scene import Scene

__all__ = ["check_layout"]


def check_layout(
    scene: Scene, uvs: Sequence[Floats], atlas: Atlas, *, even: bool, udim: bool = False
) -> None:
    """Refuse texture coordinates that a file must not hold.

    Every corner has coordinates in [0, 1]. In single precision, which files have, no face of the
    scene is turned over; those that are too thin for it are exempt. No texel of a page is covered
    twice.

    Parameters
    ----------
    scene : Scene
        The repaired meshes. Second copies of faces share the place of the first.
    uvs : sequence of (c, 2) array
        What is to be written at the corners of each mesh, on its page.
    atlas : Atlas
        Of the scene, where they come from.
    even : bool
        Whether it is an error, and not a warning, that more than 2 % of the area has less than a
        tenth of the mean texel density.
    udim : bool, default False
        Whether pages are written in their UDIM tiles, where numbers have fewer digits.

    Raises
    ------
    ValueError
        With a sentence that says what is wrong.

    Warns
    -----
    QualityWarning
        Of the density, where that is no error.
    """
    from ..atlas.metrics import turned_over

    flat = np.concatenate([*uvs, np.zeros((0, 2))])
    outside = ~((flat >= 0) & (flat <= 1)).all(axis=1)
    if outside.any():
        raise ValueError(f"{np.count_nonzero(outside)} corners have no place in the unit square")
    written = np.concatenate(
        [
            uv[mesh.repaired.corner].reshape(-1, 3, 2)
            for uv, mesh in zip(uvs, scene.meshes, strict=True)
        ]
    )
    torn = (written != atlas.uv).any(axis=(1, 2))
    if torn.any():
        raise ValueError(
            f"{np.count_nonzero(torn)} triangles lie in another chart than their polygon"
        )
    offsets = tile_offsets(atlas.face_pages)[:, None] if udim else np.zeros(2)
    single = (written + offsets).astype(np.float32).astype(np.float64)
    # What is stacked is turned over on purpose.
    single[atlas.stacked, :, 0] *= -1.0
    if flips := turned_over(single, largest=1.0 + float(offsets.max())):
        raise ValueError(f"flips: {flips} faces are turned over in the plane")
    found = atlas.diagnostics
    if fatal := found.fatal():
        raise ValueError(fatal[0])
    for sentence in found.sentences():
        if even:
            raise ValueError(sentence)
        quality.warn(sentence)
