"""Material libraries of OBJ files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .mesh import Image, Material, Placement

__all__ = ["Library", "charset", "mtl_bytes", "read_library"]

# Words after options of a texture that are arguments of the option and not the file's name.
_ARGUMENTS = {
    **dict.fromkeys(("-blendu", "-blendv", "-boost", "-cc", "-clamp", "-imfchan"), 1),
    **dict.fromkeys(("-texres", "-type", "-bm"), 1),
    **dict.fromkeys(("-mm",), 2),
    **dict.fromkeys(("-o", "-s", "-t"), 3),
}


@dataclass(frozen=True)
class Library:
    """Materials by name, and the names of all files that they are made of."""

    materials: dict[str, Material]
    textures: tuple[str, ...]


def charset(data: bytes) -> str:
    """UTF-8 where a text is that, else Latin-1, which any text is."""
    try:
        if not data.isascii():
            data.decode()
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def read_library(path: Path) -> Library | None:
    """Read a file; None where it is missing."""
    try:
        data = path.read_bytes()
    except (OSError, ValueError):
        return None
    text = data.decode(charset(data))
    found: dict[str, dict[str, list[str]]] = {}
    current: dict[str, list[str]] = {}
    textures = []
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
        word, _, rest = line.strip().replace("\t", " ").partition(" ")
        if word == "newmtl":
            current = found.setdefault(rest.strip(), {})
        elif word and not word.startswith("#"):
            current[word.lower()] = rest.split()
            if word.lower().startswith(("map_", "bump", "disp", "decal", "norm", "refl")):
                textures.append(_file_name(rest.split()))
    materials = {name: _material(name, words, path.parent) for name, words in found.items()}
    return Library(materials, tuple(dict.fromkeys(name for name in textures if name)))


def _file_name(words: list[str]) -> str:
    words = list(words)
    while words and words[0].lower() in _ARGUMENTS:
        count = _ARGUMENTS[words[0].lower()]
        words.pop(0)
        for _ in range(count):
            # Vectors may be shorter.
            if words and (count == 1 or _is_number(words[0])):
                words.pop(0)
    return " ".join(words)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _material(name: str, words: dict[str, list[str]], folder: Path) -> Material:
    def value(key: str, default: Sequence[float]) -> list[float]:
        given = words.get(key, [])[: len(default)]
        if len(given) == len(default) and all(_is_number(word) for word in given):
            return [min(max(float(word), 0.0), 1.0) for word in given]
        return list(default)

    texture, missing = None, ""
    if file_name := _file_name(words.get("map_kd", [])):
        try:
            data = (folder / file_name.replace("\\", "/")).read_bytes()
            texture = Image(file_name, data)
        except (OSError, ValueError):
            missing = file_name
    red, green, blue = value("kd", (1.0, 1.0, 1.0))
    (opacity,) = value("d", (1.0 - value("tr", (0.0,))[0],))
    return Material(
        name,
        (red, green, blue, opacity),
        texture,
        missing=missing,
        placement=_placement(words.get("map_kd", [])),
    )


def _placement(words: list[str]) -> Placement:
    """What the options of a texture say of its place."""

    def pair(option: str, default: float) -> tuple[float, float]:
        after = words[words.index(option) + 1 :][:2] if option in words else []
        given = [float(word) for word in after if _is_number(word)]
        u, v = (*given, *[default] * 2)[:2]
        return u, v

    clamp = "-clamp" in words and words[words.index("-clamp") + 1 :][:1] == ["on"]
    return Placement(pair("-o", 0.0), pair("-s", 1.0), clamp)


def mtl_bytes(
    materials: Iterable[tuple[str, Material]], texture: str | None, encoding: str = "utf-8"
) -> bytes:
    """Return a library of matt materials.

    Parameters
    ----------
    materials : iterable of (str, Material)
        By the names that the OBJ file uses.
    texture : str, optional
        File of the base colour of all of them, which takes the place of their colours; without it
        those have one that are seen through the coordinates of the OBJ file.
    encoding : str, default "utf-8"
        Of the names, as in the OBJ file.
    """
    lines = []
    for name, material in materials:
        red, green, blue, opacity = material.colour
        picture = texture
        if picture is None and material.uv_set is None and material.texture is not None:
            picture = material.texture.name
        if picture is not None:
            red = green = blue = 1.0
        lines += [
            f"newmtl {name}",
            "Ka 1 1 1",
            f"Kd {red:.6g} {green:.6g} {blue:.6g}",
            "Ks 0 0 0",
            "Ns 1",
            f"d {opacity:.6g}",
            "illum 1",
            *([] if picture is None else [f"map_Kd {picture}"]),
            "",
        ]
    return "\n".join(lines).encode(encoding, "replace")
