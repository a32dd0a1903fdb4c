"""Whole runs on files: several pages, UDIM tiles, a density, textures moved onto pages."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.scene.document import read_document


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A torus with a smooth texture in one image."""
    folder = tmp_path_factory.mktemp("model")
    surface = datasets.torus(1.0, 0.4, 16, 8)
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.vertices.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (surface.faces + 1).tolist()]
    (folder / "plain.obj").write_text("\n".join(rows) + "\n")
    x, y = np.meshgrid(np.linspace(0, 2 * np.pi, 64), np.linspace(0, 2 * np.pi, 64))
    waves = np.stack([np.sin(x), np.cos(y), np.sin(x + y)], axis=2) * 100 + 128
    Image.fromarray(waves.astype(np.uint8)).save(folder / "waves.png")
    options = pa.AtlasOptions(effort="fast", texture=folder / "waves.png", resolution=512)
    pa.atlas_file(folder / "plain.obj", folder / "model.glb", options)
    return folder / "model.glb"


def seen(document):
    """Middle and colour of each triangle, sorted by the middle; the material of each."""
    (mesh,) = document.meshes
    middles = mesh.positions[mesh.corners].reshape(-1, 3, 3).mean(axis=1)
    uv = document.corners(0).uvs[0].reshape(-1, 3, 2).mean(axis=1)
    colours = np.empty((len(uv), 3))
    for number, material in enumerate(document.materials):
        if material.texture is None:
            continue
        image = np.asarray(Image.open(io.BytesIO(material.texture.data)).convert("RGB"))
        mine = mesh.material_of == number
        row, column = ((1 - uv[:, 1]) * len(image)).astype(int), (uv[:, 0] * len(image)).astype(int)
        colours[mine] = image[row[mine], column[mine]]
    order = np.lexsort(middles.T.round(4))
    return middles[order], colours[order], [document.materials[k].name for k in mesh.material_of]


def test_textures_are_moved_onto_pages(model, tmp_path):
    options = pa.AtlasOptions(effort="fast", rebake=True, pages=2, density=60.0, mips=2)
    made = pa.atlas_file(model, tmp_path / "out.glb", options)
    assert made.atlas.n_pages == 2
    assert made.record()["density"] == pytest.approx(60.0)
    assert made.record()["resolution"] % 4 == 0
    before, after = seen(read_document(model)), seen(read_document(tmp_path / "out.glb"))
    np.testing.assert_allclose(before[0], after[0], atol=1e-5)
    assert np.abs(before[1] - after[1]).mean() < 4
    assert len(set(after[2])) == 2
    assert {name[-5:] for name in after[2]} == {".1001", ".1002"}


def test_textures_are_moved_into_tiles(model, tmp_path):
    options = pa.AtlasOptions(effort="fast", rebake=True, pages=2, udim=True, resolution=256)
    made = pa.atlas_file(model, tmp_path / "out.obj", options)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"out.obj", "out.mtl", "out.1001.png", "out.1002.png"}
    assert {path.name for path in made.files} == names
    (mesh,) = read_document(tmp_path / "out.obj").meshes
    uv = read_document(tmp_path / "out.obj").corners(0).uvs[0].reshape(-1, 3, 2).mean(axis=1)
    colours = np.empty((len(uv), 3))
    for page in range(2):
        image = np.asarray(Image.open(tmp_path / f"out.{1001 + page}.png"))
        mine = np.floor(uv[:, 0]) == page
        assert mine.any()
        row, column = (1 - uv[mine, 1]) * 256, (uv[mine, 0] - page) * 256
        colours[mine] = image[row.astype(int), column.astype(int), :3]
    middles = mesh.positions[mesh.corners].reshape(-1, 3, 3).mean(axis=1)
    before = seen(read_document(model))
    order = np.lexsort(middles.T.round(4))
    np.testing.assert_allclose(before[0], middles[order], atol=1e-5)
    assert np.abs(before[1] - colours[order]).mean() < 4


@pytest.mark.parametrize("options", [{"pages": 2}, {"pages": 3, "udim": True}, {"udim": True}])
def test_a_file_without_textures(model, tmp_path, options):
    made = pa.atlas_file(
        model.parent / "plain.obj", tmp_path / "out.obj", pa.AtlasOptions(effort="fast", **options)
    )
    uv = read_document(tmp_path / "out.obj").corners(0).uvs[0]
    assert not list(tmp_path.glob("*.png"))
    tiles = set(np.floor(uv[:, 0]).astype(int).tolist())
    assert tiles == (set(range(made.atlas.n_pages)) if "udim" in options else {0})


def test_options_that_exclude_each_other():
    for options, words in (
        ({"density": 3.0, "resolution": 64}, "resolution: value must be left out with density"),
        ({"stack": True}, "stack: value must be given with symmetry alone"),
        ({"stack": True, "symmetry": "x", "cut": True}, "stack: value must not be given with cut"),
        ({"density": 9.0, "mips": 10}, "mips: 10 puts 4096 texels between charts, .* most 2048"),
        ({"mips": 6}, "mips: 6 puts 256 texels between charts"),
        ({"pages": 101}, r"pages: 101 must be in 1\.\.100"),
        ({"symmetry": "x", "levels": 1}, "symmetry: value must not be given with levels"),
    ):
        with pytest.raises(ValueError, match=words):
            pa.AtlasOptions(**options)


def test_a_density_without_room_is_refused_before_the_work(model, tmp_path):
    options = pa.AtlasOptions(effort="fast", density=1e6)
    with pytest.raises(ValueError, match=r"density: 1e.06 texels a unit take pages of"):
        pa.atlas_file(model, tmp_path / "out.glb", options)
    assert not list(tmp_path.iterdir())
