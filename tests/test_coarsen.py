"""Simplified surfaces and the maps between their vertices."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas.coarsen import coarsen


def check(surface, coarse):
    n, k = surface.n_vertices, coarse.target.n_vertices
    assert coarse.backward.shape == (n, k)
    assert coarse.forward.shape == (k, n)
    # Means: no row is empty, no weight negative.
    for matrix in (coarse.backward, coarse.forward):
        np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-12)
        assert matrix.data.min() > 0
    # A vertex collapses to one nearby.
    length = coarse.target.mean_edge_length
    apart = coarse.backward @ coarse.target.vertices - surface.vertices
    assert np.quantile(np.linalg.norm(apart, axis=1), 0.99) < 2.0 * length
    apart = coarse.forward @ surface.vertices - coarse.target.vertices
    assert np.quantile(np.linalg.norm(apart, axis=1), 0.99) < 2.0 * length


@pytest.mark.parametrize(
    "surface",
    [
        pa.datasets.icosphere(4),
        pa.datasets.torus(1.0, 0.4, 60, 30),
        pa.datasets.sheet(60),
    ],
    ids=["sphere", "torus", "sheet"],
)
def test_a_quarter_of_the_faces_on_the_same_surface(surface):
    coarse = coarsen(surface)
    check(surface, coarse)
    assert coarse.target.n_faces == pytest.approx(0.25 * surface.n_faces, rel=0.05)
    assert coarse.target.genus == surface.genus
    assert coarse.target.n_boundary_loops == surface.n_boundary_loops
    assert coarse.target.area == pytest.approx(surface.area, rel=0.02)
    ratio = coarse.target.mean_edge_length / surface.mean_edge_length
    assert 1.8 < ratio < 3.0
    # Orientation is kept.
    normals = coarse.forward @ surface.vertex_normals
    assert np.mean(np.vecdot(coarse.target.vertex_normals, normals) > 0.5) > 0.95


@pytest.mark.parametrize("name", ["armadillo", "bunny", "camelhead", "fandisk", "hand", "spot"])
def test_real_meshes(name, mesh_path):
    surface = pa.load(mesh_path(f"{name}.obj"))
    levels = 0
    while (coarse := coarsen(surface)) is not None and surface.n_vertices > 1000:
        check(surface, coarse)
        surface = coarse.target
        levels += 1
    assert levels >= 1
    assert surface.n_vertices <= 1000


def test_few_faces_are_left_alone():
    assert coarsen(pa.datasets.icosphere(1)) is None


def test_a_surface_that_cannot_be_made_coarser_ends_the_hierarchy(case_path):
    surface = pa.load(case_path("hang_box_1x1x0.02_sub4.obj"))
    sizes = [surface.n_faces]
    while (coarse := coarsen(surface)) is not None:
        surface = coarse.target
        assert surface.n_faces <= 0.6 * sizes[-1]
        sizes.append(surface.n_faces)
    assert len(sizes) < 12


def test_transfers_compose():
    fine = pa.datasets.icosphere(5)
    first = coarsen(fine)
    second = coarsen(first.target)
    both = first.then(second)
    check(fine, both)
    values = fine.vertices[:, 2]
    np.testing.assert_allclose(both.forward @ values, second.forward @ (first.forward @ values))
    with pytest.raises(ValueError, match="other: its source"):
        second.then(first)


def test_segmentations_go_back():
    fine = pa.datasets.icosphere(5)
    transfer = coarsen(fine)
    tree = pa.segment(transfer.target, 2)
    segmentation = tree.at(2).back(transfer)
    assert segmentation.surface is fine
    np.testing.assert_allclose(segmentation.weights.sum(axis=0), 1.0, rtol=1e-12)
    assert segmentation.weights.max() <= 1
    # A face of each is near a face of the other.
    np.testing.assert_allclose(segmentation.areas, tree.areas, rtol=0.05)
    with pytest.raises(ValueError, match="transfer: its target"):
        segmentation.back(transfer)


def test_threads_do_not_disturb_one_another():
    surfaces = [pa.datasets.icosphere(4), pa.datasets.torus(1.0, 0.4, 80, 40)] * 4
    alone = [coarsen(surface).target.vertices for surface in surfaces[:2]] * 4
    with ThreadPoolExecutor(4) as pool:
        together = [coarse.target.vertices for coarse in pool.map(coarsen, surfaces)]
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))
