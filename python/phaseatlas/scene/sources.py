"""What files hold, format by format, and how it is written again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote

import numpy as np

from ..arrays import Bytes, Floats
from .accessors import Gltf
from .gltf_edit import with_uv
from .gltf_files import gltf_files
from .gltf_meshes import Triangles, corners_of
from .looks import Baked
from .mesh import Contents, Corners, Cut, Material, Mesh
from .obj_document import free_stem
from .paged import Pages
from .picture import png
from .ply import ply_of, ply_with_uv
from .ply_elements import Ply

__all__ = ["CutSource", "GltfSource", "LooseSource", "Source", "as_ply"]


class Source(Protocol):
    """What a file holds, and how it is written again in one of the kinds that keep all of it."""

    @property
    def kinds(self) -> tuple[str, ...]: ...
    @property
    def folder(self) -> Path: ...
    @property
    def named(self) -> tuple[Path, ...]: ...
    @property
    def meshes(self) -> tuple[Mesh, ...]: ...
    @property
    def materials(self) -> tuple[Material, ...]: ...
    def corners(self, index: int) -> Corners: ...
    def rewrite(
        self,
        path: Path,
        uvs: list[Floats],
        image: Bytes | None,
        uv_set: int | None,
        baked: Baked | None = None,
        pages: Pages | None = None,
    ) -> Contents: ...


@dataclass(frozen=True, eq=False)
class GltfSource:
    """A glTF document and its primitives of triangles."""

    gltf: Gltf
    groups: tuple[tuple[Triangles, ...], ...]
    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    kinds: tuple[str, ...] = (".glb", ".gltf")

    @property
    def folder(self) -> Path:
        """Where the file is."""
        return self.gltf.folder

    @property
    def named(self) -> tuple[Path, ...]:
        """Images that are files of their own."""
        uris = [image.get("uri", "data:") for image in self.gltf.json.get("images", [])]
        return tuple(self.folder / unquote(uri) for uri in uris if not uri.startswith("data:"))

    def corners(self, index: int) -> Corners:
        """Old texture coordinates, normals and colours at the corners of a mesh."""
        return corners_of(self.gltf, self.groups[index])

    def rewrite(
        self,
        path: Path,
        uvs: list[Floats],
        image: Bytes | None,
        uv_set: int | None,
        baked: Baked | None = None,
        pages: Pages | None = None,
        cuts: Sequence[Cut] | None = None,
    ) -> Contents:
        """Return the document with new texture coordinates; a GLB takes its images in."""
        embed = path.suffix.lower() == ".glb"
        document, buffer = with_uv(
            self.gltf,
            self.groups,
            uvs,
            image=image,
            uv_set=uv_set,
            embed=embed,
            cuts=cuts,
            baked=baked,
            pages=pages,
        )
        return gltf_files(path, document, buffer, self.folder, embedded=self.gltf.embedded)


@dataclass(frozen=True, eq=False)
class LooseSource:
    """Meshes of a PLY, STL or OFF file."""

    folder: Path
    meshes: tuple[Mesh, ...]
    carried: tuple[Corners, ...]
    elements: Ply | None = None
    materials: tuple[Material, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """What has all properties of a PLY file."""
        return () if self.elements is None else (".ply",)

    @property
    def named(self) -> tuple[Path, ...]:
        """The texture that a PLY file names."""
        comments = self.elements.comments if self.elements else ()
        words = [comment.split(maxsplit=2) for comment in comments]
        return tuple(self.folder / w[2] for w in words if len(w) == 3 and w[1] == "TextureFile")

    def corners(self, index: int) -> Corners:
        """Old texture coordinates, normals and colours at the corners of a mesh."""
        return self.carried[index]

    def rewrite(
        self,
        path: Path,
        uvs: list[Floats],
        image: Bytes | None,
        uv_set: int | None,
        baked: Baked | None = None,
        pages: Pages | None = None,
    ) -> Contents:
        """Return a PLY file with all properties that were read."""
        if self.elements is None:
            return as_ply(path, self.meshes, self.carried, uvs, image)
        return _ply_files(path, self.elements, uvs[0], image, self.named)


@dataclass(frozen=True, eq=False)
class CutSource:
    """A source whose meshes are cut into new triangles; attributes are interpolated."""

    source: Source
    cuts: tuple[Cut, ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        """What is no mesh stays as it is in a glTF file alone."""
        return self.source.kinds if isinstance(self.source, GltfSource) else ()

    @property
    def folder(self) -> Path:
        """Where the file is."""
        return self.source.folder

    @property
    def named(self) -> tuple[Path, ...]:
        """Files that the source names."""
        return self.source.named

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """The new meshes."""
        return tuple(cut.mesh for cut in self.cuts)

    @property
    def materials(self) -> tuple[Material, ...]:
        """Those of the source."""
        return self.source.materials

    def corners(self, index: int) -> Corners:
        """What the corners of a mesh carry, interpolated."""
        cut, old = self.cuts[index], self.source.corners(index)
        normals = old.normals
        if normals is not None:
            normals = cut.interpolate(normals)
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            normals = np.divide(normals, length, out=normals.copy(), where=length > 0)
        return Corners(
            tuple(cut.interpolate(uv) for uv in old.uvs),
            normals,
            None if old.colours is None else cut.interpolate(old.colours),
        )

    def rewrite(
        self,
        path: Path,
        uvs: list[Floats],
        image: Bytes | None,
        uv_set: int | None,
        baked: Baked | None = None,
        pages: Pages | None = None,
    ) -> Contents:
        """Return a glTF document with the new meshes."""
        if not isinstance(self.source, GltfSource):
            raise ValueError(f"path: {path} must be written as another format")
        return self.source.rewrite(path, uvs, image, uv_set, baked, pages, self.cuts)


def as_ply(
    path: Path,
    meshes: Sequence[Mesh],
    carried: Sequence[Corners],
    uvs: Sequence[Floats],
    image: Bytes | None,
) -> Contents:
    """Return a PLY file of meshes that were none; several become one."""
    offsets = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    whole = Mesh(
        name="",
        positions=np.concatenate([mesh.positions for mesh in meshes]),
        corners=np.concatenate([m.corners + o for m, o in zip(meshes, offsets, strict=False)]),
        sizes=np.concatenate([mesh.sizes for mesh in meshes]),
    )
    extra = carried[0] if len(carried) == 1 else Corners()
    made = _ply_files(path, ply_of(whole, extra), np.concatenate(list(uvs)), image)
    note = [f"{len(meshes)} meshes become one"] if len(meshes) > 1 else []
    return Contents(made.files, (*note, *made.notes))


def _ply_files(
    path: Path, elements: Ply, uv: Floats, image: Bytes | None, named: Sequence[Path] = ()
) -> Contents:
    if image is None:
        return Contents({path: ply_with_uv(elements, uv, None)})
    beside = path.with_name(f"{free_stem(path, named)}.png")
    return Contents({beside: png(image), path: ply_with_uv(elements, uv, beside.name)})
