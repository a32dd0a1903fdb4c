"""Triangles, corners, transforms and materials of glTF documents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Ints
from .accessors import Gltf, Json, decoded, rows
from .looks import image_of
from .mesh import Corners, Material, Mesh

__all__ = ["Triangles", "corners_of", "materials_of", "meshes_of", "triangles_of", "uv_names"]

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True, eq=False)
class Triangles:
    """Corners of a primitive, by vertices of its own accessors, three a triangle."""

    mesh: int
    primitive: int
    corners: Ints


def triangles_of(gltf: Gltf) -> tuple[tuple[Triangles, ...], ...]:
    """Primitives of triangles, by meshes that have some; points and lines are left out."""
    meshes = []
    for i, mesh in enumerate(gltf.json.get("meshes", [])):
        found = [
            Triangles(i, j, corners)
            for j, primitive in enumerate(mesh.get("primitives", []))
            if len(corners := _corners(gltf, primitive))
        ]
        if found:
            meshes.append(tuple(found))
    return tuple(meshes)


def _corners(gltf: Gltf, primitive: Json) -> Ints:
    mode = primitive.get("mode", _TRIANGLES)
    position = primitive.get("attributes", {}).get("POSITION")
    if mode not in (_TRIANGLES, _STRIP, _FAN) or position is None:
        return np.zeros(0, dtype=np.int64)
    count = gltf.json["accessors"][position]["count"]
    if "indices" in primitive:
        listed = rows(gltf, primitive["indices"])[:, 0].astype(np.int64)
    else:
        listed = np.arange(count)
    for holder in (primitive["attributes"], *primitive.get("targets", [])):
        for name, accessor in holder.items():
            if len(rows(gltf, accessor)) != count:
                raise ValueError(f"{name} has other than the {count} values of POSITION")
    if len(listed) and listed.max() >= count:
        raise ValueError(f"a face names vertex {listed.max()} among {count}")
    if mode == _TRIANGLES:
        return listed[: len(listed) // 3 * 3]
    i = np.arange(max(len(listed) - 2, 0))
    if mode == _FAN:
        triangles = np.stack([i + 1, i + 2, 0 * i], axis=1)
    else:
        triangles = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    corners: Ints = listed[triangles].reshape(-1)
    return corners


def uv_names(primitive: Json) -> list[str]:
    """Names of its sets of texture coordinates, in their order."""
    attributes = primitive["attributes"]
    names: list[str] = []
    while (name := f"TEXCOORD_{len(names)}") in attributes:
        names.append(name)
    return names


def meshes_of(gltf: Gltf, groups: tuple[tuple[Triangles, ...], ...]) -> tuple[Mesh, ...]:
    """A mesh for all primitives of triangles of each glTF mesh."""
    transforms = _transforms(gltf)
    names = [material.get("name", "") for material in gltf.json.get("materials", [])]
    return tuple(_mesh(gltf, group, transforms, names) for group in groups)


def _mesh(
    gltf: Gltf, group: tuple[Triangles, ...], transforms: dict[int, Floats], names: list[str]
) -> Mesh:
    entry = gltf.json["meshes"][group[0].mesh]
    offsets: dict[int, int] = {}
    positions, corners, materials = [], [], []
    uv_sets, colours, n = 0, False, 0
    for part in group:
        primitive = entry["primitives"][part.primitive]
        accessor = primitive["attributes"]["POSITION"]
        if accessor not in offsets:
            offsets[accessor] = n
            positions.append(decoded(gltf, accessor))
            n += len(positions[-1])
        corners.append(part.corners + offsets[accessor])
        materials.append(np.full(len(part.corners) // 3, primitive.get("material", -1)))
        uv_sets = max(uv_sets, len(uv_names(primitive)))
        colours |= "COLOR_0" in primitive["attributes"]
    material_of = np.concatenate(materials)
    used = np.unique(material_of[material_of >= 0])
    return Mesh(
        name=str(entry.get("name", "")),
        positions=np.concatenate(positions),
        corners=np.concatenate(corners),
        sizes=np.full(len(material_of), 3),
        transforms=transforms.get(group[0].mesh, np.eye(4)[None]),
        material_of=material_of,
        materials=tuple(names[k] for k in used),
        uv_sets=uv_sets,
        vertex_colours=colours,
    )


def _transforms(gltf: Gltf) -> dict[int, Floats]:
    """World matrices of the instances of each mesh."""
    nodes = gltf.json.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    world: dict[int, Floats] = {}
    pending = [(k, np.eye(4)) for k in range(len(nodes)) if k not in children]
    while pending:
        k, parent = pending.pop()
        if k in world:
            continue
        world[k] = parent @ _matrix(nodes[k])
        pending += [(child, world[k]) for child in nodes[k].get("children", [])]
    found: dict[int, list[Floats]] = {}
    for k, node in enumerate(nodes):
        if "mesh" in node and k in world:
            posed = _posed(gltf, node, world, world[k])
            copies = [posed @ matrix for matrix in _copies(gltf, node)]
            found.setdefault(node["mesh"], []).extend(copies)
    return {mesh: np.stack(matrices) for mesh, matrices in found.items()}


def _posed(gltf: Gltf, node: Json, world: dict[int, Floats], own: Floats) -> Floats:
    """World matrix of an instance; a skin follows its joints, not its node."""
    if "skin" not in node:
        return own
    skin = gltf.json["skins"][node["skin"]]
    joint: Floats = world[skin["joints"][0]]
    if "inverseBindMatrices" in skin:
        joint = joint @ decoded(gltf, skin["inverseBindMatrices"])[0].reshape(4, 4).T
    return joint


def _copies(gltf: Gltf, node: Json) -> list[Floats]:
    """Matrices of the copies that a node makes of its mesh; one of itself as a rule."""
    extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {})
    columns = {
        name.lower(): decoded(gltf, accessor)
        for name, accessor in extension.get("attributes", {}).items()
        if name in ("TRANSLATION", "ROTATION", "SCALE")
    }
    if not columns:
        return [np.eye(4)]
    count = min(len(values) for values in columns.values())
    return [_matrix({name: values[k] for name, values in columns.items()}) for k in range(count)]


def _matrix(node: Json) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def corners_of(gltf: Gltf, group: tuple[Triangles, ...]) -> Corners:
    """Texture coordinates, normals and colours at the corners of a mesh."""
    primitives = [gltf.json["meshes"][part.mesh]["primitives"][part.primitive] for part in group]
    sets = max(len(uv_names(primitive)) for primitive in primitives)

    def gather(name: str, width: int) -> Floats | None:
        if all(name not in primitive["attributes"] for primitive in primitives):
            return None
        parts = []
        for part, primitive in zip(group, primitives, strict=True):
            values = np.full((len(part.corners), width), np.nan)
            if name in primitive["attributes"]:
                found = decoded(gltf, primitive["attributes"][name])[part.corners]
                values[:, : found.shape[1]] = found[:, :width]
            parts.append(values)
        return np.concatenate(parts)

    uvs = []
    for k in range(sets):
        uv = gather(f"TEXCOORD_{k}", 2)
        if uv is not None:
            # v is down in glTF.
            uvs.append(uv * [1.0, -1.0] + [0.0, 1.0])
    colours = gather("COLOR_0", 4)
    return Corners(
        tuple(uvs),
        gather("NORMAL", 3),
        None if colours is None else np.where(np.isnan(colours), 1.0, colours),
        gather("TANGENT", 4),
    )


def materials_of(gltf: Gltf) -> tuple[Material, ...]:
    """What other formats can hold of the materials."""
    return tuple(_material(gltf, entry) for entry in gltf.json.get("materials", []))


def _material(gltf: Gltf, entry: Json) -> Material:
    pbr = entry.get("pbrMetallicRoughness", {})
    texture = pbr.get("baseColorTexture")
    textures = gltf.json.get("textures", [])
    colour = tuple(float(c) for c in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)))
    return Material(
        name=str(entry.get("name", "")),
        colour=(colour[0], colour[1], colour[2], colour[3]),
        texture=None if texture is None else image_of(gltf, textures[texture["index"]]),
        uv_set=0 if texture is None else texture.get("texCoord", 0),
        metallic=float(pbr.get("metallicFactor", 1.0)),
        roughness=float(pbr.get("roughnessFactor", 1.0)),
    )
