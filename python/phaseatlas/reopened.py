"""Segments and atlases that were saved, and the file of meshes that they were made of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .atlas import Atlas
from .saved_arrays import format_of, source_of
from .scene.components import as_it_is, without_input
from .scene.document import Document, read_document
from .scene.mesh import Corners, Mesh
from .scene.scene import Scene, SceneFile, scene_file, scene_in
from .scene.sources import LooseSource
from .seam_costs import cost_arrays, with_costs
from .segmentation import SceneSegmentation, Segmentation, SegmentTree
from .surface import Surface

__all__ = ["Reopened", "reopen"]


@dataclass(frozen=True, eq=False)
class Reopened:
    """What was saved, ready to be written again.

    Attributes
    ----------
    document : Document
        The file of meshes; where it is missing, the repaired triangles.
    scene : Scene
        Its repaired meshes.
    segmentation : SceneSegmentation
    atlas : Atlas or None
        The charts, where an atlas was saved.
    notes : tuple of str
        What is lost.
    """

    document: Document
    scene: Scene
    segmentation: SceneSegmentation
    atlas: Atlas | None = None
    notes: tuple[str, ...] = ()


def reopen(path: Path) -> Reopened:
    """Read an `.npz` file of `SegmentTree.save`, `SceneSegmentation.save` or `Atlas.save`.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ValueError
        For another file, and where the file of meshes has changed since.
    FileNotFoundError
        For a missing file.
    """
    atlas = None
    match format_of(path):
        case 1:
            tree = SegmentTree.load(path)
            return _of_tree(path, tree)
        case 3:
            atlas = Atlas.load(path)
            scene = _scene_of(atlas.surface)
            atlas = replace(atlas, surface=scene)
            segmentation = _segmentation(scene, atlas)
        case _:
            segmentation = SceneSegmentation.load(path)
            assert isinstance(segmentation.surface, Scene)
            scene = segmentation.surface
    document = None if scene.file is None else _document(path, scene.file)
    if document is not None:
        return Reopened(document, scene, segmentation, atlas)
    return _without_document(path, segmentation, atlas, scene.file)


def _of_tree(path: Path, tree: SegmentTree) -> Reopened:
    file = source_of(path)
    document = None if file is None else _document(path, file)
    if document is not None:
        scene = scene_in(document)
        first = scene.pieces[0].surface
        if not (
            len(scene.pieces) == 1
            and np.array_equal(first.vertices, tree.surface.vertices)
            and np.array_equal(first.faces, tree.surface.faces)
        ):
            raise ValueError(f"{path}: its surface is not that of {document.path}")
        scene = with_costs(scene, cost_arrays(tree.surface))
        scene.file = file
        return Reopened(document, scene, SceneSegmentation.of_trees(scene, [tree]))
    scene = _scene_of(tree.surface)
    segmentation = SceneSegmentation.of_trees(scene, [tree])
    return _without_document(path, segmentation, None, file)


def _scene_of(surface: Surface) -> Scene:
    if isinstance(surface, Scene):
        return surface
    scene = Scene([("", as_it_is(surface.vertices, surface.faces))])
    return with_costs(scene, cost_arrays(surface))


def _segmentation(scene: Scene, atlas: Atlas) -> SceneSegmentation:
    """Labels of an atlas, piece by piece; weights are made of them where they are asked for."""
    parts = []
    first = 0
    for piece in scene.pieces:
        own = atlas.labels[piece.faces] - first
        parts.append(Segmentation(piece.surface, own))
        first += parts[-1].n_segments
    return SceneSegmentation(scene, parts)


def _document(path: Path, file: SceneFile) -> Document | None:
    """Read the file of meshes, from where it was or beside what was saved; None if it is gone."""
    for place in (Path(file.path), path.parent / Path(file.path).name):
        if not place.is_file():
            continue
        if scene_file(place).sha256 != file.sha256:
            raise ValueError(f"{path}: {place} has changed since")
        return read_document(place)
    return None


def _without_document(
    path: Path, segmentation: SceneSegmentation, atlas: Atlas | None, file: SceneFile | None
) -> Reopened:
    """What was saved, with its repaired triangles as the file of meshes."""
    old = segmentation.surface
    assert isinstance(old, Scene)
    scene = Scene([(mesh.name, without_input(mesh.repaired)) for mesh in old.meshes])
    scene = with_costs(scene, cost_arrays(old))
    segmentation = SceneSegmentation(scene, segmentation.parts, segmentation.trees)
    meshes = tuple(
        Mesh(
            name=mesh.name,
            positions=mesh.repaired.vertices,
            corners=mesh.repaired.faces.reshape(-1),
            sizes=np.full(len(mesh.repaired.faces), 3),
            material_of=np.full(len(mesh.repaired.faces), -1),
        )
        for mesh in scene.meshes
    )
    # The formats of such documents hold no more than triangles.
    source = LooseSource(path.parent, meshes, tuple(Corners() for _ in meshes))
    document = Document(path.with_suffix(".ply"), source)
    lost = (
        ()
        if file is None
        else (f"{file.path} is missing: what it held beside its triangles is left out",)
    )
    return Reopened(document, scene, segmentation, atlas and replace(atlas, surface=scene), lost)
