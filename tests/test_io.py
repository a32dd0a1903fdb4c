"""Reading meshes: what a good file gives and what is said of a bad one."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh

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
        (index_out_of_range, r"index 40 is out of bounds"),
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


def test_directory(tmp_path):
    folder = tmp_path / "folder.obj"
    folder.mkdir()
    refusal(folder, (ValueError, OSError))


def test_unknown_suffix(tmp_path):
    message = refusal(written(tmp_path / "mesh.what", TETRAHEDRON))
    assert "'what' not supported" in message


def test_indices_from_the_end_are_legal_obj(tmp_path):
    text = TETRAHEDRON.replace("f 3 1 4", "f -2 -4 -1")
    assert pa.load(written(tmp_path / "a.obj", text)).n_faces == 4


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
