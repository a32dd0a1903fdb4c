"""Meshes of other formats as OBJ files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..arrays import Bytes, Floats, Ints
from .mesh import Contents, Corners, Material, Mesh
from .mtl import mtl_bytes
from .obj_document import free_stem
from .obj_edit import vt_lines
from .picture import png
from .polygons import starts_of

__all__ = ["as_obj"]

_NORMAL_DIGITS = 6


def as_obj(
    path: Path,
    folder: Path,
    meshes: Sequence[Mesh],
    carried: Sequence[Corners],
    materials: Sequence[Material],
    uvs: Sequence[Floats],
    *,
    image: Bytes | None,
) -> Contents:
    """Return an OBJ file with an object for each instance of each mesh, and its materials.

    Parameters
    ----------
    path : Path
        Of the OBJ file.
    folder : Path
        Of the source, none of whose files is overwritten by a material library or a texture.
    meshes, carried
        The meshes and what their corners carry.
    materials : sequence of Material
    uvs : sequence of (c, 2) array
        Texture coordinates, v up.
    image : (h, w, 3) array of uint8, optional
        Base colour of all materials.
    """
    stem = free_stem(path, folder)
    names = _names(materials, stem)
    used = sorted({int(k) for mesh in meshes for k in np.unique(mesh.material_of)})
    # What has no material needs none where there is nothing to show.
    library = image is not None or any(k >= 0 for k in used)
    lines: list[bytes] = [f"mtllib {stem}.mtl\n".encode()] if library else []
    texture, index = vt_lines(np.concatenate(list(uvs)), b"\n")
    first = 0
    bases = [0, 0]
    for number, (mesh, extra) in enumerate(zip(meshes, carried, strict=True)):
        corners = index[first : first + len(mesh.corners)]
        first += len(mesh.corners)
        title = mesh.name or (path.stem if len(meshes) == 1 else f"{path.stem}_{number}")
        for k, matrix in enumerate(mesh.transforms):
            instance = title if len(mesh.transforms) == 1 else f"{title}_{k}"
            lines.append(b"o " + _one_line(instance) + b"\n")
            if texture:
                lines.append(texture)
                texture = b""
            shown = names if library else None
            lines += _object(mesh, extra, matrix, corners, bases, shown)
    files: dict[Path, bytes] = {}
    notes = []
    if image is not None:
        files[path.with_name(f"{stem}.png")] = png(image)
    else:
        notes += [
            f"the texture {m.texture.name} belongs to the old texture coordinates and is left out"
            for k, m in enumerate(materials)
            if m.texture is not None and k in used
        ]
    if library:
        entries = [(names[k], materials[k] if k >= 0 else Material(stem)) for k in used]
        shown_texture = None if image is None else f"{stem}.png"
        files[path.with_name(f"{stem}.mtl")] = mtl_bytes(entries, shown_texture)
    return Contents({**files, path: b"".join(lines)}, tuple(notes))


def _names(materials: Sequence[Material], stem: str) -> dict[int, str]:
    """Names of the materials, each once, by their numbers; -1 for none."""
    names = {-1: stem}
    taken = {stem}
    for k, material in enumerate(materials):
        name = _one_line(material.name).decode() or f"material_{k}"
        while name in taken:
            name += f"_{k}"
        taken.add(name)
        names[k] = name
    return names


def _one_line(name: str) -> bytes:
    return " ".join(name.split()).encode()


def _object(
    mesh: Mesh,
    extra: Corners,
    matrix: Floats,
    texture: Ints,
    bases: list[int],
    names: dict[int, str] | None,
) -> list[bytes]:
    """Lines of an instance; `bases` counts the vertices and normals so far."""
    positions = mesh.positions
    moved = not np.array_equal(matrix, np.eye(4))
    if moved:
        positions = positions @ matrix[:3, :3].T + matrix[:3, 3]
    rows = [positions]
    if extra.colours is not None:
        colours = np.ones((len(positions), 3))
        colours[mesh.corners] = extra.colours[:, :3]
        rows.append(colours)
    lines = [_rows("v", [_shortest(values) for values in rows])]
    order = np.arange(len(mesh.corners))
    if np.linalg.det(matrix[:3, :3]) < 0:
        # A mirrored face is turned to look outwards again.
        starts, sizes = starts_of(mesh.sizes), mesh.sizes
        order = np.repeat(2 * starts + sizes - 1, sizes) - order
    vertex = mesh.corners[order] + 1 + bases[0]
    parts = [vertex.astype(np.bytes_), texture[order].astype(np.bytes_)]
    bases[0] += len(positions)
    if extra.normals is not None and np.isfinite(extra.normals).all():
        normals = extra.normals
        if moved:
            # The adjugate turns normals also where the matrix is singular.
            m = matrix[:3, :3]
            adjugate = np.stack([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
            normals = normals @ adjugate.T * (1 if np.linalg.det(m) >= 0 else -1)
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            normals = np.divide(normals, length, out=normals.copy(), where=length > 0)
        distinct, place = np.unique(
            np.round(normals, _NORMAL_DIGITS) + 0.0, axis=0, return_inverse=True
        )
        lines.append(_rows("vn", [np.char.mod(f"%.{_NORMAL_DIGITS}f", distinct)]))
        parts.append((place.reshape(-1)[order] + 1 + bases[1]).astype(np.bytes_))
        bases[1] += len(distinct)
    words = parts[0]
    for part in parts[1:]:
        words = np.char.add(np.char.add(words, b"/"), part)
    ends = np.cumsum(mesh.sizes)
    # A blank between the corners of a face, and a new line before each.
    separators = np.full(len(words), b" ", dtype="S3")
    separators[starts_of(mesh.sizes)] = b"\nf "
    text = np.char.add(separators, words)
    changes = np.flatnonzero(np.diff(mesh.material_of)) + 1
    for begin, end in zip([0, *changes], [*changes, len(ends)], strict=True):
        if names is not None:
            lines.append(b"usemtl " + names[int(mesh.material_of[begin])].encode() + b"\n")
        start = int(ends[begin] - mesh.sizes[begin])
        lines.append(b"".join(text[start : int(ends[end - 1])].tolist())[1:] + b"\n")
    return lines


def _shortest(values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.str_]]:
    """As few digits as give the same numbers back."""
    with np.errstate(over="ignore"):
        single = np.array_equal(values.astype(np.float32), values)
    return np.char.mod("%.9g" if single else "%.17g", values)


def _rows(word: str, groups: list[np.ndarray[tuple[int, ...], np.dtype[np.str_]]]) -> bytes:
    rows = np.concatenate(groups, axis=1).tolist()
    return "".join(f"{word} {' '.join(row)}\n" for row in rows).encode()
