"""What a surface accepts stays accepted: scaled, in part, and in another process."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import phaseatlas as pa
from phaseatlas import datasets


def with_needle(thinness: float) -> pa.Surface:
    """A sphere of which one vertex is drawn almost onto the opposite edge of one of its faces."""
    sphere = datasets.icosphere(2)
    vertices = sphere.vertices.copy()
    a, b, c = sphere.faces[0]
    middle = 0.4 * vertices[b] + 0.6 * vertices[c]
    vertices[a] = middle + thinness * (vertices[a] - middle)
    return pa.Surface(vertices, sphere.faces)


def thinnest() -> pa.Surface:
    """A needle at the bound of what is accepted."""
    low, high = 1e-16, 1e-8
    for _ in range(200):
        middle = np.sqrt(low * high)
        try:
            with_needle(middle)
            high = middle
        except ValueError:
            low = middle
    return with_needle(high)


@settings(deadline=None, max_examples=300)
@given(st.floats(1e-6, 1e6))
def test_a_scaled_surface_is_accepted(factor):
    surface = thinnest_surface
    scaled = surface.scaled(factor)
    assert scaled.area == pytest.approx(factor**2 * surface.area, rel=1e-9)


thinnest_surface = thinnest()


def test_some_scales_of_the_needle_would_be_refused():
    refused = 0
    for factor in np.linspace(0.5, 2, 200):
        try:
            pa.Surface(factor * thinnest_surface.vertices, thinnest_surface.faces)
        except ValueError:
            refused += 1
    assert refused > 0


def test_accepted_needles_are_segmented_and_travel():
    unit = thinnest_surface.scaled(thinnest_surface.area**-0.5)
    again = pickle.loads(pickle.dumps(unit))
    assert np.array_equal(again.vertices, unit.vertices)
    assert pa.segment(thinnest_surface, 1).components.tolist() == [1, 1]


def test_the_needle_of_the_collection_is_segmented(case_path):
    with np.load(case_path("needle_scaled.npz")) as file:
        surface = pa.Surface(file["v"], file["f"])
    assert pa.segment(surface, 2).components.tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_factors_that_are_no_scale_are_refused(factor):
    with pytest.raises(ValueError, match=r"factor: .* must be a positive number"):
        datasets.icosphere(1).scaled(factor)


@pytest.mark.parametrize("factor", [1e-200, 1e200])
def test_scales_without_area_are_refused(factor):
    with pytest.raises(ValueError, match="degenerate"):
        datasets.icosphere(1).scaled(factor)


def test_submesh_keeps_faces_and_names_their_vertices():
    sphere = datasets.icosphere(3)
    above = sphere.vertices[sphere.faces].mean(axis=1)[:, 2] > 0.2
    cap, vertices = sphere.submesh(above)
    assert cap.n_boundary_loops == 1
    assert np.array_equal(vertices[cap.faces], sphere.faces[above])
    assert np.array_equal(cap.vertices, sphere.vertices[vertices])
    by_index, _ = sphere.submesh(np.flatnonzero(above))
    assert np.array_equal(by_index.faces, cap.faces)


def test_faces_that_touch_at_a_vertex_alone_are_no_submesh():
    sphere = datasets.icosphere(2)
    around = np.flatnonzero((sphere.faces == 12).any(axis=1))
    first = around[0]
    apart = next(
        f for f in around[1:] if len(np.intersect1d(sphere.faces[f], sphere.faces[first])) == 1
    )
    with pytest.raises(ValueError, match=r"vertex|component"):
        sphere.submesh(np.array([first, apart]))


def test_components_of_labels():
    sphere = datasets.icosphere(3)
    z = sphere.vertices[sphere.faces].mean(axis=1)[:, 2]
    labels = np.where(np.abs(z) > 0.5, 7, 3)
    parts = sphere.label_components(labels)
    assert parts.max() == 2
    for part in range(3):
        assert len(np.unique(labels[parts == part])) == 1
    with pytest.raises(ValueError, match="labels: shape"):
        sphere.label_components(labels[:-1])
