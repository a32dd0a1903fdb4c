"""Documents: every format read, and the same mesh written with new texture coordinates."""

from __future__ import annotations

import base64
import copy
import json
import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import gltf_samples as samples
from phaseatlas.scene.document import read_document
from phaseatlas.scene.ply_elements import read_elements
from phaseatlas.scene.polygons import triangulate

MESHES = os.environ.get("PHASEATLAS_MESHES", Path(__file__).parents[2] / "shared" / "meshes")
SHARED = Path(MESHES).parent
MADE = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)


def hashed(mesh):
    """Texture coordinates that differ at every corner: all edges are seams."""
    k = np.arange(len(mesh.corners))
    # Multiples of 2^-20 are exact in single precision.
    return np.stack([(k * 40503) % 2**20, (k * 60493 + 11) % 2**20], axis=1) / 2**20


def smooth(mesh):
    """Texture coordinates of the vertices: there is no seam."""
    k = np.arange(len(mesh.positions))
    return (np.stack([k * 40503 % 2**20, k * 7919 % 2**20], axis=1) / 2**20)[mesh.corners]


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def shared_files():
    """Files of the corpus and of the cases, but those that hold no surface."""
    suffixes = (".glb", ".obj", ".ply", ".stl", ".off")
    files = sorted((SHARED / "corpus").glob("*")) + sorted((SHARED / "cases").glob("*"))
    without = {"draco.glb", "assimp__BoxWithInfinites.glb", "trimesh__empty_nodes.glb"}
    without.add("trimesh__points_ascii.ply")
    return [f for f in files if f.suffix.lower() in suffixes and f.name not in without]


each_shared_file = pytest.mark.parametrize(
    "file",
    shared_files()
    or [pytest.param(None, marks=pytest.mark.skip(reason=f"there is no corpus in {SHARED}"))],
    ids=lambda file: file.name if file else "none",
)


def refusal(path):
    with pytest.raises(ValueError, match=r": ") as caught:
        read_document(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert len(message.splitlines()) == 1
    return message[len(f"{path}: ") :]


# glTF


def check_gltf(before, after, uvs, uv_set=None):
    """All that a glTF file holds of its triangles, corner by corner."""
    old, old_blob = before
    new, new_blob = after
    at = 0 if uv_set is None else uv_set
    for i, mesh in enumerate(old.get("meshes", [])):
        k = 0
        for j, primitive in enumerate(mesh["primitives"]):
            made = new["meshes"][i]["primitives"][j]
            a = samples.corners(primitive, old, old_blob)
            if not len(a):
                assert made.get("mode") == primitive["mode"]
                continue
            b = samples.corners(made, new, new_blob)
            assert len(a) == len(b)
            holders = [(primitive["attributes"], made["attributes"])]
            holders += zip(primitive.get("targets", []), made.get("targets", []), strict=True)
            for old_holder, new_holder in holders:
                for name, accessor in old_holder.items():
                    if name == f"TEXCOORD_{uv_set}":
                        continue
                    moved = name
                    if name.startswith("TEXCOORD_") and uv_set is None:
                        moved = f"TEXCOORD_{int(name[9:]) + 1}"
                    found = samples.values(new, new_blob, new_holder[moved])
                    expected = samples.values(old, old_blob, accessor)
                    assert found.dtype == expected.dtype
                    np.testing.assert_array_equal(found[b], expected[a])
                    counts = {new["accessors"][x]["count"] for x in new_holder.values()}
                    assert len(counts) == 1
            uv = samples.values(new, new_blob, made["attributes"][f"TEXCOORD_{at}"])[b]
            expected = uvs[i][k : k + len(a)] * [1, -1] + [0, 1]
            np.testing.assert_array_equal(uv, expected.astype(np.float32))
            k += len(a)


def without_data(document):
    """The JSON without what new coordinates change."""
    rest = copy.deepcopy(document)
    for key in ("accessors", "bufferViews", "buffers", "animations", "skins", "images"):
        rest.pop(key, None)
    for mesh in rest.get("meshes", []):
        for primitive in mesh["primitives"]:
            for key in ("attributes", "targets", "indices", "mode"):
                primitive.pop(key, None)
    return rest


def in_document(document, blob):
    """Data of animations, skins and images, wherever it is."""
    found = []
    for animation in document.get("animations", []):
        found.append(animation["name"])
        for sampler in animation["samplers"]:
            found += [samples.values(document, blob, sampler[key]) for key in ("input", "output")]
    for skin in document.get("skins", []):
        found += [skin["joints"], samples.values(document, blob, skin["inverseBindMatrices"])]
    for image in document.get("images", []):
        view = document["bufferViews"][image["bufferView"]]
        start = view["byteOffset"]
        found.append(blob[start : start + view["byteLength"]])
    return found


@pytest.mark.parametrize("coordinates", [hashed, smooth])
@pytest.mark.parametrize("uv_set", [None, 0, 1, 2])
def test_a_character_keeps_all_it_has(tmp_path, coordinates, uv_set):
    before = samples.character()
    document = read_document(written(tmp_path / "a.glb", samples.glb(*before)))
    (mesh,) = document.meshes
    assert mesh.name == "Körper"
    assert (mesh.uv_sets, mesh.vertex_colours, mesh.materials) == (2, True, ("skin",))
    uvs = [coordinates(mesh)]
    assert document.save(tmp_path / "b.glb", uvs, uv_set=uv_set) == ()
    after = samples.parse((tmp_path / "b.glb").read_bytes())
    check_gltf(before, after, uvs, uv_set)
    for x, y in zip(in_document(*before), in_document(*after), strict=True):
        np.testing.assert_array_equal(x, y)
    expected = without_data(before[0])
    if uv_set is None:
        skin = expected["materials"][0]
        skin["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1
        skin["normalTexture"]["texCoord"] = 2
        skin["emissiveTexture"]["texCoord"] = 1
        skin["emissiveTexture"]["extensions"]["KHR_texture_transform"]["texCoord"] = 2
        skin["extensions"]["KHR_materials_clearcoat"]["clearcoatNormalTexture"]["texCoord"] = 1
    assert without_data(after[0]) == expected
    primitive = after[0]["meshes"][0]["primitives"][0]
    count = after[0]["accessors"][primitive["attributes"]["POSITION"]]["count"]
    assert count == (10 if coordinates is smooth else 24)


def test_old_data_goes_and_files_do_not_grow(tmp_path):
    path = written(tmp_path / "a.glb", samples.glb(*samples.character()))
    sizes = []
    for _ in range(3):
        document = read_document(path)
        document.save(path, [hashed(mesh) for mesh in document.meshes], uv_set=0)
        sizes.append(path.stat().st_size)
    assert sizes[0] == sizes[1] == sizes[2]


def test_a_gap_in_the_sets_is_refused(tmp_path):
    document = read_document(written(tmp_path / "a.glb", samples.glb(*samples.character())))
    uvs = [hashed(mesh) for mesh in document.meshes]
    with pytest.raises(ValueError, match=r"^uv_set: 3 must be in \[0, 2\]: .*'Körper' has 2$"):
        document.save(tmp_path / "b.glb", uvs, uv_set=3)
    assert not (tmp_path / "b.glb").exists()


def modes(build):
    """Primitives of all kinds: a strip, a fan, no indices, points, a shared accessor, sparse."""
    rng = np.random.default_rng(3)
    points = build.add(rng.random((6, 3)).astype(np.float32))
    texture = build.add(rng.random((6, 2)).astype(np.float32))
    both = {"POSITION": points, "TEXCOORD_0": texture}
    order = build.add(np.array([5, 3, 1, 0, 2, 4], dtype=np.uint16))
    half = build.add(np.array([0, 1, 2, 0, 2, 3], dtype=np.uint16))
    return [
        {"attributes": dict(both), "mode": 5, "indices": order},
        {"attributes": dict(both), "mode": 6},
        {"attributes": {"POSITION": points}},
        {"attributes": dict(both), "mode": 0},
        {"attributes": dict(both), "mode": 3},
        {"attributes": dict(both), "indices": half},
    ]


@pytest.mark.parametrize("coordinates", [hashed, smooth])
def test_strips_fans_loose_triangles_points_and_shared_accessors(tmp_path, coordinates):
    build = samples.Builder()
    primitives = modes(build)
    before = build.document(meshes=[{"primitives": primitives}], nodes=[{"mesh": 0}]), build.blob
    document = read_document(written(tmp_path / "a.glb", samples.glb(*before)))
    (mesh,) = document.meshes
    assert len(mesh.sizes) == 4 + 4 + 2 + 2
    # Primitives share their positions.
    assert len(mesh.positions) == 6
    uvs = [coordinates(mesh)]
    document.save(tmp_path / "b.glb", uvs)
    after = samples.parse((tmp_path / "b.glb").read_bytes())
    check_gltf(before, after, uvs)
    made = after[0]["meshes"][0]["primitives"]
    for primitive in (made[3], made[4]):
        attributes = primitive["attributes"]
        assert attributes["TEXCOORD_0"] == attributes["TEXCOORD_1"]
    # Only the four vertices that it uses are repeated for the last one.
    count = after[0]["accessors"][made[5]["attributes"]["POSITION"]]["count"]
    assert count == 6
    again = read_document(tmp_path / "b.glb")
    np.testing.assert_array_equal(
        again.meshes[0].positions[again.meshes[0].corners], mesh.positions[mesh.corners]
    )


def test_sparse_and_quantised_positions(tmp_path):
    build = samples.Builder()
    whole = build.add(np.zeros((4, 3), dtype=np.float32))
    where = build.view(np.array([1, 2, 3], dtype=np.uint16).tobytes())
    what = build.view(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32).tobytes())
    build.accessors[whole]["sparse"] = {
        "count": 3,
        "indices": {"bufferView": where, "componentType": 5123},
        "values": {"bufferView": what},
    }
    short = np.array([[0, 0, 0], [127, 0, 0], [0, -128, 0], [0, 0, 64]], dtype=np.int8)
    small = build.add(short, normalized=True)
    plain = build.add(short)
    faces = build.add(np.array([0, 1, 2, 0, 2, 3], dtype=np.uint8))
    meshes = [
        {"primitives": [{"attributes": {"POSITION": k}, "indices": faces}]}
        for k in (whole, small, plain)
    ]
    data = samples.glb(build.document(meshes=meshes), build.blob)
    document = read_document(written(tmp_path / "a.glb", data))
    expected = [
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 0, 64 / 127]],
        short,
    ]
    for mesh, positions in zip(document.meshes, expected, strict=True):
        np.testing.assert_array_equal(mesh.positions, positions)
        np.testing.assert_array_equal(mesh.transforms, [np.eye(4)])
    document.save(tmp_path / "b.glb", [hashed(mesh) for mesh in document.meshes])
    again = read_document(tmp_path / "b.glb")
    for old, new in zip(document.meshes, again.meshes, strict=True):
        np.testing.assert_array_equal(old.positions[old.corners], new.positions[new.corners])
        assert new.uv_sets == 1


def test_world_matrices_of_instances(tmp_path):
    build = samples.Builder()
    points = build.add(np.eye(3, dtype=np.float32))
    nodes = [
        {"mesh": 0, "translation": [1, 2, 3], "rotation": [0, 0, 0.6, 0.8], "scale": [1, 2, 3]},
        {"children": [2, 0], "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]},
        {"mesh": 0, "scale": [-1, 1, 1]},
    ]
    content = build.document(meshes=[{"primitives": [{"attributes": {"POSITION": points}}]}])
    content |= {"nodes": nodes, "scenes": [{"nodes": [1]}], "scene": 0}
    path = written(tmp_path / "a.glb", samples.glb(content, build.blob))
    (mesh,) = read_document(path).meshes
    scene = trimesh.load(path)
    expected = [scene.graph.get(name)[0] for name in scene.graph.nodes_geometry]
    order = [int(np.argmin([np.abs(t - e).max() for t in mesh.transforms])) for e in expected]
    assert sorted(order) == [0, 1]
    np.testing.assert_allclose(mesh.transforms[order], expected, atol=1e-12)


def test_gltf_with_files_beside_it(tmp_path):
    document, blob = samples.character()
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    picture = blob[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    document["images"] = [{"uri": "textures/a%20b.png"}, {"uri": "gone.png"}]
    document["buffers"][0]["uri"] = "data.bin"
    source, target = tmp_path / "in", tmp_path / "out"
    (source / "textures").mkdir(parents=True)
    target.mkdir()
    written(source / "a.gltf", json.dumps(document))
    written(source / "data.bin", blob)
    written(source / "textures" / "a b.png", picture)
    read = read_document(source / "a.gltf")
    uvs = [hashed(mesh) for mesh in read.meshes]
    notes = read.save(target / "b.gltf", uvs)
    assert notes == ("the texture gone.png is missing",)
    assert (target / "textures" / "a b.png").read_bytes() == picture
    after = json.loads((target / "b.gltf").read_text())
    assert after["buffers"][0]["uri"] == "b.bin"
    assert after["images"] == document["images"]
    check_gltf((document, blob), (after, (target / "b.bin").read_bytes()), uvs)
    read.save(target / "c.glb", uvs)
    after = samples.parse((target / "c.glb").read_bytes())
    assert "uri" not in after[0]["images"][0]
    assert after[0]["images"][1]["uri"] == "gone.png"
    check_gltf((document, blob), after, uvs)
    view = after[0]["bufferViews"][after[0]["images"][0]["bufferView"]]
    start = view["byteOffset"]
    assert after[1][start : start + view["byteLength"]] == picture


def test_a_buffer_in_a_data_uri_stays_one(tmp_path):
    document, blob = samples.character()
    uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    document["buffers"][0]["uri"] = uri
    read = read_document(written(tmp_path / "a.gltf", json.dumps(document)))
    uvs = [hashed(mesh) for mesh in read.meshes]
    read.save(tmp_path / "b.gltf", uvs)
    assert not (tmp_path / "b.bin").exists()
    after = json.loads((tmp_path / "b.gltf").read_text())
    new = base64.b64decode(after["buffers"][0]["uri"].partition(",")[2])
    check_gltf((document, blob), (after, new), uvs)


def test_a_texture_becomes_the_base_colour(tmp_path):
    document, blob = samples.character()
    document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.1, 0.2, 0.3, 0.5]
    read = read_document(written(tmp_path / "a.glb", samples.glb(document, blob)))
    read.save(tmp_path / "b.glb", [hashed(mesh) for mesh in read.meshes], image=MADE)
    after, _ = samples.parse((tmp_path / "b.glb").read_bytes())
    pbr = after["materials"][0]["pbrMetallicRoughness"]
    assert pbr["baseColorFactor"] == [1.0, 1.0, 1.0, 0.5]
    assert pbr["baseColorTexture"]["texCoord"] == 0
    assert after["materials"][0]["normalTexture"]["texCoord"] == 2
    again = read_document(tmp_path / "b.glb").materials[0].texture
    written(tmp_path / "c.png", again.data)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "c.png")), MADE)


def test_pygltflib_reads_what_is_written(tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    before = samples.character()
    path = written(tmp_path / "a.glb", samples.glb(*before))
    document = read_document(path)
    document.save(tmp_path / "b.glb", [hashed(mesh) for mesh in document.meshes])
    old, new = (pygltflib.GLTF2().load(str(p)) for p in (path, tmp_path / "b.glb"))
    assert [node.name for node in new.nodes] == [node.name for node in old.nodes]
    for one, other in ((old.nodes, new.nodes), (old.cameras, new.cameras)):
        assert [x.to_dict() for x in one] == [x.to_dict() for x in other]
    assert new.animations[0].channels[0].to_dict() == old.animations[0].channels[0].to_dict()
    assert new.skins[0].joints == old.skins[0].joints
    attributes = new.meshes[0].primitives[0].attributes
    assert new.accessors[attributes.WEIGHTS_0].count == new.accessors[attributes.POSITION].count
    assert len(new.meshes[0].primitives[0].targets) == 2


def malformed():
    build = samples.Builder()
    points = build.add(np.eye(3, dtype=np.float32))
    surface = {"primitives": [{"attributes": {"POSITION": points}}]}

    def file(change):
        document = build.document(meshes=[copy.deepcopy(surface)])
        document = copy.deepcopy(document)
        change(document)
        return document

    def lines(document):
        document["meshes"][0]["primitives"][0]["mode"] = 1

    def extension(name):
        def change(document):
            document["bufferViews"][0]["extensions"] = {name: {}}

        return change

    def draco(document):
        extensions = {"KHR_draco_mesh_compression": {"bufferView": 0}}
        document["meshes"][0]["primitives"][0]["extensions"] = extensions

    return build.blob, [
        (file(lambda d: d.pop("meshes")), "an empty scene: there is no mesh"),
        (file(lines), "no faces: points or lines alone"),
        (file(lambda d: d["buffers"][0].update(uri="no.bin")), "the buffer no.bin is missing"),
        (file(draco), ".*KHR_draco_mesh_compression, cannot be read"),
        (file(extension("EXT_meshopt_compression")), ".*EXT_meshopt_compression, cannot be read"),
        (file(lambda d: d["accessors"][0].update(count=9)), "an accessor reaches past buffer"),
        (file(lambda d: d["accessors"].pop()), "the file is damaged"),
        (file(lambda d: d["asset"].update(version="1.0")), "version 1.0 of glTF is not supported"),
        (file(lambda d: d.pop("asset")), "its JSON is no glTF"),
    ]


@pytest.mark.parametrize("case", range(9))
def test_gltf_without_a_surface_is_refused(tmp_path, case):
    blob, cases = malformed()
    document, reason = cases[case]
    message = refusal(written(tmp_path / "a.glb", samples.glb(document, blob)))
    assert re.match(reason, message), message


def test_a_cut_file_and_infinite_positions_are_refused(tmp_path):
    build = samples.Builder()
    points = np.eye(3, dtype=np.float32)
    points[1, 1] = np.inf
    build.add(points)
    document = build.document(
        meshes=[{"name": "m", "primitives": [{"attributes": {"POSITION": 0}}]}]
    )
    data = samples.glb(document, build.blob)
    assert refusal(written(tmp_path / "a.glb", data)) == "vertex 1 of mesh 'm' is not finite"
    assert refusal(written(tmp_path / "b.glb", data[:-8])) == "the file is cut short"


# OBJ

TEXT = """\
# a cube, more or less
mtllib some.mtl
o first
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 1 1 0 0 0 1
v 0 1 0 1 1 1
vn 0 0 1
vt 0.5 0.5
g left   # a group
usemtl red
s 1
f 1 2 3 4
 f   1/1   2/1/1\t3//1   # comment 1/2/3
vt 0.25 0.25
v 0 0 1
o second
v 1 0 1
v 1 1 1
usemtl blue
f -1/-1/-1 -2/-2/-1 \\
  -3/-1/-1
f 5//1 6//1 7//1 1//1 2//1
l 1/1 2/2 3
f 1/1/1 2/2/1
p 4
g
vp 0.1
f 7/ 6/1/ 5
"""


def edited_lines(before, after):
    """Lines of both but coordinates of textures; those of faces without these."""

    def kept(text):
        lines = text.replace("\\\n", "").replace("\\\r\n", "").split("\n")
        found = []
        for line in lines:
            words = line.split("#")[0].split()
            if words[:1] == ["vt"]:
                continue
            if words[:1] in (["f"], ["l"]):
                parts = [word.split("/") for word in words[1:]]
                line = [words[0], *((p[0], (p[2:] or [""])[0]) for p in parts)]
            found.append(line)
        return found

    assert kept(before) == kept(after)


def obj_corners(text):
    """Texture coordinates at the corners of the faces of an OBJ text, word by word."""
    table, corners = [], []
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["vt"]:
            table.append([float(word) for word in words[1:3]])
        elif words[:1] == ["f"] and len(words) > 3:
            corners += [int(word.split("/")[1]) for word in words[1:]]
    return np.array(table)[np.array(corners) - 1]


@pytest.mark.parametrize("coordinates", [hashed, smooth])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_the_text_of_an_obj_stays(tmp_path, coordinates, end):
    text = TEXT.replace("\n", end)
    document = read_document(written(tmp_path / "a.obj", text))
    first, second = document.meshes
    assert (first.name, second.name) == ("first", "second")
    assert (first.materials, second.materials) == (("red",), ("blue",))
    assert first.sizes.tolist() == [4, 3]
    assert second.sizes.tolist() == [3, 5, 3]
    assert second.corners.tolist()[:3] == [4, 3, 2]
    uvs = [coordinates(mesh) for mesh in document.meshes]
    document.save(tmp_path / "b.obj", uvs)
    after = (tmp_path / "b.obj").read_bytes().decode()
    edited_lines(text, after)
    np.testing.assert_allclose(obj_corners(after), np.concatenate(uvs), rtol=0, atol=5.1e-9)
    faces = [line for line in after.split(end) if line.lstrip().startswith("f")]
    assert faces[0] == "f 1/1 2/2 3/3 4/4"
    vt = {hashed: (5, 6, 7), smooth: (1, 2, 3)}[coordinates]
    assert faces[1] == f" f   1/{vt[0]}   2/{vt[1]}/1\t3/{vt[2]}/1   # comment 1/2/3"
    # All new lines stand before the first face.
    assert after.index(f"{end}f ") > after.rindex(f"{end}vt ")
    assert after.count("\r") == (after.count("\n") if end == "\r\n" else 0)


def test_files_that_an_obj_names_go_with_it(tmp_path):
    source, target = tmp_path / "in", tmp_path / "out"
    (source / "maps").mkdir(parents=True)
    target.mkdir()
    written(source / "a.obj", TEXT)
    written(source / "some.mtl", "newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 maps/red one.png\n")
    Image.fromarray(MADE).save(source / "maps" / "red one.png")
    document = read_document(source / "a.obj")
    assert [m.name for m in document.materials] == ["red", "blue"]
    uvs = [hashed(mesh) for mesh in document.meshes]
    document.save(target / "b.obj", uvs)
    for name in ("some.mtl", "maps/red one.png"):
        assert (target / name).read_bytes() == (source / name).read_bytes()
    written(target / "some.mtl", "another one")
    notes = document.save(target / "c.obj", uvs)
    assert (target / "some.mtl").read_text() == "another one"
    assert any("some.mtl was there" in note for note in notes)


def test_a_texture_for_an_obj_needs_a_library_of_its_own(tmp_path):
    text = TEXT.replace("usemtl red\n", "")
    written(tmp_path / "some.mtl", "newmtl blue\nKd 0 0 1\nd 0.5\nmap_Kd b.png\n")
    written(tmp_path / "b.png", "mine")
    document = read_document(written(tmp_path / "a.obj", text))
    document.save(tmp_path / "b.obj", [hashed(mesh) for mesh in document.meshes], image=MADE)
    assert (tmp_path / "b.png").read_text() == "mine"
    after = (tmp_path / "b.obj").read_text()
    assert after.startswith("mtllib b_atlas.mtl\nusemtl b_atlas\n")
    assert "some.mtl" not in after
    again = read_document(tmp_path / "b.obj")
    assert [m.name for m in again.materials] == ["b_atlas", "blue"]
    assert [m.colour for m in again.materials] == [(1, 1, 1, 1), (1, 1, 1, 0.5)]
    assert all(m.texture is not None for m in again.materials)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1"])
def test_names_and_encodings_of_an_obj(tmp_path, encoding):
    text = TEXT.replace("red", "grün").replace("some.mtl", "größe.mtl")
    document = read_document(written(tmp_path / "a.obj", text.encode(encoding)))
    assert document.meshes[0].materials == ("grün",)
    uvs = [hashed(mesh) for mesh in document.meshes]
    document.save(tmp_path / "b.obj", uvs)
    edited_lines(text, (tmp_path / "b.obj").read_bytes().decode(encoding))
    document.save(tmp_path / "c.glb", uvs)
    assert "grün" in {m.name for m in read_document(tmp_path / "c.glb").materials}


def test_ends_of_old_macintosh_files(tmp_path):
    text = "v 0 0 0\rv 1 0 0\r\rv 0 1 0\rf 1 2 3\r"
    document = read_document(written(tmp_path / "a.obj", text))
    document.save(tmp_path / "b.obj", [hashed(mesh) for mesh in document.meshes])
    after = (tmp_path / "b.obj").read_bytes()
    assert after.startswith(b"v 0 0 0\rv 1 0 0\r\rv 0 1 0\rvt ")
    assert after.endswith(b"\rf 1/1 2/2 3/3\r")


def test_coordinates_outside_of_the_unit_square(tmp_path):
    document = read_document(written(tmp_path / "a.obj", TEXT))
    uvs = [hashed(mesh) * 40 - 20 for mesh in document.meshes]
    document.save(tmp_path / "b.obj", uvs)
    found = obj_corners((tmp_path / "b.obj").read_text())
    np.testing.assert_allclose(found, np.concatenate(uvs), rtol=0, atol=5.1e-9)


def test_many_blocks_of_lines(tmp_path):
    n = 120_000
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", *["vt 0 0", "f 1/1/1 -2/-1 3"] * n, "vn 0 0 1"]
    text = "\n".join(["# long " + "x" * 5_000_000, *lines, "# end without a new line"])
    document = read_document(written(tmp_path / "a.obj", text))
    uvs = [hashed(mesh) for mesh in document.meshes]
    document.save(tmp_path / "b.obj", uvs)
    after = (tmp_path / "b.obj").read_text()
    edited_lines(text, after)
    np.testing.assert_allclose(obj_corners(after), uvs[0], rtol=0, atol=5.1e-9)


# PLY, STL, OFF

PLY = """\
ply
format {form} 1.0
comment made by hand
element vertex 5
property float x
property double y
property float z
property uchar red
property uchar green
property uchar blue
property float quality
property list uchar int rings
element face 3
property int flag
property list uchar uint vertex_index
property list uchar float texcoord
element edge 1
property int vertex1
property int vertex2
end_header
"""
VERTICES = [
    (0, 0, 0, 255, 0, 0, 0.5, [1]),
    (1, 0, 0, 0, 255, 0, 1.5, []),
    (1, 1, 0, 0, 0, 255, 2.5, [2, 3]),
    (0, 1, 0, 9, 9, 9, 3.5, [4]),
    (7, 7, 7, 1, 2, 3, 4.5, [5, 6]),
]
FACES = [(5, [0, 1, 2, 3]), (6, [2, 1, 0]), (7, [0, 3])]


def ply_bytes(form):
    if form == "ascii":
        words = [" ".join(map(str, [*row[:-1], len(row[-1]), *row[-1]])) for row in VERTICES]
        for flag, face in FACES:
            uv = [0.5] * (2 * len(face))
            words.append(" ".join(map(str, [flag, len(face), *face, len(uv), *uv])))
        return (PLY.format(form=form) + "\n".join([*words, "0 3", ""])).encode()
    order = "<" if "little" in form else ">"
    body = b""
    for row in VERTICES:
        body += struct.pack(order + "fdf3Bf", *row[:-1])
        body += struct.pack(f"{order}B{len(row[-1])}i", len(row[-1]), *row[-1])
    for flag, face in FACES:
        body += struct.pack(f"{order}iB{len(face)}I", flag, len(face), *face)
        body += struct.pack(f"{order}B{2 * len(face)}f", 2 * len(face), *[0.5] * (2 * len(face)))
    return PLY.format(form=form).encode() + body + struct.pack(order + "2i", 0, 3)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("coordinates", [hashed, smooth])
def test_a_ply_keeps_its_properties(tmp_path, form, coordinates):
    document = read_document(written(tmp_path / "a.ply", ply_bytes(form)))
    (mesh,) = document.meshes
    assert mesh.corners.tolist() == [0, 1, 2, 3, 2, 1, 0]
    assert mesh.sizes.tolist() == [4, 3]
    assert (mesh.uv_sets, mesh.vertex_colours, len(mesh.positions)) == (1, True, 5)
    uv = coordinates(mesh)
    document.save(tmp_path / "b.ply", [uv])
    again = read_document(tmp_path / "b.ply")
    (other,) = again.meshes
    assert other.sizes.tolist() == [4, 3]
    np.testing.assert_array_equal(other.positions[other.corners], mesh.positions[mesh.corners])
    np.testing.assert_array_equal(other.positions[:5], mesh.positions)
    np.testing.assert_array_equal(again.corners(0).uvs[0], uv.astype(np.float32))
    np.testing.assert_array_equal(again.corners(0).colours, document.corners(0).colours)
    assert len(other.positions) == (8 if coordinates is hashed else 5)
    raw = read_elements((tmp_path / "b.ply").read_bytes()).elements
    assert raw["edge"].columns["vertex2"].tolist() == [3]
    assert raw["vertex"].columns["quality"][:5].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]
    assert raw["vertex"].columns["rings"].sizes[:5].tolist() == [1, 0, 2, 1, 2]
    assert raw["vertex"].columns["rings"].values[:6].tolist() == [1, 2, 3, 4, 5, 6]
    assert raw["face"].columns["flag"].tolist() == [5, 6, 7]
    assert raw["face"].columns["vertex_index"].sizes.tolist() == [4, 3, 2]
    assert b"comment made by hand" in (tmp_path / "b.ply").read_bytes()[:200]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_cut_ply_is_refused(tmp_path, form):
    data = ply_bytes(form)
    message = refusal(written(tmp_path / "a.ply", data[:-40]))
    assert message in ("the file is cut short", "a value is no number")


def test_a_ply_of_triangles_alone(tmp_path):
    sphere = trimesh.creation.icosphere(2)
    sphere.export(tmp_path / "a.ply")
    document = read_document(tmp_path / "a.ply")
    (mesh,) = document.meshes
    np.testing.assert_array_equal(mesh.corners.reshape(-1, 3), sphere.faces)
    document.save(tmp_path / "b.ply", [hashed(mesh)], image=MADE)
    assert b"comment TextureFile b.png\n" in (tmp_path / "b.ply").read_bytes()[:300]
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "b.png")), MADE)
    loaded = trimesh.load(tmp_path / "b.ply", process=False)
    np.testing.assert_array_equal(loaded.triangles, sphere.triangles.astype(np.float32))
    np.testing.assert_array_equal(loaded.visual.uv[loaded.faces.reshape(-1)], hashed(mesh))


@pytest.mark.parametrize("file_type", ["stl", "stl_ascii"])
def test_stl_in_text_and_binary(tmp_path, file_type):
    sphere = trimesh.creation.icosphere(1)
    path = tmp_path / "a.stl"
    written(path, sphere.export(file_type=file_type))
    (mesh,) = read_document(path).meshes
    assert len(mesh.positions) == 42
    triangles = mesh.positions[mesh.corners].reshape(-1, 3, 3)
    np.testing.assert_allclose(triangles, sphere.triangles, rtol=0, atol=1e-7)


def test_solids_of_an_stl_are_meshes(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 {z}\nvertex 1 0 {z}\nvertex 0 1 {z}\n"
    facet += "endloop\nendfacet\n"
    text = "".join(f"solid part {z}\n{facet.format(z=z)}endsolid part {z}\n" for z in (1, 2))
    document = read_document(written(tmp_path / "a.stl", text))
    assert [mesh.name for mesh in document.meshes] == ["part 1", "part 2"]
    document.save(tmp_path / "b.glb", [hashed(mesh) for mesh in document.meshes])
    again = read_document(tmp_path / "b.glb")
    assert [mesh.name for mesh in again.meshes] == ["part 1", "part 2"]
    document.save(tmp_path / "b.ply", [hashed(mesh) for mesh in document.meshes])
    assert len(read_document(tmp_path / "b.ply").meshes[0].sizes) == 2


def test_off_with_colours_quads_and_comments(tmp_path):
    text = """OFF # a comment
4 3 0
0 0 0 255 0 0 255

1 0 0 0 255 0 255
1 1 0 0 0 255 255
0 1 0 0 0 0 51
4 0 1 2 3  9 9 9
3 0 1 2
2 0 1
"""
    document = read_document(written(tmp_path / "a.off", text))
    (mesh,) = document.meshes
    assert mesh.sizes.tolist() == [4, 3]
    assert document.corners(0).colours[3].tolist() == [0, 0, 0, 0.2]
    document.save(tmp_path / "b.ply", [hashed(mesh)])
    again = read_document(tmp_path / "b.ply")
    assert again.meshes[0].sizes.tolist() == [4, 3]
    np.testing.assert_array_equal(again.corners(0).colours, document.corners(0).colours)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "the file is cut short"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 5\n", "a face names vertex 5 among 3"),
        ("a.off", "hello\n", "the first word must be OFF"),
        ("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "no faces: 3 points alone"),
        ("a.stl", "solid\nendsolid\n", "no faces: the mesh is empty"),
        ("a.stl", bytes(80) + b"\xff\0\0\0", "the file is cut short"),
        ("a.ply", "plain\n", "there is no PLY header"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n", "no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3: there is no vertex 3 among 2"),
        ("a.obj", "v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 1 is not finite"),
        ("a.glb", "{", "its JSON cannot be read"),
        ("a.xyz", "1", "suffix '.xyz' must be .glb or"),
    ],
)
def test_what_holds_no_surface_is_refused(tmp_path, name, content, reason):
    assert refusal(written(tmp_path / name, content)).startswith(reason)


# From one format to another


def loaded_triangles(path):
    """Triangles of a file in the scene, with texture coordinates, as trimesh reads them."""
    scene = trimesh.load(path, process=False, force="scene")
    points, uvs = [], []
    for name in scene.graph.nodes_geometry:
        matrix, key = scene.graph[name]
        mesh = scene.geometry[key]
        corners = mesh.faces.reshape(-1)
        points.append(mesh.vertices[corners] @ matrix[:3, :3].T + matrix[:3, 3])
        uvs.append(mesh.visual.uv[corners])
    return np.concatenate(points), np.concatenate(uvs)


def ordered(points, uvs):
    """Triangles in the order of the texture coordinates of their first corners."""
    uvs = uvs.reshape(-1, 6)
    order = np.lexsort(np.rint(uvs[:, 1::-1] * 2**20).T)
    return points.reshape(-1, 9)[order], uvs[order]


def distinct(points, uvs):
    """Corners in the order of their texture coordinates, each once."""
    _, first = np.unique(np.rint(uvs * 2**20), axis=0, return_index=True)
    return points[first], uvs[first]


def expected_triangles(document, uvs):
    """Triangles of all instances with their texture coordinates."""
    points, corners = [], []
    for mesh, uv in zip(document.meshes, uvs, strict=True):
        triangles, _ = triangulate(mesh.positions, mesh.corners, mesh.sizes)
        for matrix in mesh.transforms:
            at = triangles[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else triangles
            at = at.reshape(-1)
            points.append(mesh.positions[mesh.corners[at]] @ matrix[:3, :3].T + matrix[:3, 3])
            corners.append(uv[at])
    return np.concatenate(points), np.concatenate(corners)


def test_obj_to_glb_keeps_objects_materials_and_old_textures(tmp_path):
    written(tmp_path / "some.mtl", "newmtl red\nKd 1 0 0\nmap_Kd red.png\nnewmtl blue\nKd 0 0 1\n")
    Image.fromarray(MADE).save(tmp_path / "red.png")
    document = read_document(written(tmp_path / "a.obj", TEXT))
    uvs = [hashed(mesh) for mesh in document.meshes]
    notes = document.save(tmp_path / "b.glb", uvs)
    assert notes == ("2 polygons are cut into triangles",)
    again = read_document(tmp_path / "b.glb")
    assert [mesh.name for mesh in again.meshes] == ["first", "second"]
    assert [mesh.materials for mesh in again.meshes] == [("red",), ("blue",)]
    red = again.materials[0]
    assert (red.colour, red.uv_set, red.metallic) == ((1, 0, 0, 1), 1, 0)
    assert red.texture.data == (tmp_path / "red.png").read_bytes()
    first = document.meshes[0]
    triangles, _ = triangulate(first.positions, first.corners, first.sizes)
    at = triangles.reshape(-1)
    new, old = again.corners(0), document.corners(0)
    np.testing.assert_allclose(new.uvs[0], uvs[0][at], rtol=0, atol=1e-7)
    # The quad had none; zeros stand for that, v down.
    filled = np.where(np.isnan(old.uvs[0]), [0, 1], old.uvs[0])
    np.testing.assert_array_equal(new.uvs[1], filled[at])
    np.testing.assert_allclose(new.colours[:, :3], old.colours[at][:, :3])
    document.save(tmp_path / "c.glb", uvs, uv_set=1)
    assert read_document(tmp_path / "c.glb").materials[0].uv_set == 0


def test_glb_to_obj_writes_instances_out(tmp_path):
    build = samples.Builder()
    points = build.add(np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], dtype=np.float32))
    normals = build.add(np.tile(np.array([[0, 0, 1]], dtype=np.float32), (3, 1)))
    document = build.document(
        meshes=[
            {
                "name": "leaf",
                "primitives": [
                    {"attributes": {"POSITION": points, "NORMAL": normals}, "material": 0}
                ],
            }
        ],
        materials=[
            {"name": "green leaf", "pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}}
        ],
        nodes=[{"mesh": 0, "translation": [5, 0, 0]}, {"mesh": 0, "scale": [1, -1, 1]}],
    )
    read = read_document(written(tmp_path / "a.glb", samples.glb(document, build.blob)))
    uvs = [hashed(read.meshes[0])]
    notes = read.save(tmp_path / "b.obj", uvs)
    assert "instances are written out" in notes
    again = read_document(tmp_path / "b.obj")
    assert [mesh.name for mesh in again.meshes] == ["leaf_0", "leaf_1"]
    assert again.materials[0].colour == (0, 1, 0, 1)
    for mesh, k in zip(again.meshes, range(2), strict=True):
        a, b, c = mesh.positions[mesh.corners]
        np.testing.assert_allclose(np.cross(b - a, c - a), [0, 0, 6])
        np.testing.assert_allclose(again.corners(k).normals, [[0, 0, 1]] * 3)
    points, corners = expected_triangles(read, uvs)
    np.testing.assert_allclose(
        np.concatenate([mesh.positions[mesh.corners] for mesh in again.meshes]), points
    )
    found = np.concatenate([again.corners(k).uvs[0] for k in range(2)])
    np.testing.assert_allclose(found, corners, rtol=0, atol=5.1e-9)


def test_positions_far_from_the_origin(tmp_path):
    sphere = trimesh.creation.icosphere(2)
    offset = np.array([443_000.25, 5_142_000.5, 120.0])
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in sphere.vertices + offset]
    lines += [f"f {a} {b} {c}" for a, b, c in (sphere.faces + 1).tolist()]
    document = read_document(written(tmp_path / "a.obj", "\n".join(lines)))
    document.save(tmp_path / "b.glb", [hashed(mesh) for mesh in document.meshes])
    (mesh,) = read_document(tmp_path / "b.glb").meshes
    found = mesh.positions[mesh.corners] + mesh.transforms[0, :3, 3] - offset
    # Single precision of an extent of 2.
    np.testing.assert_allclose(found, sphere.vertices[sphere.faces.reshape(-1)], rtol=0, atol=2e-7)


def test_concave_polygons_are_cut_inside():
    arrow = np.array([[0, 0, 0], [2, -1, 0], [0.5, 0, 0], [2, 1, 0]], dtype=float)
    comb = np.array(
        [[0, 0], [6, 0], [6, 3], [5, 1], [4, 3], [3, 1], [2, 3], [1, 1], [0, 3]], dtype=float
    )
    comb = np.column_stack([comb[:, 1], 0 * comb[:, 0], comb[:, 0]])
    positions = np.concatenate([arrow, comb])
    sizes = np.array([4, 9])
    triangles, polygon = triangulate(positions, np.arange(13), sizes)
    assert polygon.tolist() == [0, 0, *[1] * 7]
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    for k, whole in ((0, arrow), (1, comb)):
        own = normals[polygon == k]
        total = 0.5 * np.cross(whole, np.roll(whole, -1, axis=0)).sum(axis=0)
        np.testing.assert_allclose(0.5 * own.sum(axis=0), total)
        assert (own @ total > 0).all()


# Files as people have them


@each_shared_file
@pytest.mark.parametrize("coordinates", [hashed, smooth])
def test_shared_file_is_the_same_with_new_coordinates(tmp_path, file, coordinates):
    document = read_document(file)
    uvs = [coordinates(mesh) for mesh in document.meshes]
    suffix = file.suffix.lower()
    suffix = ".ply" if suffix in (".stl", ".off") else suffix
    document.save(tmp_path / f"same{suffix}", uvs)
    again = read_document(tmp_path / f"same{suffix}")
    if suffix == ".glb":
        before, after = (samples.parse(path.read_bytes()) for path in (file, tmp_path / "same.glb"))
        for key in ("nodes", "scenes", "scene", "asset", "cameras", "extensions", "samplers"):
            assert before[0].get(key) == after[0].get(key)
        check_gltf(before, after, uvs)
    if suffix == ".obj":
        encoding = "utf-16-be" if "UTF16BE" in file.name else "latin-1"
        before, after = (
            path.read_bytes().decode(encoding) for path in (file, tmp_path / "same.obj")
        )
        edited_lines(before.lstrip("\ufeff"), after.lstrip("\ufeff"))
    meshes = document.meshes if len(document.meshes) == len(again.meshes) else None
    if meshes is None:
        # A PLY file has one mesh.
        assert file.suffix.lower() == ".stl"
        return
    for k, (old, new) in enumerate(zip(meshes, again.meshes, strict=True)):
        np.testing.assert_array_equal(old.sizes, new.sizes)
        np.testing.assert_array_equal(old.positions[old.corners], new.positions[new.corners])
        if suffix == file.suffix.lower():
            assert (old.name, old.materials) == (new.name, new.materials)
        np.testing.assert_array_equal(old.transforms, new.transforms)
        np.testing.assert_allclose(again.corners(k).uvs[0], uvs[k], rtol=0, atol=1e-7)


@each_shared_file
@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_shared_file_as_trimesh_reads_it(tmp_path, file, suffix):
    document = read_document(file)
    # Different at all corners of all meshes.
    counts = [len(mesh.corners) for mesh in document.meshes]
    whole = np.arange(sum(counts))
    whole = np.stack([whole * 40503 % 2**20, whole * 60493 % 2**20], axis=1) / 2**20
    uvs = np.split(whole, np.cumsum(counts)[:-1])
    # With a texture, as trimesh shows no coordinates without.
    document.save(tmp_path / f"other{suffix}", uvs, image=MADE)
    points, corners = loaded_triangles(tmp_path / f"other{suffix}")
    expected, uv = expected_triangles(document, uvs)
    extent = np.ptp(expected, axis=0).max()
    if suffix == ".obj" and any((mesh.sizes > 3).any() for mesh in document.meshes):
        # trimesh cuts polygons in another way: the corners alone are compared.
        points, corners = distinct(points / extent, corners)
        expected, uv = distinct(expected / extent, uv)
    else:
        points, corners = ordered(points / extent, corners)
        expected, uv = ordered(expected / extent, uv)
    np.testing.assert_allclose(corners, uv, rtol=0, atol=1e-7)
    np.testing.assert_allclose(points, expected, rtol=0, atol=2e-6)
