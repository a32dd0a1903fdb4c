"""Files whose polygons share several textures: materials for each page, or UDIM tiles."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

import gltf_samples
from phaseatlas.scene.document import read_document
from phaseatlas.scene.gltf_slots import indices
from phaseatlas.scene.mesh import Corners
from phaseatlas.scene.paged import Pages
from phaseatlas.scene.sources import as_ply

OBJ = """# Two materials, a comment and a face of none.
mtllib old.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
v 2 1 0
v 3 0 0
v 3 1 0
o first
f 1 2 3 4
usemtl red
f 2 5 6
f 2 6 3
o second
usemtl blue
f 5 7 8 \\
 6
usemtl red
f 7 5 1
"""
PAGE_OF_OBJ = [[0, 1, 0], [1, 1]]
TITLES = [["OUT.1001", "red.1002", "red.1001"], ["blue.1002", "red.1002"]]
IMAGES = tuple(np.full((4, 4, 3), colour, dtype=np.uint8) for colour in (40, 200))


def obj_file(folder):
    path = folder / "in.obj"
    path.write_text(OBJ)
    (folder / "old.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\nd 0.5\n")
    return read_document(path)


def uvs_of(document, seed=0):
    """Coordinates of single precision, another one at each corner."""
    numbers = np.random.default_rng(seed)
    found = [numbers.random((len(m.corners), 2)) for m in document.meshes]
    return [np.round(uv * 2**12) / 2**12 for uv in found]


def titles(document):
    names = [material.name for material in document.materials]
    return [[names[k] for k in mesh.material_of] for mesh in document.meshes]


def colour(material):
    return np.asarray(Image.open(io.BytesIO(material.texture.data)).convert("RGB"))[0, 0, 0]


@pytest.fixture
def pages():
    return Pages(tuple(np.array(of) for of in PAGE_OF_OBJ), IMAGES)


def test_an_obj_file_has_a_material_for_each_page(tmp_path, pages):
    document = obj_file(tmp_path)
    uvs = uvs_of(document)
    document.save(tmp_path / "OUT.obj", uvs, pages=pages)
    again = read_document(tmp_path / "OUT.obj")
    assert titles(again) == TITLES
    for k, mesh in enumerate(again.meshes):
        np.testing.assert_array_equal(mesh.corners, document.meshes[k].corners)
        np.testing.assert_allclose(again.corners(k).uvs[0], uvs[k], atol=1e-8)
    for material in again.materials:
        assert colour(material) == (40 if material.name.endswith("1001") else 200)
    text = (tmp_path / "OUT.obj").read_text()
    assert text.count("usemtl") == 5
    assert "# Two materials, a comment" in text
    assert "d 0.5" in (tmp_path / "OUT.mtl").read_text()


def test_materials_are_split_without_textures_too(tmp_path):
    document = obj_file(tmp_path)
    pages = Pages(tuple(np.array(of) for of in PAGE_OF_OBJ))
    document.save(tmp_path / "OUT.obj", uvs_of(document), pages=pages)
    assert titles(read_document(tmp_path / "OUT.obj")) == TITLES
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_an_obj_file_becomes_a_gltf_file_of_pages(tmp_path, pages, suffix):
    document = obj_file(tmp_path)
    uvs = uvs_of(document)
    document.save(tmp_path / f"OUT{suffix}", uvs, pages=pages)
    again = read_document(tmp_path / f"OUT{suffix}")
    assert {name for names in titles(again) for name in names} == {
        name for names in TITLES for name in names
    }
    for k, (mesh, of) in enumerate(zip(again.meshes, PAGE_OF_OBJ, strict=True)):
        # Every corner is in its picture.
        names = [again.materials[number].name for number in mesh.material_of]
        found = {
            (round(u * 4096), round(v * 4096), name[-4:] == "1002")
            for (u, v), name in zip(again.corners(k).uvs[0], np.repeat(names, 3), strict=True)
        }
        sizes = document.meshes[k].sizes
        wanted = {
            (round(u * 4096), round(v * 4096), bool(page))
            for (u, v), page in zip(uvs[k], np.repeat(of, sizes), strict=True)
        }
        assert found == wanted
    for material in again.materials:
        assert colour(material) == (40 if material.name.endswith("1001") else 200)


@pytest.mark.parametrize("uv_set", [None, 0, 1])
def test_primitives_are_split_and_keep_what_they_carry(tmp_path, uv_set):
    json, blob = gltf_samples.character()
    (tmp_path / "in.glb").write_bytes(gltf_samples.glb(json, blob))
    document = read_document(tmp_path / "in.glb")
    uvs = uvs_of(document)
    pages = Pages(tuple(np.arange(len(mesh.sizes)) % 2 for mesh in document.meshes), IMAGES)
    document.save(tmp_path / "OUT.glb", uvs, uv_set=uv_set, pages=pages)
    new, _ = gltf_samples.parse((tmp_path / "OUT.glb").read_bytes())
    at = uv_set or 0
    for mesh, before in zip(new["meshes"], json["meshes"], strict=True):
        for primitive in mesh["primitives"]:
            if primitive.get("mode", 4) != 4:
                continue
            material = new["materials"][primitive["material"]]
            reference = material["pbrMetallicRoughness"]["baseColorTexture"]
            assert reference["texCoord"] == at
            assert f"TEXCOORD_{at}" in primitive["attributes"]
        old_targets = [len(p.get("targets", [])) for p in before["primitives"]]
        assert {len(p.get("targets", [])) for p in mesh["primitives"]} == set(old_targets)
    assert new.get("skins") is not None
    assert len(new["skins"]) == len(json["skins"])
    again = read_document(tmp_path / "OUT.glb")
    for k, mesh in enumerate(again.meshes):
        old = document.meshes[k]
        assert len(mesh.sizes) == len(old.sizes)

        def triangles(mesh, uv, page):
            rows = np.column_stack([mesh.positions[mesh.corners], uv, np.repeat(page, 3)])
            rows = rows.reshape(-1, 18).round(5)
            return rows[np.lexsort(rows.T)]

        names = [again.materials[number].name for number in mesh.material_of]
        found = triangles(
            mesh, again.corners(k).uvs[at], [int(name.endswith("1002")) for name in names]
        )
        np.testing.assert_allclose(found, triangles(old, uvs[k], pages.of[k]), atol=2e-5)
    for material in again.materials:
        if material.texture is not None and material.name.endswith(("1001", "1002")):
            assert colour(material) == (40 if material.name.endswith("1001") else 200)


def test_a_ply_file_has_no_pages_but_tiles(tmp_path, pages):
    document = obj_file(tmp_path)
    made = as_ply(tmp_path / "in.ply", document.meshes, [Corners()] * 2, uvs_of(document), None)
    (tmp_path / "in.ply").write_bytes(made.files[tmp_path / "in.ply"])
    ply = read_document(tmp_path / "in.ply")
    whole = Pages((np.concatenate(pages.of),), IMAGES)
    (uv,) = uvs_of(ply)
    with pytest.raises(ValueError, match=r"pages: .* has one texture"):
        ply.save(tmp_path / "OUT.ply", [uv], pages=whole)
    assert not (tmp_path / "OUT.ply").exists()
    ply.save(
        tmp_path / "OUT.ply",
        [uv + np.array([1.0, 0.0])],
        tiles=[{"base": image} for image in IMAGES],
    )
    assert b"TextureFile OUT.<UDIM>.png" in (tmp_path / "OUT.ply").read_bytes()
    np.testing.assert_allclose(
        read_document(tmp_path / "OUT.ply").corners(0).uvs[0], uv + np.array([1.0, 0.0]), atol=1e-6
    )
    ply.save(tmp_path / "PAGES.obj", [uv], pages=whole)
    assert {name for names in titles(read_document(tmp_path / "PAGES.obj")) for name in names} == {
        "PAGES.1001",
        "PAGES.1002",
    }


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_tiles_are_pictures_beside_the_file(tmp_path, pages, suffix):
    document = obj_file(tmp_path)
    uvs = [
        uv + np.repeat(of, mesh.sizes)[:, None] * [1.0, 0.0]
        for uv, of, mesh in zip(uvs_of(document), pages.of, document.meshes, strict=True)
    ]
    notes = document.save(
        tmp_path / f"OUT{suffix}", uvs, tiles=[{"base": image} for image in IMAGES]
    )
    again = read_document(tmp_path / f"OUT{suffix}")
    assert {path.name for path in tmp_path.glob("*.png")} == {"OUT.1001.png", "OUT.1002.png"}
    for number, image in zip((1001, 1002), IMAGES, strict=True):
        np.testing.assert_array_equal(Image.open(tmp_path / f"OUT.{number}.png"), image)
    reached = np.concatenate([again.corners(k).uvs[0] for k in range(2)])
    assert set(np.floor(reached[:, 0]).astype(int)) == {0, 1}
    if suffix == ".obj":
        np.testing.assert_allclose(reached, np.concatenate(uvs), atol=1e-8)
        text = (tmp_path / "OUT.mtl").read_text()
        assert text.count("map_Kd OUT.<UDIM>.png") == text.count("newmtl") > 0
    else:
        assert any("glTF has no UDIM tiles" in note for note in notes)
        assert all(material.texture is None for material in again.materials)


@pytest.mark.parametrize(("most", "size"), [(65534, 2), (65535, 4)])
def test_indices_of_two_bytes_are_none_that_restarts_a_strip(most, size):
    made = indices(np.array([[0, 1, most]]))
    assert made.values.dtype.itemsize == size
    assert made.values.reshape(-1).tolist() == [0, 1, most]
