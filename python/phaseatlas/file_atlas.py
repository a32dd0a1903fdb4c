"""From a file of meshes to the same file with an atlas, in one call."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from ._core import __version__
from .atlas import Atlas, build_atlas
from .atlas.pages import PackOptions
from .atlas_options import AtlasOptions, check_saved, check_solved, files_of
from .file_textures import CHECKER, notes_of, read_texture, textures_of, with_textures
from .partitioning import Partition, partition
from .quality import QualityWarning
from .reopened import Reopened, reopen
from .scene.check import check_layout
from .scene.cut import cut_document
from .scene.describe import defects
from .scene.document import check_suffix, read_document, write_contents
from .scene.mesh import Contents
from .scene.rebake import has_textures
from .scene.scene import NoAreaError, Scene, no_places, scene_file, scene_in
from .scene.wishes import granted
from .segmentation import SceneSegmentation
from .segmentation.segment import segment

__all__ = ["CHECKER", "AtlasOptions", "FileAtlas", "atlas_file"]

_PAGE = ".html"
_SAVED = ".npz"


@dataclass(frozen=True, eq=False)
class FileAtlas:
    """What was made of a file.

    Attributes
    ----------
    source, output : Path
        The file that was read, and the one that was written.
    options : AtlasOptions
    scene : Scene or None
        The repaired meshes; None where no face has an area, and with it the next three. With `cut`
        those of the new mesh.
    segmentation : SceneSegmentation or None
    atlas : Atlas or None
    before : Scene or None
        The repaired meshes of the file; another scene than `scene` with `cut` alone.
    files : tuple of Path
        All files that were written.
    notes : tuple of str
        Sentences about what the output cannot hold, or about what was made.
    warnings : tuple of str
        What is worse than asked for.
    seconds : float
        What it took.
    """

    source: Path
    output: Path
    options: AtlasOptions
    scene: Scene | None
    segmentation: SceneSegmentation | None
    atlas: Atlas | None
    before: Scene | None = None
    files: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0

    def record(self) -> dict[str, Any]:
        """Return what JSON can hold of it.

        Returns
        -------
        dict
            - ``input``, ``output``: paths; ``files``: all that were written.
            - ``version``: of the package.
            - ``options``: those that were not left at their defaults.
            - ``pieces``, ``segments``, ``charts``: numbers of connected pieces, segments, charts.
            - ``pages``, ``resolution``: number of textures and their side in texels; ``density``:
              texels a unit length of the surface.
            - ``shares``: part of the area of each segment, which sum to 1.
            - ``energy``: of a file of one piece cut into charts by energy, the ``energy``,
              ``seam``, ``cuts`` and ``distortion`` of `partition`; else None.
            - ``metrics``: as `Atlas.metrics`; empty where no face has an area.
            - ``flaws``: as `Atlas.diagnostics`.
            - ``defects``: number of each kind that was repaired; see `scene.repair.RepairReport`.
            - ``notes``, ``warnings``: sentences.
            - ``seconds``: what it took.
        """
        found: dict[str, Any] = {
            "input": str(self.source),
            "output": str(self.output),
            "files": [str(path) for path in self.files],
            "version": __version__,
            "options": self.options.given(),
            "pieces": 0,
            "segments": 0,
            "charts": 0,
            "pages": 0,
            "resolution": 0,
            "density": 0.0,
            "shares": [],
            "energy": None,
            "metrics": {},
            "flaws": {},
            "defects": {},
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            "seconds": self.seconds,
        }
        if self.segmentation is not None and self.atlas is not None:
            parts = self.segmentation.parts
            found |= {
                "pieces": len(parts),
                "segments": self.segmentation.n_segments,
                "charts": len(self.atlas.charts),
                "pages": self.atlas.n_pages,
                "resolution": self.atlas.resolution,
                "density": self.atlas.density,
                "shares": (self.segmentation.areas / self.segmentation.surface.area).tolist(),
                "metrics": self.atlas.metrics(),
                "flaws": asdict(self.atlas.diagnostics),
                "defects": {} if self.before is None else defects(self.before.report),
            }
            if len(parts) == 1 and isinstance(parts[0], Partition) and parts[0].diagnostics:
                last = parts[0].diagnostics[-1]
                names = ("energy", "seam", "cuts", "distortion")
                found["energy"] = {name: getattr(last, name) for name in names}
        return found


def atlas_file(
    source: str | PathLike[str],
    output: str | PathLike[str],
    options: AtlasOptions | None = None,
    *,
    executor: Executor | None = None,
    progress: Callable[[Any], None] | None = None,
) -> FileAtlas:
    """Give all meshes of a file one atlas, and write the file with the new texture coordinates.

    The file keeps all else that it holds. What is written has been checked: every face has its
    place, none is turned over, no texel is covered twice.

    Parameters
    ----------
    source : str or PathLike
        A GLB, glTF, OBJ, PLY, STL or OFF file, or an `.npz` file of segments or an atlas, which
        are solved: options of the solve are refused.
    output : str or PathLike
        A `.glb`, `.gltf` or `.obj` file; `.ply` where the source is a PLY, STL or OFF file; `.npz`
        for the atlas alone, to be baked, packed or flattened in another way; `.html` for a page
        that shows it, with the file's own textures where none is given. Written whole or not at
        all.
    options : AtlasOptions, optional
    executor : concurrent.futures.Executor, optional
        Runs the nodes of a level and the pieces side by side; the result does not depend on it.
    progress : callable, optional
        Called with each `Phase` of `partition`, or the `Progress` of `segment`.

    Returns
    -------
    FileAtlas

    Raises
    ------
    ValueError
        For a file or an image that cannot be read, an output of another suffix, and a layout that
        must not be written.
    OSError
        For files that cannot be read or written.

    Warns
    -----
    QualityWarning
        Of a result that is worse than asked for.
    """
    source, output = Path(source), Path(output)
    options = AtlasOptions() if options is None else options
    check_suffix(source, output, _SAVED, _PAGE)
    if output.suffix.lower() == _SAVED:
        check_saved(options)
    _check_kept([output], source, options)
    start = time.perf_counter()
    with _heard() as said:
        made = _made(source, output, options, executor, progress)
    for message in said:
        warnings.warn(message, QualityWarning, stacklevel=2)
    return replace(made, warnings=tuple(said), seconds=time.perf_counter() - start)


def _made(
    source: Path,
    output: Path,
    options: AtlasOptions,
    executor: Executor | None,
    progress: Callable[[Any], None] | None,
) -> FileAtlas:
    picture = read_texture(options.texture)
    result = FileAtlas(source, output, options, None, None, None)
    found: Reopened | FileAtlas
    if source.suffix.lower() == _SAVED:
        check_solved(options)
        found = reopen(source)
    else:
        found = _solved(result, executor, progress)
        if isinstance(found, FileAtlas):
            return found
    before = found.scene
    if options.cut:
        if found.atlas is not None and found.atlas.stacked.any():
            # Straightened seams are not symmetric.
            raise ValueError("cut: value must not be given for stacked charts")
        document, scene, segmentation = cut_document(
            found.document, found.scene, found.segmentation
        )
        found = Reopened(document, scene, segmentation, None, found.notes)
    # What is saved may get a texture later.
    saved, page = output.suffix.lower() == _SAVED, output.suffix.lower() == _PAGE
    overlap = saved or page or options.texture is not None
    overlap = overlap or options.charts is not None
    scene, atlas = found.scene, _laid_out(found, options, overlap)
    corners = scene.corners(atlas.uv)
    try:
        check_layout(scene, corners, atlas, even=not options.by_tree, udim=options.udim)
    except ValueError as error:
        raise ValueError(f"{source}: {output} is not written: {error}") from error
    result = replace(
        result, scene=scene, segmentation=found.segmentation, atlas=atlas, before=before
    )
    if saved:
        atlas.save(output)
        result = replace(result, files=(output,), notes=found.notes)
        return _save_more(result, atlas, scene)
    if page:
        from .page import html_of

        images, baked = textures_of(
            found.document,
            scene,
            atlas,
            texture=options.texture,
            picture=picture,
            rebaked=options.rebake or (options.texture is None and has_textures(found.document)),
        )
        text = html_of(atlas, title=source.name, image=images or None, of=found.segmentation)
        contents = Contents({output: text.encode()})
        written = _written(result, contents, *found.notes, *notes_of(baked))
        return _save_more(written, atlas, scene)
    contents, notes = with_textures(
        found.document,
        scene,
        atlas,
        output,
        texture=options.texture,
        picture=picture,
        rebaked=options.rebake,
        udim=options.udim,
        uv_set=options.uv_set,
    )
    written = _written(result, contents, *found.notes, *notes)
    return _save_more(written, atlas, scene)


def _solved(
    result: FileAtlas, executor: Executor | None, progress: Callable[[Any], None] | None
) -> Reopened | FileAtlas:
    """Read a file of meshes and cut it into segments; done at once where no face has an area."""
    options = result.options
    document = read_document(result.source)
    try:
        scene = scene_in(document, weld=options.weld, whole=not options.cut)
    except NoAreaError:
        # What has no layout has neither a page nor an atlas to be saved.
        if result.output.suffix.lower() in (_PAGE, _SAVED):
            raise
        if options.weld > 0:
            raise ValueError(f"weld: {options.weld:g} leaves no face with an area") from None
        places = no_places(document.meshes)
        words = "no face has an area: all texture coordinates are 0, and no texture is made"
        contents = document.with_uv(result.output, places, uv_set=options.uv_set)
        return _written(result, contents, words)
    PackOptions(**options.of_packing()).check_area(scene.area)
    if not options.cut:
        scene.file = scene_file(result.source)
    scene = granted(document, scene, options.wishes())
    segmentation = (
        segment(
            scene,
            options.levels,
            shares=options.shares,
            executor=executor,
            progress=progress,
            **options.of_tree(),
        )
        if options.by_tree
        else partition(scene, executor=executor, progress=progress, **options.of_partition())
    )
    return Reopened(document, scene, segmentation)


def _laid_out(found: Reopened, options: AtlasOptions, overlap: bool) -> Atlas:
    """Flatten and pack the segments; what was flattened is packed alone."""
    with warnings.catch_warnings():
        # What is wrong with the layout is said by its check.
        warnings.filterwarnings("ignore", r"(flips|overlap|density): ", QualityWarning)
        if found.atlas is not None and options.flatten is None:
            given = {name for name in options.of_packing() if name in options.given()}
            # What was saved stays where it is, on as many pages, unless it is to be packed anew.
            if not given:
                return found.atlas
            pages = options.pages if "pages" in given else found.atlas.n_pages
            return found.atlas.packed(**{**options.of_packing(), "pages": pages})
        return build_atlas(
            found.segmentation,
            flatten=options.flatten,
            overlap=overlap,
            stack=options.symmetry if options.stack else None,
            **options.of_packing(),
        )


def _save_more(result: FileAtlas, atlas: Atlas, scene: Scene) -> FileAtlas:
    """Write what is asked for beside the output."""
    options, files = result.options, list(result.files)
    if options.charts is not None:
        files.append(Path(options.charts))
        atlas.save_charts(files[-1], padding=options.padding, resolution=atlas.resolution)
    if options.outlines is not None:
        files.append(Path(options.outlines))
        meshes = result.source if scene.file is None else Path(scene.file.path)
        metres = meshes.suffix.lower() in (".glb", ".gltf")
        atlas.outlines().save(files[-1], unit=options.unit or ("m" if metres else "mm"))
    return replace(result, files=tuple(files))


def _check_kept(files: Iterable[Path], source: Path, options: AtlasOptions) -> None:
    """Refuse to write what is read."""
    read = {path.resolve() for path in (source, *files_of(options))}
    for path in files:
        if path.resolve() in read:
            raise ValueError(f"output: {path} would overwrite an input")


def _written(result: FileAtlas, contents: Contents, *notes: str) -> FileAtlas:
    """Write the files, whole or not at all."""
    _check_kept(contents.files, result.source, result.options)
    write_contents(contents, result.output)
    return replace(result, files=tuple(contents.files), notes=(*contents.notes, *notes))


@contextmanager
def _heard() -> Iterator[list[str]]:
    """Give the list of what the package warns of, for the caller to issue; others are issued."""
    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", QualityWarning)
        try:
            yield said
        finally:
            ours = [w for w in caught if issubclass(w.category, QualityWarning)]
            said += dict.fromkeys(str(w.message) for w in ours)
    for other in caught:
        if other not in ours:
            warnings.warn_explicit(other.message, other.category, other.filename, other.lineno)
