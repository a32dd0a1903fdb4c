"""Textures and images of a glTF document that nothing names any more."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .accessors import Json
from .gltf_slots import integers

__all__ = ["drop_pictures"]

# What holds the numbers of textures and images in ways that are known here.
_KNOWN = ("materials", "textures", "images")


def drop_pictures(before: Json, document: Json) -> None:
    """Drop textures and images that were named before, and are no more.

    Those that nothing ever named stay, and so do all where an extension elsewhere has numbers that
    may be theirs.

    Parameters
    ----------
    before : dict
        The JSON as it was read.
    document : dict
        The JSON with other textures; it is changed.
    """
    rest = {key: value for key, value in document.items() if key not in _KNOWN}
    if any(True for _ in integers(rest, inside=False)):
        return
    for key, name, places in (("textures", "index", _references), ("images", "source", _sources)):
        gone = {p[name] for p in places(before)} - {p[name] for p in places(document)}
        kept = [k for k in range(len(document.get(key, []))) if k not in gone]
        number = {old: new for new, old in enumerate(kept)}
        for place in places(document):
            place[name] = number.get(place[name], place[name])
        if gone:
            document[key] = [document[key][k] for k in kept]


def _references(document: Json) -> Iterator[Json]:
    """References to textures, in materials and their extensions."""
    for material in document.get("materials", []):
        yield from _within(material)


def _within(value: Any) -> Iterator[Json]:
    if isinstance(value, list):
        for member in value:
            yield from _within(member)
    if not isinstance(value, dict):
        return
    for key, member in value.items():
        if key.lower().endswith("texture") and isinstance(member, dict) and "index" in member:
            yield member
        elif key != "extras":
            yield from _within(member)


def _sources(document: Json) -> Iterator[Json]:
    """Holders of the images of textures: textures themselves, and extensions for more formats."""
    for texture in document.get("textures", []):
        for holder in (texture, *texture.get("extensions", {}).values()):
            if "source" in holder:
                yield holder
