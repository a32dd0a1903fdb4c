"""Repair: any polygons become an oriented manifold, and every corner is found again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import phaseatlas as pa
import reference
from phaseatlas import datasets
from phaseatlas.scene.components import components
from phaseatlas.scene.repair import repair

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
DEFECTS = (
    "isolated_vertices",
    "welded_vertices",
    "degenerate_faces",
    "duplicate_faces",
    "opposite_faces",
    "non_manifold_edges",
    "non_manifold_vertices",
    "flipped_faces",
    "cut_edges",
    "opened_edges",
)


def read_polygons(path):
    """Positions, corners and sizes of an OBJ or OFF file, by a reader of the tests' own."""
    rows = [line.split() for line in path.read_text().splitlines() if line.strip()]
    if path.suffix == ".off":
        n, m = map(int, rows[1][:2])
        positions = np.array(rows[2 : 2 + n], dtype=float)
        polygons = [list(map(int, row[1:])) for row in rows[2 + n : 2 + n + m]]
    else:
        positions = np.array([row[1:4] for row in rows if row[0] == "v"], dtype=float)
        polygons = [[int(c.split("/")[0]) for c in row[1:]] for row in rows if row[0] == "f"]
        polygons = [[c - 1 if c > 0 else c + len(positions) for c in row] for row in polygons]
    return positions, np.concatenate(polygons), np.array([len(row) for row in polygons])


def found(repaired):
    """The defects that were found, by name."""
    report = dataclasses.asdict(repaired.report)
    return {name: report[name] for name in DEFECTS if report[name]}


def check(repaired, positions, corners, sizes):
    """All that holds for every input."""
    corners = np.asarray(corners, dtype=np.int64).reshape(-1)
    if sizes is None:
        sizes = np.full(len(corners) // 3, 3)
    sizes = np.asarray(sizes, dtype=np.int64)
    m, report = len(repaired.faces), repaired.report
    assert reference.manifold_defects(len(repaired.vertices), repaired.faces) == []
    assert np.array_equal(repaired.component, reference.face_components(repaired.faces))
    assert report.components == repaired.component.max(initial=-1) + 1
    assert report.boundary_loops == reference.boundary_loop_count(repaired.faces)

    # Every triangle is a face or set aside.
    aside = repaired.aside
    assert report.faces == m
    assert report.aside == len(aside.polygon)
    assert report.duplicate_faces == aside.twin.sum()
    triangles = np.where(sizes > 3, sizes - 2, np.minimum(sizes, 1))
    both = np.concatenate([repaired.polygon, aside.polygon])
    assert np.array_equal(np.bincount(both, minlength=len(sizes)), triangles)
    assert report.polygons == tuple(sorted((s, int((sizes == s).sum())) for s in set(sizes)))

    # Corners belong to their polygons, and run as these do unless the face is flipped.
    owner = np.repeat(np.arange(len(sizes)), sizes)
    assert (owner[repaired.corner] == repaired.polygon[:, None]).all()
    assert (owner[aside.corner] == aside.polygon[:, None]).all()
    every = np.concatenate([repaired.corner, aside.corner]).reshape(-1)
    assert np.array_equal(np.unique(every), np.arange(len(corners)))
    descents = (np.roll(repaired.corner, -1, axis=1) < repaired.corner).sum(axis=1)
    assert np.array_equal(descents == 2, repaired.flipped)
    assert report.flipped_faces == repaired.flipped.sum()

    # Vertices stand where the corners do.
    assert np.array_equal(repaired.vertices, positions[repaired.source_vertex])
    assert (np.diff(repaired.source_vertex) >= 0).all()
    assert np.array_equal(repaired.vertices[repaired.faces], positions[corners[repaired.corner]])
    isolated = np.setdiff1d(np.arange(len(positions)), corners)
    assert report.isolated_vertices == len(isolated)

    # A map that is linear in space is carried to all corners of faces and of twins.
    assert (aside.host < m).all()
    assert (aside.host >= (0 if m else -1)).all()
    plane = np.array([[0.3, -1.0], [0.7, 0.2], [-0.4, 0.9]])
    uv = repaired.corners(repaired.vertices[repaired.faces] @ plane)
    assert uv.shape == (len(corners), 2)
    assert np.isfinite(uv).all()
    carried = np.concatenate([repaired.corner, aside.corner[aside.twin]]).reshape(-1)
    np.testing.assert_allclose(uv[carried], positions[corners[carried]] @ plane, atol=1e-12)
    if m:
        np.testing.assert_allclose(aside.weights.sum(axis=2), 1, atol=1e-15)
        assert (aside.weights >= 0).all()
        # What has no area has none on its host.
        w = aside.weights[~aside.twin]
        assert np.abs(np.linalg.det(w)).max(initial=0) == 0

    surfaces = components(repaired)
    assert len(surfaces) == report.components
    for c, part in enumerate(surfaces):
        assert np.array_equal(part.faces, np.flatnonzero(repaired.component == c))
        assert np.array_equal(part.vertices[part.surface.faces], repaired.faces[part.faces])
        assert np.array_equal(part.surface.vertices, repaired.vertices[part.vertices])


def repaired_and_checked(positions, corners, sizes=None, **options):
    repaired = repair(positions, corners, sizes, **options)
    check(repaired, np.asarray(positions, dtype=float), corners, sizes)
    return repaired


def assert_unchanged(repaired, positions, faces):
    assert np.array_equal(repaired.vertices, positions)
    assert np.array_equal(repaired.faces, faces)
    assert np.array_equal(repaired.source_vertex, np.arange(len(positions)))
    assert np.array_equal(repaired.polygon, np.arange(len(faces)))
    assert np.array_equal(repaired.corner, np.arange(3 * len(faces)).reshape(-1, 3))
    assert found(repaired) == {}


# --------------------------------------------------------------------------------------------------
# clean input
# --------------------------------------------------------------------------------------------------


def test_a_clean_mesh_comes_back_as_it_is(surfaces):
    repaired = repair(surfaces.vertices, surfaces.faces)
    assert_unchanged(repaired, surfaces.vertices, surfaces.faces)
    assert not repaired.inner.any()
    assert repaired.report.components == 1
    assert repaired.report.boundary_loops == surfaces.n_boundary_loops
    (part,) = components(repaired)
    assert np.array_equal(part.surface.faces, surfaces.faces)


def test_the_input_stays_as_it_is():
    positions, quads = CUBE.copy(), CUBE_QUADS.reshape(-1).copy()
    repair(positions, quads, [4] * 6)
    assert np.array_equal(positions, CUBE)
    assert np.array_equal(quads, CUBE_QUADS.reshape(-1))


def test_nothing_is_nothing():
    for positions in ([], np.zeros((0, 3)), [[0.0, 0, 0]]):
        repaired = repaired_and_checked(np.reshape(positions, (-1, 3)), [], [])
        assert repaired.corners(np.zeros((0, 3, 2))).shape == (0, 2)
        assert components(repaired) == []
        assert repaired.report.sentences()[0] == "The mesh has no polygons."


# --------------------------------------------------------------------------------------------------
# cases
# --------------------------------------------------------------------------------------------------


@pytest.fixture
def case(case_path):
    """``case("moebius.obj")`` is the file's positions and triangles, and their checked repair."""

    def read(name):
        positions, corners, sizes = read_polygons(case_path(name))
        return positions, corners, repaired_and_checked(positions, corners, sizes)

    return read


@pytest.mark.parametrize(("name", "count"), [("two_components.obj", 2), ("touching_vertex.obj", 2)])
def test_what_is_apart_in_the_file_stays_apart(case, name, count):
    positions, corners, repaired = case(name)
    assert_unchanged(repaired, positions, corners.reshape(-1, 3))
    assert repaired.report.components == count


def test_case_isolated_vertex(case):
    positions, corners, repaired = case("isolated_vertex.obj")
    used = np.unique(corners)
    assert found(repaired) == {"isolated_vertices": len(positions) - len(used)}
    assert np.array_equal(repaired.source_vertex, used)


def test_case_duplicate_face(case):
    _, corners, repaired = case("duplicate_face.obj")
    assert found(repaired) == {"duplicate_faces": 1}
    twin, host = repaired.aside.corner[0], repaired.corner[repaired.aside.host[0]]
    assert set(corners[twin]) == set(corners[host])
    uv = np.random.default_rng(0).random((len(repaired.faces), 3, 2))
    carried = repaired.corners(uv)
    for corner in twin:
        assert np.array_equal(carried[corner], carried[host[corners[host] == corners[corner]][0]])


def test_case_one_face_flipped(case):
    _, corners, repaired = case("one_face_flipped.obj")
    assert found(repaired) == {"flipped_faces": 1}
    faces = corners.reshape(-1, 3)
    (flipped,) = np.flatnonzero(repaired.flipped)
    assert repaired.faces[flipped].tolist() == faces[flipped][[0, 2, 1]].tolist()
    others = ~repaired.flipped
    assert np.array_equal(repaired.faces[others], faces[others])
    assert repaired.report.boundary_loops == 0


def test_case_moebius(case):
    positions, _, repaired = case("moebius.obj")
    # Cut once across: a strip, one vertex more for each along the cut.
    assert repaired.report.cut_edges > 0
    assert repaired.report.components == 1
    (part,) = components(repaired)
    assert (part.surface.euler_characteristic, part.surface.n_boundary_loops) == (1, 1)
    assert len(repaired.vertices) == len(positions) + repaired.report.cut_edges + 1


def test_case_fin_on_sphere(case):
    positions, corners, repaired = case("fin_on_sphere.obj")
    assert found(repaired) == {"non_manifold_edges": 1}
    sphere, fin = components(repaired)
    assert (sphere.surface.n_boundary_loops, sphere.surface.euler_characteristic) == (0, 2)
    assert fin.surface.n_faces == 1
    assert fin.faces == len(corners) // 3 - 1
    assert len(repaired.vertices) == len(positions) + 2


def test_case_uv_sphere_pole_row(case):
    _, _, repaired = case("uv_sphere_pole_row.obj")
    assert set(found(repaired)) == {"welded_vertices", "degenerate_faces"}
    (part,) = components(repaired)
    assert (part.surface.n_boundary_loops, part.surface.euler_characteristic) == (0, 2)


@pytest.mark.parametrize(
    ("name", "polygons", "faces"), [("quad_cube.obj", 6, 12), ("quads.off", 6, 12)]
)
def test_case_quads(case, name, polygons, faces):
    _, _, repaired = case(name)
    assert repaired.report.polygons == ((4, polygons),)
    assert found(repaired) == {}
    assert repaired.report.faces == faces
    # A diagonal each, seen from both of its faces.
    assert repaired.inner.sum() == 2 * polygons


@pytest.mark.parametrize(
    "name", ["negative_indices_vt", "tiny_units", "huge_units", "long_strip", "sem_spike1e3"]
)
def test_case_without_defects(case, name):
    _, _, repaired = case(f"{name}.obj")
    assert found(repaired) == {}
    assert repaired.report.components == 1


# --------------------------------------------------------------------------------------------------
# vertices
# --------------------------------------------------------------------------------------------------


def soup(positions, faces):
    """Every face with vertices of its own."""
    positions = np.asarray(positions)[np.asarray(faces).reshape(-1)]
    return positions, np.arange(len(positions)).reshape(-1, 3)


def test_loose_triangles_are_welded():
    sphere = datasets.icosphere(2)
    positions, faces = soup(sphere.vertices, sphere.faces)
    repaired = repair(positions, faces)
    assert found(repaired) == {"welded_vertices": len(positions) - sphere.n_vertices}
    (part,) = components(repaired)
    assert part.surface.n_boundary_loops == 0


def test_only_exactly_equal_positions_are_welded():
    left = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
    right = [[1.0, 1, 0], [-0.0, 1, -0.0], [1, 0, -0.0]]
    positions = np.array(left + right)
    faces = [[0, 1, 2], [3, 4, 5]]
    assert repaired_and_checked(positions, faces).report.components == 1
    # Equal in single precision alone.
    positions[5, 0] += 1e-12
    assert repaired_and_checked(positions, faces).report.components == 2
    joined = repair(positions, faces, weld=1e-9)
    assert joined.report.components == 1
    assert joined.report.welded_vertices == 2
    assert joined.vertices.tolist() == positions[[0, 1, 2, 3]].tolist()


def test_welding_by_distance_collapses_what_is_smaller():
    sphere = datasets.icosphere(1)
    repaired = repair(sphere.vertices, sphere.faces, weld=10.0)
    assert found(repaired) == {"degenerate_faces": sphere.n_faces}
    assert len(repaired.vertices) == 0
    assert not repaired.corners(np.zeros((0, 3, 2))).any()


def test_a_bow_tie_is_opened():
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]])
    repaired = repaired_and_checked(positions, [[0, 1, 2], [0, 3, 4]])
    assert found(repaired) == {"non_manifold_vertices": 1}
    assert repaired.source_vertex.tolist() == [0, 0, 1, 2, 3, 4]
    assert repaired.faces.tolist() == [[0, 2, 3], [1, 4, 5]]


# --------------------------------------------------------------------------------------------------
# edges and orientation
# --------------------------------------------------------------------------------------------------


def cubes(*places):
    """Triangles of unit cubes, each with vertices of its own."""
    faces = CUBE_QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    positions = np.concatenate([CUBE + place for place in places])
    return positions, np.concatenate([faces + 8 * k for k in range(len(places))])


@pytest.mark.parametrize("place", [(1, 1, 0), (1, 0, 0), (1, 1, 1), (0, 0, 1)])
@pytest.mark.parametrize("split", [False, True])
def test_solids_that_touch_stay_solids(place, split):
    positions, faces = cubes((0, 0, 0), place)
    if split:
        positions, faces = soup(positions, faces)
    repaired = repaired_and_checked(positions, faces)
    if not split or sum(place) > 1:
        assert repaired.report.components == 2
        assert repaired.report.boundary_loops == 0


def test_voxels_of_one_solid_that_touch_along_an_edge():
    # Two by two by three voxels, in the middle layer only two across the diagonal.
    places = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 2)] + [(0, 0, 1), (1, 1, 1)]
    positions, faces = cubes(*places)
    # The side of a voxel from its middle; what lies there is filled where the side is inside.
    middles = positions[faces].reshape(len(places), 6, 6, 3).mean(axis=2)
    steps = np.round(2 * (middles - np.array(places)[:, None] - 0.5)).astype(int)
    outside = [
        tuple(np.add(place, step).tolist()) not in places
        for place, row in zip(places, steps, strict=True)
        for step in row
    ]
    faces = faces[np.repeat(outside, 2)]
    # Vertices at a place are one, as in a mesh of voxels.
    positions, index = np.unique(positions, axis=0, return_inverse=True)
    repaired = repaired_and_checked(positions, index.reshape(-1)[faces])
    assert found(repaired) == {"non_manifold_edges": 1}
    assert repaired.report.components == 1
    assert repaired.report.boundary_loops == 0


def test_back_to_back_faces_are_two_sheets():
    sheet = datasets.sheet(4, 3)
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1]])
    repaired = repaired_and_checked(sheet.vertices, faces)
    assert repaired.report.opposite_faces == sheet.n_faces
    assert repaired.report.flipped_faces == 0
    front, back = components(repaired)
    for part in (front, back):
        assert (part.surface.n_faces, part.surface.n_boundary_loops) == (sheet.n_faces, 1)


def test_faces_around_an_edge_are_paired_flattest_first():
    positions = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0.1, 0], [0, 1, 0], [0.1, -1, 0]])
    # Two sheets that cross, one from left to right and one from below to above.
    faces = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]]
    repaired = repaired_and_checked(positions, faces)
    assert found(repaired) == {"non_manifold_edges": 1}
    assert repaired.component.tolist() == [0, 0, 1, 1]


def test_patches_turn_over_to_be_paired():
    positions = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]])
    repaired = repaired_and_checked(positions, [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert repaired.report.components == 2
    assert repaired.component.tolist() == [0, 0, 1]
    assert repaired.flipped.tolist() == [False, True, False]


def test_many_faces_around_one_edge():
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    positions = np.concatenate([[[0, 0, -1.0], [0, 0, 1]], rim])
    faces = [[0, 1, 2 + k] if k < 20 else [1, 0, 2 + k] for k in range(40)]
    repaired = repaired_and_checked(positions, faces)
    # Every blade goes on to the one half a turn away.
    assert repaired.component.tolist() == [*range(20), *range(20)]


def test_the_winding_of_most_of_the_area_wins():
    sphere = datasets.icosphere(1)
    centre = sphere.vertices[sphere.faces].mean(axis=1)
    for bound, turned in [(0.3, centre[:, 2] > 0.3), (-0.3, centre[:, 2] <= -0.3)]:
        faces = sphere.faces.copy()
        over = centre[:, 2] > bound
        faces[over] = faces[over][:, ::-1]
        repaired = repair(sphere.vertices, faces)
        assert np.array_equal(repaired.flipped, turned)


def klein_bottle(rows=12, columns=9):
    """A grid that closes along its rows as a torus does, and along its columns mirrored."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))

    def vertex(i, j):
        return (i % rows) * columns + np.where(i < rows, j, -j) % columns

    a, b, c, d = vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    positions = np.random.default_rng(3).random((rows * columns, 3))
    return positions, faces


def test_a_klein_bottle_is_cut_open():
    positions, faces = klein_bottle()
    repaired = repaired_and_checked(positions, faces)
    assert set(found(repaired)) <= {"cut_edges", "flipped_faces"}
    assert repaired.report.cut_edges >= 9
    assert repaired.report.components == 1
    (part,) = components(repaired)
    assert part.surface.n_boundary_loops >= 1


# --------------------------------------------------------------------------------------------------
# polygons and what is set aside
# --------------------------------------------------------------------------------------------------


def test_polygons_with_a_hole_and_straight_sides():
    # An L with a corner in the middle of a side, which the triangle there uses.
    positions = np.array(
        [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0], [1, -1, 0]]
    )
    repaired = repaired_and_checked(positions, [0, 1, 2, 3, 4, 5, 6, 1, 0, 7, 2, 1, 7], [7, 3, 3])
    assert found(repaired) == {}
    assert repaired.report.components == 1
    (part,) = components(repaired)
    assert part.surface.area == pytest.approx(4)
    assert part.surface.n_boundary_loops == 1
    assert repaired.inner[:5].sum() == 8
    assert not repaired.inner[5:].any()


def test_a_polygon_with_a_repeated_corner_has_no_diagonal_there():
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    repaired = repaired_and_checked(positions, [0, 1, 1, 2, 1, 3, 2], [4, 3])
    assert found(repaired) == {"degenerate_faces": 1}
    assert repaired.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert not repaired.inner.any()


def test_a_triangle_without_area_lies_on_its_longest_side():
    positions = np.array([[0.0, 0, 0], [4, 0, 0], [2, 3, 0], [1, 0, 0], [1, -1, 0]])
    repaired = repaired_and_checked(positions, [[0, 1, 2], [1, 0, 3], [0, 3, 4]])
    assert found(repaired) == {"degenerate_faces": 1}
    assert repaired.aside.host.tolist() == [0]
    assert repaired.aside.weights[0].tolist() == [[0, 1, 0], [1, 0, 0], [0.75, 0.25, 0]]


def test_what_touches_no_face_goes_to_the_first():
    positions = np.array([[0.0, 0, 0], [4, 0, 0], [2, 3, 0], [9, 9, 9], [7, 7, 7]])
    repaired = repaired_and_checked(positions, [0, 1, 2, 3, 4, 3], [3, 2, 1])
    assert repaired.aside.host.tolist() == [0, 0]
    assert repaired.polygon_face.tolist() == [0, 0, 0]


def test_needles_that_a_surface_refuses_are_set_aside():
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-13, 0], [0.5, 1e-11, 0], [0.5, -1, 0]])
    repaired = repaired_and_checked(positions, [[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    assert repaired.aside.polygon.tolist() == [0]
    with pytest.raises(ValueError, match="degenerate"):
        pa.Surface(positions[:3], [[0, 1, 2]])


# --------------------------------------------------------------------------------------------------
# what is refused, and what is said
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("positions", "corners", "sizes", "options", "message"),
    [
        (CUBE[:, :2], [0, 1, 2], None, {}, r"positions: shape \(8, 2\) must be \(n, 3\)"),
        (CUBE, [0, 1, 8], None, {}, r"corners\[2\]: 8 must be in 0..8"),
        (CUBE, [0, -1, 7], None, {}, r"corners\[1\]: -1 must be in 0..8"),
        (CUBE, [0.0, 1, 2], None, {}, "corners: dtype float64 must be an integer type"),
        (CUBE, [0, 1, 2, 3], None, {}, "corners: length 4 must be 6"),
        (CUBE, [[0, 1, 2, 3]], None, {}, r"corners: shape \(1, 4\) must be \(c,\) or \(m, 3\)"),
        (CUBE, [0, 1, 2], [2], {}, "corners: length 3 must be 2"),
        (CUBE, [0, 1, 2], [2, 2], {}, r"sizes\[1\]: 2 must be in \[0, 1\]"),
        (CUBE, [0, 1, 2], [-1, 4], {}, r"sizes\[0\]: -1 must be in \[0, 3\]"),
        (CUBE, [0, 1, 2], None, {"weld": -1.0}, "weld: -1 must be a non-negative number"),
        (CUBE, [0, 1, 2], None, {"weld": np.nan}, "weld: NaN must be a non-negative number"),
        (
            CUBE + np.array([np.inf, 0, 0]),
            [3, 1, 2],
            None,
            {},
            r"positions\[1\]: inf must be a finite",
        ),
    ],
)
def test_what_is_refused(positions, corners, sizes, options, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        repair(positions, corners, sizes, **options)


def test_a_vertex_that_nothing_uses_may_be_anywhere():
    positions = np.concatenate([CUBE, [[np.nan, 0, np.inf]]])
    repaired = repair(positions, CUBE_QUADS.reshape(-1), [4] * 6)
    assert found(repaired) == {"isolated_vertices": 1}


def test_a_map_of_another_shape_is_refused():
    repaired = repair(CUBE, [0, 1, 2])
    with pytest.raises(ValueError, match=r"^uv: shape \(2, 3, 2\) must be \(1, 3, 2\)"):
        repaired.corners(np.zeros((2, 3, 2)))


def test_sentences():
    positions = np.concatenate([CUBE, CUBE[:1], [[5.0, 5, 5]]])
    corners = np.concatenate([CUBE_QUADS.reshape(-1), [0, 1, 3], [8, 1, 1], [0, 1, 3, 2]])
    repaired = repaired_and_checked(positions, corners, [4] * 6 + [3, 3] + [4])
    assert repaired.report.sentences() == [
        "The mesh has 2 triangles and 7 quadrilaterals.",
        "Repaired, it has 12 triangles in 1 component with 0 boundary loops.",
        "1 vertex belongs to no polygon.",
        "1 triangle has no area and was set aside.",
        "3 triangles are second copies and were set aside.",
    ]


# --------------------------------------------------------------------------------------------------
# anything
# --------------------------------------------------------------------------------------------------


@st.composite
def soups(draw):
    """Polygons over few places: shared, doubled, flipped, pinched, crossing, without area."""
    size = draw(st.sampled_from([2, 3]))
    place = st.tuples(*[st.integers(0, size)] * 2, st.integers(0, 1))
    positions = np.array(draw(st.lists(place, min_size=1, max_size=12)), dtype=float)
    vertex = st.integers(0, len(positions) - 1)
    only_triangles = draw(st.booleans())
    lengths = st.just(3) if only_triangles else st.integers(0, 8)
    polygons = draw(
        st.lists(lengths.flatmap(lambda n: st.lists(vertex, min_size=n, max_size=n)), max_size=14)
    )
    for polygon in list(polygons):
        copy = draw(st.sampled_from(["none", "none", "same", "turned", "flipped"]))
        if copy != "none":
            turned = polygon[1:] + polygon[:1] if copy == "turned" else list(polygon)
            polygons.append(turned[::-1] if copy == "flipped" else turned)
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    corners = np.array([v for polygon in polygons for v in polygon], dtype=np.int64)
    return positions, corners, None if only_triangles and draw(st.booleans()) else sizes


@settings(max_examples=200, deadline=None)
@given(soups())
def test_any_soup_is_repaired(case):
    positions, corners, sizes = case
    repaired_and_checked(positions, corners, sizes)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_any_clean_mesh_comes_back(seed, count):
    rng = np.random.default_rng(seed)
    parts = [
        datasets.icosphere(1),
        datasets.torus(1.0, 0.4, 8, 6),
        datasets.sheet(3, 4),
    ]
    positions, faces = [], []
    for k in range(count):
        part = parts[rng.integers(3)]
        faces.append(part.faces + sum(map(len, positions)))
        positions.append(part.vertices + np.array([10.0 * k, 0, 0]))
    positions, faces = np.concatenate(positions), np.concatenate(faces)
    faces = faces[rng.permutation(len(faces))]
    order = rng.permutation(len(positions))
    inverse = np.argsort(order)
    repaired = repair(positions[order], inverse[faces])
    assert_unchanged(repaired, positions[order], inverse[faces])
    assert repaired.report.components == count
