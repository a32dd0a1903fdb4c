"""Files as people have them: each gets an atlas, and is the same mesh with it."""

import logging

import numpy as np
import pytest

import phaseatlas as pa
from conftest import MESHES
from phaseatlas import _core
from phaseatlas.cli.app import app
from phaseatlas.scene.document import read_document

CORPUS = MESHES.parent / "corpus"
SUFFIXES = (".obj", ".glb", ".ply", ".stl", ".off")
FILES = (
    sorted(file for file in CORPUS.iterdir() if file.suffix.lower() in SUFFIXES)
    if CORPUS.is_dir()
    else []
)
# What holds no surface, and what is said of it.
WITHOUT_A_SURFACE = {
    "assimp__BoxWithInfinites.glb": "vertex 0 of mesh 'Mesh' is not finite",
    "trimesh__empty_nodes.glb": "an empty scene: there is no mesh",
    "trimesh__points_ascii.ply": "no faces: 5 points alone",
}
# Its only face.
WITHOUT_AN_AREA = "xatlas__zero_area_face.obj"
# Coarse, of several pieces, with flaws, with textures.
SAMPLE = (
    "KayKit-D__barrel_small.gltf.glb",
    "assimp__box_UTF16BE.obj",
    "trimesh__BoxTextured.glb",
    "trimesh__multibody.stl",
    "xatlas__duplicate_edge.obj",
)
# Texels along the side of the raster on which texels are counted.
SIDE = 1024
# Height of a face that single precision cannot tell from none: four units in the last place.
THIN = 4 * 2.0**-24


def each(files):
    missing = pytest.param(None, marks=pytest.mark.skip(reason=f"there is no corpus at {CORPUS}"))
    return pytest.mark.parametrize(
        "file", files or [missing], ids=lambda file: file.name if file else "none"
    )


def run_atlas(file, output, *options):
    """The command in this process, which spares the second that a fresh one takes."""
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    return app(["atlas", str(file), "-o", str(output), *options], standalone_mode=False)


def check_atlas(file, output, *, even):
    """All that must hold of the texture coordinates of a file that was written."""
    before, after = read_document(file), read_document(output)
    uv = np.concatenate([after.corners(k).uvs[0] for k in range(len(after.meshes))])
    assert np.isfinite(uv).all()
    # Eight decimals, or single precision.
    assert uv.min() >= 0
    assert uv.max() <= 1
    if file.name == WITHOUT_AN_AREA:
        return
    scene = pa.load_scene(file)
    counts = [len(mesh.corners) for mesh in before.meshes]
    assert len(uv) == sum(counts)
    parts = np.split(uv, np.cumsum(counts)[:-1])
    faces = np.concatenate(
        [part[mesh.repaired.corner] for part, mesh in zip(parts, scene.meshes, strict=True)]
    )
    # Once the surface is oriented, each chart looks upwards.
    a, b = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    longest = np.linalg.norm(np.roll(faces, -1, axis=1) - faces, axis=2).max(axis=1)
    thin = 2 * np.abs(area) <= THIN * longest
    assert not ((area <= 0) & ~thin).any()
    _, count = _core.rasterize(np.ascontiguousarray(faces), SIDE)
    assert count.max() == 1
    density = np.sqrt(np.abs(area) / scene.face_areas)
    mean = np.sqrt(np.abs(area).sum() / scene.area)
    if even:
        assert scene.face_areas[density < 0.1 * mean].sum() <= 0.02 * scene.area


def check_same_mesh(file, output):
    before, after = read_document(file), read_document(output)
    old, new = (
        [np.concatenate([getattr(m, name) for m in d.meshes]) for name in ("sizes",)]
        + [np.concatenate([m.positions[m.corners] for m in d.meshes])]
        for d in (before, after)
    )
    for a, b in zip(old, new, strict=True):
        np.testing.assert_array_equal(a, b)
    if file.suffix.lower() in (".stl", ".off"):
        return
    for k, (a, b) in enumerate(zip(before.meshes, after.meshes, strict=True)):
        assert (a.name, a.materials) == (b.name, b.materials)
        np.testing.assert_array_equal(a.transforms, b.transforms)
        np.testing.assert_array_equal(a.material_of, b.material_of)
        if file.suffix.lower() == ".glb":
            former, kept = before.corners(k).uvs, after.corners(k).uvs[1:]
            for x, y in zip(former, kept, strict=True):
                np.testing.assert_array_equal(x, y)


def written(folder, file):
    suffix = file.suffix.lower()
    return folder / f"out{'.ply' if suffix in ('.stl', '.off') else suffix}"


@each(FILES)
def test_each_file_gets_an_atlas(file, tmp_path):
    output = written(tmp_path, file)
    if file.name in WITHOUT_A_SURFACE:
        with pytest.raises(ValueError, match=r": ") as caught:
            run_atlas(file, output)
        message = str(caught.value)
        assert message.startswith(f"{file}: {WITHOUT_A_SURFACE[file.name]}")
        assert len(message.splitlines()) == 1
        assert not list(tmp_path.iterdir())
        return
    assert run_atlas(file, output) in (0, None)
    check_atlas(file, output, even=True)
    check_same_mesh(file, output)


@each([file for file in FILES if file.name in SAMPLE])
def test_segments_of_equal_area_are_an_atlas_too(file, tmp_path):
    output = written(tmp_path, file)
    assert run_atlas(file, output, "--levels", "3") in (0, None)
    check_atlas(file, output, even=False)
    check_same_mesh(file, output)
