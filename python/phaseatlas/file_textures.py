"""The textures of a file with an atlas: baked, rebaked, on one page, several or UDIM tiles."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .arrays import Bytes, Floats
from .atlas import Atlas
from .atlas.bake import load_image
from .scene.document import Document
from .scene.looks import Baked
from .scene.mesh import Contents
from .scene.paged import Pages
from .scene.rebake import rebake
from .scene.scene import Scene

__all__ = ["CHECKER", "Look", "notes_of", "read_texture", "textures_of", "with_textures"]

# What is given as a texture to have the checker of the library.
CHECKER = "checker"

Look = str | PathLike[str] | None


def read_texture(texture: Look) -> Bytes | None:
    """Read the image of a texture; None for the checker and for none."""
    if texture is None or str(texture) == CHECKER:
        return None
    try:
        return load_image(texture)
    except MemoryError:
        raise
    except Exception as error:
        # Each format fails in its own way; a file that cannot be opened says so itself.
        if isinstance(error, OSError) and error.filename is not None:
            raise
        raise ValueError(f"{texture}: cannot be read as an image: {error}") from error


def with_textures(
    document: Document,
    scene: Scene,
    atlas: Atlas,
    output: Path,
    *,
    texture: Look,
    picture: Bytes | None,
    rebaked: bool,
    udim: bool,
    uv_set: int | None,
) -> tuple[Contents, list[str]]:
    """Return a file with the places of an atlas and the textures that are asked for.

    Parameters
    ----------
    document, scene : Document, Scene
        The file and its repaired meshes, which the atlas is of.
    atlas : Atlas
    output : Path
        Where it is to be written.
    texture, picture : str or PathLike, (h, w, 3) array of uint8
        A texture to bake, if it is not None, and what `read_texture` made of it.
    rebaked : bool
        Whether to bake the file's own textures.
    udim : bool
        Whether several pages are UDIM tiles, and not textures with materials of their own.
    uv_set : int, optional
        As in `Document.with_uv`.

    Returns
    -------
    Contents
        To be written.
    list of str
        Sentences about textures that could not be baked.
    """
    images, baked = textures_of(
        document, scene, atlas, texture=texture, picture=picture, rebaked=rebaked
    )
    shown: dict[str, Any] = {"image": images[0] if images and not baked else None}
    shown["baked"] = baked[0] if baked else None
    if udim:
        tiles = [each.images for each in baked] or [{"base": image} for image in images]
        shown |= {"image": None, "tiles": tiles or None}
    elif atlas.n_pages > 1:
        of = tuple(np.maximum(each, 0) for each in scene.polygon_values(atlas.face_pages))
        shown = {"pages": Pages(of, tuple(images), tuple(baked))}
    corners = scene.corners(atlas.udim if udim else atlas.uv)
    contents = document.with_uv(output, corners, uv_set=uv_set, **shown)
    return contents, notes_of(baked)


def textures_of(
    document: Document,
    scene: Scene,
    atlas: Atlas,
    *,
    texture: Look,
    picture: Bytes | None,
    rebaked: bool,
) -> tuple[list[Bytes], list[Baked]]:
    """Base colour of each page, if any is asked for, and what was rebaked; see `with_textures`."""
    if rebaked:
        baked = _rebaked(document, scene, atlas, scene.corners(atlas.uv))
        return [each.images["base"] for each in baked], baked
    if texture is not None:
        return [atlas.bake(picture, page=page) for page in range(atlas.n_pages)], []
    return [], []


def notes_of(baked: Sequence[Baked]) -> list[str]:
    """Sentences about textures that could not be baked, each once."""
    return list(dict.fromkeys(note for each in baked for note in each.notes))


def _rebaked(
    document: Document, scene: Scene, atlas: Atlas, corners: Sequence[Floats]
) -> list[Baked]:
    """The file's own textures on each page."""
    side, own = atlas.resolution, ~atlas.stacked
    if atlas.n_pages == 1 and own.all():
        return [rebake(document, scene, corners, resolution=side)]
    pages = atlas.face_pages
    return [
        rebake(
            document, scene, corners, resolution=side, faces=np.flatnonzero(own & (pages == page))
        )
        for page in range(atlas.n_pages)
    ]
