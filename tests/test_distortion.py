"""Conformal distortion, equations (11) to (13)."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phaseatlas as pa
import reference
from contract import (
    check_agreement,
    check_gradient,
    check_gradient_of_every_vertex,
    random_directions,
    random_field,
)
from phaseatlas import datasets

# Solutions of systems of a few thousand unknowns.
AGREE = 1e-9

LAWS = ("sharp", "paper")
ETA = {"sharp": 1e-6, "paper": 1e-3}


def profile(distance, epsilon):
    """Optimal profile of the perimeter across an interface at distance 0."""
    return np.tanh(3.0 * distance / (2.0 * math.sqrt(2.0) * epsilon))


def arrays(surface):
    return np.asarray(surface.vertices), np.asarray(surface.faces)


def polar_angles(surface):
    vertices = np.asarray(surface.vertices)
    return np.arctan2(np.linalg.norm(vertices[:, :2], axis=1), vertices[:, 2])


# --------------------------------------------------------------------------------------------------
# against the reference
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("kind", "weighted"), [("smooth", False), ("random", True)], ids=["smooth", "random-weighted"]
)
def test_agrees_with_reference(surfaces, smooth_field, smooth_weight, law, kind, weighted):
    u = smooth_field(surfaces) if kind == "smooth" else random_field(surfaces)
    weight = smooth_weight(surfaces) if weighted else None
    epsilon, delta = 2.0 * surfaces.mean_edge_length, 0.02
    functional = pa.functionals.Distortion(surfaces, epsilon, law=law, delta=delta, weight=weight)
    expected = reference.distortion(*arrays(surfaces), u, epsilon, law, delta, ETA[law], weight)
    check_agreement(functional.value_and_gradient(u), expected, AGREE)


@pytest.fixture(
    params=[
        datasets.icosphere(2, radius=0.7),
        datasets.torus(1.0, 0.4, 14, 9),
        datasets.sheet(9, 8, size=(1.3, 1.0), amplitude=0.15, periods=1),
        datasets.sheet(1, 3, amplitude=0.15, periods=0.7),
    ],
    ids=["icosphere", "torus", "sheet", "all-border"],
)
def coarse(request):
    return request.param


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("kind", ["random", "smooth"])
@pytest.mark.parametrize(("delta", "eta"), [(0.0, 1e-3), (0.3, 0.05)])
def test_agrees_with_reference_for_all_settings(
    coarse, smooth_field, smooth_weight, law, weighted, kind, delta, eta
):
    u = smooth_field(coarse) if kind == "smooth" else random_field(coarse)
    weight = smooth_weight(coarse) if weighted else None
    epsilon = 1.5 * coarse.mean_edge_length
    functional = pa.functionals.Distortion(
        coarse, epsilon, law=law, delta=delta, eta=eta, weight=weight
    )
    settings = (epsilon, law, delta, eta, weight)
    expected = reference.distortion(*arrays(coarse), u, *settings)
    check_agreement(functional.value_and_gradient(u), expected, AGREE)
    for actual, twin in zip(
        functional.log_scale(u), reference.log_scales(*arrays(coarse), u, *settings), strict=True
    ):
        assert actual.shape == twin.shape
        assert np.linalg.norm(actual - twin) <= AGREE * np.linalg.norm(twin)


@pytest.mark.parametrize("law", LAWS)
def test_defaults(coarse, smooth_field, law):
    u, epsilon = smooth_field(coarse), 2.0 * coarse.mean_edge_length
    # The half width of the plateaus is a pure number: epsilon / 10 on a surface of unit area.
    delta = epsilon / math.sqrt(coarse.area) / 10.0
    default = pa.functionals.Distortion(coarse, epsilon, law=law).value_and_gradient(u)
    explicit = pa.functionals.Distortion(
        coarse, epsilon, law=law, delta=delta, eta=ETA[law], weight=np.ones(coarse.n_vertices)
    ).value_and_gradient(u)
    check_agreement(default, explicit, 1e-12)
    if law == "sharp":
        assert pa.functionals.Distortion(coarse, epsilon).value_and_gradient(u)[0] == default[0]


# --------------------------------------------------------------------------------------------------
# the gradient
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("weighted", [False, True])
def test_gradient_is_the_derivative(surfaces, smooth_field, smooth_weight, law, weighted):
    epsilon = 2.0 * surfaces.mean_edge_length
    weight = smooth_weight(surfaces) if weighted else None
    functional = pa.functionals.Distortion(surfaces, epsilon, law=law, weight=weight)
    for u in (random_field(surfaces), smooth_field(surfaces)):
        # The laws are C1 with kinks in the first derivative, so the error is of first order in
        # h at the few vertices that step over one.
        check_gradient(functional, u, random_directions(surfaces), 1e-6, 1e-7)


@pytest.mark.parametrize("law", LAWS)
def test_gradient_of_every_vertex(law):
    surface = datasets.sheet(4, 4, amplitude=0.2, periods=0.7)
    rng = np.random.default_rng(1)
    u, weight = rng.uniform(-1.0, 1.0, (2, surface.n_vertices))
    functional = pa.functionals.Distortion(surface, 0.4, law=law, weight=np.abs(weight))
    check_gradient_of_every_vertex(functional, u, 1e-6, 1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_no_gradient_outside_the_parent(coarse, smooth_field, smooth_weight, law):
    weight = smooth_weight(coarse)
    functional = pa.functionals.Distortion(coarse, 0.2, law=law, weight=weight)
    gradient = functional.value_and_gradient(smooth_field(coarse))[1]
    assert (weight == 0.0).any()
    assert not gradient[weight == 0.0].any()


@pytest.mark.parametrize("law", LAWS)
def test_symmetric_in_the_phases(surfaces, smooth_field, law):
    functional = pa.functionals.Distortion(surfaces, 2.0 * surfaces.mean_edge_length, law=law)
    u = smooth_field(surfaces)
    value, gradient = functional.value_and_gradient(u)
    mirrored, mirrored_gradient = functional.value_and_gradient(-u)
    assert mirrored == pytest.approx(value, rel=1e-12)
    scale = np.linalg.norm(gradient)
    assert np.linalg.norm(mirrored_gradient + gradient) <= 1e-12 * scale
    for first, second in zip(functional.log_scale(u), functional.log_scale(-u)[::-1], strict=True):
        assert np.linalg.norm(first - second) <= 1e-12 * np.linalg.norm(first)


def test_value_is_that_of_the_log_scales(surfaces, smooth_field):
    functional = pa.functionals.Distortion(surfaces, 2.0 * surfaces.mean_edge_length)
    u = smooth_field(surfaces)
    squares = sum(scale**2 for scale in functional.log_scale(u))
    assert functional.value_and_gradient(u)[0] == pytest.approx(surfaces.mass @ squares, rel=1e-12)


# --------------------------------------------------------------------------------------------------
# the sharp limit
# --------------------------------------------------------------------------------------------------

# On a hemisphere of unit radius s = ln(1 + cos t) at the angle t from its pole, hence the integral
# of s^2 is 2 pi int_0^1 ln(1 + x)^2 dx.
HEMISPHERE = 2.0 * math.pi * (2.0 * math.log(2.0) ** 2 - 4.0 * math.log(2.0) + 2.0)


@pytest.fixture(scope="module", params=[1.0, 0.3])
def sphere(request):
    """A fine sphere and the geodesic distance to its equator."""
    surface = datasets.icosphere(6, request.param)
    return surface, request.param, request.param * (0.5 * math.pi - polar_angles(surface))


def hemisphere_ratio(sphere, edges, law):
    """Distortion of two hemispheres over its value in the sharp limit."""
    surface, radius, distance = sphere
    epsilon = edges * surface.mean_edge_length
    functional = pa.functionals.Distortion(surface, epsilon, law=law)
    value = functional.value_and_gradient(profile(distance, epsilon))[0]
    return 0.5 * value / (HEMISPHERE * radius**2)


def test_hemispheres_tend_to_the_sharp_limit(sphere):
    ratios = [hemisphere_ratio(sphere, edges, "sharp") for edges in (8.0, 4.0, 2.0)]
    assert ratios[0] > ratios[1] > ratios[2] > 1.0
    assert ratios[2] < 1.15


def test_printed_law_is_far_from_the_sharp_limit(sphere):
    # Its penalty over a layer of width epsilon only makes a Robin condition, and it depends on the
    # unit of length: this is why it is not the default.
    assert hemisphere_ratio(sphere, 2.0, "paper") > 5.0


def test_sharp_law_never_rewards_mixing(sphere):
    surface, _, distance = sphere
    epsilon = 2.0 * surface.mean_edge_length
    functional = pa.functionals.Distortion(surface, epsilon)
    u = profile(distance, epsilon)
    values = [functional.value_and_gradient(t * u)[0] for t in (1.0, 0.9, 0.6, 0.3, 0.0)]
    assert values == sorted(values)


def test_printed_law_rewards_mixing(sphere):
    surface, _, distance = sphere
    epsilon = 2.0 * surface.mean_edge_length
    functional = pa.functionals.Distortion(surface, epsilon, law="paper")
    mixed = functional.value_and_gradient(np.zeros(surface.n_vertices))[0]
    # There s = epsilon K in both phases: source and penalty are constant.
    curvature = surface.angle_defects / surface.mass
    assert mixed == pytest.approx(2.0 * epsilon**2 * surface.mass @ curvature**2, rel=0.02)
    assert mixed < functional.value_and_gradient(profile(distance, epsilon))[0]


# --------------------------------------------------------------------------------------------------
# log scale factors
# --------------------------------------------------------------------------------------------------


def cap_log_scale(angle, rim):
    """Log scale of the flat metric on a cap of the sphere that keeps the lengths of its rim.

    The stereographic projection from the opposite pole has the scale 1 / (1 + cos angle).
    """
    return np.log((1.0 + np.cos(rim)) / (1.0 + np.cos(angle)))


@pytest.mark.parametrize("rim", [0.7, 1.0, 1.4])
def test_cap_of_a_sphere_shrinks(rim):
    surface = datasets.icosphere(6)
    angle = polar_angles(surface)
    epsilon = 2.0 * surface.mean_edge_length
    inside, outside = pa.functionals.Distortion(surface, epsilon).log_scale(
        profile(rim - angle, epsilon)
    )
    assert inside[angle < rim].max() < 0.0
    assert outside[angle > rim].max() < 0.0
    # Each scale fades within a few epsilon of the rim.
    assert np.abs(inside[angle > rim + 2.0 * epsilon]).max() < 1e-4
    assert np.abs(outside[angle < rim - 2.0 * epsilon]).max() < 1e-4
    pole, antipole = angle.argmin(), angle.argmax()
    assert inside[pole] == pytest.approx(cap_log_scale(0.0, rim), rel=0.1)
    # The complement is a cap around the other pole.
    assert outside[antipole] == pytest.approx(cap_log_scale(0.0, math.pi - rim), rel=0.1)


def polar_disk(rings, around):
    """Angle (n,), radius (n,) in [0, 1] and faces of rings around a point."""
    radius = np.concatenate([[0.0], np.repeat(np.arange(1, rings + 1) / rings, around)])
    longitude = np.concatenate([[0.0], np.tile(2.0 * np.pi * np.arange(around) / around, rings)])
    k = np.arange(around)
    following = (k + 1) % around
    faces = [np.stack([np.zeros_like(k), 1 + k, 1 + following], axis=1)]
    for ring in range(rings - 1):
        inner, outer = 1 + ring * around, 1 + (ring + 1) * around
        faces.append(np.stack([inner + k, outer + k, outer + following], axis=1))
        faces.append(np.stack([inner + k, outer + following, inner + following], axis=1))
    return longitude, radius, np.concatenate(faces)


@pytest.mark.parametrize("law", LAWS)
def test_border_of_an_open_cap_keeps_its_length(law):
    rim = 1.2
    longitude, radius, faces = polar_disk(24, 60)
    angle = rim * radius
    vertices = np.stack(
        [np.sin(angle) * np.cos(longitude), np.sin(angle) * np.sin(longitude), np.cos(angle)],
        axis=1,
    )
    functional = pa.functionals.Distortion(pa.Surface(vertices, faces), 0.1, law=law)
    inside, outside = functional.log_scale(np.ones(len(vertices)))
    # No interface: the border alone holds the scale, and the absent phase has none.
    assert np.abs(inside - cap_log_scale(angle, rim)).max() < 0.01 * abs(cap_log_scale(0.0, rim))
    assert not outside.any()


def test_saddle_grows():
    flat = datasets.sheet(24, 24, size=(2.0, 2.0))
    vertices, faces = arrays(flat)
    x, y = vertices[:, 0] - 1.0, vertices[:, 1] - 1.0
    surface = pa.Surface(np.stack([x, y, 0.4 * x * y], axis=1), faces)
    scale, _ = pa.functionals.Distortion(surface, 0.1).log_scale(np.ones(surface.n_vertices))
    assert scale[~reference.boundary_vertices(vertices, faces)].min() > 0.0


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("weighted", [False, True])
def test_no_scale_on_the_border(smooth_field, smooth_weight, law, weighted):
    surface = datasets.sheet(16, 13, size=(1.3, 1.0), amplitude=0.15, periods=0.7)
    border = reference.boundary_vertices(*arrays(surface))
    weight = smooth_weight(surface) if weighted else None
    functional = pa.functionals.Distortion(surface, 0.1, law=law, weight=weight)
    u = smooth_field(surface)
    for scale in functional.log_scale(u):
        assert not scale[border].any()
        assert scale[~border].all()
    # The field of a border vertex enters the matrix through the diffusion of its faces alone.
    gradient = functional.value_and_gradient(u)[1]
    assert gradient[border].any() == (law == "paper")


# --------------------------------------------------------------------------------------------------
# shapes and units
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "surface", [datasets.sheet(24, 20), datasets.cylinder()], ids=["sheet", "cylinder"]
)
def test_developable_surfaces_have_none(surface, law):
    vertices = np.asarray(surface.vertices)
    functional = pa.functionals.Distortion(surface, 0.1, law=law)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    along = [profile(vertices[:, k] - middle[k], 0.1) for k in range(3)]
    for u in [*along, np.random.default_rng(0).uniform(-1.0, 1.0, surface.n_vertices)]:
        value, gradient = functional.value_and_gradient(u)
        assert 0.0 <= value < 1e-20
        assert np.abs(gradient).max() < 1e-20


def test_all_vertices_on_the_border():
    surface = datasets.sheet(1, 5, amplitude=0.3, periods=0.7)
    value, gradient = pa.functionals.Distortion(surface, 0.1).value_and_gradient(
        np.linspace(-1.0, 1.0, surface.n_vertices)
    )
    assert value == 0.0
    assert not gradient.any()


@pytest.mark.parametrize("factor", [1e-3, 3.7, 1000.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_free_of_the_unit_of_length(surfaces, smooth_field, smooth_weight, factor, weighted):
    u = smooth_field(surfaces)
    weight = smooth_weight(surfaces) if weighted else None
    epsilon = 2.0 * surfaces.mean_edge_length
    scaled = pa.Surface(factor * np.asarray(surfaces.vertices), surfaces.faces)
    first = pa.functionals.Distortion(surfaces, epsilon, weight=weight)
    second = pa.functionals.Distortion(scaled, factor * epsilon, weight=weight)
    value, gradient = first.value_and_gradient(u)
    check_agreement(
        second.value_and_gradient(u), (factor**2 * value, factor**2 * gradient), tolerance=1e-8
    )
    for one, other in zip(first.log_scale(u), second.log_scale(u), strict=True):
        assert np.linalg.norm(other - one) <= 1e-8 * np.linalg.norm(one)


def smallest_angle(surface):
    """Smallest angle of all faces in degrees."""
    vertices, faces = arrays(surface)
    smallest = math.inf
    for face in faces:
        for k in range(3):
            p, q, r = vertices[np.roll(face, k)]
            angle = math.atan2(np.linalg.norm(np.cross(q - p, r - p)), np.dot(q - p, r - p))
            smallest = min(smallest, math.degrees(angle))
    return smallest


def thin_sheet():
    """All cells are 115 times as long as wide."""
    return datasets.sheet(8, 24, size=(1.0, 24 / 8 / 115), amplitude=0.002, periods=1)


def slivered_sheet():
    """Triangles with an angle of nearly 180 degrees among well-shaped ones."""
    wavy = datasets.sheet(12, 12, amplitude=0.1, periods=1)
    vertices, faces = arrays(wavy)
    extra, children = [], []
    for f, face in enumerate(faces):
        if f % 5:
            children.append(face)
            continue
        # A vertex next to the middle of an edge.
        new = len(vertices) + len(extra)
        extra.append(np.array([0.495, 0.495, 0.01]) @ vertices[face])
        children += [[face[k], face[(k + 1) % 3], new] for k in range(3)]
    return pa.Surface(np.concatenate([vertices, extra]), np.array(children))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("make", [thin_sheet, slivered_sheet])
def test_needles(smooth_field, make, law):
    surface = make()
    assert 0.1 < smallest_angle(surface) < 0.7
    for u in (random_field(surface), smooth_field(surface)):
        for epsilon in (0.01, 0.1):
            functional = pa.functionals.Distortion(surface, epsilon, law=law, delta=0.01)
            expected = reference.distortion(*arrays(surface), u, epsilon, law, 0.01, ETA[law])
            assert np.isfinite(expected[0])
            check_agreement(functional.value_and_gradient(u), expected, tolerance=1e-8)


def needled_sheet(degrees):
    """Faces among well-shaped ones that are cut next to an edge, with angles of `degrees`."""
    wavy = datasets.sheet(10, 10, amplitude=0.1, periods=1)
    vertices, faces = arrays(wavy)
    chosen = faces[::5]
    part = 0.5 * math.tan(math.radians(degrees))
    corners = vertices[chosen]
    extra = (0.5 - 0.5 * part) * (corners[:, 0] + corners[:, 1]) + part * corners[:, 2]
    new = len(vertices) + np.arange(len(chosen))
    children = [np.stack([chosen[:, k], chosen[:, (k + 1) % 3], new], axis=1) for k in range(3)]
    kept = np.delete(faces, np.s_[::5], axis=0)
    return pa.Surface(np.concatenate([vertices, extra]), np.concatenate([kept, *children]))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("degrees", [0.5, 0.1, 0.01])
def test_sharper_needles(smooth_weight, law, weighted, degrees):
    surface = needled_sheet(degrees)
    assert 0.3 * degrees < smallest_angle(surface) < 1.5 * degrees
    n = surface.n_vertices
    weight = smooth_weight(surface) if weighted else None
    functional = pa.functionals.Distortion(surface, 0.1, law=law, delta=0.01, weight=weight)
    fields = [np.ones(n), -np.ones(n), np.zeros(n)]
    fields.append(0.009 * np.random.default_rng(0).uniform(-1.0, 1.0, n))
    for u in fields:
        expected = reference.distortion(*arrays(surface), u, 0.1, law, 0.01, ETA[law], weight)
        assert np.isfinite(expected[0])
        check_agreement(functional.value_and_gradient(u), expected, tolerance=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_needles_of_a_real_mesh(mesh_path, law):
    # Its worst triangle has 0.017 of the area of the equilateral one of the same edges.
    surface = pa.load(mesh_path("camelhead"))
    u = np.random.default_rng(0).uniform(-1.0, 1.0, surface.n_vertices)
    functional = pa.functionals.Distortion(surface, 2.0 * surface.mean_edge_length, law=law)
    for field in (u, np.ones_like(u)):
        value, gradient = functional.value_and_gradient(field)
        assert value > 0.0
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()


def test_finite_for_pure_phases(surfaces):
    # No metric of a closed surface but a torus is flat: what is left of the penalty, eta, holds the
    # scale. The printed law has nothing left, and a singular matrix.
    functional = pa.functionals.Distortion(surfaces, 2.0 * surfaces.mean_edge_length)
    for phase in (-1.0, 1.0):
        value, gradient = functional.value_and_gradient(np.full(surfaces.n_vertices, phase))
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()


# --------------------------------------------------------------------------------------------------
# determinism
# --------------------------------------------------------------------------------------------------


# --------------------------------------------------------------------------------------------------
# segmentation
# --------------------------------------------------------------------------------------------------

OMEGA = 10.0


def unit_distortion(tree):
    """Distortion of the only split of a tree, surface scaled to unit area."""
    length = math.sqrt(tree.surface.area)
    functional = pa.functionals.Distortion(
        tree.surface.scaled(1.0 / length), tree.epsilon / length, delta=tree.delta
    )
    return functional.value_and_gradient(tree.fields[0])[0]


@pytest.fixture(scope="module")
def trees():
    """The sphere cut in two without and with distortion."""
    surface = datasets.icosphere(4)
    return [pa.segment(surface, levels=1, distortion=omega) for omega in (0.0, OMEGA)]


def test_segments_are_balanced_and_connected(trees):
    for tree in trees:
        assert tree.diagnostics[0].converged
        assert tree.components.tolist() == [1, 1]
        assert tree.areas == pytest.approx(0.5 * tree.surface.area, rel=1e-2)
        assert tree.weights @ tree.surface.mass == pytest.approx(0.5 * tree.surface.area, rel=1e-4)
        np.testing.assert_allclose(tree.weights.sum(axis=0), 1.0, rtol=0.0, atol=1e-12)


def test_segment_without_distortion_is_the_default(trees):
    plain = pa.segment(trees[0].surface, levels=1)
    assert plain.fields.tobytes() == trees[0].fields.tobytes()


def test_segment_energy_holds_the_distortion(trees):
    for tree, omega in zip(trees, (0.0, OMEGA), strict=True):
        record = tree.diagnostics[0]
        # Both phases connect, so the perimeter and the distortion are all of the energy.
        perimeter = math.sqrt(2.0) * record.length / math.sqrt(tree.surface.area)
        assert record.energy == pytest.approx(perimeter + omega * unit_distortion(tree), rel=1e-9)


def test_segment_trades_length_for_distortion(trees):
    plain, flattened = trees
    assert unit_distortion(flattened) < 0.5 * unit_distortion(plain)
    assert flattened.diagnostics[0].length > plain.diagnostics[0].length
    # The great circle is no minimum of the sum.
    hemispheres = plain.diagnostics[0].energy + OMEGA * unit_distortion(plain)
    assert flattened.diagnostics[0].energy < hemispheres


def test_segment_with_free_area():
    # Coarser spheres hold the sharp law's border on their edges, off by a tenth of the area.
    surface = datasets.icosphere(5)
    # The perimeter alone would shrink this cap to nothing; the distortion of what is around it
    # lets it grow to about a half.
    cap = np.tanh(3.0 * (np.asarray(surface.vertices)[:, 2] - 0.4))
    tree = pa.segment(surface, levels=1, distortion=OMEGA, area="none", initial=cap)
    assert tree.diagnostics[0].converged
    assert tree.components.tolist() == [1, 1]
    assert tree.areas == pytest.approx(0.5 * surface.area, rel=0.1)
    with pytest.raises(pa.CollapsedError, match="phase is empty"):
        pa.segment(surface, levels=1, area="none", initial=cap)


def test_segment_with_free_area_from_a_random_start():
    tree = pa.segment(datasets.icosphere(4), levels=1, distortion=OMEGA, area="none")
    assert tree.components.tolist() == [1, 1]
    assert tree.areas.min() > 0.1 * tree.surface.area


@pytest.mark.parametrize("omega", [-1.0, math.nan, math.inf])
def test_segment_rejects_bad_distortion(omega):
    with pytest.raises(ValueError, match="distortion"):
        pa.segment(datasets.icosphere(1), levels=1, distortion=omega)


def test_segment_rejects_unknown_law():
    with pytest.raises(ValueError, match=r"\blaw\b"):
        pa.segment(datasets.icosphere(1), levels=1, distortion=1.0, law="robin")


# --------------------------------------------------------------------------------------------------
# bad input
# --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    return datasets.icosphere(1)


@pytest.mark.parametrize("law", ["", "Sharp", "robin"])
def test_rejects_unknown_law(small, law):
    with pytest.raises(ValueError, match=r"\blaw\b"):
        pa.functionals.Distortion(small, 0.1, law=law)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("eta", [-1.0, -1e-9, math.nan, math.inf])
def test_rejects_bad_eta(small, law, eta):
    with pytest.raises(ValueError, match=r"\beta\b"):
        pa.functionals.Distortion(small, 0.1, law=law, eta=eta)
