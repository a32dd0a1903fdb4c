"""Refined surfaces: exactly the shape, short edges, round triangles, one parent for each face."""

from __future__ import annotations

import numpy as np
import pytest

import generated
import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.refine import count_refined, refine


def _surfaces():
    square = pa.Surface([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    return {
        "square": square,
        "box": generated.box(1.0, 2.0, 0.1, edge=3.0),
        "sphere": datasets.icosphere(1),
        "cone": generated.round_solid("cone", 1.0, 3.0, 16, 5.0),
        "cylinder": generated.round_solid("cylinder", 1.0, 2.0, 32, 5.0),
    }


@pytest.fixture(params=list(_surfaces()))
def coarse(request):
    return _surfaces()[request.param]


@pytest.fixture
def refined(coarse):
    return refine(coarse, np.sqrt(coarse.area) / 20)


def test_no_edge_is_longer_than_the_bound(coarse, refined):
    assert refined.target.face_diameters.max() <= np.sqrt(coarse.area) / 20


def test_the_refined_surface_is_a_surface_of_the_same_topology(coarse, refined):
    again = pa.Surface(refined.target.vertices, refined.target.faces)
    assert again.euler_characteristic == coarse.euler_characteristic
    assert again.n_boundary_loops == coarse.n_boundary_loops


def test_every_face_is_a_part_of_its_parent(coarse, refined):
    parts = refined.target
    areas = np.bincount(refined.origin_face, weights=parts.face_areas, minlength=coarse.n_faces)
    np.testing.assert_allclose(areas, coarse.face_areas, rtol=1e-12)
    corners = refined.corners
    assert (corners.barycentric >= 0).all()
    np.testing.assert_allclose(corners.barycentric.sum(axis=1), 1, rtol=1e-14)
    places = np.einsum(
        "pk,pkd->pd", corners.barycentric, coarse.vertices[coarse.faces[corners.face]]
    )
    size = np.abs(coarse.vertices).max()
    np.testing.assert_allclose(
        places, parts.vertices[parts.faces].reshape(-1, 3), atol=1e-14 * size, rtol=0
    )


def test_faces_keep_the_side_of_their_parent(coarse, refined):
    def normals(surface):
        a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
        return np.cross(b - a, c - a) / (2 * surface.face_areas[:, None])

    cosines = (normals(refined.target) * normals(coarse)[refined.origin_face]).sum(axis=1)
    np.testing.assert_allclose(cosines, 1, atol=1e-9)


def test_values_go_forward_linearly_and_come_back(coarse, refined):
    np.testing.assert_allclose(
        refined.forward @ coarse.vertices, refined.target.vertices, atol=1e-14, rtol=1e-13
    )
    values = np.arange(coarse.n_vertices, dtype=float)
    assert (refined.backward @ (refined.forward @ values) == values).all()


def test_few_faces_are_thinner_than_the_input_makes_them(coarse, refined):
    quality = refined.target.face_quality
    # Needles stay thin, but none becomes a thinner one than bisection makes it.
    assert quality.min() >= 0.5 * min(0.6, coarse.face_quality.min())
    assert np.quantile(quality, 0.1) >= 0.3
    round_parents = coarse.face_quality[refined.origin_face] >= 0.5
    if round_parents.any():
        assert np.quantile(quality[round_parents], 0.05) >= 0.5


def test_far_fewer_faces_than_four_in_one(coarse, refined):
    longest = np.sqrt(coarse.area) / 20
    times = np.ceil(np.log2(np.maximum(coarse.face_diameters.max() / longest, 1)))
    assert refined.target.n_faces <= 1.05 * coarse.n_faces * 4**times
    assert refined.target.n_faces <= 2 * count_refined(coarse, longest)
    assert refined.target.n_faces >= 0.5 * count_refined(coarse, longest)


def test_a_needle_gets_no_vertex_inside():
    needle = pa.Surface([[0, 0, 0], [100, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    parts = refine(needle, 1.0).target
    assert parts.on_border.all()
    assert parts.n_faces < 300


def test_short_edges_are_left_alone():
    surface = datasets.icosphere(2)
    same = refine(surface, 1.0).target
    assert same.faces.tobytes() == surface.faces.tobytes()
    assert same.vertices.tobytes() == surface.vertices.tobytes()


def test_seam_costs_go_to_the_parts_of_their_edges():
    square = _surfaces()["square"].with_seam_costs([[1, 2, 3], [3, 4, 5]])
    parts = refine(square, 0.2).target
    starts = parts.vertices[parts.faces]
    middles = 0.5 * (starts + np.roll(starts, -1, axis=1))
    x, y = middles[..., 0], middles[..., 1]
    costs = parts.seam_costs
    for on, cost in ((y == 0, 1), (x == 1, 2), (x == y, 3), (y == 1, 4), (x == 0, 5)):
        assert (costs[on & ~((x == y) & (cost != 3))] == cost).all()
    inside = (x != y) & (x > 0) & (x < 1) & (y > 0) & (y < 1)
    assert (costs[inside] == 1).all()


@pytest.mark.parametrize("longest", [0.0, -1.0, np.nan, np.inf])
def test_a_bound_that_is_no_length_is_refused(longest):
    with pytest.raises(ValueError, match=r"longest: .* must be a positive number"):
        refine(datasets.icosphere(0), longest)
