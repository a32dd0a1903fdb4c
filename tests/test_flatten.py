"""Maps of charts: energies, exact maps, bijections whatever the labels."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh

import generated
import phaseatlas as pa
import reference
from phaseatlas import _core
from phaseatlas.points import flat_areas

METHODS = ["isometric", "bff"]


def one_segment(surface):
    labels = np.zeros(surface.n_faces, dtype=np.int64)
    return pa.Segmentation(surface, labels, np.ones((1, surface.n_vertices)))


def cells(surface, count, seed):
    """Segments of the faces nearest to some random ones, with even weights."""
    rng = np.random.default_rng(seed)
    centres = surface.vertices[surface.faces].mean(axis=1)
    seeds = centres[rng.choice(surface.n_faces, count, replace=False)]
    labels = np.linalg.norm(centres[:, None] - seeds, axis=2).argmin(axis=1)
    return pa.Segmentation(surface, labels, np.full((count, surface.n_vertices), 1 / count))


def ramp(turns):
    """A strip that winds about an axis, rising: flattened it comes to lie on itself."""
    flat = pa.datasets.sheet(60, 5)
    x, y, _ = (flat.vertices / np.ptp(flat.vertices, axis=0).clip(1e-9)).T
    x, y = x - x.min(), y - y.min()
    angle, radius = 2 * np.pi * turns * x, 2 - y
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.5 * x], axis=1)
    return pa.Surface(vertices, flat.faces)


def check_bijections(atlas):
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in atlas.charts])
    np.testing.assert_array_equal(np.sort(labelled), np.arange(atlas.surface.n_faces))
    for chart in atlas.charts:
        assert reference.is_bijection(chart.triangles[chart.labelled].tolist(), chart.uv)
    assert (atlas.diagnostics.flips, atlas.diagnostics.crossing) == (0, 0)


def test_energy_and_gradient_are_those_of_the_twin():
    surface = pa.datasets.sheet(6, 5, amplitude=0.2, periods=1)
    disk = surface.cut_to_disk(np.arange(surface.n_faces))
    rng = np.random.default_rng(0)
    uv = _core.bff(disk.mesh).uv + 0.02 * rng.random((len(disk.vertices), 2))
    vertices = surface.vertices[disk.vertices]
    energy, gradient = _core.symmetric_dirichlet(disk.mesh, uv)
    expected, slopes = reference.symmetric_dirichlet(vertices, disk.triangles, uv)
    assert energy == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(gradient, slopes, rtol=1e-9, atol=1e-12)


def test_isometric_maps_are_at_rest():
    surface = pa.datasets.sheet(20, 16, amplitude=0.2, periods=1)
    disk = surface.cut_to_disk(np.arange(surface.n_faces)).mesh
    start, rest = (
        _core.symmetric_dirichlet(disk, uv) for uv in (_core.bff(disk).uv, _core.isometric(disk))
    )
    assert rest[0] < start[0]
    assert np.abs(rest[1]).max() < 0.01 * np.abs(start[1]).max()


def test_large_charts_are_mapped_as_well_as_small_ones():
    # Above 40,000 faces the vertices of a chart move with those of a simplified one.
    excess = []
    for cells in (60, 150):
        surface = pa.datasets.sheet(cells, cells, amplitude=0.15, periods=1)
        cut = surface.cut_to_disk(np.arange(surface.n_faces))
        uv = _core.isometric(cut.mesh)
        uv *= np.sqrt(surface.area / flat_areas(uv[cut.triangles]).sum())
        excess.append(_core.symmetric_dirichlet(cut.mesh, uv)[0] - 4)
        assert _core.faults(cut.triangles, uv, 0.0) == (0, False, 0)
    assert excess[1] < 1.05 * excess[0]


@pytest.mark.parametrize("flatten", METHODS)
@pytest.mark.parametrize("name", ["sheet", "cylinder", "cone"])
def test_developable_surfaces_are_mapped_exactly(flatten, name):
    surface = {
        "sheet": lambda: pa.datasets.sheet(12, 9),
        "cylinder": lambda: pa.datasets.cylinder(0.5, 1.0, 30, 10),
        "cone": generated.SURFACES["cone open"],
    }[name]()
    metrics = pa.build_atlas(one_segment(surface), flatten=flatten).metrics()
    assert metrics["charts"] == 1
    assert metrics["hencky"] < 1e-9
    assert metrics["qc"] - 1 < 1e-9


@pytest.mark.parametrize("flatten", METHODS)
def test_tiny_pieces_have_maps(flatten):
    box = trimesh.creation.box((1, 2, 3))
    whole = pa.Surface(box.vertices, box.faces)
    sides = np.abs(box.face_normals @ [1, 2, 3] + 4).round().astype(np.int64)
    _, sides = np.unique(sides, return_inverse=True)
    triangle = pa.Surface([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    square = pa.Surface([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1)], [(0, 1, 2), (0, 2, 3)])
    strip = pa.datasets.sheet(9, 2, amplitude=0.1, periods=1)
    for surface, labels in [
        (triangle, [0]),
        (square, [0, 0]),
        (square, [0, 1]),
        (strip, np.zeros(strip.n_faces, dtype=np.int64)),
        (whole, sides),
        (whole, np.arange(12)),
        (whole, np.zeros(12, dtype=np.int64)),
    ]:
        count = int(np.max(labels)) + 1
        weights = np.full((count, surface.n_vertices), 1 / count)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pa.QualityWarning)
            atlas = pa.build_atlas(pa.Segmentation(surface, labels, weights), flatten=flatten)
        check_bijections(atlas)


@pytest.mark.parametrize("flatten", METHODS)
@pytest.mark.parametrize(
    "name", ["box brick coarse", "torus coarse", "blob coarse", "sphere coarse", "terrain strip"]
)
def test_charts_of_any_labels_are_bijections(name, flatten):
    surface = generated.SURFACES[name]()
    for count, seed in [(1, 0), (3, 1), (8, 2)]:
        segmentation = cells(surface, count, seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pa.QualityWarning)
            check_bijections(pa.build_atlas(segmentation, flatten=flatten, resolution=128))


def test_what_overlaps_itself_is_split_and_said():
    segmentation = one_segment(ramp(1.3))
    with pytest.warns(pa.QualityWarning, match=r"^charts: 1 had to be split"):
        atlas = pa.build_atlas(segmentation, flatten="bff")
    assert len(atlas.charts) > 1
    assert {chart.segment for chart in atlas.charts} == {0}
    check_bijections(atlas)


def test_isometric_maps_are_drawn_apart_rather_than_split():
    atlas = pa.build_atlas(one_segment(ramp(1.3)), flatten="isometric")
    assert len(atlas.charts) == 1
    check_bijections(atlas)


@pytest.mark.parametrize("flatten", METHODS)
def test_flat_segments_with_holes_are_not_cut(flatten):
    surface = generated.SURFACES["annulus flat"]()
    atlas = pa.build_atlas(one_segment(surface), flatten=flatten)
    (chart,) = atlas.charts
    assert chart.cut_length == 0.0
    assert len(chart.vertices) == surface.n_vertices
    metrics = atlas.metrics()
    assert metrics["seam"] == 0.0
    assert metrics["hencky"] < 1e-12
    check_bijections(atlas)


@pytest.mark.parametrize("name", ["hand", "bunny"])
def test_partitions_keep_areas_better_than_conformal_maps(mesh_path, name):
    found = pa.partition(pa.load(mesh_path(name)), effort="fast")
    default, conformal = pa.build_atlas(found), pa.build_atlas(found, flatten="bff")
    figures, others = default.metrics(), conformal.metrics()
    assert figures["hencky"] < 0.3 * others["hencky"]
    assert figures["hencky"] < 1.5e-3
    assert figures["qc"] < 1.04
    assert figures["flips"] == figures["crossing"] == figures["non_disk"] == 0
    np.testing.assert_array_equal(pa.build_atlas(found).uv, default.uv)
