"""New texture coordinates in a glTF document; all else of its JSON stays as it is.

The JSON is edited as it was read, and not through a library's classes: those know the properties of
the specification, set their defaults, and drop what they do not know.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..arrays import Bytes, Floats, Ints
from .accessors import Gltf, Json, Rows, resource, rows
from .gltf_meshes import Triangles, uv_names
from .gltf_pictures import drop_pictures
from .gltf_slots import NewAccessor, NewView, indices, settle
from .looks import SLOTS, Baked
from .mesh import Cut
from .paged import Pages, Part, split_primitives
from .picture import kind_of, png
from .polygons import split_corners, split_vertices

__all__ = ["with_uv"]

# The material of what has none: glTF takes a missing metallicFactor for 1, dark metal.
_PLAIN = {
    "name": "atlas",
    "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
}


def with_uv(
    gltf: Gltf,
    groups: tuple[tuple[Triangles, ...], ...],
    uvs: list[Floats],
    *,
    image: Bytes | None = None,
    uv_set: int | None = None,
    embed: bool = False,
    cuts: Sequence[Cut] | None = None,
    baked: Baked | None = None,
    pages: Pages | None = None,
) -> tuple[Json, bytes]:
    """Write texture coordinates of the corners into a document.

    Vertices on seams are repeated with all their attributes and morph targets. Primitives without
    seams keep their accessors.

    Parameters
    ----------
    gltf : Gltf
        What was read; it stays as it is.
    groups : tuple of tuple of Triangles
        Primitives of each mesh.
    uvs : list of (c, 2) array
        For each mesh, v up.
    image : (h, w, 3) array of uint8, optional
        Base colour of all materials of the meshes, seen through the new coordinates; their factor
        becomes 1. Other textures stay, and so do colours of vertices, which multiply it.
    uv_set : int, optional
        Set to write. By default the new coordinates become set 0, and the old sets and what uses
        them move up by one.
    embed : bool, default False
        Take images that are files of their own into the buffer; one that is missing keeps its URI.
    cuts : sequence of Cut, optional
        New triangles of each mesh, whose corners `uvs` are at. Attributes are interpolated; joints
        and their weights are those of the nearest vertex.
    baked : Baked, optional
        Pictures in place of the textures of the materials, and of the colours of vertices, which
        become the attribute `_COLOR_0`. Tangents of the old coordinates go with their normal maps.
    pages : Pages, optional
        Several textures, instead of an image: primitives are split by page.

    Returns
    -------
    json : dict
        The document with one buffer, without URI.
    buffer : bytes
        Its content.
    """
    document = copy.deepcopy(gltf.json)
    if uv_set is None:
        _make_room(document)
    else:
        _check_set(document, groups, uv_set)
    at = 0 if uv_set is None else uv_set
    shared = _shared_positions(document)
    parts: list[Part] = []
    for number, (group, uv) in enumerate(zip(groups, uvs, strict=True)):
        single = (uv * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32)
        start = 0
        for part in group:
            primitive = document["meshes"][part.mesh]["primitives"][part.primitive]
            end = start + len(part.corners)
            mine = slice(start, end)
            if cuts is None:
                written = _write(gltf, primitive, part.corners, single[mine], at, shared)
            else:
                cut = cuts[number]
                mine = slice(*np.searchsorted(cut.corners[:, 0], [start, end]))
                points = part.corners[cut.corners[mine] - start], cut.weights[mine]
                written = _write_cut(gltf, primitive, *points, single[mine], at)
            if pages is not None and len(written):
                of = pages.of[number][mine.start // 3 : mine.stop // 3]
                parts.append(Part(part.mesh, part.primitive, written, of))
            start = end
    if pages is not None:
        _drop_what_is_baked(document, groups, pages.baked)
        numbers = split_primitives(document, parts, pages, at, _PLAIN)
        for page, of_page in enumerate(pages.baked):
            _replace_textures(
                document, of_page, at, {a: b for (a, k), b in numbers.items() if k == page}
            )
    if baked is not None:
        image = baked.images["base"]
    if image is not None:
        _paint(document, groups, png(image), at)
    if baked is not None:
        _drop_what_is_baked(document, groups, [baked])
        _replace_textures(document, baked, at, {})
        drop_pictures(gltf.json, document)
    if embed:
        _embed(gltf, document)
    return settle(gltf, document)


def _embed(gltf: Gltf, document: Json) -> None:
    for entry in document.get("images", []):
        uri = entry.get("uri", "data:")
        data = None if uri.startswith("data:") else resource(gltf.folder, uri)
        if data is not None:
            kind = kind_of(data)
            entry.setdefault("name", Path(unquote(uri)).stem)
            entry.setdefault("mimeType", f"image/{'jpeg' if kind == 'jpg' else kind or 'png'}")
            entry["bufferView"] = NewView(data)
            del entry["uri"]


def _make_room(document: Json) -> None:
    """Move all sets of texture coordinates up by one, and all that name them."""
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            attributes = primitive["attributes"]
            targets = primitive.get("targets", [])
            for holder in (attributes, *targets):
                sets = [int(name[9:]) for name in holder if name.startswith("TEXCOORD_")]
                for k in sorted(sets, reverse=True):
                    holder[f"TEXCOORD_{k + 1}"] = holder.pop(f"TEXCOORD_{k}")
            if "TEXCOORD_1" in attributes:
                # Points and lines have no new ones, and sets follow each other from 0.
                attributes["TEXCOORD_0"] = attributes["TEXCOORD_1"]
            _shift(primitive.get("extensions", {}))
    for material in document.get("materials", []):
        _shift({key: value for key, value in material.items() if key != "extras"})


def _shift(value: Any) -> None:
    """Raise `texCoord` of all texture references in a material or an extension."""
    if isinstance(value, list):
        for member in value:
            _shift(member)
    if not isinstance(value, dict):
        return
    for key, member in value.items():
        if key.lower().endswith("texture") and isinstance(member, dict) and "index" in member:
            member["texCoord"] = member.get("texCoord", 0) + 1
            transform = member.get("extensions", {}).get("KHR_texture_transform", {})
            if "texCoord" in transform:
                transform["texCoord"] += 1
        elif key != "extras":
            _shift(member)


def _check_set(document: Json, groups: tuple[tuple[Triangles, ...], ...], uv_set: int) -> None:
    for group in groups:
        for part in group:
            mesh = document["meshes"][part.mesh]
            sets = len(uv_names(mesh["primitives"][part.primitive]))
            if not 0 <= uv_set <= sets:
                raise ValueError(
                    f"uv_set: {uv_set} must be in [0, {sets}]: sets follow each other, and mesh "
                    f"{mesh.get('name', part.mesh)!r} has {sets}"
                )


def _shared_positions(document: Json) -> set[int]:
    """Accessors of positions of several primitives."""
    seen: set[int] = set()
    shared: set[int] = set()
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            accessor = primitive["attributes"].get("POSITION")
            (shared if accessor in seen else seen).add(accessor)
    return shared


def _write(
    gltf: Gltf, primitive: Json, corners: Ints, uv: Rows, uv_set: int, shared: set[int]
) -> Ints:
    """Give a primitive its coordinates, and vertices of its own if it has seams.

    Returns the vertices of its triangles.
    """
    attributes = primitive["attributes"]
    position = attributes["POSITION"]
    count = gltf.json["accessors"][position]["count"]
    origin, new, values = split_vertices(count, corners, uv)
    if len(origin) > count:
        if position in shared:
            # Vertices of other primitives would be repeated with each of them.
            used = np.unique(new)
            origin, values, new = origin[used], values[used], np.searchsorted(used, new)
        made: dict[int, NewAccessor] = {}
        for holder in (attributes, *primitive.get("targets", [])):
            for name, accessor in holder.items():
                if accessor not in made:
                    made[accessor] = _repeated(gltf, accessor, origin)
                holder[name] = made[accessor]
        primitive["indices"] = indices(new)
        if primitive.get("mode", 4) != 4:
            primitive["mode"] = 4
    # The attributes keep the order of the file.
    attributes[f"TEXCOORD_{uv_set}"] = NewAccessor(
        {"componentType": 5126, "type": "VEC2"}, values.astype("<f4"), "vertices"
    )
    return new


def _write_cut(
    gltf: Gltf, primitive: Json, vertices: Ints, weights: Floats, uv: Rows, uv_set: int
) -> Ints:
    """Give a primitive new triangles, whose corners lie between three of its vertices each.

    Returns the vertices of its triangles.
    """
    if not len(vertices):
        return np.zeros(0, dtype=np.int64)
    vertices = np.where(weights > 0, vertices, -1)
    order = np.argsort(vertices, axis=1)
    vertices = np.take_along_axis(vertices, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    first, new, _ = split_corners(
        vertices[:, 2], vertices[:, :2].astype(np.float64), weights, uv.astype(np.float32)
    )
    vertices, weights = vertices[first], weights[first]
    nearest = np.take_along_axis(vertices, weights.argmax(axis=1)[:, None], axis=1)[:, 0]
    made: dict[int, NewAccessor] = {}
    for holder in (primitive["attributes"], *primitive.get("targets", [])):
        for name, accessor in holder.items():
            if accessor not in made:
                if name.startswith(("JOINTS", "WEIGHTS", "_")):
                    made[accessor] = _repeated(gltf, accessor, nearest)
                else:
                    values = _interpolated(rows(gltf, accessor), vertices, weights, nearest)
                    if holder is primitive["attributes"] and name in ("NORMAL", "TANGENT"):
                        values = _renormalised(values)
                    made[accessor] = _accessor(gltf, accessor, values)
            holder[name] = made[accessor]
    primitive["indices"] = indices(new)
    primitive["mode"] = 4
    primitive["attributes"][f"TEXCOORD_{uv_set}"] = NewAccessor(
        {"componentType": 5126, "type": "VEC2"}, uv[first].astype("<f4"), "vertices"
    )
    return new


def _interpolated(values: Rows, vertices: Ints, weights: Floats, nearest: Ints) -> Rows:
    """Means of rows, in their own type; those at vertices are copies."""
    mean = np.einsum("kcd,kc->kd", values[vertices].astype(np.float64), weights)
    found: Rows = (np.rint(mean) if values.dtype.kind in "iu" else mean).astype(values.dtype)
    exact = weights.max(axis=1) == 1
    found[exact] = values[nearest[exact]]
    if values.shape[1] == 4 and values.dtype.kind == "f":
        # The fourth of a tangent is a sign.
        signs = np.abs(values[:, 3]) == 1
        found[:, 3] = np.where(signs[nearest], values[nearest, 3], found[:, 3])
    return found


def _renormalised(values: Rows) -> Rows:
    if values.dtype.kind != "f":
        return values
    length = np.linalg.norm(values[:, :3], axis=1, keepdims=True)
    values[:, :3] = np.divide(values[:, :3], length, out=values[:, :3].copy(), where=length > 0)
    return values


def _repeated(gltf: Gltf, accessor: int, origin: Ints) -> NewAccessor:
    old = gltf.json["accessors"][accessor]
    if "bufferView" not in old and "sparse" not in old:
        # All of it is 0.
        entry = {key: value for key, value in old.items() if key not in ("byteOffset", "count")}
        return NewAccessor({**entry, "count": len(origin)}, None, "vertices")
    return _accessor(gltf, accessor, rows(gltf, accessor)[origin])


def _accessor(gltf: Gltf, accessor: int, values: Rows) -> NewAccessor:
    """New values in place of an accessor's."""
    old = gltf.json["accessors"][accessor]
    entry = {
        key: value
        for key, value in old.items()
        if key not in ("bufferView", "byteOffset", "sparse", "count", "min", "max")
    }
    # A vertex that no face uses may be anything, but JSON has no word for it.
    known = values[np.isfinite(values).all(axis=1)]
    if ("min" in old or "max" in old) and len(known):
        entry |= {"min": known.min(axis=0).tolist(), "max": known.max(axis=0).tolist()}
    return NewAccessor(entry, values, "vertices")


def _paint(
    document: Json, groups: tuple[tuple[Triangles, ...], ...], data: bytes, uv_set: int
) -> None:
    """Make an image the base colour of all materials of the meshes."""
    images = document.setdefault("images", [])
    images.append({"name": "atlas", "mimeType": "image/png", "bufferView": NewView(data)})
    textures = document.setdefault("textures", [])
    textures.append({"source": len(images) - 1})
    reference = {"index": len(textures) - 1, "texCoord": uv_set}
    materials = document.setdefault("materials", [])
    for group in groups:
        for part in group:
            primitive = document["meshes"][part.mesh]["primitives"][part.primitive]
            if "material" not in primitive:
                primitive["material"] = _plain(materials)
            pbr = materials[primitive["material"]].setdefault("pbrMetallicRoughness", {})
            opacity = pbr.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])[3]
            pbr["baseColorFactor"] = [1.0, 1.0, 1.0, opacity]
            pbr["baseColorTexture"] = dict(reference)


def _replace_textures(
    document: Json, baked: Baked, uv_set: int, numbers: dict[int | None, int]
) -> None:
    """Make pictures the other textures of the materials.

    `numbers` has the places of those materials that are elsewhere now.
    """
    for slot, image in baked.images.items():
        if slot == "base":
            continue
        document["images"].append(
            {"name": f"atlas_{slot}", "mimeType": "image/png", "bufferView": NewView(png(image))}
        )
        document["textures"].append({"source": len(document["images"]) - 1})
        for number in baked.materials[slot]:
            holder = document["materials"][numbers.get(number, number)]
            *path, key = SLOTS[slot]
            for step in path:
                holder = holder[step]
            reference = holder[key]
            reference |= {"index": len(document["textures"]) - 1, "texCoord": uv_set}
            reference.get("extensions", {}).pop("KHR_texture_transform", None)
            if not reference.get("extensions", True):
                del reference["extensions"]
            if slot == "normal":
                reference.pop("scale", None)


def _drop_what_is_baked(
    document: Json, groups: tuple[tuple[Triangles, ...], ...], baked: Sequence[Baked]
) -> None:
    """Drop what went into pictures: colours of vertices, and tangents of the old coordinates."""
    if not baked:
        return
    turned = {number for each in baked for number in each.materials.get("normal", ())}
    for part in (part for group in groups for part in group):
        primitive = document["meshes"][part.mesh]["primitives"][part.primitive]
        for holder in (primitive["attributes"], *primitive.get("targets", [])):
            if "COLOR_0" in holder:
                holder["_COLOR_0"] = holder.pop("COLOR_0")
            if primitive.get("material") in turned:
                holder.pop("TANGENT", None)


def _plain(materials: list[Json]) -> int:
    """The material of what has none."""
    for k, material in enumerate(materials):
        if material.get("name") == "atlas" and "baseColorTexture" in material.get(
            "pbrMetallicRoughness", {}
        ):
            return k
    materials.append(copy.deepcopy(_PLAIN))
    return len(materials) - 1
