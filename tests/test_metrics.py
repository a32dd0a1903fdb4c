"""Metrics of UV layouts against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import reference
from phaseatlas import datasets
from phaseatlas.atlas.metrics import atlas_metrics, uv_topology, yamabe_factors
from phaseatlas.surface import Surface

SMALL = {"resolution": 256}


def flat(surface):
    """The sheet's own plane as UV."""
    return surface.vertices[surface.faces][..., :2].copy()


def hemisphere(cells):
    """Square grid wrapped onto the upper half of the unit sphere."""
    surface = datasets.sheet(cells, cells, size=(2.0, 2.0))
    square = surface.vertices[:, :2] - 1.0
    norm = np.linalg.norm(square, axis=1)
    polar = 0.5 * math.pi * np.abs(square).max(axis=1)
    direction = square / np.where(norm > 0.0, norm, 1.0)[:, None]
    ring = direction * np.sin(polar)[:, None]
    sphere = Surface(np.column_stack([ring, np.cos(polar)]), surface.faces)
    return sphere, flat(surface)


def unrolled(surface, n_around, n_along, radius):
    """A cylinder cut along its first column and laid flat at the length of its chords."""
    column, row = np.divmod(surface.faces, n_along + 1)
    column = np.where((column == 0) & (column.max(axis=1) > 1)[:, None], n_around, column)
    chord = 2.0 * radius * math.sin(math.pi / n_around)
    heights = surface.vertices[surface.faces][..., 2]
    assert row.max() == n_along
    return np.stack([column * chord, heights], axis=-1)


def test_isometric_sheet():
    surface = datasets.sheet(12, 9, size=(2.0, 2.0))
    metrics = atlas_metrics(surface, 3.0 * flat(surface) + 5.0, **SMALL)
    expected = {
        "charts": 1,
        "non_disk": 0,
        "seam": 0.0,
        "yamabe": 0.0,
        "qc": 1.0,
        "hencky": 0.0,
        "l2": 1.0,
        "degenerate": 0,
        "flips": 0,
        "crossing": 0,
        "overlap": 0.0,
        "packing": 100.0,
    }
    assert set(metrics) == set(expected)
    assert metrics == pytest.approx(expected, abs=1e-12)


def test_stretched_sheet():
    surface = datasets.sheet(6, 6)
    metrics = atlas_metrics(surface, flat(surface) * [2.0, 0.5], **SMALL)
    assert metrics["qc"] == pytest.approx(4.0)
    assert metrics["hencky"] == pytest.approx(0.0, abs=1e-14)
    assert metrics["l2"] == pytest.approx(math.sqrt(0.5 * (2.0**-2 + 0.5**-2)))
    assert metrics["packing"] == pytest.approx(25.0)


def test_two_charts_of_different_scale():
    surface = datasets.sheet(8, 4, size=(2.0, 1.0))
    uv = flat(surface)
    right = uv[:, :, 0].mean(axis=1) > 1.0
    uv[right] = math.e * uv[right]
    metrics = atlas_metrics(surface, uv, **SMALL)
    assert metrics["charts"] == 2
    assert metrics["non_disk"] == 0
    assert metrics["seam"] == pytest.approx(1.0 / math.sqrt(2.0))
    assert metrics["hencky"] == pytest.approx(0.25)
    assert metrics["qc"] == pytest.approx(1.0)


def test_mirrored_layout_has_no_flips():
    surface = datasets.sheet(4, 4)
    assert atlas_metrics(surface, flat(surface) * [-1.0, 1.0], **SMALL)["flips"] == 0


def test_folded_face_is_a_flip_and_overlaps():
    surface = datasets.sheet(3, 1, size=(3.0, 1.0))
    uv = flat(surface)
    valence = np.bincount(surface.faces.ravel())
    face, corner = np.argwhere(valence[surface.faces] == 1)[0]
    # The third corner of a right isosceles triangle mirrored in its hypotenuse.
    other = uv[face, [(corner + 1) % 3, (corner + 2) % 3]]
    uv[face, corner] = other.sum(axis=0) - uv[face, corner]
    metrics = atlas_metrics(surface, uv, resolution=600)
    assert metrics["flips"] == 1
    assert metrics["overlap"] == pytest.approx(20.0, abs=0.5)


def test_faces_without_area_are_counted_and_left_out():
    surface = datasets.sheet(3, 3)
    uv = flat(surface)
    uv[5] = uv[5, 0]
    metrics = atlas_metrics(surface, uv, **SMALL)
    assert metrics["degenerate"] == 1
    assert metrics["qc"] == pytest.approx(1.0)
    assert metrics["flips"] == 0


def test_cylinder_is_flat_once_cut():
    n_around, n_along = 24, 8
    surface = datasets.cylinder(1.0, 2.0, n_around, n_along)
    uv = unrolled(surface, n_around, n_along, 1.0)
    metrics = atlas_metrics(surface, uv, **SMALL)
    assert metrics["charts"] == 1
    assert metrics["non_disk"] == 0
    assert metrics["seam"] == pytest.approx(2.0 / math.sqrt(surface.area))
    assert metrics["yamabe"] == pytest.approx(0.0, abs=1e-20)
    assert metrics["qc"] == pytest.approx(1.0)
    assert metrics["l2"] == pytest.approx(1.0)


def test_annulus_is_no_disk():
    surface = datasets.cylinder(1.0, 1.0, 16, 4)
    radius = np.exp(-surface.vertices[:, 2:])
    metrics = atlas_metrics(surface, (radius * surface.vertices[:, :2])[surface.faces], **SMALL)
    assert metrics["charts"] == 1
    assert metrics["non_disk"] == 1
    assert metrics["seam"] == 0.0


def test_slit_is_cut_open_but_leaves_one_disk():
    surface = datasets.sheet(4, 4, amplitude=0.1)
    uv = flat(surface)
    below = (uv[:, :, 1] <= 0.5 + 1e-12).all(axis=1)
    on_slit = (np.abs(uv[:, :, 1] - 0.5) < 1e-12) & (uv[:, :, 0] < 0.5 - 1e-12)
    uv[on_slit & below[:, None]] -= [0.0, 0.1]
    topology = uv_topology(surface, uv)
    assert topology.n_charts == 1
    # Two edges, the second ending at the tip, which stays one vertex: two vertices double.
    assert topology.n_vertices == surface.n_vertices + 2
    assert topology.seams.sum() == 4
    assert atlas_metrics(surface, uv, **SMALL)["non_disk"] == 0


def test_hemisphere_shrinks_like_the_stereographic_projection():
    surface, uv = hemisphere(40)
    topology = uv_topology(surface, uv)
    factors = yamabe_factors(surface, topology)
    height = np.empty(topology.n_vertices)
    height[topology.corner] = surface.vertices[surface.faces][..., 2]
    np.testing.assert_allclose(factors, -np.log1p(height), atol=3e-3)
    mean_square = 2.0 * math.log(2.0) ** 2 - 4.0 * math.log(2.0) + 2.0
    assert atlas_metrics(surface, uv, **SMALL)["yamabe"] == pytest.approx(mean_square, rel=1e-2)


def cut_in_three(surface):
    """A UV layout of three parts of a surface, two of which touch at a vertex."""
    uv = surface.vertices[surface.faces][..., :2].copy()
    centres = uv.mean(axis=1)
    parts = (centres[:, 0] > 1.0).astype(int) + 2 * (centres[:, 1] > 1.0)
    parts[parts == 3] = 0
    return uv + 10.0 * parts[:, None, None]


def test_topology_is_that_of_the_twin():
    surface = datasets.sheet(6, 5, size=(2.0, 2.0))
    uv = cut_in_three(surface)
    topology = uv_topology(surface, uv)
    chart, corner = reference.layout_of(surface.faces, uv, 1e-9)
    np.testing.assert_array_equal(topology.chart, chart)
    np.testing.assert_array_equal(topology.corner, corner)
    assert (topology.n_charts, topology.n_vertices) == (chart.max() + 1, corner.max() + 1)


def test_factors_are_those_of_the_twin():
    surface = datasets.sheet(9, 8, size=(2.0, 2.0), amplitude=0.2, periods=1)
    topology = uv_topology(surface, cut_in_three(surface))
    factors = yamabe_factors(surface, topology)
    for chart in range(topology.n_charts):
        corners = topology.corner[topology.chart == chart]
        members, faces = np.unique(corners, return_inverse=True)
        origin = np.empty(topology.n_vertices, dtype=int)
        origin[topology.corner] = surface.faces
        vertices, faces = surface.vertices[origin[members]], faces.reshape(-1, 3)
        matrix = reference.weighted_stiffness(vertices, faces, np.ones(len(vertices)))
        inner = np.flatnonzero(~reference.boundary_vertices(vertices, faces))
        expected = np.zeros(len(vertices))
        defects = reference.angle_defects(vertices, faces)[inner]
        expected[inner] = np.linalg.solve(matrix[np.ix_(inner, inner)], -defects)
        np.testing.assert_allclose(factors[members], expected, atol=1e-11)


def test_closed_chart_has_no_yamabe_energy():
    surface = datasets.icosphere(1)
    metrics = atlas_metrics(surface, surface.vertices[surface.faces][..., :2], **SMALL)
    assert math.isnan(metrics["yamabe"])


def test_wrong_input_is_named():
    surface = datasets.sheet(2, 2)
    uv = flat(surface)
    with pytest.raises(ValueError, match=r"uv: shape \(7, 3, 2\) must be \(8, 3, 2\)"):
        atlas_metrics(surface, uv[:7])
    with pytest.raises(ValueError, match="uv: area must be positive"):
        atlas_metrics(surface, 0.0 * uv)
    uv[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"uv\[3, 1\]: .* must be finite numbers"):
        atlas_metrics(surface, uv)
