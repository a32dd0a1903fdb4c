"""Meshes of other formats as OBJ files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
# Lines that are formatted at once.
_CHUNK = 1 << 16


def as_obj(
    path: Path,
    named: Sequence[Path],
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
    named : sequence of Path
        Files that the source names, whose names the material library and the texture do not take.
    meshes, carried
        The meshes and what their corners carry.
    materials : sequence of Material
    uvs : sequence of (c, 2) array
        Texture coordinates, v up.
    image : (h, w, 3) array of uint8, optional
        Base colour of all materials.
    """
    stem = free_stem(path, named)
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
    own = {m.texture.name: m.texture.data for m in materials if m.uv_set is None and m.texture}
    files |= {path.with_name(picture): data for picture, data in own.items()}
    if image is not None:
        files[path.with_name(f"{stem}.png")] = png(image)
    else:
        notes += [
            f"the texture {m.texture.name} belongs to the old texture coordinates and is left out"
            for k, m in enumerate(materials)
            if m.texture is not None and k in used and m.texture.name not in own
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
    rows = positions
    if extra.colours is not None:
        colours = np.ones((len(positions), 3))
        colours[mesh.corners] = extra.colours[:, :3]
        rows = np.column_stack([positions, colours])
    lines = [_rows("v", _form(positions), rows)]
    order = np.arange(len(mesh.corners))
    if np.linalg.det(matrix[:3, :3]) < 0:
        # A mirrored face is turned to look outwards again.
        starts, sizes = starts_of(mesh.sizes), mesh.sizes
        order = np.repeat(2 * starts + sizes - 1, sizes) - order
    columns = [mesh.corners[order] + 1 + bases[0], texture[order]]
    bases[0] += len(positions)
    if extra.normals is not None and np.isfinite(extra.normals).all():
        normals = extra.normals
        if moved:
            normals = _turned(normals, matrix[:3, :3])
        whole = np.rint(normals * 10**_NORMAL_DIGITS).astype(np.int64) + 0
        representative, place = _distinct(whole)
        lines.append(
            _rows("vn", f"%.{_NORMAL_DIGITS}f", whole[representative] / 10**_NORMAL_DIGITS)
        )
        columns.append(place[order] + 1 + bases[1])
        bases[1] += len(representative)
    words = np.stack(columns, axis=1)
    ends = np.cumsum(mesh.sizes)
    changes = np.flatnonzero(np.diff(mesh.material_of)) + 1
    for begin, end in zip([0, *changes], [*changes, len(ends)], strict=True):
        if names is not None:
            lines.append(b"usemtl " + names[int(mesh.material_of[begin])].encode() + b"\n")
        start = int(ends[begin] - mesh.sizes[begin])
        lines += _faces(words[start : int(ends[end - 1])], mesh.sizes[begin:end])
    return lines


def _turned(normals: Floats, matrix: Floats) -> Floats:
    """Unit normals of a surface that a matrix moves; mirrored faces are turned round."""
    # The cofactors turn normals also where the matrix is singular.
    cofactors = np.stack([np.cross(matrix[k - 2], matrix[k - 1]) for k in range(3)])
    turned: Floats = normals @ cofactors.T * (1 if np.linalg.det(matrix) >= 0 else -1)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    unit: Floats = np.divide(turned, length, out=turned.copy(), where=length > 0)
    return unit


def _distinct(whole: Ints) -> tuple[Ints, Ints]:
    """Rows that differ, by the first of each, and which of them each row is."""
    # 20 bits hold a component of a unit vector in steps of a millionth, its sign aside.
    key = ((whole[:, 0] + (1 << 20)) << 42) + ((whole[:, 1] + (1 << 20)) << 21) + whole[:, 2]
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    return first, place.reshape(-1)


def _faces(words: Ints, sizes: Ints) -> Iterator[bytes]:
    """Lines of faces, of which each row of `words` is a corner."""
    corner = " " + "/".join(["%d"] * words.shape[1])
    forms = {size: "f" + corner * size + "\n" for size in np.unique(sizes).tolist()}
    ends = np.concatenate([[0], np.cumsum(sizes)])
    for begin in range(0, len(sizes), _CHUNK):
        end = min(begin + _CHUNK, len(sizes))
        form = "".join([forms[size] for size in sizes[begin:end].tolist()])
        numbers = words[ends[begin] : ends[end]].reshape(-1).tolist()
        yield (form % tuple(numbers)).encode()


def _form(values: Floats) -> str:
    """As few digits as give the same numbers back."""
    with np.errstate(over="ignore"):
        single = np.array_equal(values.astype(np.float32), values)
    return "%.9g" if single else "%.17g"


def _rows(word: str, form: str, values: Floats) -> bytes:
    line = f"{word} {' '.join([form] * values.shape[1])}\n"
    chunks = [values[k : k + _CHUNK] for k in range(0, len(values), _CHUNK)]
    return "".join(line * len(c) % tuple(c.reshape(-1).tolist()) for c in chunks).encode()
