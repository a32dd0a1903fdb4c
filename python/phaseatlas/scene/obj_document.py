"""OBJ files as meshes, and the same text with new texture coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from .. import _core
from ..arrays import Bytes, Floats, Ints
from .gltf_files import copy_beside
from .looks import Baked
from .mesh import Contents, Corners, Material, Mesh
from .mtl import Library, mtl_bytes, read_library
from .obj_edit import Header, with_vt
from .obj_text import (
    FACE,
    NORMAL,
    TEXTURE,
    VERTEX,
    ObjText,
    corner_indices,
    numbers,
    read_text,
    statements,
)
from .paged import Pages, paged
from .picture import png

__all__ = ["ObjSource", "free_stem", "read_obj_source"]


@dataclass(frozen=True, eq=False)
class ObjSource:
    """An OBJ file: its text, its meshes, one an object, and its materials.

    Attributes
    ----------
    text : ObjText
    folder : Path
        Where the file is.
    meshes : tuple of Mesh
    places : tuple of (c,) array of int
        Corners of each mesh among those of the file.
    vertices : (c,) array of int
        Vertices of the file's corners.
    materials : tuple of Material
    libraries : dict of str to Library or None
        Material libraries by the names in the text; None for one that is missing.
    """

    text: ObjText
    folder: Path
    meshes: tuple[Mesh, ...]
    places: tuple[Ints, ...]
    vertices: Ints
    materials: tuple[Material, ...]
    libraries: dict[str, Library | None]
    kinds: tuple[str, ...] = (".obj",)

    @property
    def has_points(self) -> bool:
        """Whether there are vertices, in faces or not."""
        return bool((self.text.kinds == VERTEX).any())

    @property
    def named(self) -> tuple[Path, ...]:
        """Material libraries and textures of the file."""
        return tuple(
            self.folder / name.replace("\\", "/")
            for library in self.libraries
            for name in self._files_of(library)
        )

    def _files_of(self, name: str) -> list[str]:
        """A library and its textures, relative to the file's folder."""
        library = self.libraries[name]
        textures = () if library is None else library.textures
        folder = Path(name.replace("\\", "/")).parent
        return [name, *(str(folder / texture) for texture in textures)]

    def corners(self, index: int) -> Corners:
        """Texture coordinates, normals and colours at the corners of a mesh."""
        place = self.places[index]
        uv, normals, colours = (
            None if table is None else table.values[table.index[place]] for table in self._tables
        )
        if uv is not None and np.isnan(uv).all():
            uv = None
        if normals is not None and np.isnan(normals).all():
            normals = None
        return Corners(() if uv is None else (uv,), normals, colours)

    @cached_property
    def _tables(self) -> tuple[_Table | None, _Table | None, _Table | None]:
        """Texture coordinates, normals and colours of the file; all meshes look into them."""
        _, texture, normal = corner_indices(self.text)
        colours = None
        if any(mesh.vertex_colours for mesh in self.meshes):
            rows = numbers(self.text, VERTEX, 6)[:, 3:]
            if np.nanmax(rows, initial=0.0) > 1:
                rows = rows / 255.0
            rows = np.nan_to_num(np.column_stack([rows, np.ones(len(rows))]), nan=1.0)
            colours = _Table(rows, self.vertices)
        uv = _table(numbers(self.text, TEXTURE, 2), texture)
        return uv, _table(numbers(self.text, NORMAL, 3), normal), colours

    def rewrite(
        self,
        path: Path,
        uvs: list[Floats],
        image: Bytes | None,
        uv_set: int | None,
        baked: Baked | None = None,
        pages: Pages | None = None,
    ) -> Contents:
        """Return the file with new texture coordinates, and the files that it names."""
        uv = np.empty((len(self.vertices), 2))
        for place, values in zip(self.places, uvs, strict=True):
            uv[place] = values
        if pages is not None:
            return self._paged(path, uv, pages)
        if image is not None:
            return self._painted(path, uv, image)
        files: dict[Path, bytes] = {}
        notes = []
        for name, library in self.libraries.items():
            if library is None:
                notes.append(f"the material library {name} is missing")
                continue
            for relative in self._files_of(name):
                try:
                    data = (self.folder / relative.replace("\\", "/")).read_bytes()
                except (OSError, ValueError):
                    notes.append(f"the texture {relative} is missing")
                    continue
                copies, said = copy_beside(path.parent, self.folder, relative, data)
                files |= copies
                notes += said
            if library.textures and any(mesh.uv_sets for mesh in self.meshes):
                notes.append(f"the textures of {name} were made for the old texture coordinates")
        return Contents({**files, path: with_vt(self.text, uv)}, tuple(notes))

    def _painted(self, path: Path, uv: Floats, image: Bytes) -> Contents:
        stem = free_stem(path, self.named)
        used = {name for mesh in self.meshes for name in mesh.materials}
        bare = any((mesh.material_of < 0).any() for mesh in self.meshes)
        materials = [(m.name, m) for m in self.materials if m.name in used]
        if bare:
            materials.insert(0, (stem, Material(stem)))
        texture = f"{stem}.png"
        lines = [f"mtllib {stem}.mtl"]
        # What stands before the first `usemtl` has no material.
        lines += [f"usemtl {stem}"] if bare else []
        charset = self.text.charset
        header = Header(
            dropped=tuple(line for line, _, _ in statements(self.text, (b"mtllib",))),
            top=tuple(line.encode(charset, "replace") for line in lines),
        )
        return Contents(
            {
                path.with_name(texture): png(image),
                path.with_name(f"{stem}.mtl"): mtl_bytes(materials, texture, charset),
                path: with_vt(self.text, uv, header),
            }
        )

    def _paged(self, path: Path, uv: Floats, pages: Pages) -> Contents:
        """Return the file with a material for each page of each old one."""
        stem = free_stem(path, self.named)
        meshes, materials = paged(self.meshes, self.materials, pages, stem)
        material = np.empty(len(self.vertices), dtype=np.int64)
        for place, mesh in zip(self.places, meshes, strict=True):
            material[place] = np.repeat(mesh.material_of, mesh.sizes)
        line = corner_indices(self.text)[0]
        first = np.flatnonzero(np.diff(line, prepend=-1))
        change = first[np.flatnonzero(np.diff(material[first], prepend=-1))]
        charset = self.text.charset
        encoded = [m.name.encode(charset, "replace") for m in materials]
        header = Header(
            dropped=tuple(k for k, _, _ in statements(self.text, (b"mtllib", b"usemtl"))),
            top=(f"mtllib {stem}.mtl".encode(charset, "replace"),),
            before={
                int(at): b"usemtl " + encoded[number]
                for at, number in zip(line[change], material[change], strict=True)
            },
        )
        pictures = {
            m.texture.name: m.texture.data for m in materials if m.texture and m.uv_set is None
        }
        return Contents(
            {
                **{path.with_name(name): data for name, data in pictures.items()},
                path.with_name(f"{stem}.mtl"): mtl_bytes(
                    [(m.name, m) for m in materials], None, charset
                ),
                path: with_vt(self.text, uv, header),
            }
        )


def free_stem(path: Path, named: Sequence[Path]) -> str:
    """A name for a new library and texture that is none of the files that the source names."""
    stem = path.stem
    taken = {file.resolve() for file in named}
    while any(path.with_name(f"{stem}{suffix}").resolve() in taken for suffix in (".mtl", ".png")):
        stem += "_atlas"
    return stem


@dataclass(frozen=True, eq=False)
class _Table:
    """Rows of values, and the row of each corner of the file."""

    values: Floats
    index: Ints


def _table(values: Floats, index: Ints) -> _Table | None:
    """A table with NaN for corners of index -1; None where all are that."""
    if not len(values) or (index < 0).all():
        return None
    return _Table(np.concatenate([values, np.full((1, values.shape[1]), np.nan)]), index)


def read_obj_source(path: Path) -> ObjSource:
    """Read an OBJ file and its material libraries.

    Raises
    ------
    ValueError
        For what is no position or names no vertex; the message names the line.
    """
    text = read_text(path.read_bytes())
    positions, vertices, ends = _core.parse_obj(text.data)
    sizes = np.diff(np.concatenate([[0], ends]))
    lines = np.flatnonzero(text.kinds == FACE)
    if len(lines) != len(ends):
        line = corner_indices(text)[0]
        lines = line[ends - 1] if len(line) == len(vertices) else lines[: len(ends)]
    if len(text.continued) and len(corner_indices(text)[0]) != len(vertices):
        raise ValueError("where its continued lines end cannot be told")
    libraries = {
        name: read_library(path.parent / name.replace("\\", "/"))
        for _, _, rest in statements(text, (b"mtllib",))
        for name in _library_names(rest.decode(text.charset), path.parent)
    }
    material_of, names = _current(text, b"usemtl", lines)
    known = {k: v for lib in libraries.values() if lib for k, v in lib.materials.items()}
    materials = tuple(known.get(name, Material(name)) for name in names)
    object_of, objects = _current(text, b"o", lines)
    own = np.flatnonzero(text.kinds == VERTEX)
    owner, _ = _current(text, b"o", own, objects)
    colours = _coloured(text, own)
    uv_sets = int(_textured(text, lines))
    meshes, places = [], []
    for part in _objects(positions, vertices, sizes, object_of, owner):
        of = material_of[part.faces]
        meshes.append(
            Mesh(
                name=objects[part.number] if part.number >= 0 else "",
                positions=part.positions,
                corners=part.corners,
                sizes=sizes[part.faces],
                material_of=of,
                materials=tuple(names[k] for k in np.unique(of[of >= 0])),
                uv_sets=uv_sets,
                vertex_colours=colours,
            )
        )
        places.append(part.places)
    return ObjSource(
        text, path.parent, tuple(meshes), tuple(places), vertices, materials, libraries
    )


@dataclass(frozen=True, eq=False)
class _Object:
    """Faces of an object, its corners among those of the file, and its own vertices."""

    number: int
    faces: Ints
    places: Ints
    positions: Floats
    corners: Ints


def _objects(
    positions: Floats, vertices: Ints, sizes: Ints, object_of: Ints, owner: Ints
) -> Iterator[_Object]:
    """Objects with the vertices that they use, and those of their own that no face uses."""
    numbers, first = np.unique(object_of, return_index=True)
    if len(numbers) <= 1:
        if len(numbers):
            faces, places = np.arange(len(sizes)), np.arange(len(vertices))
            yield _Object(int(numbers[0]), faces, places, positions, vertices)
        return
    loose = np.ones(len(positions), dtype=np.bool_)
    loose[vertices] = False
    rest = np.flatnonzero(loose)
    n = len(positions)
    of_corner = np.repeat(object_of, sizes)
    keys, local = np.unique(
        np.concatenate([of_corner * n + vertices, owner[rest] * n + rest]), return_inverse=True
    )
    local = local.reshape(-1)[: len(vertices)]
    faces, places = np.argsort(object_of, kind="stable"), np.argsort(of_corner, kind="stable")
    face_numbers, corner_numbers = object_of[faces], of_corner[places]
    # Objects stand in the order of their first faces.
    for number in numbers[np.argsort(first)].tolist():
        begin, end = np.searchsorted(keys, [number * n, (number + 1) * n])
        own = faces[slice(*np.searchsorted(face_numbers, [number, number + 1]))]
        place = places[slice(*np.searchsorted(corner_numbers, [number, number + 1]))]
        yield _Object(number, own, place, positions[keys[begin:end] % n], local[place] - begin)


def _library_names(whole: str, folder: Path) -> list[str]:
    # A name may have blanks, and a line several names.
    if (folder / whole.replace("\\", "/")).is_file():
        return [whole]
    return whole.split()


def _current(
    text: ObjText, word: bytes, lines: Ints, names: list[str] | None = None
) -> tuple[Ints, list[str]]:
    """Number of the name that such a statement last gave before each line, else -1."""
    found = [(line, rest) for line, _, rest in statements(text, (word,))]
    given = [rest.decode(text.charset) for _, rest in found]
    names = list(dict.fromkeys(given)) if names is None else names
    number = {name: k for k, name in enumerate(names)}
    numbered = np.array([-1, *(number[name] for name in given)], dtype=np.int64)
    at = np.searchsorted(np.array([line for line, _ in found], dtype=np.int64), lines)
    return numbered[at], names


def _coloured(text: ObjText, own: Ints) -> bool:
    if not len(own):
        return False
    line = text.data[text.starts[own[0]] : text.starts[own[0] + 1]]
    return len(line.partition(b"#")[0].split()) >= 7


def _textured(text: ObjText, lines: Ints) -> bool:
    """Whether a face has texture coordinates: its first corner tells."""
    if not (text.kinds == TEXTURE).any():
        return False
    for line in lines.tolist():
        words = text.data[text.starts[line] : text.starts[line + 1]].split()
        parts = words[1].split(b"/") if len(words) > 1 else []
        if len(parts) > 1 and parts[1]:
            return True
    return False
