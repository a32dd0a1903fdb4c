"""Connectedness penalty, equation (3)."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phaseatlas as pa
import reference
from contract import check_agreement, check_gradient, check_gradient_of_every_vertex
from phaseatlas import datasets


def arrays(surface):
    return np.asarray(surface.vertices), np.asarray(surface.faces)


def n_components(surface, u, epsilon):
    return reference.components(np.asarray(surface.faces), u, epsilon).max() + 1


# The other forms of the functional than the paper's; the plateau lies above every threshold here.
VARIANTS = [
    {"form": "tree"},
    {"saturation": 1e-2},
    {"form": "tree", "saturation": 1e-2, "plateau": 0.95},
]


def twin(surface, u, epsilon, weight=None, phase="both", **variant):
    vertices, faces = arrays(surface)
    value, gradient = 0.0, np.zeros(len(vertices))
    if phase in ("both", "positive"):
        c, dc = reference.connectedness(vertices, faces, u, epsilon, weight, **variant)
        value, gradient = value + c, gradient + dc
    if phase in ("both", "negative"):
        c, dc = reference.connectedness(vertices, faces, -u, epsilon, weight, **variant)
        value, gradient = value + c, gradient - dc
    return value, gradient


def check_twin(actual, expected):
    assert expected[0] > 0.0, "the case has to have something to connect"
    check_agreement(actual, expected)


def random_case(surface):
    """A field without any structure, and an epsilon for some ten to forty components."""
    u = np.random.default_rng(3).uniform(-1.0, 1.0, surface.n_vertices)
    return u, 0.05 if surface.n_faces > 4000 else 0.2


def separate_bumps(surface, seed):
    """Three or so smooth bumps of unequal height on a background that is no constant."""
    vertices = np.asarray(surface.vertices)
    scaled = (vertices - vertices.mean(axis=0)) / np.ptp(vertices, axis=0).max()
    rng = np.random.default_rng(seed)
    centres = [int(rng.integers(len(scaled)))]
    while len(centres) < 3:
        gaps = np.linalg.norm(scaled[:, None] - scaled[centres], axis=2).min(axis=1)
        centres.append(int(gaps.argmax()))
    distances = np.linalg.norm(scaled[:, None] - scaled[centres], axis=2)
    heights = np.array([1.9, 1.8, 1.85])
    bumps = (heights * np.exp(-((distances / 0.25) ** 4))).sum(axis=1)
    return -0.9 + bumps + 0.05 * np.sin(scaled @ np.array([7.0, 5.0, 3.0]) + seed)


# --------------------------------------------------------------------------------------------------
# agreement with the twin
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weighted", [False, True])
def test_random_field_agrees_with_reference(surfaces, smooth_weight, weighted):
    u, epsilon = random_case(surfaces)
    weight = smooth_weight(surfaces) if weighted else None
    assert n_components(surfaces, u, epsilon) >= 3
    assert n_components(surfaces, -u, epsilon) >= 3
    parts = {phase: twin(surfaces, u, epsilon, weight, phase) for phase in ("positive", "negative")}
    parts["both"] = tuple(a + b for a, b in zip(parts["positive"], parts["negative"], strict=True))
    for phase, expected in parts.items():
        functional = pa.functionals.Connectedness(surfaces, epsilon, weight=weight, phase=phase)
        check_twin(functional.value_and_gradient(u), expected)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_smooth_bumps_agree_with_reference(surfaces, smooth_weight, weighted, seed):
    u = separate_bumps(surfaces, seed)
    weight = smooth_weight(surfaces) if weighted else None
    epsilon = 0.1
    assert n_components(surfaces, u, epsilon) >= 2
    functional = pa.functionals.Connectedness(surfaces, epsilon, weight=weight)
    check_twin(functional.value_and_gradient(u), twin(surfaces, u, epsilon, weight))


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("kind", ["random", "bumps"])
def test_variants_agree_with_reference(surfaces, smooth_weight, variant, weighted, kind):
    u, epsilon = random_case(surfaces) if kind == "random" else (separate_bumps(surfaces, 1), 0.1)
    weight = smooth_weight(surfaces) if weighted else None
    functional = pa.functionals.Connectedness(surfaces, epsilon, weight=weight, **variant)
    expected = twin(surfaces, u, epsilon, weight, **variant)
    check_twin(functional.value_and_gradient(u), expected)


def test_smooth_waves_agree_with_reference(surfaces, smooth_field):
    u, epsilon = smooth_field(surfaces, seed=5), 0.1
    expected = twin(surfaces, u, epsilon)
    check_twin(pa.functionals.Connectedness(surfaces, epsilon).value_and_gradient(u), expected)


def test_default_phase_is_both(surfaces):
    u = separate_bumps(surfaces, 0)
    by_default = pa.functionals.Connectedness(surfaces, 0.1).value_and_gradient(u)
    both = pa.functionals.Connectedness(surfaces, 0.1, phase="both").value_and_gradient(u)
    assert by_default[0] == both[0]
    assert np.array_equal(by_default[1], both[1])


def test_negative_phase_mirrors_the_positive(surfaces):
    u = separate_bumps(surfaces, 2)
    positive = pa.functionals.Connectedness(surfaces, 0.1, phase="positive").value_and_gradient(u)
    negative = pa.functionals.Connectedness(surfaces, 0.1, phase="negative").value_and_gradient(-u)
    assert positive[0] == pytest.approx(negative[0], rel=1e-14)
    assert positive[0] > 0.0
    assert np.allclose(positive[1], -negative[1], rtol=0.0, atol=1e-14)


# --------------------------------------------------------------------------------------------------
# the gradient is the derivative
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("kind", ["random", "bumps"])
@pytest.mark.parametrize("variant", [{}, *VARIANTS], ids=str)
def test_gradient_is_the_derivative(surfaces, smooth_field, smooth_weight, weighted, kind, variant):
    if kind == "random":
        u, epsilon = random_case(surfaces)
    else:
        u, epsilon = separate_bumps(surfaces, 0), 0.1
    weight = smooth_weight(surfaces) if weighted else None
    functional = pa.functionals.Connectedness(surfaces, epsilon, weight=weight, **variant)
    assert functional.value_and_gradient(u)[0] > 0.0
    directions = [smooth_field(surfaces, seed=10 + seed) for seed in range(4)]
    # The laws are C1 with a third derivative of 12 / epsilon^(3/2): h^2 times that is 1e-8, and
    # rounding 1e-16 |C| / h = 1e-11 |C|. A face within h of a threshold adds h.
    check_gradient(functional, u, directions, 1e-5, 1e-5)


def test_gradient_of_every_vertex():
    surface = datasets.sheet(8, 6, amplitude=0.1, periods=1)
    u, epsilon = random_case(surface)
    functional = pa.functionals.Connectedness(surface, epsilon)
    # One face within h of a threshold costs h times the jump of the second derivative.
    check_gradient_of_every_vertex(functional, u, 1e-6, 1e-5)


def chain():
    """A strip one cell wide: its dual graph is a chain, so shortest paths never change over.

    Where two paths tie the distance has a corner, as every minimum has; on a chain nothing but the
    laws and the components can spoil the smoothness.
    """
    return datasets.sheet(90, 1, size=(3.0, 0.1))


def hump(x, centre, width):
    return np.exp(-(((x - centre) / width) ** 4))


def appearing(x):
    """(start, direction): between two bumps a third one grows across the threshold."""
    base = -0.95 + 1.85 * hump(x, 0.5, 0.2) + 1.9 * hump(x, 2.5, 0.25) + 0.03 * np.sin(4.0 * x)
    return base, 1.95 * hump(x, 1.45, 0.2)


def vanishing(x):
    """(start, direction): the same backwards, from a bump that is there."""
    base, direction = appearing(x)
    return base + direction, -direction


def merging(x):
    """(start, direction): the valley between two bumps fills until they are one component."""
    base = -0.95 + 1.85 * hump(x, 0.8, 0.4) + 1.9 * hump(x, 2.2, 0.4) + 0.03 * np.sin(4.0 * x)
    return base, 1.9 * hump(x, 1.5, 0.6)


FAMILIES = [appearing, vanishing, merging]


def sweep(functional, start, direction, steps):
    times = np.linspace(0.0, 1.0, steps + 1)
    values = [functional.value_and_gradient(start + t * direction) for t in times]
    return times, np.array([v for v, _ in values]), np.array([g @ direction for _, g in values])


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("weighted", [False, True])
def test_value_and_slope_are_continuous_when_components_change(family, weighted):
    surface, epsilon = chain(), 0.1
    x = np.asarray(surface.vertices)[:, 0]
    start, direction = family(x)
    counts = [n_components(surface, start + t * direction, epsilon) for t in np.linspace(0, 1, 41)]
    assert len(set(counts)) >= 2, "the family has to change the number of components"
    weight = 0.6 + 0.4 * np.sin(3.0 * x) if weighted else None
    functional = pa.functionals.Connectedness(surface, epsilon, weight=weight, phase="positive")
    _, coarse, coarse_slope = sweep(functional, start, direction, 200)
    _, fine, fine_slope = sweep(functional, start, direction, 3200)
    # Sixteen times as many steps divide the largest step of a continuous function with bounded
    # slope by sixteen; a jump stays. A quarter of that is asked for, for the sampling of peaks.
    for a, b in ((coarse, fine), (coarse_slope, fine_slope)):
        assert np.abs(np.diff(b)).max() < np.abs(np.diff(a)).max() / 4.0


@pytest.mark.parametrize("family", FAMILIES)
def test_gradient_is_the_derivative_when_components_change(family):
    surface, epsilon = chain(), 0.1
    start, direction = family(np.asarray(surface.vertices)[:, 0])
    functional = pa.functionals.Connectedness(surface, epsilon, phase="positive")
    times, values, slopes = sweep(functional, start, direction, 2000)
    h = 1e-6
    # The slope is Lipschitz with a constant that the sweep shows, so a central difference is off by
    # h times that at most (half of it, and the sweep may miss as much); rounding adds 1e-16 C / h.
    tolerance = h * np.abs(np.diff(slopes)).max() / (times[1] - times[0]) + 1e-9 * values.max()
    for t, slope in zip(times[::8], slopes[::8], strict=True):
        plus = functional.value_and_gradient(start + (t + h) * direction)[0]
        minus = functional.value_and_gradient(start + (t - h) * direction)[0]
        assert abs((plus - minus) / (2.0 * h) - slope) < tolerance


def test_slope_integrates_to_the_value_on_a_surface(surfaces):
    """Along a family on a real surface, where paths do change over and components come and go."""
    epsilon = 0.1
    start = separate_bumps(surfaces, 0)
    direction = separate_bumps(surfaces, 1) - start
    functional = pa.functionals.Connectedness(surfaces, epsilon)
    counts = {
        n_components(surfaces, start + t * direction, epsilon) for t in np.linspace(0.0, 1.0, 21)
    }
    assert len(counts) >= 2
    errors = []
    for steps in (50, 400):
        times, values, slopes = sweep(functional, start, direction, steps)
        integral = np.concatenate(
            ([0.0], np.cumsum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(times)))
        )
        errors.append(np.abs(values - values[0] - integral).max() / values.max())
    # The trapezoidal rule is first order at the corners where paths change over and second order
    # elsewhere; a jump of the value, or a missing term of the gradient, would stay.
    assert errors[1] < errors[0] / 4.0
    assert errors[1] < 1e-3


# --------------------------------------------------------------------------------------------------
# closed forms
# --------------------------------------------------------------------------------------------------


def two_bands(n, first, last):
    """Unit sheet of n x n cells, u = 1 in the columns up to `first` and from `last`, -1 between."""
    surface = datasets.sheet(n, n)
    column = np.rint(np.asarray(surface.vertices)[:, 0] * n)
    return surface, np.where((column <= first) | (column >= last), 1.0, -1.0)


@pytest.mark.parametrize("epsilon", [0.01, 0.09])
def test_two_bands_in_closed_form(epsilon):
    n, first, last = 20, 5, 13
    surface, u = two_bands(n, first, last)
    value, _ = pa.functionals.Connectedness(surface, epsilon, phase="positive").value_and_gradient(
        u
    )
    # All faces have the diameter sqrt(2) / n. A path crosses each of the columns of cells through
    # at least two faces; those of the outermost columns have the means +-1/3. F = 0 in the bands.
    a = 1.0 - math.sqrt(epsilon)
    inner = 2 * (last - first - 2) * (1.0 + a) ** 2
    outer = 2.0 * ((a - 1.0 / 3.0) ** 2 + (a + 1.0 / 3.0) ** 2)
    distance = math.sqrt(2.0) / n * (inner + outer)
    expected = 2.0 * (first / n) * ((n - last) / n) * distance
    assert value == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("amplitude", [0.0, 0.05])
def test_two_bumps_between_bounds(amplitude):
    n, epsilon = 32, 0.04
    surface = datasets.sheet(n, n, amplitude=amplitude)
    vertices, faces = arrays(surface)
    centres = np.array([[0.2, 0.25], [0.8, 0.7]])
    gaps = np.linalg.norm(vertices[:, None, :2] - centres, axis=2)
    u = np.where((gaps < 0.13).any(axis=1), 1.0, -1.0)
    labels = reference.components(faces, u, epsilon)
    assert labels.max() == 1
    totals = [np.asarray(surface.face_areas)[labels == i].sum() for i in range(2)]
    value, _ = pa.functionals.Connectedness(surface, epsilon, phase="positive").value_and_gradient(
        u
    )
    distance = value / (2.0 * totals[0] * totals[1])
    pure = (2.0 - math.sqrt(epsilon)) ** 2  # F(-1)
    # Below: a centroid is a third of a median away from the middle of an edge, and a median is
    # shorter than the diameter, so a path is longer than 3/2 of its chord. Up to two diameters at
    # each end may run through faces with less than F(-1).
    centroids = vertices[faces].mean(axis=1)
    first, second = centroids[labels == 0], centroids[labels == 1]
    chord = np.linalg.norm(first[:, None] - second, axis=2).min()
    diameter = np.asarray(surface.face_diameters).max()
    assert distance > 1.5 * pure * (chord - 4.0 * diameter)
    # Above: along x and then along y, two faces in each cell, nowhere more than F(-1).
    cells = n * (0.6 + 0.45)
    assert distance < pure * diameter * 2.0 * cells


def test_zero_when_connected(surfaces):
    one = np.ones(surfaces.n_vertices)
    z = np.asarray(surfaces.vertices)[:, 0]
    halves = np.tanh((z - np.median(z)) / (0.1 * np.ptp(z)))
    cases = {"positive": one, "negative": -one, "absent": -one}
    for name, u in cases.items():
        phase = "positive" if name == "absent" else name
        functional = pa.functionals.Connectedness(surfaces, 0.1, phase=phase)
        value, gradient = functional.value_and_gradient(u)
        assert value == 0.0
        assert not gradient.any()
    # One connected component, yet u is neither constant nor everywhere in the phase.
    phases = [
        p
        for p, s in (("positive", 1), ("negative", -1))
        if n_components(surfaces, s * halves, 0.3) == 1
    ]
    assert phases
    for phase in phases:
        functional = pa.functionals.Connectedness(surfaces, 0.3, phase=phase)
        value, gradient = functional.value_and_gradient(halves)
        assert value == 0.0
        assert not gradient.any()


def test_touching_in_a_vertex_is_not_connected():
    surface = datasets.sheet(6, 6)
    i, j = np.divmod(np.arange(surface.n_vertices), 7)
    # Two blocks of cells that share the vertex (3, 3) and no edge, off the diagonals of the cells.
    u = np.where(((i <= 3) & (j >= 3)) | ((i >= 3) & (j <= 3)), 1.0, -1.0)
    assert n_components(surface, u, 0.01) == 2
    value, _ = pa.functionals.Connectedness(surface, 0.01, phase="positive").value_and_gradient(u)
    expected, _ = reference.connectedness(*arrays(surface), u, 0.01)
    assert value == pytest.approx(expected, rel=1e-12)
    assert value > 0.0


def test_path_through_a_third_component_is_free():
    n, epsilon = 90, 0.01
    surface = chain()
    column = np.rint(np.asarray(surface.vertices)[:, 0] * 30.0)
    bands = [(0, 10), (40, 50), (80, n)]
    u = np.full(surface.n_vertices, -1.0)
    for low, high in bands:
        u[(column >= low) & (column <= high)] = 1.0
    value, _ = pa.functionals.Connectedness(surface, epsilon, phase="positive").value_and_gradient(
        u
    )
    a = 1.0 - math.sqrt(epsilon)
    diameter = math.hypot(1.0 / 30.0, 0.1)
    gap = diameter * (2 * 28 * (1.0 + a) ** 2 + 2.0 * ((a - 1.0 / 3.0) ** 2 + (a + 1.0 / 3.0) ** 2))
    # Three components of the same area; the outer two are two gaps apart, the middle being free.
    total = 10 / n * 0.3
    assert value == pytest.approx(2.0 * total**2 * (gap + gap + 2.0 * gap), rel=1e-12)


def test_paths_that_leave_the_weight_pay():
    surface, u = two_bands(20, 5, 13)
    i, _ = np.divmod(np.arange(surface.n_vertices), 21)
    # The weight vanishes on a belt across every path: the edges in the middle of it cost a factor
    # of 1 / 1e-2, the bands keep their weight.
    weight = np.where((i >= 8) & (i <= 10), 0.0, 1.0)
    value, _ = pa.functionals.Connectedness(
        surface, 0.01, weight=weight, phase="positive"
    ).value_and_gradient(u)
    plain, _ = pa.functionals.Connectedness(surface, 0.01, phase="positive").value_and_gradient(u)
    expected, _ = reference.connectedness(*arrays(surface), u, 0.01, weight)
    assert value == pytest.approx(expected, rel=1e-12)
    # Four of sixteen faces of a path have no weight, hence three edges cost a hundred times more.
    assert value > 3 / 16 * 100.0 * plain * 0.9


# --------------------------------------------------------------------------------------------------
# the same bytes whatever the number of threads
# --------------------------------------------------------------------------------------------------


# --------------------------------------------------------------------------------------------------
# bad input
# --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    return datasets.icosphere(1)


# sqrt(epsilon) >= 1 would put the threshold below the mixed phase u = 0; only signs are refused.


@pytest.mark.parametrize("form", ["pairs", "tree"])
def test_only_the_faces_of_the_parent_count(surfaces, smooth_weight, form):
    u, weight, epsilon = separate_bumps(surfaces, 0), smooth_weight(surfaces), 0.1
    inside = np.asarray(surfaces.vertices)[np.asarray(surfaces.faces)].mean(axis=1) @ [1, 2, 3]
    inside = inside > np.median(inside)
    functional = pa.functionals.Connectedness(
        surfaces, epsilon, weight=weight, inside=inside, form=form
    )
    expected = twin(surfaces, -u, epsilon, weight, inside=inside, form=form)
    check_twin(functional.value_and_gradient(-u), expected)


def test_rejects_faces_of_another_number(small):
    with pytest.raises(ValueError, match=r"inside.*81.*80"):
        pa.functionals.Connectedness(small, 0.1, inside=np.ones(81, dtype=bool))


def test_tree_is_no_smaller_and_zero_alike(surfaces, smooth_field):
    epsilon = 0.1
    pairs = pa.functionals.Connectedness(surfaces, epsilon)
    tree = pa.functionals.Connectedness(surfaces, epsilon, form="tree")
    for seed in range(8):
        u = smooth_field(surfaces, seed=seed)
        low, high = (functional.value_and_gradient(u)[0] for functional in (pairs, tree))
        assert (low == 0.0) == (high == 0.0)
        assert high >= low * (1.0 - 1e-12)


def test_saturated_tree_counts_the_bridges():
    # Bands far larger than the saturation count 1 each, however wide they are: C is twice the
    # length of the bridges, F(-1) = (2 - sqrt(epsilon))^2 to the unit of length.
    surface = datasets.sheet(120, 12, size=(3.0, 0.3))
    x = np.asarray(surface.vertices)[:, 0]
    epsilon = 0.04
    bands = (x < 0.5) | ((x > 0.95) & (x < 1.05)) | (x > 2.0)
    functional = pa.functionals.Connectedness(
        surface, epsilon, phase="positive", form="tree", saturation=1e-9
    )
    u = np.where(bands, 1.0, -1.0)
    assert functional.components(u) == (3, 2)
    length = (0.95 - 0.5) + (2.0 - 1.05)
    price = (2.0 - math.sqrt(epsilon)) ** 2
    # A path of dual edges, each counted with the diameters of its faces, is longer than straight.
    value = functional.value_and_gradient(u)[0]
    assert length * price < value / 2.0 < 4.0 * length * price


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_rejects_bad_saturation(small, bad):
    with pytest.raises(ValueError, match="saturation"):
        pa.functionals.Connectedness(small, 0.1, saturation=bad)


@pytest.mark.parametrize("bad", [0.5, 1.1, math.nan])
def test_rejects_bad_plateau(small, bad):
    with pytest.raises(ValueError, match="plateau"):
        pa.functionals.Connectedness(small, 0.1, plateau=bad)


def test_rejects_bad_form(small):
    with pytest.raises(ValueError, match="form"):
        pa.functionals.Connectedness(small, 0.1, form="star")


def test_rejects_bad_phase(small):
    with pytest.raises(ValueError, match="phase"):
        pa.functionals.Connectedness(small, 0.1, phase="neither")
