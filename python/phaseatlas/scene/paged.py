"""Meshes whose polygons share several textures: a material for each page of each old one."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..arrays import Bytes, Ints
from ..tiles import tile_number
from .accessors import Json
from .gltf_slots import NewView, indices
from .looks import Baked
from .mesh import Contents, Image, Material, Mesh
from .picture import png

__all__ = ["Pages", "Part", "in_tiles", "paged", "split_primitives", "tile_name"]


@dataclass(frozen=True, eq=False)
class Pages:
    """Which of several textures each polygon is in.

    Attributes
    ----------
    of : tuple of (p,) array of int
        Page of each polygon, mesh by mesh.
    images : tuple of (h, w, 3) array of uint8
        Base colour of each page, first row on top; none where no texture is made.
    baked : tuple of Baked
        What `scene.rebake` made of the textures for each page, the base colour among them; none
        where they are not rebaked.
    """

    of: tuple[Ints, ...]
    images: tuple[Bytes, ...] = ()
    baked: tuple[Baked, ...] = ()

    @property
    def used(self) -> list[int]:
        """Pages that have a polygon."""
        return sorted({int(page) for of in self.of for page in np.unique(of)})

    def image(self, page: int) -> Bytes | None:
        """Base colour of a page."""
        return self.images[page] if self.images else None


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of a primitive with their new vertices.

    Attributes
    ----------
    mesh, primitive : int
        Place in the document.
    indices : (3 t,) array of int
    pages : (t,) array of int
    """

    mesh: int
    primitive: int
    indices: Ints
    pages: Ints


def tile_name(name: str, page: int) -> str:
    """The name of a page's own material or picture: with the number of its UDIM tile."""
    return f"{name}.{tile_number(page)}"


def split_primitives(
    document: Json, parts: Sequence[Part], pages: Pages, uv_set: int, plain: Json
) -> dict[tuple[int | None, int], int]:
    """Give each page of each primitive a primitive and a material of its own.

    The primitives share the vertices. Those of further pages follow all others of their mesh.

    Parameters
    ----------
    document : dict
        Its JSON, which is changed.
    parts : sequence of Part
    pages : Pages
    uv_set : int
        Set of texture coordinates that the images are seen through.
    plain : dict
        The material of what has none.

    Returns
    -------
    dict of (int or None, int) to int
        New material of each old one and each page.
    """
    images: dict[int, int] = {}
    if pages.images:
        for page in pages.used:
            document.setdefault("images", []).append(
                {
                    "name": tile_name("atlas", page),
                    "mimeType": "image/png",
                    "bufferView": NewView(png(pages.images[page])),
                }
            )
            textures = document.setdefault("textures", [])
            textures.append({"source": len(document["images"]) - 1})
            images[page] = len(textures) - 1
    materials = document.setdefault("materials", [])
    before = copy.deepcopy(materials)
    made: dict[tuple[int | None, int], int] = {}

    def material_of(old: int | None, page: int) -> int:
        if (old, page) not in made:
            entry = copy.deepcopy(plain if old is None else before[old])
            entry["name"] = tile_name(entry.get("name") or f"material_{old}", page)
            if page in images:
                pbr = entry.setdefault("pbrMetallicRoughness", {})
                opacity = pbr.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])[3]
                pbr["baseColorFactor"] = [1.0, 1.0, 1.0, opacity]
                pbr["baseColorTexture"] = {"index": images[page], "texCoord": uv_set}
            if old is not None and not any(key[0] == old for key in made):
                # Others that name the material find it where it was.
                made[old, page] = old
                materials[old] = entry
            else:
                made[old, page] = len(materials)
                materials.append(entry)
        return made[old, page]

    for part in parts:
        primitives = document["meshes"][part.mesh]["primitives"]
        whole = primitives[part.primitive]
        old = whole.get("material")
        present = np.unique(part.pages).tolist()
        if len(present) == 1:
            whole["material"] = material_of(old, present[0])
            continue
        triangles = part.indices.reshape(-1, 3)
        for k, page in enumerate(present):
            one = {
                **copy.copy(whole),
                "attributes": dict(whole["attributes"]),
                "indices": indices(triangles[part.pages == page]),
                "material": material_of(old, page),
                "mode": 4,
            }
            if "targets" in whole:
                one["targets"] = [dict(target) for target in whole["targets"]]
            if k == 0:
                primitives[part.primitive] = one
            else:
                primitives.append(one)
    return made


def paged(
    meshes: Sequence[Mesh], materials: Sequence[Material], pages: Pages, name: str
) -> tuple[list[Mesh], list[Material]]:
    """Meshes whose materials are those of their pages, and these, for files of another format.

    Parameters
    ----------
    meshes : sequence of Mesh
    materials : sequence of Material
    pages : Pages
    name : str
        Of the pictures, and of the material of what has none.
    """
    every = [Material(name), *materials]
    made: dict[tuple[int, int], int] = {}
    split = []
    for mesh, of in zip(meshes, pages.of, strict=True):
        numbers = mesh.material_of + 1 if len(mesh.material_of) else np.zeros_like(of)
        keys, place = np.unique(np.stack([numbers, of]), axis=1, return_inverse=True)
        for number, page in keys.T.tolist():
            made.setdefault((number, page), len(made))
        new = np.array([made[number, page] for number, page in keys.T.tolist()], dtype=np.int64)
        split.append(replace(mesh, material_of=new[place.reshape(-1)]))
    pictures = {
        page: Image(f"{tile_name(name, page)}.png", png(image))
        for page in pages.used
        if (image := pages.image(page)) is not None
    }
    found = []
    for number, page in made:
        old = every[number]
        title = tile_name(old.name or f"material_{number - 1}", page)
        if page in pictures:
            # Seen through the new texture coordinates.
            white = (1.0, 1.0, 1.0, old.colour[3])
            old = replace(old, colour=white, texture=pictures[page], uv_set=None)
        found.append(replace(old, name=title))
    return split, found


def in_tiles(
    contents: Contents, path: Path, stem: str, tiles: Sequence[Mapping[str, Bytes]]
) -> Contents:
    """Put a picture for each UDIM tile beside a file; what names one picture names them all.

    Parameters
    ----------
    contents : Contents
        Made with the picture of one tile, or of a format that names none.
    path : Path
        Of the file.
    stem : str
        Of the names of pictures.
    tiles : sequence of mapping of str to (h, w, 3) array of uint8
        Pictures of each tile by slot.
    """
    single, many = f"{stem}.png", f"{stem}.<UDIM>.png"
    files = {file: data for file, data in contents.files.items() if file.name != single}
    for file in [file for file in files if file.suffix in (".mtl", ".ply")]:
        # A PLY file names it once, in its header.
        times = 1 if file.suffix == ".ply" else -1
        files[file] = files[file].replace(f" {single}".encode(), f" {many}".encode(), times)
    names = {slot: stem if slot == "base" else f"{stem}_{slot}" for tile in tiles for slot in tile}
    pictures = {
        path.with_name(f"{tile_name(names[slot], page)}.png"): png(image)
        for page, tile in enumerate(tiles)
        for slot, image in tile.items()
    }
    return Contents({**pictures, **files}, contents.notes)
