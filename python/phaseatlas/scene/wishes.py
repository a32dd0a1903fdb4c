"""Where seams may run, as files say it: attributes, lists of edges, regions by name or number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Bools, Floats, Ints
from ..files import check_input
from ..seam_costs import check_creases, with_seam_cost
from .accessors import decoded
from .document import Document
from .obj_document import ObjSource
from .opened import NoEdgeError, half_edges, opened
from .ply_elements import Lists
from .scene import Scene
from .sources import GltfSource, LooseSource

__all__ = ["Wishes", "granted"]

# Positions of a list of edges and of a mesh are one that agree to this part of the extent: single
# precision, and decimal digits of six places.
_SAME_PLACE = 2e-6
_LISTS = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class Wishes:
    """Where the seams of a file may run.

    Attributes
    ----------
    seam_cost : str or None
        Vertex attribute whose values are factors on the length of seams: a property of a PLY file,
        an attribute of a glTF file with or without its underscore, or "COLOR_0" or "red" for the
        red of vertex colours. Meshes without it have 1.
    seams : Path or None
        Edges that must be cut. A text file has a path of vertices in each line, by their numbers
        from 0; vertices count through the meshes of the file. An OBJ file has them as `l`
        elements, and its vertices are found by their places.
    keep : tuple of str
        Regions within which no seam runs. A text file has numbers of polygons from 0; a name is
        that of a mesh, an object or a material, or of a property of PLY faces that is not 0 there.
    creases : float or None
        Angle in degrees of edges that are cheap.
    """

    seam_cost: str | None = None
    seams: Path | None = None
    keep: tuple[str, ...] = ()
    creases: float | None = None

    def __post_init__(self) -> None:
        check_creases(self.creases)
        if self.seams is not None:
            check_input(self.seams)

    def __bool__(self) -> bool:
        return self != Wishes()


def granted(document: Document, scene: Scene, wishes: Wishes) -> Scene:
    """Return the scene of a file with seams where they are wished for.

    Parameters
    ----------
    document : Document
    scene : Scene
        Of its meshes.
    wishes : Wishes

    Raises
    ------
    ValueError
        For a name that the file does not have, a file that is no such list, factors that are not
        positive, and edges to cut inside a region to keep. The message is one line.
    """
    if not wishes:
        return scene
    cut = None if wishes.seams is None else _cut_edges(document, scene, wishes.seams)
    costs = None if wishes.seam_cost is None else _painted(document, scene, wishes.seam_cost)
    regions = [_kept_faces(document, scene, region) for region in wishes.keep]
    for region, kept in zip(wishes.keep, regions, strict=True):
        if cut is not None:
            inside = cut & kept[:, None] & (scene.face_neighbours >= 0)
            if (inside & kept[scene.face_neighbours]).any():
                raise ValueError(f"keep: {region} must not have edges of {wishes.seams} inside")
    for kept in regions[1:]:
        scene = with_seam_cost(scene, keep=kept)
    keep = regions[0] if regions else None
    scene = with_seam_cost(scene, costs, keep=keep, creases=wishes.creases)
    return scene if cut is None else opened(scene, cut)


def _painted(document: Document, scene: Scene, name: str) -> Floats:
    """Values of an attribute at the vertices of a scene, the mean over their corners."""
    found = [_attribute(document, k, name) for k in range(len(document.meshes))]
    if all(values is None for values in found):
        there = sorted({each for k in range(len(found)) for each in _attributes(document, k)})
        listed = f"it has {', '.join(there)}" if there else "it has none"
        raise ValueError(f"seam_cost: {name!r} must be a vertex attribute of the file; {listed}")
    costs = np.ones(scene.n_vertices)
    for mesh, values in zip(scene.meshes, found, strict=True):
        repaired = mesh.repaired
        if values is None or not len(repaired.faces):
            continue
        at = values[repaired.corner.reshape(-1)]
        if not (np.isfinite(at) & (at > 0)).all():
            wrong = at[~(np.isfinite(at) & (at > 0))][0]
            named = f" of mesh {mesh.name!r}" if mesh.name else ""
            raise ValueError(f"seam_cost: {name}{named} is {wrong:g} somewhere; must be positive")
        vertex, n = repaired.faces.reshape(-1), len(repaired.vertices)
        # Weights of 1 would round the mean of equal values.
        low, high = np.full(n, np.inf), np.zeros(n)
        np.minimum.at(low, vertex, at)
        np.maximum.at(high, vertex, at)
        means = np.bincount(vertex, at, n) / np.bincount(vertex, minlength=n)
        costs[mesh.first_vertex :][:n] = np.clip(means, low, high)
    return costs


def _attributes(document: Document, k: int) -> list[str]:
    """Names of the vertex attributes of a mesh that have one number, and of its colours."""
    source = document.source
    names = ["COLOR_0"] if document.meshes[k].vertex_colours else []
    if isinstance(source, GltfSource):
        accessors = source.gltf.json["accessors"]
        for part in source.groups[k]:
            primitive = source.gltf.json["meshes"][part.mesh]["primitives"][part.primitive]
            names += [
                name
                for name, accessor in primitive["attributes"].items()
                if name.startswith("_") and accessors[accessor]["type"] == "SCALAR"
            ]
    elif isinstance(source, LooseSource) and source.elements is not None:
        columns = source.elements.elements["vertex"].columns
        names += [
            name
            for name, column in columns.items()
            if not isinstance(column, Lists) and name not in ("x", "y", "z")
        ]
    return names


def _attribute(document: Document, k: int, name: str) -> Floats | None:
    """Values of a vertex attribute at the corners of a mesh; None where it has none."""
    source, mesh = document.source, document.meshes[k]
    if name in ("COLOR_0", "red") and mesh.vertex_colours:
        colours = document.corners(k).colours
        return None if colours is None else colours[:, 0]
    names = _attributes(document, k)
    if isinstance(source, GltfSource):
        spelt = next((n for n in (name, f"_{name}", f"_{name}".upper()) if n in names), None)
        if spelt is not None:
            parts = []
            for part in source.groups[k]:
                primitive = source.gltf.json["meshes"][part.mesh]["primitives"][part.primitive]
                accessor = primitive["attributes"].get(spelt)
                parts.append(
                    np.ones(len(part.corners))
                    if accessor is None
                    else decoded(source.gltf, accessor)[part.corners, 0]
                )
            return np.concatenate(parts)
    elif isinstance(source, LooseSource) and source.elements is not None and name in names:
        columns = source.elements.elements["vertex"].columns
        if name in columns:
            return np.asarray(columns[name], dtype=np.float64)[mesh.corners]
    return None


def _kept_faces(document: Document, scene: Scene, region: str) -> Bools:
    """Faces of a region, (m,)."""
    masks = _named(document, region)
    if not any(mask.any() for mask in masks):
        path = Path(region)
        if not path.is_file():
            raise ValueError(
                f"keep: {region!r} must be a file of polygon numbers, or the name of a mesh, a "
                "material or a property of PLY faces"
            )
        masks = _numbered(document, path)
    return np.concatenate(
        [mask[mesh.repaired.polygon] for mask, mesh in zip(masks, scene.meshes, strict=True)]
    )


def _named(document: Document, name: str) -> list[Bools]:
    """Polygons of what has a name, mesh by mesh."""
    source = document.source
    masks = []
    for mesh in document.meshes:
        mask = np.full(len(mesh.sizes), mesh.name == name)
        for number, material in enumerate(document.materials):
            if material.name == name:
                mask |= mesh.material_of == number
        masks.append(mask)
    if isinstance(source, LooseSource) and source.elements is not None:
        columns = source.elements.elements["face"].columns
        polygons = next(columns[key] for key in _LISTS if key in columns)
        column = columns.get(name)
        if isinstance(polygons, Lists) and isinstance(column, np.ndarray):
            masks[0] |= column[polygons.sizes > 2] != 0
    return masks


def _numbered(document: Document, path: Path) -> list[Bools]:
    """Polygons by their numbers, which count through the meshes."""
    _check_countable(document, "keep", path)
    counts = [len(mesh.sizes) for mesh in document.meshes]
    mask = np.zeros(sum(counts), dtype=np.bool_)
    for line, numbers in _lines(path, "keep"):
        wrong = [number for number in numbers if not 0 <= number < len(mask)]
        if wrong:
            raise ValueError(
                f"keep: {path}, line {line}: polygon {wrong[0]} must be in 0..{len(mask) - 1}"
            )
        mask[numbers] = True
    return np.split(mask, np.cumsum(counts)[:-1])


def _cut_edges(document: Document, scene: Scene, path: Path) -> Bools:
    """Edges of a scene that a file lists, (m, 3)."""
    if path.suffix.lower() == ".obj":
        return _drawn_edges(scene, path)
    _check_countable(document, "seams", path)
    firsts = np.cumsum([0, *(len(mesh.positions) for mesh in document.meshes)])
    # Vertices at one place are one, as those of a glTF file on both sides of an old seam.
    number = np.concatenate(
        [
            first + _first_of_place(mesh.positions)
            for first, mesh in zip(firsts, document.meshes, strict=False)
        ]
    )
    at = np.concatenate(
        [
            first + mesh.corners[placed.repaired.corner].reshape(-1, 3)
            for first, mesh, placed in zip(firsts, document.meshes, scene.meshes, strict=False)
        ]
    )
    lines = _lines(path, "seams")
    for line, numbers in lines:
        wrong = [each for each in numbers if not 0 <= each < len(number)]
        if wrong or len(numbers) < 2:
            what = f"vertex {wrong[0]} must be in 0..{len(number) - 1}" if wrong else "two vertices"
            raise ValueError(
                f"seams: {path}, line {line}: {what if wrong else 'must have at least ' + what}"
            )
    return _edges_of_paths(
        number[at], [_Path(line, numbers, numbers) for line, numbers in lines], number, path
    )


def _drawn_edges(scene: Scene, path: Path) -> Bools:
    """Edges that an OBJ file draws as lines, found by their places."""
    places: list[list[float]] = []
    lines: list[_Path] = []
    for line, words in enumerate(_text(path, "seams").splitlines(), start=1):
        parts = words.partition("#")[0].split()
        try:
            if parts[:1] == ["v"]:
                place = [float(word) for word in parts[1:4]]
                if len(place) < 3 or not all(map(math.isfinite, place)):
                    raise ValueError
                places.append(place)
            elif parts[:1] == ["l"]:
                written = [int(word.partition("/")[0]) for word in parts[1:]]
                numbers = [n - 1 if n > 0 else len(places) + n for n in written]
                if not all(0 <= n < len(places) for n in numbers):
                    raise ValueError
                lines.append(_Path(line, written, numbers))
        except ValueError:
            raise ValueError(f"seams: {path}, line {line}: cannot be read") from None
    if not lines:
        raise ValueError(f"seams: {path} must have lines, elements l")
    number = _first_of_place(scene.vertices)
    extent = float(np.ptp(scene.vertices, axis=0).max())
    distance, nearest = cKDTree(scene.vertices).query(np.array(places).reshape(-1, 3))
    used = np.unique([n for each in lines for n in each.vertices])
    far = distance[used] > _SAME_PLACE * extent
    if far.any():
        raise ValueError(f"seams: {path}: no vertex is where its vertex {used[far][0] + 1} is")
    return _edges_of_paths(number[scene.faces], lines, number[nearest], path)


@dataclass(frozen=True)
class _Path:
    """A path of vertices in a line of a file: as it is written there, and counted from 0."""

    line: int
    written: Sequence[int]
    vertices: Sequence[int]


def _edges_of_paths(at: Ints, paths: Sequence[_Path], number: Ints, file: Path) -> Bools:
    """Edges along paths of vertices."""
    pairs = [pair for each in paths for pair in pairwise(each.vertices)]
    ends = number[np.array(pairs, dtype=np.int64).reshape(-1, 2)]
    try:
        return half_edges(at, ends, int(number.max(initial=0)) + 1 + int(at.max(initial=0)))
    except NoEdgeError as error:
        steps = [(each.line, *step) for each in paths for step in pairwise(each.written)]
        line, a, b = steps[error.row]
        raise ValueError(f"seams: {file}, line {line}: no edge joins {a} and {b}") from None


def _first_of_place(positions: Floats) -> Ints:
    """For each vertex the first that is at its place."""
    _, first, inverse = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    number: Ints = first[inverse.reshape(-1)]
    return number


def _check_countable(document: Document, option: str, path: Path) -> None:
    """Refuse numbers where the meshes of an OBJ file have others than its text."""
    if isinstance(document.source, ObjSource) and len(document.meshes) > 1:
        other = "lines of an OBJ file" if option == "seams" else "names of materials or objects"
        raise ValueError(
            f"{option}: {path} must not have numbers where an OBJ file has objects, but {other}"
        )


def _lines(path: Path, option: str) -> list[tuple[int, list[int]]]:
    """Whole numbers of each line of a text file that has some; what follows # is a comment."""
    found = []
    for line, words in enumerate(_text(path, option).splitlines(), start=1):
        parts = words.partition("#")[0].replace(",", " ").split()
        try:
            numbers = [int(part) for part in parts]
        except ValueError:
            raise ValueError(
                f"{option}: {path}, line {line}: must have whole numbers alone"
            ) from None
        if numbers:
            found.append((line, numbers))
    if not found:
        raise ValueError(f"{option}: {path} must have numbers")
    return found


def _text(path: Path, option: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"{option}: {path} must be a text file") from None
