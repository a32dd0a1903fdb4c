"""Reading meshes: what a good file gives and what is said of a bad one."""

from __future__ import annotations

import importlib.util
import json
import re
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

import phaseatlas as pa

TETRAHEDRON = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""


def obj(vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    return "\n".join(lines) + "\n"


def grid(cells=2):
    """Vertices and faces of a flat square."""
    sheet = pa.datasets.sheet(cells, cells)
    return sheet.vertices.tolist(), sheet.faces.tolist()


def refusal(path, error=ValueError):
    """The message of the refusal of a file: one line that starts with its path."""
    with pytest.raises(error) as caught:
        pa.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert len(message.splitlines()) == 1
    return message[len(f"{path}: ") :]


def written(path, content):
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content)
    return path


def nan_vertex():
    vertices, faces = grid()
    vertices[4][1] = "nan"
    return obj(vertices, faces)


def three_faces_at_an_edge():
    vertices, faces = grid()
    # The diagonal of the first cell, which both of its faces share.
    return obj([*vertices, (0.2, 0.2, 1.0)], [*faces, [0, 4, len(vertices)]])


def flipped_face():
    vertices, faces = grid()
    faces[3] = faces[3][::-1]
    return obj(vertices, faces)


def repeated_vertex():
    vertices, faces = grid()
    faces[5][2] = faces[5][0]
    return obj(vertices, faces)


def zero_area():
    vertices, faces = grid()
    # The third corner slides along the face's own edge to its middle.
    a, b, c = faces[0]
    vertices[c] = [(p + q) / 2 for p, q in zip(vertices[a], vertices[b], strict=True)]
    return obj(vertices, faces)


def two_components():
    vertices, faces = grid()
    far = [(x, y, z + 5.0) for x, y, z in vertices]
    n = len(vertices)
    return obj([*vertices, *far], [*faces, *[[i + n for i in face] for face in faces]])


def touching_at_a_vertex():
    return obj([(0, 0, 0), (1, 0, 0), (1, 1, 0), (-1, 0, 0), (-1, -1, 0)], [[0, 1, 2], [0, 3, 4]])


def unreferenced_vertex():
    vertices, faces = grid()
    return obj([*vertices, (7.0, 7.0, 7.0)], faces)


def index_out_of_range():
    vertices, faces = grid()
    faces[2][1] = 40
    return obj(vertices, faces)


def no_number():
    vertices, faces = grid()
    vertices[4][1] = "1,5"
    return obj(vertices, faces)


def no_vertex():
    return obj(*grid()).replace("f 2 5 6", "f x/1 5 6")


@pytest.mark.parametrize(
    ("make", "culprit"),
    [
        (nan_vertex, r"vertices\[4\]: coordinate 1 is NaN"),
        (three_faces_at_an_edge, r"non-manifold edge \(0, 4\)"),
        (flipped_face, r"inconsistent orientation, faces \d and 3|faces 3 and \d"),
        (repeated_vertex, r"faces\[5\]: degenerate face .* names a vertex twice"),
        (zero_area, r"faces\[0\]: degenerate face .* has area 0"),
        (two_components, r"disconnected surface of 2 components; faces 0 and 8"),
        (touching_at_a_vertex, r"vertices\[0\]: non-manifold vertex"),
        (unreferenced_vertex, r"vertices\[9\]: unreferenced vertex"),
        (index_out_of_range, r"line 12: there is no vertex 41 among 9"),
        (no_number, r"line 5: coordinate 1 of a vertex, .1,5., is no number"),
        (no_vertex, r"line 12: corner .x/1. of a face names no vertex"),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_bad_obj_is_refused_by_name(tmp_path, make, culprit):
    message = refusal(written(tmp_path / "bad.obj", make()))
    assert re.search(culprit, message), message


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "off"])
def test_empty_file(tmp_path, suffix):
    assert refusal(written(tmp_path / f"empty.{suffix}", b"")) == "empty file"


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "off"])
def test_random_bytes(tmp_path, suffix):
    noise = np.random.default_rng(0).bytes(4000)
    message = refusal(written(tmp_path / f"noise.{suffix}", noise))
    # Text formats skip lines that they do not know, and find nothing.
    assert message.startswith(("cannot be read as a mesh: ", "no faces"))
    # The file is at fault, not the installation.
    assert "module" not in message


@pytest.mark.parametrize("suffix", ["ply", "stl", "glb", "off"])
def test_truncated_file(tmp_path, suffix):
    sphere = pa.datasets.icosphere(2)
    data = trimesh.Trimesh(sphere.vertices, sphere.faces).export(file_type=suffix)
    data = data.encode() if isinstance(data, str) else data
    whole = written(tmp_path / f"whole.{suffix}", data)
    assert pa.load(whole).n_faces == sphere.n_faces
    message = refusal(written(tmp_path / f"half.{suffix}", data[: len(data) // 2]))
    assert message.startswith(("cannot be read as a mesh: ", "no faces"))
    assert "module" not in message


def test_comments_in_another_encoding_do_no_harm(tmp_path):
    text = "# Modèle, façonné à la main\n" + TETRAHEDRON
    path = written(tmp_path / "latin.obj", text.encode("latin-1"))
    assert pa.load(path).n_faces == 4


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_point_cloud(tmp_path, suffix):
    points = pa.datasets.icosphere(1).vertices
    path = tmp_path / f"points.{suffix}"
    if suffix == "obj":
        path.write_text(obj(points, []))
    else:
        path.write_bytes(trimesh.PointCloud(points).export(file_type="ply"))
    assert refusal(path).startswith("no faces")


def test_missing_file(tmp_path):
    assert refusal(tmp_path / "missing.obj", FileNotFoundError) == "no such file"


def test_a_missing_folder_is_told_by_the_name_that_was_given(tmp_path):
    path = tmp_path / "missing" / "model.ply"
    with pytest.raises(FileNotFoundError) as caught:
        pa.save_mesh(pa.datasets.icosphere(1), path)
    assert caught.value.filename == str(path)


def test_directory(tmp_path):
    folder = tmp_path / "folder.obj"
    folder.mkdir()
    assert refusal(folder, IsADirectoryError) == "a folder, not a file"


def test_unknown_suffix(tmp_path):
    message = refusal(written(tmp_path / "mesh.what", TETRAHEDRON))
    assert "'what' not supported" in message


@pytest.mark.parametrize("corner", ["{}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}"])
def test_indices_from_the_end_are_legal_obj(tmp_path, corner):
    expected = pa.load(written(tmp_path / "a.obj", TETRAHEDRON))
    vertices = [line for line in TETRAHEDRON.splitlines() if line.startswith("v")]
    more = [line.replace("v", kind) for kind in ("vt", "vn") for line in vertices]
    lines = [*vertices, *more]
    for face in expected.faces:
        lines.append("f " + " ".join(corner.format(index - 4) for index in face.tolist()))
    surface = pa.load(written(tmp_path / "b.obj", "\n".join(lines)))
    np.testing.assert_array_equal(surface.vertices, expected.vertices)
    np.testing.assert_array_equal(surface.faces, expected.faces)


@pytest.mark.parametrize("codec", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-8-sig"])
def test_encodings_of_an_obj(tmp_path, codec):
    text = "# façonné à la main ☃\n" + TETRAHEDRON.replace("\n", "\r\n")
    path = written(tmp_path / "a.obj", text.encode(codec))
    surface, expected = pa.load(path), pa.load(written(tmp_path / "b.obj", TETRAHEDRON))
    np.testing.assert_array_equal(surface.vertices, expected.vertices)
    np.testing.assert_array_equal(surface.faces, expected.faces)


def test_groups_and_materials_keep_the_order_of_an_obj(tmp_path):
    lines = TETRAHEDRON.splitlines()
    vertices, faces = lines[:4], lines[4:]
    groups = [f"o part{k}\ng side{k}\nusemtl m{k % 2}\ns {k}\n{f}" for k, f in enumerate(faces)]
    # The material's file is missing, and nobody asks for it.
    text = "\n".join(["mtllib missing.mtl", *vertices, *groups])
    surface, expected = pa.load(written(tmp_path / "a.obj", text)), TETRAHEDRON
    np.testing.assert_array_equal(
        surface.faces, pa.load(written(tmp_path / "b.obj", expected)).faces
    )


def test_polygons_of_an_obj_are_cut_around_their_first_corner(tmp_path):
    ring = [(np.cos(t), np.sin(t), 0.0) for t in 2 * np.pi * np.arange(6) / 6]
    vertices = [*ring, (0.0, 0.0, 1.0)]
    faces = [[3, 2, 1, 0, 5, 4], *[[k, (k + 1) % 6, 6] for k in range(6)]]
    surface = pa.load(written(tmp_path / "pyramid.obj", obj(vertices, faces)))
    fan = [[3, 2, 1], [3, 1, 0], [3, 0, 5], [3, 5, 4]]
    np.testing.assert_array_equal(surface.faces, [*fan, *faces[1:]])
    assert surface.n_boundary_loops == 0


def glb(header, data=b""):
    text = json.dumps({"asset": {"version": "2.0"}, **header}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle(positions=None, **extra):
    """A file of one triangle, with more in its header."""
    if positions is None:
        positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
    return glb(
        {
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": positions.nbytes}],
            "buffers": [{"byteLength": positions.nbytes}],
            **extra,
        },
        positions.tobytes(),
    )


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "EXT_mesh_gpu_instancing"])
def test_extensions_that_a_mesh_cannot_be_read_without(tmp_path, name):
    path = written(tmp_path / "a.glb", triangle(extensionsUsed=[name], extensionsRequired=[name]))
    assert f"needs the glTF extension {name}, which is not supported" in refusal(path)


def test_positions_in_whole_numbers(tmp_path):
    # Rows of four, of which the last is a gap, as the format asks for.
    positions = np.array([[0, 0, 0, 0], [100, 0, 0, 0], [0, 300, 0, 0]], dtype="<i2")
    accessor = {"bufferView": 0, "componentType": 5122, "count": 3, "type": "VEC3"}
    changes = {
        "nodes": [{"mesh": 0, "scale": [0.01, 0.01, 0.01]}],
        "bufferViews": [{"buffer": 0, "byteLength": 24, "byteStride": 8}],
        "buffers": [{"byteLength": 24}],
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
    }
    whole = triangle(positions, accessors=[accessor], **changes)
    surface = pa.load(written(tmp_path / "whole.glb", whole))
    np.testing.assert_allclose(surface.vertices, positions[:, :3] / 100, rtol=1e-6)
    # Fractions of the largest number, which the reader does not divide by.
    parts = triangle(positions, accessors=[{**accessor, "normalized": True}], **changes)
    assert "KHR_mesh_quantization" in refusal(written(tmp_path / "parts.glb", parts))


def test_draco_is_read_or_refused_by_name(tmp_path):
    name = "KHR_draco_mesh_compression"
    path = written(tmp_path / "a.glb", triangle(extensionsUsed=[name], extensionsRequired=[name]))
    if importlib.util.find_spec("DracoPy") is None:
        assert name in refusal(path)
    else:
        # Required, but not used.
        assert pa.load(path).n_faces == 1


def test_extensions_that_change_no_position_are_no_matter(tmp_path):
    names = ["KHR_materials_unlit", "EXT_texture_webp", "KHR_texture_transform"]
    path = written(tmp_path / "a.glb", triangle(extensionsUsed=names, extensionsRequired=names))
    assert pa.load(path).n_faces == 1
    # Offered beside what every reader knows.
    path = written(tmp_path / "b.glb", triangle(extensionsUsed=["EXT_meshopt_compression"]))
    assert pa.load(path).n_faces == 1


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_images_of_materials_are_not_read(tmp_path, monkeypatch, suffix):
    sphere = pa.datasets.icosphere(2)
    mesh = trimesh.Trimesh(sphere.vertices, sphere.faces, process=False)
    image = Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8))
    mesh.visual = trimesh.visual.TextureVisuals(uv=sphere.vertices[:, :2], image=image)
    path = tmp_path / f"textured.{suffix}"
    mesh.export(path)

    def opened(*_, **__):
        raise AssertionError("an image was opened")

    monkeypatch.setattr(Image, "open", opened)
    assert pa.load(path).n_faces == sphere.n_faces


def test_quads_are_split(tmp_path):
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cube = pa.load(written(tmp_path / "cube.obj", obj(corners, quads)))
    assert (cube.n_vertices, cube.n_faces) == (8, 12)
    assert cube.area == pytest.approx(6.0)
    np.testing.assert_array_equal(cube.vertices, corners)


def test_texture_seams_are_closed(tmp_path):
    # The unfolded tetrahedron: every corner has a texture coordinate of its own.
    lines = TETRAHEDRON.splitlines()
    faces = [line.split()[1:] for line in lines if line.startswith("f")]
    text = "\n".join(line for line in lines if line.startswith("v")) + "\n"
    text += "".join(f"vt {k / 12} {k % 5 / 5}\n" for k in range(12))
    for k, face in enumerate(faces):
        text += "f " + " ".join(f"{v}/{3 * k + c + 1}" for c, v in enumerate(face)) + "\n"
    surface = pa.load(written(tmp_path / "seams.obj", text))
    assert (surface.n_vertices, surface.n_faces, surface.n_boundary_loops) == (4, 4, 0)


def test_loose_triangles_of_an_stl_are_joined(tmp_path):
    sphere = pa.datasets.icosphere(2)
    path = tmp_path / "sphere.stl"
    path.write_bytes(trimesh.Trimesh(sphere.vertices, sphere.faces).export(file_type="stl"))
    surface = pa.load(path)
    assert (surface.n_vertices, surface.n_faces) == (sphere.n_vertices, sphere.n_faces)
    assert surface.n_boundary_loops == 0
    # Faces keep their order; the corners are those of the sphere in single precision.
    np.testing.assert_array_equal(
        surface.vertices[surface.faces], sphere.vertices[sphere.faces].astype(np.float32)
    )


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "glb"])
def test_vertices_and_faces_keep_their_order(tmp_path, suffix):
    sheet = pa.datasets.sheet(7, 5, amplitude=0.1)
    # A random order: a reader that sorts or renumbers by first use gives another one.
    order = np.random.default_rng(0).permutation(sheet.n_vertices)
    place = np.argsort(order)
    vertices, faces = sheet.vertices[order], place[sheet.faces]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    data = mesh.export(file_type=suffix)
    surface = pa.load(
        written(tmp_path / f"sheet.{suffix}", data if isinstance(data, bytes) else str(data))
    )
    np.testing.assert_array_equal(surface.faces, faces)
    np.testing.assert_allclose(surface.vertices, vertices, atol=1e-7)


def test_coincident_vertices_are_merged_to_the_first(tmp_path):
    vertices, faces = grid()
    n = len(vertices)
    # Backwards, so that sorting the positions does not give the order of the file.
    vertices, faces = vertices[::-1], [[n - 1 - i for i in face] for face in faces]
    expected = [face.copy() for face in faces]
    # The last face gets copies of all its corners for itself.
    copies = [vertices[i] for i in faces[-1]]
    faces[-1] = [n, n + 1, n + 2]
    surface = pa.load(written(tmp_path / "a.obj", obj([*vertices, *copies], faces)))
    np.testing.assert_array_equal(surface.vertices, vertices)
    np.testing.assert_array_equal(surface.faces, expected)


def test_path_may_be_text_and_suffix_in_capitals(tmp_path):
    path = written(tmp_path / "A.OBJ", TETRAHEDRON)
    assert pa.load(str(path)).n_faces == 4


def test_real_meshes_keep_their_counts(mesh_path):
    expected = {"bunny": (0, 0), "fertility": (4, 0), "camelhead": (0, 1)}
    for name, topology in expected.items():
        path = mesh_path(name)
        lines = path.read_text().splitlines()
        surface = pa.load(path)
        assert surface.n_vertices == sum(line.startswith("v ") for line in lines)
        assert surface.n_faces == sum(line.startswith("f ") for line in lines)
        assert (surface.genus, surface.n_boundary_loops) == topology


def crack_that_touches_itself():
    """A sheet with two slits that end at one point: there the surface has two vertices."""
    sheet = pa.datasets.sheet(8, 8)
    middle = 40
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    fan = np.flatnonzero((sheet.faces == middle).any(axis=1))
    # Without the faces left and right of the middle, those above and below touch there.
    centres = sheet.face_mean(sheet.vertices)[fan]
    beside = np.abs(centres[:, 0] - x[middle]) > np.abs(centres[:, 1] - y[middle])
    faces = np.delete(sheet.faces, fan[beside], axis=0)
    below = np.flatnonzero((faces == middle).any(axis=1))
    below = below[(sheet.vertices[faces[below]].mean(axis=1)[:, 1] < y[middle])]
    faces[below] = np.where(faces[below] == middle, sheet.n_vertices, faces[below])
    return pa.Surface(np.vstack([sheet.vertices, sheet.vertices[middle]]), faces)


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "off", "stl"])
def test_a_written_surface_that_touches_itself_loads_again(tmp_path, suffix):
    surface = crack_that_touches_itself()
    pa.save_mesh(surface, tmp_path / f"crack.{suffix}")
    again = pa.load(tmp_path / f"crack.{suffix}")
    assert (again.n_vertices, again.n_faces) == (surface.n_vertices, surface.n_faces)
    assert (again.genus, again.n_boundary_loops) == (surface.genus, surface.n_boundary_loops)


def test_an_atlas_of_a_surface_that_touches_itself_loads_again(tmp_path):
    surface = crack_that_touches_itself()
    pa.build_atlas(pa.segment(surface, 1)).save(tmp_path / "crack.glb", resolution=64)
    assert pa.load(tmp_path / "crack.glb").n_vertices == surface.n_vertices


def far_away():
    sphere = pa.datasets.icosphere(3)
    return pa.Surface(sphere.vertices + np.array([448_000.0, 5_411_000.0, 120.0]), sphere.faces)


@pytest.mark.parametrize(("suffix", "digits"), [("glb", 1e-7), ("ply", 0), ("obj", 1e-9)])
def test_positions_far_from_the_origin_keep_their_precision(tmp_path, suffix, digits):
    surface = far_away()
    pa.save_mesh(surface, tmp_path / f"far.{suffix}")
    again = pa.load(tmp_path / f"far.{suffix}")
    assert np.abs(again.vertices - surface.vertices).max() <= 2 * digits


def test_stl_refuses_what_single_precision_would_ruin(tmp_path):
    with pytest.raises(ValueError, match=r"path: .* must be a .ply or .obj file: in an STL"):
        pa.save_mesh(far_away(), tmp_path / "far.stl")
    assert not list(tmp_path.iterdir())


def close_pair():
    """A surface with two vertices closer than single precision tells apart."""
    sheet = pa.datasets.sheet(4, 4)
    vertices, faces = sheet.vertices.copy(), sheet.faces
    a, b, _ = faces[5]
    vertices[a] = vertices[b] + 2e-9 * (vertices[a] - vertices[b])
    return pa.Surface(vertices, faces)


@pytest.mark.parametrize("suffix", ["glb", "stl"])
def test_vertices_that_would_become_one_are_refused(tmp_path, suffix):
    with pytest.raises(ValueError, match="1 vertices would stand where others do"):
        pa.save_mesh(close_pair(), tmp_path / f"close.{suffix}")


@pytest.mark.parametrize("suffix", ["obj", "ply", "off"])
def test_vertices_are_told_apart_by_as_many_digits_as_it_takes(tmp_path, suffix):
    surface = close_pair()
    pa.save_mesh(surface, tmp_path / f"close.{suffix}")
    assert pa.load(tmp_path / f"close.{suffix}").n_vertices == surface.n_vertices


def glb_header(path):
    data = path.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size])


def test_glb_files_have_a_white_material_a_name_and_normals(tmp_path):
    pa.save_mesh(pa.datasets.icosphere(2), tmp_path / "ball.glb")
    header = glb_header(tmp_path / "ball.glb")
    (material,) = header["materials"]
    assert material["pbrMetallicRoughness"] == {
        "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0,
    }
    assert material["name"] == header["meshes"][0]["name"] == "ball"
    assert "ball" in [node["name"] for node in header["nodes"]]
    assert "NORMAL" in header["meshes"][0]["primitives"][0]["attributes"]


def test_atlases_have_the_normals_of_the_whole_surface_on_both_sides_of_a_seam(tmp_path):
    surface = pa.datasets.starfish(3)
    atlas = pa.build_atlas(pa.segment(surface, 2))
    atlas.save(tmp_path / "star.glb", resolution=64)
    (mesh,) = trimesh.load(tmp_path / "star.glb", process=False).geometry.values()
    assert len(mesh.vertices) > surface.n_vertices
    _, place = np.unique(np.round(mesh.vertices, 5), axis=0, return_inverse=True)
    first = np.zeros((place.max() + 1, 3))
    first[place.reshape(-1)] = mesh.vertex_normals
    np.testing.assert_allclose(mesh.vertex_normals, first[place.reshape(-1)], atol=1e-6)
    factors = glb_header(tmp_path / "star.glb")["materials"][0]["pbrMetallicRoughness"]
    assert factors["baseColorFactor"] == [1.0, 1.0, 1.0, 1.0]
    assert (factors["metallicFactor"], factors["roughnessFactor"]) == (0.0, 1.0)
    atlas.save(tmp_path / "star.obj", resolution=64)
    material = (tmp_path / "star.mtl").read_text()
    assert "Kd 1 1 1" in material
    assert "Ks 0 0 0" in material
    assert "map_Kd star.png" in material
    textured = trimesh.load(tmp_path / "star.obj", force="mesh", process=False)
    assert textured.visual.uv.shape == (len(textured.vertices), 2)
