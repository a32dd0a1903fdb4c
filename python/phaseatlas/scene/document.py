"""Files of meshes: read, and written again with new texture coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from ..arrays import Bytes, Floats
from ..files import check_input, write_files
from .accessors import read_gltf
from .convert_gltf import as_gltf
from .convert_obj import as_obj
from .gltf_files import gltf_files
from .gltf_meshes import materials_of, meshes_of, triangles_of
from .looks import Baked
from .mesh import Contents, Corners, Material, Mesh
from .obj_document import ObjSource, free_stem, read_obj_source
from .off import read_off
from .paged import Pages, in_tiles, paged
from .ply import read_ply
from .sources import CutSource, GltfSource, LooseSource, Source, as_ply
from .stl import read_stl

__all__ = ["Document", "check_suffix", "read_document", "suffixes_for", "write_contents"]

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")


@dataclass(frozen=True, eq=False)
class Document:
    """A file of meshes.

    Attributes
    ----------
    path : Path
        Of the file.
    source : Source
        Its content.
    """

    path: Path
    source: Source

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The meshes: glTF meshes, objects of an OBJ file, solids of an STL file."""
        return self.source.meshes

    @property
    def materials(self) -> tuple[Material, ...]:
        """What `Mesh.material_of` numbers."""
        return self.source.materials

    def corners(self, index: int) -> Corners:
        """Old texture coordinates, normals and colours at the corners of a mesh."""
        return self.source.corners(index)

    def with_uv(
        self,
        path: str | PathLike[str],
        uvs: Sequence[Floats],
        *,
        image: Bytes | None = None,
        uv_set: int | None = None,
        baked: Baked | None = None,
        pages: Pages | None = None,
        tiles: Sequence[Mapping[str, Bytes]] | None = None,
    ) -> Contents:
        """Return the file with new texture coordinates.

        A file of the same format keeps all else. Another format keeps what it can hold, and the
        notes say what is lost.

        Parameters
        ----------
        path : str or PathLike
            Where it is to be written: `.glb`, `.gltf` or `.obj`, or `.ply` for what was a PLY, STL
            or OFF file. A PLY file has its coordinates as properties `s` and `t` of the vertices.
        uvs : sequence of (c, 2) array
            For each mesh the coordinates at its corners, v up.
        image : (h, w, 3) array of uint8, optional
            A texture for them, first row on top, which becomes the base colour of all materials.
            Where it is not given none is made.
        uv_set : int, optional
            In a glTF file, the set to write; the others stay. By default the new coordinates are
            set 0, and the old sets and the textures that use them move up by one.
        baked : Baked, optional
            What `scene.rebake` made of the textures for these coordinates, instead of an image. A
            file that was no glTF file, or becomes none, has a base colour alone.
        pages : Pages, optional
            Several textures, and which of them each polygon is in, instead of an image. Each page
            of a material becomes a material of its own: glTF primitives are split, an OBJ file gets
            a `usemtl` line where the page changes. A PLY file has one texture.
        tiles : sequence of mapping of str to (h, w, 3) array of uint8, optional
            The pictures of each UDIM tile by slot (see `Baked`), instead of an image: files
            `name.1001.png` and so on beside the file, and `name_normal.1001.png` of other slots.
            OBJ and PLY files name the base colours as `name.<UDIM>.png`; glTF files, for which
            there are no tiles, name none.

        Returns
        -------
        Contents
            The file and those that it names, to be written together.

        Raises
        ------
        ValueError
            For another suffix, coordinates that do not fit the meshes, and a set that would leave
            a gap.
        """
        path = Path(path)
        kind = path.suffix.lower()
        allowed = suffixes_for(self.path)
        if kind not in allowed:
            either = " or ".join(allowed)
            raise ValueError(f"path: suffix {path.suffix!r} of {path} must be {either}")
        given = [np.asarray(uv, dtype=np.float64) for uv in uvs]
        if len(given) != len(self.meshes):
            raise ValueError(f"uvs: {len(given)} arrays must be {len(self.meshes)}, one a mesh")
        for k, (uv, mesh) in enumerate(zip(given, self.meshes, strict=True)):
            if uv.shape != (len(mesh.corners), 2):
                raise ValueError(f"uvs[{k}]: shape {uv.shape} must be ({len(mesh.corners)}, 2)")
            if not np.isfinite(uv).all():
                raise ValueError(f"uvs[{k}]: coordinates must be finite")
        if tiles is not None:
            shown = tiles[0]["base"] if kind in (".obj", ".ply") else None
            first = baked if shown is not None else None
            made = self.with_uv(path, given, image=shown, uv_set=uv_set, baked=first)
            note = "glTF has no UDIM tiles: the pictures are beside the file, which names none"
            notes = made.notes if shown is not None else (*made.notes, note)
            stem = free_stem(path, self.source.named)
            return in_tiles(Contents(made.files, notes), path, stem, tiles)
        if baked is not None:
            image = baked.images["base"]
        if pages is not None and kind == ".ply":
            raise ValueError(f"pages: {path} has one texture; UDIM tiles may be several")
        if kind in self.source.kinds:
            if kind not in (".glb", ".gltf"):
                _only_set(uv_set, 0)
            return self.source.rewrite(path, given, image, uv_set, baked, pages)
        carried = [self.corners(k) for k in range(len(self.meshes))]
        meshes, materials = self.meshes, self.materials
        if pages is not None:
            name = free_stem(path, self.source.named)
            split, with_pages = paged(meshes, materials, pages, name)
            meshes, materials = tuple(split), tuple(with_pages)
        if baked is not None or (pages is not None and pages.baked):
            # They are in the picture.
            carried = [replace(extra, colours=None) for extra in carried]
        if kind == ".ply":
            _only_set(uv_set, 0)
            return as_ply(path, meshes, carried, given, image)
        if kind == ".obj":
            _only_set(uv_set, 0)
            lost = self._lost(carried)
            made = as_obj(
                path,
                self.source.named,
                meshes,
                carried,
                materials,
                given,
                image=image,
            )
            return Contents(made.files, (*lost, *made.notes))
        sets = min(len(extra.uvs) for extra in carried)
        _only_set(uv_set, sets)
        document, buffer = as_gltf(
            path.stem,
            meshes,
            carried,
            materials,
            given,
            image=image,
            uv_set=uv_set or 0,
        )
        files = gltf_files(path, document, buffer, self.source.folder, embedded=False)
        return Contents(files.files, (*self._lost_polygons(), *files.notes))

    def save(
        self,
        path: str | PathLike[str],
        uvs: Sequence[Floats],
        *,
        image: Bytes | None = None,
        uv_set: int | None = None,
        baked: Baked | None = None,
        pages: Pages | None = None,
        tiles: Sequence[Mapping[str, Bytes]] | None = None,
    ) -> tuple[str, ...]:
        """Write what `with_uv` returns, whole or not at all, and return its notes."""
        contents = self.with_uv(
            path, uvs, image=image, uv_set=uv_set, baked=baked, pages=pages, tiles=tiles
        )
        write_contents(contents, Path(path))
        return contents.notes

    def _lost_polygons(self) -> list[str]:
        count = sum(int(np.count_nonzero(mesh.sizes > 3)) for mesh in self.meshes)
        return [f"{count} polygons are cut into triangles"] if count else []

    def _lost(self, carried: Sequence[Corners]) -> list[str]:
        """What an OBJ file cannot hold of this one."""
        lost = []
        sets = max((len(extra.uvs) for extra in carried), default=0)
        if sets:
            lost.append(f"{sets} old sets of texture coordinates are left out")
        source = self.source.source if isinstance(self.source, CutSource) else self.source
        if isinstance(source, GltfSource):
            json = source.gltf.json
            lost += [
                f"{len(json[key])} {key} are left out"
                for key in ("animations", "skins", "cameras")
                if json.get(key)
            ]
            if any(len(mesh.transforms) > 1 for mesh in self.meshes):
                lost.append("instances are written out")
            if any("targets" in p for m in json.get("meshes", []) for p in m["primitives"]):
                lost.append("morph targets are left out")
            if json.get("materials"):
                lost.append("of materials only the base colour is kept")
        return lost


def write_contents(contents: Contents, path: Path) -> None:
    """Write what `Document.with_uv` returned for a path, whole or not at all."""
    for file in contents.files:
        if file.parent != path.parent:
            file.parent.mkdir(parents=True, exist_ok=True)
    write_files(contents.files)


def suffixes_for(source: Path) -> tuple[str, ...]:
    """Suffixes of the files that a file of this name can be written as."""
    loose = source.suffix.lower() in (".ply", ".stl", ".off")
    return (".glb", ".gltf", ".obj", *([".ply"] if loose else []))


def check_suffix(source: Path, output: Path, *others: str) -> None:
    """Refuse an output that a file of meshes cannot be written as, and that is none of the others.

    What a saved file (`.npz`) can be written as is known once it is read.
    """
    kind = source.suffix.lower()
    allowed = (*suffixes_for(source), *([".ply"] if kind == ".npz" else []), *others)
    if output.suffix.lower() not in allowed:
        raise ValueError(f"output: {output} must end in {' or '.join(allowed)} for {kind} files")


def _only_set(uv_set: int | None, last: int) -> None:
    if uv_set is not None and not 0 <= uv_set <= last:
        raise ValueError(f"uv_set: {uv_set} must be in [0, {last}] for such a file")


def read_document(path: str | PathLike[str]) -> Document:
    """Read all meshes of a file, with what is needed to write it again.

    Parameters
    ----------
    path : str or PathLike
        A glTF file (`.glb`, or `.gltf` with its buffers), OBJ, PLY, STL or OFF.

    Returns
    -------
    Document

    Raises
    ------
    ValueError
        For another suffix and for a file that holds no surface: what cannot be read, points or
        lines alone, an empty scene, a missing buffer, coordinates that are not finite, and a
        compression that cannot be read. The message is one line that starts with the path.
    FileNotFoundError, IsADirectoryError
        For a missing file and for a folder.
    """
    path = Path(path)
    check_input(path)
    try:
        source = _read(path)
    except (KeyError, IndexError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"{path}: the file is damaged: {type(error).__name__} {error}") from error
    except ValueError as error:
        reason = str(error).strip().splitlines()
        raise ValueError(f"{path}: {reason[0] if reason else 'the file is damaged'}") from error
    if not any(len(mesh.sizes) for mesh in source.meshes):
        raise ValueError(f"{path}: {_nothing(source)}")
    for mesh in source.meshes:
        bad = np.zeros(len(mesh.positions), dtype=np.bool_)
        # What no face uses may be anything.
        bad[mesh.corners] = ~np.isfinite(mesh.positions[mesh.corners]).all(axis=1)
        if bad.any():
            named = f" of mesh {mesh.name!r}" if mesh.name else ""
            raise ValueError(f"{path}: vertex {int(np.argmax(bad))}{named} is not finite")
    return Document(path, source)


def _read(path: Path) -> Source:
    match path.suffix.lower():
        case ".glb" | ".gltf":
            gltf = read_gltf(path)
            groups = triangles_of(gltf)
            return GltfSource(gltf, groups, meshes_of(gltf, groups), materials_of(gltf))
        case ".obj":
            return read_obj_source(path)
        case ".ply":
            elements, mesh, carried = read_ply(path.read_bytes())
            return LooseSource(path.parent, (mesh,), (carried,), elements)
        case ".stl":
            meshes = read_stl(path.read_bytes())
            return LooseSource(path.parent, meshes, tuple(Corners() for _ in meshes))
        case ".off":
            mesh, carried = read_off(path.read_bytes())
            return LooseSource(path.parent, (mesh,), (carried,))
    raise ValueError(f"suffix {path.suffix!r} must be {' or '.join(SUFFIXES)}")


def _nothing(source: Source) -> str:
    """Why a file holds no surface."""
    points = sum(len(mesh.positions) for mesh in source.meshes)
    if isinstance(source, ObjSource) and source.has_points:
        return "no faces: points or lines alone"
    if isinstance(source, GltfSource):
        if not source.gltf.json.get("meshes"):
            return "an empty scene: there is no mesh"
        return "no faces: points or lines alone"
    if points:
        return f"no faces: {points} points alone"
    return "no faces: the mesh is empty"
