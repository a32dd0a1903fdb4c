"""Factors on the length of seams: the diffuse limit, charts, regions to keep, edges to cut."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import phaseatlas as pa
import reference
from contract import (
    AGREE,
    check_agreement,
    check_gradient,
    check_gradient_of_every_vertex,
    random_directions,
    random_field,
)
from generated import box
from phaseatlas import datasets
from phaseatlas.coarsen import coarsen, reduced
from phaseatlas.refine import refine
from phaseatlas.scene.opened import half_edges, opened
from phaseatlas.scene.repair import repair
from phaseatlas.scene.scene import Scene
from phaseatlas.seam_costs import CREASE, with_seam_cost


def smooth_cost(surface):
    vertices = np.asarray(surface.vertices)
    return 1.3 + np.sin(vertices @ np.array([3.0, -2.0, 4.0]))


PARENTS = [{}, {"eta": 0.05, "sigma": 4.0}, {"eta": 0.0, "sigma": 0.07}]


@pytest.mark.parametrize("parent", PARENTS, ids=["whole", "wide", "narrow"])
def test_perimeter_agrees_with_reference(surfaces, smooth_weight, parent):
    options = {"weight": smooth_weight(surfaces), **parent} if parent else {}
    u, cost = random_field(surfaces), smooth_cost(surfaces)
    epsilon = 2.0 * surfaces.mean_edge_length
    functional = pa.functionals.Perimeter(surfaces, epsilon, seam_cost=cost, **options)
    vertices, faces = np.asarray(surfaces.vertices), np.asarray(surfaces.faces)
    given = (vertices, faces, u, epsilon, cost)
    check_agreement(functional.value_and_gradient(u), reference.costed_perimeter(*given, **options))
    expected = reference.costed_perimeter_hessian(*given, **options)
    difference = functional.hessian(u).toarray() - expected
    assert np.abs(difference).max() <= AGREE * np.abs(expected).max()


@pytest.mark.parametrize("parent", PARENTS, ids=["whole", "wide", "narrow"])
def test_gradient_is_the_derivative(surfaces, smooth_weight, parent):
    options = {"weight": smooth_weight(surfaces), **parent} if parent else {}
    epsilon = 2.0 * surfaces.mean_edge_length
    cost = smooth_cost(surfaces)
    functional = pa.functionals.Perimeter(surfaces, epsilon, seam_cost=cost, **options)
    u = random_field(surfaces)
    check_gradient(functional, u, random_directions(surfaces), 1e-4, 1e-7)


def test_gradient_of_every_vertex():
    surface = datasets.sheet(3, 3, amplitude=0.2, periods=0.7)
    rng = np.random.default_rng(1)
    u, weight, cost = rng.uniform(-1.0, 1.0, (3, surface.n_vertices))
    functional = pa.functionals.Perimeter(
        surface, 0.2, weight=np.abs(weight), eta=0.1, sigma=0.2, seam_cost=1.1 + cost
    )
    check_gradient_of_every_vertex(functional, u, 1e-4, 1e-7)


def test_a_constant_factor_is_one_of_the_perimeter(smooth_weight):
    surface = datasets.torus(1.0, 0.4, 28, 12)
    u, weight = random_field(surface), smooth_weight(surface)
    plain, costed = (
        pa.functionals.Perimeter(surface, 0.2, weight=weight, sigma=0.3, seam_cost=cost)
        for cost in (None, np.full(surface.n_vertices, 2.5))
    )
    value, gradient = plain.value_and_gradient(u)
    check_agreement(costed.value_and_gradient(u), (2.5 * value, 2.5 * gradient))
    np.testing.assert_allclose(costed.preconditioner(), 2.5 * plain.preconditioner(), rtol=1e-14)
    assert costed.length(u) == pytest.approx(2.5 * plain.length(u), rel=1e-12)


@pytest.mark.parametrize("epsilon", [0.08, 0.04, 0.02])
@pytest.mark.parametrize("x", [0.37, 0.5, 0.6])
def test_a_straight_interface_costs_the_factor_where_it_runs(epsilon, x):
    # The best profile does not depend on the factor; its second moment is (pi^2 - 6) / (12 k^2).
    strip = datasets.sheet(400, 4, size=(1.0, 0.01))
    along = np.asarray(strip.vertices)[:, 0]
    k = 3 / (2 * math.sqrt(2) * epsilon)
    u = np.tanh(k * (along - x))
    cost = 1.5 + np.cos(2 * np.pi * along)
    weighted, plain = (
        pa.functionals.Perimeter(strip, epsilon, seam_cost=g).length(u) for g in (cost, None)
    )
    second = -((2 * np.pi) ** 2) * np.cos(2 * np.pi * x)
    limit = 1.5 + np.cos(2 * np.pi * x)
    expected = limit + 0.5 * second * (np.pi**2 - 6) / (12 * k**2)
    # What follows is of the fourth order: 4th derivative / 24 times the fourth moment, 0.3 eps^4.
    assert weighted / plain == pytest.approx(expected, abs=25 * epsilon**4 + 2e-4)
    assert plain == pytest.approx(0.01, rel=5e-3)


def test_the_best_profile_is_the_same_for_any_factor():
    # Of all widths that of epsilon costs least, wherever the factor is linear.
    strip = datasets.sheet(200, 4, size=(1.0, 0.02))
    along = np.asarray(strip.vertices)[:, 0]
    functional = pa.functionals.Perimeter(strip, 0.05, seam_cost=1 + 3 * along)
    widths = np.array([0.8, 0.9, 1.0, 1.1, 1.25])
    lengths = [
        functional.length(np.tanh(3 * (along - 0.5) / (2 * math.sqrt(2) * 0.05 * width)))
        for width in widths
    ]
    assert np.argmin(lengths) == 2
    # By equal parts of both terms: (width + 1 / width) / 2 times the weighted length.
    np.testing.assert_allclose(
        np.array(lengths) / lengths[2], 0.5 * (widths + 1 / widths), rtol=2e-3
    )


@pytest.mark.parametrize(("cost", "across"), [(0.35, False), (0.65, True)])
def test_an_interface_takes_the_long_way_where_that_is_cheap_enough(cost, across):
    # Halves of a 2 x 1 sheet: 1 the short way, 2 times the cost of the middle band the long way.
    # The band is wider than the profile, and crossing it spares the short way little.
    sheet = datasets.sheet(48, 24, size=(2.0, 1.0))
    x, y, _ = np.asarray(sheet.vertices).T
    distance = np.abs(y - 0.5)
    g = np.where(distance < 0.16, cost, 1.0) + np.clip((distance - 0.16) / 0.05, 0, 1) * (1 - cost)
    g = np.where(distance < 0.16, cost, np.minimum(g, 1.0))
    tree = pa.segment(sheet, 1, seam_cost=g)
    u = tree.fields[0]
    vertical = abs(np.corrcoef(u, x)[0, 1]) > abs(np.corrcoef(u, y)[0, 1])
    assert vertical == across
    short = 1 - 2 * 0.16 * (1 - cost) - 0.05 * (1 - cost)
    assert tree.diagnostics[0].length == pytest.approx(short if across else 2 * cost, rel=0.08)


def test_ipopt_takes_the_factor():
    pytest.importorskip("ipyopt")
    sheet = datasets.sheet(24, 12, size=(2.0, 1.0))
    cost = smooth_cost(sheet)
    lengths = [
        pa.segment(sheet, 1, solver=solver, seam_cost=cost, connected=False).diagnostics[0].length
        for solver in ("lbfgs", "ipopt")
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-3)


def lengths_of_seams(surface, labels, factor=None):
    """Sum of the lengths of the edges between labels, times a factor of each."""
    corners = np.asarray(surface.vertices)[surface.faces]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    neighbours = surface.face_neighbours
    seam = (neighbours >= 0) & (labels[:, None] != labels[neighbours])
    return float((lengths * (1.0 if factor is None else factor))[seam].sum() / 2)


def test_the_energy_of_charts_has_the_weighted_length():
    surface = datasets.icosphere(3)
    cost = np.exp(np.asarray(surface.vertices)[:, 2])
    charts = pa.partition(surface, distortion=100.0, effort="fast", seam_cost=cost)
    ends = cost[surface.faces]
    means = (ends + np.roll(ends, -1, axis=1)) / 2
    expected = lengths_of_seams(surface, charts.labels, means) / math.sqrt(surface.area)
    assert charts.diagnostics[-1].seam == pytest.approx(expected, rel=1e-9)
    assert charts.surface.seam_costs is None
    assert np.array_equal(charts.surface.vertex_seam_costs, cost)


@pytest.mark.parametrize("axis", [0, 2])
def test_seams_and_cuts_of_charts_leave_what_is_dear(axis):
    surface = datasets.icosphere(4)
    height = np.asarray(surface.vertices)[:, axis]
    dear = surface.face_mean(height) > 0.2
    cost = np.where(height > 0.2, 8.0, 1.0)
    ends = cost[surface.faces]
    means = (ends + np.roll(ends, -1, axis=1)) / 2
    corners = np.asarray(surface.vertices)[surface.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)

    def figures(charts):
        seams = sides * uv_seams(surface, pa.build_atlas(charts).uv)
        return np.array([seams[dear].sum() / seams.sum(), (seams * means).sum()])

    before = figures(pa.partition(surface, effort="fast"))
    after = figures(pa.partition(surface, effort="fast", seam_cost=cost))
    assert before[0] > 0.4
    assert (after < 0.6 * before).all()


def uv_seams(surface, uv):
    """Edges whose two faces have other texture coordinates at an end, (m, 3)."""
    keys = np.sort(
        np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2), axis=2
    ).reshape(-1, 2)
    order = np.lexsort(keys.T[::-1])
    pair = np.flatnonzero((keys[order[1:]] == keys[order[:-1]]).all(axis=1))
    a, b = order[pair], order[pair + 1]
    start, stop = uv.reshape(-1, 2), np.roll(uv, -1, axis=1).reshape(-1, 2)
    apart = (np.abs(start[a] - stop[b]).max(axis=1) > 1e-9) | (
        np.abs(stop[a] - start[b]).max(axis=1) > 1e-9
    )
    seams = np.zeros(len(keys), dtype=bool)
    seams[a[apart]] = seams[b[apart]] = True
    return seams.reshape(-1, 3)


def test_children_of_the_tree_take_the_factor_too():
    # Four segments of a long strip: all three interfaces are weighted.
    strip = datasets.sheet(96, 12, size=(8.0, 1.0))
    cost = np.full(strip.n_vertices, 3.0)
    plain, costed = pa.segment(strip, 2), pa.segment(strip, 2, seam_cost=cost)
    for before, after in zip(plain.diagnostics, costed.diagnostics, strict=True):
        assert after.length == pytest.approx(3 * before.length, rel=0.02)


def test_scenes_take_the_factor_piece_by_piece():
    ball, ring = datasets.icosphere(2), datasets.torus(1.0, 0.4, 20, 10)
    scene = Scene(
        [("a", repair(ball.vertices, ball.faces)), ("b", repair(ring.vertices, ring.faces))]
    )
    cost = np.linspace(1.0, 2.0, scene.n_vertices)
    costed = with_seam_cost(scene, cost)
    assert isinstance(costed, Scene)
    first, second = costed.pieces
    assert np.array_equal(first.surface.vertex_seam_costs, cost[: ball.n_vertices])
    assert np.array_equal(second.surface.vertex_seam_costs, cost[ball.n_vertices :])
    again = pickle.loads(pickle.dumps(costed))
    assert np.array_equal(again.vertex_seam_costs, cost)
    parts = pa.segment(scene, 2, seam_cost=cost).parts
    assert np.array_equal(parts[0].surface.vertex_seam_costs, cost[: ball.n_vertices])


def test_factors_go_to_surfaces_made_of_others():
    surface = datasets.icosphere(4)
    cost = 2 + np.asarray(surface.vertices)[:, 2]
    costed = with_seam_cost(surface, cost)
    assert np.array_equal(costed.scaled(2.0).vertex_seam_costs, cost)
    part, vertices = costed.submesh(surface.face_mean(cost) > 2.2)
    assert np.array_equal(part.vertex_seam_costs, cost[vertices])
    step = coarsen(costed)
    np.testing.assert_allclose(step.target.vertex_seam_costs, step.forward @ cost)
    small, _ = reduced(costed, 500)
    np.testing.assert_allclose(
        small.vertex_seam_costs, 2 + np.asarray(small.vertices)[:, 2], atol=0.2
    )
    fine = refine(costed, 0.02)
    np.testing.assert_allclose(fine.target.vertex_seam_costs, fine.forward @ cost)
    for made in (surface, coarsen(surface).target, reduced(surface, 500)[0]):
        assert made.seam_costs is None
        assert made.vertex_seam_costs is None


def test_creases_are_cheap_and_seams_follow_them():
    # Of a cube the edges are creases, and of its refinement no other edge.
    fine = box(1.0, 1.0, 1.0, 0.13)
    costed = with_seam_cost(fine, creases=40.0)
    crease = costed.seam_costs == CREASE
    corners = np.asarray(fine.vertices)[fine.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert sides[crease].sum() == pytest.approx(2 * 12, rel=1e-12)
    charts = pa.partition(fine, effort="fast", creases=40.0, distortion=100.0)
    assert charts.n_segments > 1
    on_creases = lengths_of_seams(fine, charts.labels, crease.astype(float))
    assert on_creases > 0.99 * lengths_of_seams(fine, charts.labels)
    # An angle of 90 degrees is not above 100.
    assert with_seam_cost(fine, creases=100.0).seam_costs is None


def one_sided(surface, cost):
    """A factor on one side of each edge, and 1 on the other."""
    numbers = np.arange(surface.n_faces)[:, None]
    return np.where(numbers < surface.face_neighbours, cost, 1.0)


@pytest.mark.parametrize("surface", [datasets.icosphere(2), datasets.sheet(5, 4)])
def test_of_the_two_factors_of_an_edge_the_larger_counts(surface):
    given = np.random.default_rng(0).uniform(1.0, 2.0, (surface.n_faces, 3))
    edges = np.sort(np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2), axis=2)
    largest = {}
    for edge, cost in zip(map(tuple, edges.reshape(-1, 2)), given.reshape(-1), strict=True):
        largest[edge] = max(largest.get(edge, 0.0), cost)
    expected = [largest[edge] for edge in map(tuple, edges.reshape(-1, 2))]
    scene = Scene([("", repair(surface.vertices, surface.faces))])
    for costed in (surface.with_seam_costs(given), scene.with_seam_costs(given)):
        np.testing.assert_array_equal(costed.seam_costs.reshape(-1), expected)
        assert np.array_equal(pickle.loads(pickle.dumps(costed)).seam_costs, costed.seam_costs)


def test_phase_fields_see_a_factor_that_one_side_has():
    surface = datasets.icosphere(2)
    costed = with_seam_cost(surface, one_sided(surface, 9.0))
    assert (costed.seam_costs == 9).all()
    assert (costed.diffuse_seam_costs == 9).all()


def test_an_edge_that_one_side_forbids_is_not_cut_in_silence():
    surface = datasets.icosphere(1)
    costed = with_seam_cost(surface, one_sided(surface, np.inf))
    with pytest.warns(pa.QualityWarning, match="keep: ") as said:
        atlas = pa.build_atlas(pa.Segmentation(costed, np.zeros(surface.n_faces, dtype=int)))
    count = np.count_nonzero(uv_seams(surface, atlas.uv)) // 2
    assert f"keep: {count} edges of regions to keep are cut" in str(said[0].message)


def test_a_region_to_keep_has_no_seam():
    surface = datasets.icosphere(4)
    kept = surface.face_mean(np.asarray(surface.vertices))[:, 2] > 0.5
    for charts in (
        pa.partition(surface, effort="fast", keep=kept, distortion=2000.0),
        pa.segment(surface, 2, keep=np.flatnonzero(kept)).at(2),
    ):
        assert charts.n_segments > 1
        assert len(np.unique(charts.labels[kept])) == 1


def test_to_keep_a_region_once_more_changes_nothing():
    surface = datasets.sheet(8, 6)
    x = surface.face_mean(np.asarray(surface.vertices))[:, 0]
    left, right = x < 0.7, x > 0.3
    cost = np.linspace(1.0, 3.0, surface.n_vertices)
    for given in (surface, with_seam_cost(surface, cost)):
        once = with_seam_cost(given, keep=left)
        twice = with_seam_cost(once, keep=left)
        np.testing.assert_array_equal(twice.vertex_seam_costs, once.vertex_seam_costs)
        np.testing.assert_array_equal(twice.seam_costs, once.seam_costs)
        # Where two regions overlap the factor is there once, and it is that of either elsewhere.
        both = with_seam_cost(once, keep=right).vertex_seam_costs
        alone = with_seam_cost(given, keep=right).vertex_seam_costs
        np.testing.assert_array_equal(both, np.maximum(alone, once.vertex_seam_costs))
    # A factor that is painted is multiplied in any order.
    one = with_seam_cost(with_seam_cost(surface, 30 * cost), keep=left)
    other = with_seam_cost(with_seam_cost(surface, keep=left), 30 * cost)
    np.testing.assert_allclose(one.vertex_seam_costs, other.vertex_seam_costs)


def test_a_region_that_is_closed_is_cut_and_said_to_be():
    surface = datasets.icosphere(2)
    with pytest.warns(pa.QualityWarning, match=r"keep: \d+ edges of regions to keep are cut"):
        found = pa.unwrap(surface, keep=np.arange(surface.n_faces), effort="fast")
    assert found.report.charts == 1


def test_edges_to_cut_are_open():
    ring = datasets.torus(1.0, 0.4, 20, 10)
    scene = Scene([("", repair(ring.vertices, ring.faces))])
    # One meridian and one parallel: what is left is a disk.
    index = np.arange(200).reshape(20, 10)
    meridian = np.stack([index[0], np.roll(index[0], -1)], axis=1)
    parallel = np.stack([index[:, 0], np.roll(index[:, 0], -1)], axis=1)
    pairs = np.concatenate([meridian, parallel])
    edges = half_edges(scene.faces, pairs, scene.n_vertices)
    assert edges.sum() == 2 * 30
    disk = opened(scene, edges)
    surface = disk.pieces[0].surface
    assert (len(disk.pieces), surface.genus, surface.n_boundary_loops) == (1, 0, 1)
    assert disk.n_vertices == 200 + 30 + 1
    assert disk.meshes[0].repaired.report.boundary_loops == 1
    assert np.array_equal(disk.vertices[disk.faces], scene.vertices[scene.faces])
    assert opened(scene, np.zeros_like(edges)) is scene
    found = pa.unwrap(ring.vertices, ring.faces, seams=pairs, effort="fast")
    assert found.corners.shape == (400, 3, 2)
    assert (uv_seams(ring, found.corners) >= edges).all()
    # A circle around a tube falls apart into two.
    ball = datasets.icosphere(3)
    upper = ball.face_mean(np.asarray(ball.vertices))[:, 2] > 0
    neighbours = ball.face_neighbours
    f, k = np.nonzero(upper[:, None] & ~upper[neighbours])
    equator = np.stack([ball.faces[f, k], ball.faces[f, (k + 1) % 3]], axis=1)
    halves = pa.unwrap(ball, seams=equator, effort="fast")
    assert halves.report.pieces == 2
    assert len(np.intersect1d(halves.charts[upper], halves.charts[~upper])) == 0


def test_an_edge_that_stands_alone_is_not_opened():
    ball = datasets.icosphere(2)
    with pytest.warns(pa.QualityWarning, match="seams: 1 of 1 edges are not opened"):
        found = pa.unwrap(ball, seams=ball.edges[:1], effort="fast")
    assert found.report.pieces == 1


def test_polygons_of_an_unwrap_take_costs_by_their_vertices():
    surface = datasets.rounded_cube(6)
    quads = np.array([[0, 1, 2, 3], [3, 2, 4, 5]])
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 2, 0], [0, 2, 0]], float)
    found = pa.unwrap(points, quads, seam_cost=[1, 2, 3, 4, 5, 6], keep=[0, 1])
    # All of it is kept, with the diagonals and the edge between the polygons.
    assert np.array_equal(found.atlas.surface.vertex_seam_costs, 20.0 * np.arange(1, 7))
    assert np.isinf(found.atlas.surface.seam_costs).sum() == 6
    # Along edges, whatever the winding of the input.
    mixed = np.array(surface.faces)
    mixed[::3] = mixed[::3, ::-1]
    index = np.random.default_rng(0).uniform(1, 2, (surface.n_vertices, surface.n_vertices))
    symmetric = index + index.T
    costs = symmetric[mixed, np.roll(mixed, -1, axis=1)]
    scene = pa.unwrap(surface.vertices, mixed, seam_cost=costs, effort="fast").atlas.surface
    expected = symmetric[scene.faces, np.roll(scene.faces, -1, axis=1)]
    np.testing.assert_array_equal(scene.seam_costs, expected)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seam_cost": np.ones(5)}, r"^seam_cost: shape \(5,\) must be \(42,\) or \(80, 3\)$"),
        ({"seam_cost": np.r_[0.0, np.ones(41)]}, r"^seam_cost\[0\]: 0 must be a positive number"),
        ({"seam_cost": np.r_[np.ones(41), np.nan]}, r"^seam_cost\[41\]: nan must be a positive"),
        ({"seam_cost": np.r_[np.inf, np.ones(41)]}, r"^seam_cost\[0\]: inf must be a positive"),
        ({"seam_cost": np.full((80, 3), -1.0)}, r"^seam_cost\[0, 0\]: -1 must be a positive"),
        ({"keep": np.ones(5, dtype=bool)}, r"^keep: shape \(5,\) must be \(80,\)$"),
        ({"keep": [80]}, r"^keep\[0\]: 80 must be in 0\.\.79$"),
        ({"keep": [0.5]}, r"^keep: shape \(1,\) of float64 must be"),
        ({"creases": 0.0}, r"^creases: 0\.0 must be an angle in degrees between 0 and 180$"),
    ],
)
def test_bad_wishes_are_named(options, message):
    ball = datasets.icosphere(1)
    for function in (pa.partition, pa.segment, pa.unwrap):
        with pytest.raises(ValueError, match=message):
            function(ball, **options)


def test_bad_edges_are_named():
    ball = datasets.icosphere(1)
    with pytest.raises(ValueError, match=r"^seams\[1\]: no edge joins vertices 0 and 99$"):
        pa.unwrap(ball, seams=[ball.edges[0], [0, 99]])
    with pytest.raises(ValueError, match=r"^seams: shape \(1, 3\) of int64 must be \(k, 2\)"):
        pa.unwrap(ball, seams=[[0, 1, 2]])
    with pytest.raises(ValueError, match=r"^seam_costs\[0, 1\]: -1\.0 must be a positive number$"):
        ball.with_seam_costs(np.tile([1.0, -1.0, 1.0], (80, 1)))


def test_no_factor_changes_nothing():
    ball = datasets.icosphere(3)
    plain = pa.segment(ball, 1)
    assert with_seam_cost(ball) is ball
    assert pa.segment(ball, 1, seam_cost=None).fields.tobytes() == plain.fields.tobytes()
    ones = ball.with_seam_costs(np.ones((ball.n_faces, 3)))
    assert ones.diffuse_seam_costs is None
    assert pa.segment(ones, 1).fields.tobytes() == plain.fields.tobytes()
