"""Simplification that keeps the topology whatever the surface is like."""

from __future__ import annotations

import numpy as np
import pytest

import generated
import phaseatlas as pa
from phaseatlas.coarsen import reduced


def _euler_characteristic(faces):
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces)


def _places(surface):
    """Centroids and unit normals of the faces."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners.mean(axis=1), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("name", sorted(generated.SURFACES))
def test_topology_is_kept(name):
    surface = generated.SURFACES[name]()
    simplified, parents = reduced(surface, surface.n_faces // 8)
    # The core checks nothing of what it makes itself: here every check of a given surface is made.
    given = pa.Surface(simplified.vertices, simplified.faces)
    assert given.genus == surface.genus
    assert given.n_boundary_loops == surface.n_boundary_loops
    assert _euler_characteristic(given.faces) == _euler_characteristic(surface.faces)
    assert parents.shape == (surface.n_faces,)
    assert 0 <= parents.min() <= parents.max() < given.n_faces


@pytest.mark.parametrize(
    "surface",
    [
        pa.datasets.icosphere(5),
        pa.datasets.torus(1.0, 0.4, 120, 60),
        pa.datasets.sheet(60),
    ],
    ids=["sphere", "torus", "sheet"],
)
def test_shape_is_kept(surface):
    simplified, parents = reduced(surface, surface.n_faces // 8)
    assert simplified.n_faces == pytest.approx(surface.n_faces / 8, rel=0.05)
    assert simplified.area == pytest.approx(surface.area, rel=0.01)
    # Every face is inherited by a face nearby that looks the same way.
    middle, normal = _places(surface)
    theirs, their_normal = _places(simplified)
    apart = np.linalg.norm(middle - theirs[parents], axis=1)
    assert apart.max() < 2 * simplified.mean_edge_length
    assert np.vecdot(normal, their_normal[parents]).min() > 0.5


def test_shape_does_not_depend_on_place_and_size():
    surface = pa.datasets.torus(1.0, 0.4, 60, 30)
    simplified, _ = reduced(surface, 600)
    for scale, shift in ((2.0**-20, 0.0), (2.0**20, 0.0), (1.0, 2.0**10)):
        moved = pa.Surface(scale * surface.vertices + shift, surface.faces)
        again, _ = reduced(moved, 600)
        assert again.area == pytest.approx(scale**2 * simplified.area, rel=1e-2)
        assert again.genus == 1


def test_result_is_the_same_each_time():
    surface = generated.blob(5, 6, 1.0, 3)
    first, parents = reduced(surface, 2000)
    second, again = reduced(surface, 2000)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)
    np.testing.assert_array_equal(parents, again)


def test_a_fine_surface_gets_charts_that_are_disks():
    surface = generated.blob(7, 6, 1.0, 3)
    assert surface.n_faces > 300_000
    partition = pa.partition(surface, effort="fast")
    last = partition.diagnostics[-1]
    assert last.n_faces == surface.n_faces
    assert last.n_overlapping == 0
    assert partition.n_segments == last.n_charts
    np.testing.assert_array_equal(partition.components, 1)
    sought = [phase for phase in partition.diagnostics if phase.n_faces < surface.n_faces]
    assert last.energy < 1.1 * sought[-1].energy
