"""What surfaces look like: the textures of materials, and how they are seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Bytes, Floats
from .accessors import Gltf, Json, resource, view_bytes
from .mesh import Image, Material

__all__ = [
    "SLOTS",
    "Baked",
    "Look",
    "TextureUse",
    "gltf_looks",
    "image_of",
    "linear_light",
    "plain_looks",
    "shown",
]

#: Textures of a glTF material: where they are in its JSON.
SLOTS: dict[str, tuple[str, ...]] = {
    "base": ("pbrMetallicRoughness", "baseColorTexture"),
    "metallic_roughness": ("pbrMetallicRoughness", "metallicRoughnessTexture"),
    "normal": ("normalTexture",),
    "occlusion": ("occlusionTexture",),
    "emissive": ("emissiveTexture",),
}
_WRAPS = {33071: "clamp", 33648: "mirror"}
# Formats of pictures that stand in an extension of the texture.
_OTHER_FORMATS = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds")


@dataclass(frozen=True, eq=False)
class TextureUse:
    """A picture as a material sees it.

    Attributes
    ----------
    name : str
        Of the picture.
    data : bytes or None
        The picture's file; None where it is missing.
    uv_set : int
        Set of texture coordinates.
    matrix : (2, 3) array
        From these, with v down, to places in the picture.
    wrap : tuple of str
        For u and v: "repeat", "mirror" or "clamp".
    scale : float
        Factor of the slopes of a normal map.
    """

    name: str
    data: bytes | None
    uv_set: int = 0
    matrix: Floats = field(default_factory=lambda: np.eye(2, 3))
    wrap: tuple[str, str] = ("repeat", "repeat")
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Look:
    """What a material looks like.

    Attributes
    ----------
    colour : tuple of float
        Factor of the base colour, linear, its opacity last.
    textures : mapping of str to TextureUse
        By slot; see `SLOTS`.
    """

    colour: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    textures: Mapping[str, TextureUse] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Baked:
    """Pictures in the new texture coordinates.

    Attributes
    ----------
    images : dict of str to (r, r, c) array of uint8
        By slot; the base colour is always there.
    materials : dict of str to frozenset of int
        Materials whose texture each picture takes the place of; the base colour is that of all.
    notes : tuple of str
        A sentence for each texture that could not be baked.
    """

    images: dict[str, Bytes]
    materials: dict[str, frozenset[int]]
    notes: tuple[str, ...] = ()


def gltf_looks(gltf: Gltf) -> tuple[Look, ...]:
    """Looks of all materials of a glTF document."""
    return tuple(_look(gltf, material) for material in gltf.json.get("materials", []))


def _look(gltf: Gltf, material: Json) -> Look:
    textures = {}
    for slot, path in SLOTS.items():
        reference: Any = material
        for key in path:
            reference = reference.get(key, {})
        if "index" in reference:
            textures[slot] = _use(gltf, reference)
    pbr = material.get("pbrMetallicRoughness", {})
    return Look(tuple(pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))), textures)


def _use(gltf: Gltf, reference: Json) -> TextureUse:
    texture = gltf.json["textures"][reference["index"]]
    found = image_of(gltf, texture)
    name = found.name if found else _picture_name(gltf, texture)
    transform = reference.get("extensions", {}).get("KHR_texture_transform", {})
    (u, v), (su, sv) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    # Counter-clockwise as seen, as the text of the extension, Khronos' viewer and three.js have it;
    # the shader in that text turns the other way.
    angle = transform.get("rotation", 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    samplers = gltf.json.get("samplers", [])
    sampler = samplers[texture["sampler"]] if "sampler" in texture else {}
    wraps = [_WRAPS.get(sampler.get(key, 10497), "repeat") for key in ("wrapS", "wrapT")]
    return TextureUse(
        name,
        found.data if found else None,
        transform.get("texCoord", reference.get("texCoord", 0)),
        np.array([[cos * su, sin * sv, u], [-sin * su, cos * sv, v]]),
        (wraps[0], wraps[1]),
        float(reference.get("scale", 1.0)),
    )


def _source(texture: Json) -> int | None:
    """Number of the picture of a texture."""
    if "source" in texture:
        return int(texture["source"])
    extensions = texture.get("extensions", {})
    return next((extensions[k].get("source") for k in _OTHER_FORMATS if k in extensions), None)


def image_of(gltf: Gltf, texture: Json) -> Image | None:
    """The picture of a texture; None where it is missing."""
    source = _source(texture)
    if source is None:
        return None
    entry = gltf.json["images"][source]
    uri = entry.get("uri")
    if "bufferView" in entry:
        data: bytes | None = bytes(view_bytes(gltf, entry["bufferView"]))
    else:
        data = resource(gltf.folder, uri) if uri else None
    return None if data is None else Image(_picture_name(gltf, texture), data)


def _picture_name(gltf: Gltf, texture: Json) -> str:
    source = _source(texture)
    entry = {} if source is None else gltf.json["images"][source]
    uri = entry.get("uri")
    named = entry.get("name") or (uri if uri and not uri.startswith("data:") else None)
    return str(named or f"image_{source}")


def plain_looks(materials: tuple[Material, ...]) -> tuple[Look, ...]:
    """Looks of materials that have a base colour alone, as it is shown."""
    looks = []
    for material in materials:
        texture, placed = material.texture, material.placement
        name = texture.name if texture else material.missing
        textures = {}
        if name:
            # v is up in an OBJ file.
            (u, v), (su, sv) = placed.offset, placed.scale
            matrix = np.array([[su, 0.0, u], [0.0, sv, 1.0 - sv - v]])
            wrap = ("clamp", "clamp") if placed.clamp else ("repeat", "repeat")
            data = texture.data if texture else None
            textures["base"] = TextureUse(name, data, material.uv_set or 0, matrix, wrap)
        colour = linear_light(np.array(material.colour[:3]))
        looks.append(Look((*colour.tolist(), material.colour[3]), textures))
    return tuple(looks)


def linear_light(shown: Floats) -> Floats:
    """From sRGB, as pictures hold it, to linear light."""
    light: Floats = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    return light


def shown(light: Floats) -> Floats:
    """From linear light to sRGB."""
    light = np.clip(light, 0.0, 1.0)
    found: Floats = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return found
