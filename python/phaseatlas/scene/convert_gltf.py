"""Meshes of other formats as glTF documents."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..arrays import Bytes, Floats, Ints
from .accessors import Gltf, Json, Rows
from .gltf import translation
from .gltf_slots import NewAccessor, NewView, attribute, indices, settle
from .mesh import Corners, Material, Mesh
from .picture import as_png_or_jpeg, kind_of, png
from .polygons import split_corners, triangulate

__all__ = ["as_gltf"]

# Corners whose face leans further from the mean of the faces around keep their face's normal: less
# than the 55 degrees of a cube's corner.
_CREASE = np.cos(np.radians(50.0))


def as_gltf(
    name: str,
    meshes: Sequence[Mesh],
    carried: Sequence[Corners],
    materials: Sequence[Material],
    uvs: Sequence[Floats],
    *,
    image: Bytes | None,
    uv_set: int,
) -> tuple[Json, bytes]:
    """Return a document with a node for each mesh.

    Positions are of single precision; where they lie far from the origin they are relative to a
    translation of the node. Polygons become triangles.

    Parameters
    ----------
    name : str
        Of what has none.
    meshes, carried
        The meshes and what their corners carry.
    materials : sequence of Material
    uvs : sequence of (c, 2) array
        New texture coordinates, v up.
    image : (h, w, 3) array of uint8, optional
        Base colour of all materials, seen through the new coordinates.
    uv_set : int
        Set of the new coordinates; the old ones are the other.

    Returns
    -------
    json : dict
    buffer : bytes
    """
    document: Json = {
        "asset": {"version": "2.0", "generator": "phaseatlas"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(meshes)))}],
        "nodes": [],
        "meshes": [],
    }
    n_sets = max((len(extra.uvs) for extra in carried), default=0)
    place = _write_materials(document, name, materials, image, uv_set)
    for index, (mesh, extra, uv) in enumerate(zip(meshes, carried, uvs, strict=True)):
        centre = translation(mesh.positions[mesh.corners])
        title = mesh.name or (name if len(meshes) == 1 else f"{name}_{index}")
        node: Json = {"name": title, "mesh": index}
        if centre.any():
            node["translation"] = centre.tolist()
        document["nodes"].append(node)
        # A material may be seen through a set that another mesh has.
        sets = [*extra.uvs, *[np.zeros((len(uv), 2))] * (n_sets - len(extra.uvs))]
        sets.insert(uv_set, uv)
        primitives = _primitives(mesh, centre, extra, sets)
        for primitive in primitives:
            primitive["material"] = place[primitive["material"]]
        document["meshes"].append({"name": title, "primitives": primitives})
    _drop_unused(document)
    return settle(Gltf({}, (), Path(), True), document)


def _primitives(mesh: Mesh, centre: Floats, extra: Corners, sets: Sequence[Floats]) -> list[Json]:
    triangles, polygon = triangulate(mesh.positions, mesh.corners, mesh.sizes)
    normals = _normals(mesh, triangles, polygon, extra.normals)
    columns = [np.nan_to_num(uv * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32) for uv in sets]
    columns.append(normals.astype(np.float32))
    if extra.colours is not None:
        columns.append(extra.colours.astype(np.float32))
    of = mesh.material_of[polygon]
    primitives = []
    for material in dict.fromkeys(of.tolist()):
        at = triangles[of == material].reshape(-1)
        values = [column[at] for column in columns]
        representative, new, _ = split_corners(mesh.corners[at], *values)
        kept = at[representative]
        positions = (mesh.positions[mesh.corners[kept]] - centre).astype("<f4")
        attributes = {
            "POSITION": attribute(
                "VEC3",
                positions,
                min=positions.min(axis=0).tolist(),
                max=positions.max(axis=0).tolist(),
            ),
            "NORMAL": attribute("VEC3", columns[len(sets)][kept]),
        }
        for k in range(len(sets)):
            attributes[f"TEXCOORD_{k}"] = attribute("VEC2", columns[k][kept])
        if extra.colours is not None:
            colours = np.rint(np.clip(extra.colours[kept], 0, 1) * 255).astype("u1")
            attributes["COLOR_0"] = NewAccessor(
                {"componentType": 5121, "type": "VEC4", "normalized": True}, colours, "vertices"
            )
        primitives.append({"attributes": attributes, "indices": indices(new), "material": material})
    return primitives


def _normals(mesh: Mesh, triangles: Ints, polygon: Ints, given: Floats | None) -> Floats:
    """Unit normals at the corners: those of the file, else smooth ones up to creases."""
    normals = np.full((len(mesh.corners), 3), np.nan) if given is None else given.copy()
    length = np.linalg.norm(normals, axis=1)
    missing = ~(np.isfinite(length) & (length > 0))
    normals[~missing] /= length[~missing, None]
    if not missing.any():
        return normals
    a, b, c = (mesh.positions[mesh.corners[triangles[:, k]]] for k in range(3))
    area = np.cross(b - a, c - a)
    faces = np.stack([np.bincount(polygon, x, len(mesh.sizes)) for x in area.T], axis=1)
    of = np.repeat(np.arange(len(mesh.sizes)), mesh.sizes)
    smooth: Rows = np.stack(
        [np.bincount(mesh.corners, x, len(mesh.positions)) for x in faces[of].T], axis=1
    )[mesh.corners]
    flat, smooth = _unit(faces)[of], _unit(smooth)
    leaning = np.einsum("ij,ij->i", flat, smooth) < _CREASE
    smooth[leaning] = flat[leaning]
    # A face of no area looks anywhere.
    smooth[np.linalg.norm(smooth, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    normals[missing] = smooth[missing]
    return normals


def _unit(vectors: Rows) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: Floats = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return unit


def _write_materials(
    document: Json, name: str, materials: Sequence[Material], image: Bytes | None, uv_set: int
) -> dict[int, int]:
    """Write all materials and a plain one for what has none; places by number of material."""
    entries: list[Json] = []
    images: list[Json] = []
    atlas = None
    if image is not None:
        images.append({"name": name, "mimeType": "image/png", "bufferView": NewView(png(image))})
        atlas = {"index": 0, "texCoord": uv_set}
    seen: dict[str, int] = {}
    for material in (*materials, Material(name)):
        pbr: Json = {
            "baseColorFactor": list(material.colour),
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        }
        if atlas is not None:
            pbr["baseColorFactor"] = [1.0, 1.0, 1.0, material.colour[3]]
            pbr["baseColorTexture"] = dict(atlas)
        elif material.texture is not None:
            picture = material.texture
            if picture.name not in seen and (data := as_png_or_jpeg(picture.data)) is not None:
                seen[picture.name] = len(images)
                kind = "jpeg" if kind_of(data) == "jpg" else "png"
                images.append(
                    {
                        "name": picture.name,
                        "mimeType": f"image/{kind}",
                        "bufferView": NewView(data),
                    }
                )
            if picture.name in seen:
                # The old coordinates moved out of the way of the new ones.
                old = material.uv_set
                at = uv_set if old is None else old + (old >= uv_set)
                pbr["baseColorTexture"] = {"index": seen[picture.name], "texCoord": at}
        entry: Json = {"name": material.name, "pbrMetallicRoughness": pbr}
        if material.colour[3] < 1:
            entry["alphaMode"] = "BLEND"
        entries.append(entry)
    document["materials"] = entries
    if images:
        document["images"] = images
        document["textures"] = [{"source": k} for k in range(len(images))]
    return {**{k: k for k in range(len(materials))}, -1: len(materials)}


def _drop_unused(document: Json) -> None:
    """Drop the plain material where all have another; it is the last."""
    used = {p["material"] for mesh in document["meshes"] for p in mesh["primitives"]}
    if len(document["materials"]) - 1 not in used:
        document["materials"].pop()
