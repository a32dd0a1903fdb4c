"""Odd files of the kinds that programs write: they get an atlas, or one line says why."""

import numpy as np
import pytest
import trimesh

from gltf_samples import Builder, glb, parse
from phaseatlas.file_atlas import AtlasOptions, atlas_file
from phaseatlas.scene.document import read_document
from phaseatlas.scene.ply_elements import read_elements
from phaseatlas.scene.repair import repair

SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
VERTICES = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {}\nproperty list uchar int vertex_indices\n"
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


def made(tmp_path, name, content, suffix=None):
    """The file with its atlas."""
    source = tmp_path / name
    source.write_bytes(content if isinstance(content, bytes) else content.encode())
    output = tmp_path / f"out{suffix or source.suffix}"
    atlas_file(source, output)
    before, after = read_document(source), read_document(output)
    for a, b in zip(before.meshes, after.meshes, strict=True):
        np.testing.assert_array_equal(a.sizes, b.sizes)
        np.testing.assert_array_equal(a.positions[a.corners], b.positions[b.corners])
    return output


def refusal(tmp_path, name, content):
    with pytest.raises(ValueError, match=":") as caught:
        made(tmp_path, name, content)
    return str(caught.value).removeprefix(f"{tmp_path / name}: ")


def ascii_ply(rest):
    return f"ply\nformat ascii 1.0\n{rest}"


def test_a_ply_header_with_a_line_of_no_keyword(tmp_path) -> None:
    text = ascii_ply(f"Made by hand\n{VERTICES}{FACES.format(1)}end_header\n{SQUARE}4 0 1 2 3\n")
    output = made(tmp_path, "a.ply", text)
    assert "comment Made by hand" in read_elements(output.read_bytes()).comments


def test_a_ply_header_that_declares_what_is_not_known(tmp_path) -> None:
    text = ascii_ply(f"{VERTICES}property complex w\nend_header\n{SQUARE}")
    assert refusal(tmp_path, "a.ply", text) == "the header says 'property complex w'"


@pytest.mark.parametrize("binary", [False, True])
def test_a_ply_with_carriage_returns_alone(tmp_path, binary) -> None:
    head = f"{VERTICES}{FACES.format(1)}end_header\n"
    if binary:
        rows = np.array([float(w) for w in SQUARE.split()], dtype="<f4").tobytes()
        # A carriage return and a newline may be among the bytes of the rows.
        rows += b"\x04" + np.arange(4, dtype="<i4").tobytes()
        text = f"ply\nformat binary_little_endian 1.0\n{head}".replace("\n", "\r").encode() + rows
    else:
        text = ascii_ply(f"{head}{SQUARE}4 0 1 2 3\n").replace("\n", "\r").encode()
    made(tmp_path, "a.ply", text)


def test_a_text_of_uneven_polygons_stays_a_text_that_others_read(tmp_path) -> None:
    points = "0 0 0 0.1\n1 0 0 0.2\n1 1 0 0.3\n0 1 0 1e-7\n0 0 1 16777217\n"
    head = VERTICES.replace("4", "5") + "property double extra\n" + FACES.format(3)
    edges = "element edge 1\nproperty int vertex1\nproperty int vertex2\nproperty float weight\n"
    faces = "4 0 1 2 3\n3 0 1 4\n3 1 2 4\n"
    output = made(
        tmp_path, "a.ply", ascii_ply(f"{head}{edges}end_header\n{points}{faces}0 4 0.5\n")
    )
    written = read_elements(output.read_bytes())
    assert written.text
    assert set(written.elements["vertex"].columns["extra"]) == {0.1, 0.2, 0.3, 1e-7, 16777217.0}
    assert written.elements["edge"].columns["weight"].tolist() == [0.5]
    assert len(trimesh.load(output, process=False).faces) == 4


def test_uneven_polygons_of_another_format_become_a_text(tmp_path) -> None:
    output = made(tmp_path, "a.off", f"OFF\n5 2 0\n{SQUARE}0 0 1\n4 0 1 2 3\n3 0 1 4\n", ".ply")
    assert len(trimesh.load(output, process=False).faces) == 3


def test_strips_of_a_ply_are_faces(tmp_path) -> None:
    # Two strips in one list, a vertex repeated to turn, and a list of its own.
    strips = "9 0 1 3 2 -1 0 0 3 2\n3 1 2 3\n"
    head = f"{VERTICES}element tristrips 2\nproperty list int int vertex_indices\nend_header\n"
    output = made(tmp_path, "a.ply", ascii_ply(f"{head}{SQUARE}{strips}"))
    (mesh,) = read_document(output).meshes
    corners = mesh.positions[mesh.corners].reshape(-1, 3, 3)
    points = np.array([float(w) for w in SQUARE.split()]).reshape(4, 3)
    # Every second triangle of a strip runs the other way.
    expected = points[[(0, 1, 3), (1, 2, 3), (0, 2, 3), (1, 2, 3)]]
    np.testing.assert_array_equal(corners, expected)
    assert "tristrips" not in read_elements(output.read_bytes()).elements


def test_the_vertex_that_a_face_names_wrongly_is_said(tmp_path) -> None:
    text = ascii_ply(f"{VERTICES}{FACES.format(1)}end_header\n{SQUARE}3 0 1 -1\n")
    assert refusal(tmp_path, "a.ply", text) == "a face names vertex -1 among 4"


@pytest.mark.parametrize("word", ["nan", "1e400", "3.1+e2", "inf", ""])
def test_a_vertex_that_no_face_uses_may_be_anything(tmp_path, word) -> None:
    made(tmp_path, "a.obj", f"{TETRAHEDRON}v 0 0 {word}\nf 1 2 3\nf 1 2 4\n")
    text = made(tmp_path, "a.obj", f"v 0 0 {word}\n{TETRAHEDRON}f -4 -3 -2\n").read_text()
    assert text.startswith(f"v 0 0 {word}\n")
    for suffix in (".glb", ".obj"):
        made(tmp_path, "a.obj", f"{TETRAHEDRON}v 0 0 {word}\nf 1 2 3\nf 1 2 4\n", suffix)


def test_a_vertex_that_nothing_uses_in_a_glb(tmp_path) -> None:
    box = trimesh.creation.box()
    build = Builder()
    places = np.concatenate([box.vertices, [[np.nan] * 3]]).astype(np.float32)
    position = build.add(places, min=[-0.5] * 3, max=[0.5] * 3)
    indices = build.add(box.faces.reshape(-1).astype(np.uint16))
    primitive = {"attributes": {"POSITION": position}, "indices": indices}
    document = build.document(meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0}])
    output = made(tmp_path, "a.glb", glb(document, build.blob))
    document, _ = parse(output.read_bytes())
    position = document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    assert document["accessors"][position]["min"] == [-0.5] * 3


def test_a_vertex_of_a_face_is_a_place(tmp_path) -> None:
    text = f"{TETRAHEDRON}v 0 0 x\nv 0 y 0\nf 1 2 6\n"
    reason = 'line 6: coordinate 1 of a vertex, "y", is no number'
    assert refusal(tmp_path, "a.obj", text) == reason


@pytest.mark.parametrize("elements", ["p 1 2\n", "l 1 2 3\n", ""])
def test_points_and_lines_alone_are_said(tmp_path, elements) -> None:
    text = f"{TETRAHEDRON}{elements}"
    assert refusal(tmp_path, "a.obj", text) == "no faces: points or lines alone"


def test_colours_of_some_vertices_alone(tmp_path) -> None:
    points = SQUARE.replace("1 1 0", "1 1 0 255 0 0")
    made(tmp_path, "a.off", f"OFF\n4 1 0\n{points}4 0 1 2 3\n", ".ply")


def test_a_solid_with_a_long_name(tmp_path) -> None:
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    text = f"solid {'x' * 5000}\n{facet}endfacet\nendsolid\n"
    made(tmp_path, "a.stl", text, ".ply")


def test_what_a_format_cannot_become_is_refused_before_the_work(tmp_path) -> None:
    source = tmp_path / "a.obj"
    # Nothing of the file is looked at.
    source.write_text("f 1 2 x\n")
    words = r"^output: .*a\.ply must end in \.glb or \.gltf or \.obj or .* for \.obj files"
    with pytest.raises(ValueError, match=words):
        atlas_file(source, tmp_path / "a.ply", AtlasOptions())


def polygons_hang_together(repaired, sizes):
    """Each polygon's triangles are joined along all of its diagonals."""
    joined = np.bincount(repaired.polygon, repaired.inner.sum(axis=1), len(sizes)) / 2
    np.testing.assert_array_equal(joined, np.array(sizes) - 3)


def klein_bottle_of_quadrilaterals(rows, columns):
    u, w = np.meshgrid(
        2 * np.pi * np.arange(rows) / rows, 2 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    r = 2 + np.cos(u / 2) * np.sin(w) - np.sin(u / 2) * np.sin(2 * w)
    z = np.sin(u / 2) * np.sin(w) + np.cos(u / 2) * np.sin(2 * w)
    points = np.stack([r * np.cos(u), r * np.sin(u), z], axis=2).reshape(-1, 3)

    def at(i, j):
        # Around once, it is upside down.
        return (-j if i == rows else j) % columns + i % rows * columns

    faces = [
        (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1))
        for i in range(rows)
        for j in range(columns)
    ]
    return points, np.array(faces)


@pytest.mark.parametrize(("rows", "columns"), [(6, 5), (12, 9), (40, 20)])
def test_no_cut_of_what_is_not_orientable_runs_along_a_diagonal(rows, columns) -> None:
    points, faces = klein_bottle_of_quadrilaterals(rows, columns)
    repaired = repair(points, faces.reshape(-1), np.full(len(faces), 4))
    assert repaired.report.cut_edges > 0
    polygons_hang_together(repaired, np.full(len(faces), 4))


def test_polygons_on_one_diagonal_stay_whole(tmp_path) -> None:
    # A pillow: two quadrilaterals with the same four corners, and a triangle on their diagonal.
    points = [(0, 0, 0), (1, 0, 0.1), (1, 1, 0), (0, 1, 0.1), (0.5, 0.5, 1)]
    faces = [(0, 1, 2, 3), (0, 3, 2, 1), (0, 2, 4), (2, 0, 1, 4)]
    corners, sizes = np.concatenate([np.array(f) for f in faces]), [len(f) for f in faces]
    repaired = repair(np.array(points, dtype=float), corners, np.array(sizes))
    polygons_hang_together(repaired, sizes)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    text += "".join(f"f {' '.join(str(v + 1) for v in face)}\n" for face in faces)
    made(tmp_path, "a.obj", text)


@pytest.mark.parametrize("seed", range(6))
def test_soups_of_quadrilaterals_stay_whole(seed) -> None:
    rng = np.random.default_rng(seed)
    n = 7 + 3 * seed
    points = rng.random((n, 3))
    faces = np.array([rng.choice(n, 4, replace=False) for _ in range(8 * n)])
    # Copies of triangles are set aside, and take their polygon apart.
    repaired = repair(points, faces.reshape(-1), np.full(len(faces), 4))
    whole = np.bincount(repaired.polygon, minlength=len(faces)) == 2
    joined = np.bincount(repaired.polygon, repaired.inner.sum(axis=1), len(faces)) == 2
    assert whole.any()
    np.testing.assert_array_equal(joined[whole], True)
