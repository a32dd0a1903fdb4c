"""Charts in mirrored pairs: the plane, the half, and labels of both."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.partitioning.symmetry import mirror
from phaseatlas.scene.mesh import Mesh
from phaseatlas.scene.scene import scene_of


def doubled(surface, offset, axis=0):
    """A surface beside its mirror image across a plane, in two pieces."""
    image = surface.vertices.copy()
    image[:, axis] = 2 * offset - image[:, axis]
    vertices = np.concatenate([surface.vertices, image])
    faces = np.concatenate([surface.faces, surface.faces[:, ::-1] + surface.n_vertices])
    return vertices, faces


def scene(vertices, faces):
    sizes = np.full(len(faces), faces.shape[1])
    return scene_of([Mesh("", vertices, faces.reshape(-1), sizes)])


def images(surface, offset, axis):
    """The face that each one's mirror image is, by brute force; -1 for none."""
    centre = surface.vertices[surface.faces].mean(axis=1)
    turned = centre.copy()
    turned[:, axis] = 2 * offset - turned[:, axis]
    distance = np.linalg.norm(turned[:, None] - centre[None], axis=2)
    return np.where(distance.min(axis=1) < 1e-9, distance.argmin(axis=1), -1)


def test_the_plane_goes_through_the_middle_of_the_pairs():
    vertices, faces = doubled(datasets.sheet(7, 5, size=(2.0, 1.0)), 3.25)
    surface = scene(vertices, faces)
    found = mirror(surface, "x")
    assert found.offset == pytest.approx(3.25, abs=1e-9)
    assert found.share == pytest.approx(1.0)
    np.testing.assert_array_equal(found.partner[found.unit], images(surface, 3.25, 0))
    # Of each pair one is kept.
    assert len(found.half) == surface.n_faces // 2
    assert (surface.vertices[surface.faces[found.half]][..., 0] > 3.25).all()


def test_an_unmatched_part_leaves_the_plane_where_it_is():
    vertices, faces = doubled(datasets.sheet(10, 10), 1.0)
    extra = np.array([[5.0, 0.0, 0.0], [5.2, 0.0, 0.0], [5.0, 0.2, 0.0]])
    faces = np.concatenate([faces, np.arange(3)[None] + len(vertices)])
    surface = scene(np.concatenate([vertices, extra]), faces)
    found = mirror(surface, "x")
    assert found.offset == pytest.approx(1.0, abs=1e-9)
    assert found.partner[found.unit[-1]] == -1
    assert found.kept[found.unit[-1]]


def test_polygons_are_matched_whole_however_they_are_cut():
    x, y = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(0, 1, 4), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), 0.1 * np.abs(x).ravel()], axis=1)
    k = np.arange(9 * 4).reshape(9, 4)
    quads = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], axis=-1).reshape(-1, 4)
    surface = scene(vertices, quads)
    found = mirror(surface, "x")
    assert found.share == pytest.approx(1.0)
    assert found.offset == pytest.approx(0.0, abs=1e-12)
    labels = pa.partition(surface, symmetry="x", effort="fast").labels
    polygon = surface.meshes[0].repaired.polygon
    of_polygon = np.full(len(quads), -1)
    of_polygon[polygon] = labels
    np.testing.assert_array_equal(of_polygon[polygon], labels)


def test_what_is_not_symmetric_is_refused_in_one_line():
    surface = datasets.sheet(12, 7, size=(2.0, 1.0))
    bent = pa.Surface(
        surface.vertices + np.array([1.0, 0.0, 1.0]) * surface.vertices[:, :1] ** 2, surface.faces
    )
    message = r"symmetry: [\d.e+-]+ % of the area has a mirror image across x = .* at least 95 %"
    with pytest.raises(ValueError, match=message) as error:
        pa.partition(bent, symmetry="x")
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="symmetry: 'w' must be one of"):
        pa.partition(surface, symmetry="w")
    with pytest.raises(ValueError, match="symmetry: value must be left out with levels"):
        pa.unwrap(surface, levels=1, symmetry="x")


@pytest.mark.parametrize("axis", ["x", "z"])
def test_charts_come_in_mirrored_pairs(axis):
    # The squares of the grid are cut along one diagonal, those of its image along the other.
    along = "xyz".index(axis)
    surface = datasets.torus(1.0, 0.4, 24, 12)
    charts = pa.partition(surface, symmetry=axis, effort="fast")
    turned = surface.vertices.copy()
    turned[:, along] *= -1.0
    distance = np.linalg.norm(turned[:, None] - surface.vertices[None], axis=2)
    assert distance.min(axis=1).max() < 1e-9
    image = distance.argmin(axis=1)
    own = [
        frozenset(surface.faces[charts.labels == k].ravel().tolist())
        for k in range(len(charts.areas))
    ]
    for vertices, area in zip(own, charts.areas, strict=True):
        other = own.index(frozenset(image[list(vertices)].tolist()))
        assert own[other] != vertices
        assert charts.areas[other] == pytest.approx(area)
        # No chart crosses the plane.
        side = np.sign(surface.vertices[list(vertices), along].round(9))
        assert len(set(side.tolist()) - {0.0}) == 1
    assert pa.build_atlas(charts, resolution=256).diagnostics.fatal() == []


@pytest.mark.parametrize("most", [1, 3, 4, 6])
def test_max_charts_holds_for_both_halves(most):
    torus = datasets.torus(1.0, 0.4, 24, 12)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        charts = pa.partition(torus, symmetry="z", max_charts=most, effort="fast")
    assert charts.n_segments % 2 == 0
    # What is said is said of both halves, in the number that was given.
    words = f"max_charts: {most} is exceeded, there are {charts.n_segments} charts"
    assert [str(w.message) for w in said] == [words] * (charts.n_segments > most)
    assert charts.n_segments <= max(most, 2)


def test_more_pieces_than_max_charts_are_counted_on_both_sides():
    vertices, faces = doubled(datasets.sheet(4, 3), 2.5)
    twice = np.concatenate([vertices, vertices + np.array([0.0, 5.0, 0.0])])
    surface = scene(twice, np.concatenate([faces, faces + len(vertices)]))
    with pytest.warns(pa.QualityWarning) as said:
        charts = pa.partition(surface, symmetry="x", max_charts=3, effort="fast")
    assert charts.n_segments == 4
    messages = [str(w.message) for w in said]
    assert messages == ["max_charts: 3 is exceeded, there are 4 charts"]


def test_the_energy_is_that_of_both_halves(tmp_path):
    torus = datasets.torus(1.0, 0.4, 24, 12)
    charts = pa.partition(torus, symmetry="z", effort="fast", distortion=500.0)
    (last,) = charts.diagnostics
    assert last.n_charts == charts.n_segments
    corners = torus.vertices[torus.faces]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    seam = lengths[charts.labels[:, None] != charts.labels[torus.face_neighbours]].sum() / 2
    assert last.seam == pytest.approx(seam / np.sqrt(torus.area))
    sum_of_terms = last.seam + last.cuts + 500.0 * last.distortion + 0.1 * last.n_charts
    assert last.energy == pytest.approx(sum_of_terms)
    pa.save_mesh(torus, tmp_path / "in.obj")
    options = pa.AtlasOptions(symmetry="z", effort="fast", distortion=500.0)
    record = pa.atlas_file(tmp_path / "in.obj", tmp_path / "out.obj", options).record()
    assert record["energy"]["energy"] == pytest.approx(last.energy, rel=1e-6)


def test_two_pieces_that_are_images_of_each_other():
    vertices, faces = doubled(datasets.sheet(8, 6, size=(2.0, 1.0)), 2.5)
    charts = pa.partition(scene(vertices, faces), symmetry="x", effort="fast")
    first, second = np.split(charts.labels, 2)
    assert not set(first) & set(second)
    # They are one labelling, up to names.
    assert len(set(zip(first, second, strict=True))) == len(set(first)) == len(set(second))


def test_a_real_model_is_symmetric(mesh_path):
    surface = pa.load_scene(mesh_path("bob"))
    found = mirror(surface, "z")
    assert found.share == pytest.approx(1.0)
    assert abs(found.offset) < 1e-6
    with pytest.raises(ValueError, match="symmetry: "):
        mirror(surface, "x")


@pytest.fixture(scope="module")
def stacked():
    surface = datasets.torus(1.0, 0.4, 24, 12)
    charts = pa.partition(surface, symmetry="z", effort="fast")
    return pa.build_atlas(charts, resolution=256, stack="z")


def test_stacked_charts_share_texels_turned_over(stacked):
    surface = stacked.surface
    over = stacked.stacked
    assert np.count_nonzero(over) == surface.n_faces // 2
    e = stacked.uv[:, 1:] - stacked.uv[:, :1]
    signed = e[:, 0, 0] * e[:, 1, 1] - e[:, 0, 1] * e[:, 1, 0]
    assert (signed[~over] > 0).all()
    assert (signed[over] < 0).all()
    # A place in the texture is two mirrored points of the surface.
    place = {}
    for face in np.flatnonzero(~over):
        for vertex, uv in zip(surface.faces[face], stacked.uv[face], strict=True):
            place.setdefault(tuple(uv), surface.vertices[vertex] * [1.0, 1.0, -1.0])
    for face in np.flatnonzero(over):
        for vertex, uv in zip(surface.faces[face], stacked.uv[face], strict=True):
            np.testing.assert_allclose(place[tuple(uv)], surface.vertices[vertex], atol=1e-9)


def test_stacked_faces_are_exempt_and_counted(stacked):
    found = stacked.diagnostics
    assert found.fatal() == []
    assert found.stacked == stacked.surface.n_faces // 2
    metrics = stacked.metrics()
    assert metrics["charts"] == len(stacked.charts)
    assert metrics["overlap"] == metrics["flips"] == 0
    alone = pa.build_atlas(
        pa.partition(stacked.surface, symmetry="z", effort="fast"), resolution=256
    )
    assert stacked.density > 1.2 * alone.density
    assert stacked.metrics()["seam"] == pytest.approx(alone.metrics()["seam"])


def test_stacked_charts_stay_so_packed_again_and_saved(stacked, tmp_path):
    again = stacked.packed(resolution=512, pages=2)
    np.testing.assert_array_equal(again.stacked, stacked.stacked)
    assert again.diagnostics.fatal() == []
    over = again.stacked
    np.testing.assert_array_equal(again.uv[over], again.uv.reshape(-1, 2)[again.stack[over]])
    np.testing.assert_array_equal(
        again.face_pages[over], again.face_pages[again.stack[over][:, 0] // 3]
    )
    stacked.save(tmp_path / "a.npz")
    loaded = pa.Atlas.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(loaded.stack, stacked.stack)
    assert loaded.resolution == 256
    image = stacked.bake()
    assert image.shape == (256, 256, 3)


def test_what_is_no_pair_is_not_stacked():
    surface = datasets.torus(1.0, 0.4, 24, 12)
    labels = np.zeros(surface.n_faces, dtype=np.int64)
    with pytest.warns(pa.QualityWarning, match="stack: no chart is the mirror image"):
        atlas = pa.build_atlas(pa.Segmentation(surface, labels), flatten="bff", stack="z")
    assert not atlas.stacked.any()
    with pytest.raises(ValueError, match="stack: value must be given with symmetry alone"):
        pa.unwrap(surface, stack=True)


def test_a_file_of_stacked_charts(tmp_path):
    surface = datasets.torus(1.0, 0.4, 24, 12)
    path = tmp_path / "in.obj"
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.vertices.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (surface.faces + 1).tolist()]
    path.write_text("\n".join(rows) + "\n")
    options = pa.AtlasOptions(
        symmetry="z", stack=True, effort="fast", texture="checker", resolution=128
    )
    made = pa.atlas_file(path, tmp_path / "out.glb", options)
    assert made.record()["flaws"]["stacked"] == surface.n_faces // 2
    assert made.warnings == ()
    with pytest.raises(ValueError, match="symmetry: value must not be given with levels"):
        pa.AtlasOptions(symmetry="z", levels=2)
