"""The surfaces and the phase fields that the comparisons work on, the same at every run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import phaseatlas as pa
from phaseatlas import datasets

Floats = NDArray[np.float64]

# Random displacement of the irregular surface's vertices, relative to the edge length.
_JITTER = 0.25


def icosphere(subdivisions: int) -> pa.Surface:
    """Sphere of unit area with 10 * 4**subdivisions + 2 vertices."""
    return _of_unit_area(datasets.icosphere(subdivisions))


def irregular(subdivisions: int) -> pa.Surface:
    """Bumpy body of unit area: uneven triangles of different sizes, numbered at random."""
    rng = np.random.default_rng(1)
    sphere = datasets.icosphere(subdivisions)
    n = sphere.n_vertices
    moved = sphere.vertices + _JITTER * np.sqrt(4 * np.pi / n) * rng.uniform(-1, 1, (n, 3))
    x, y, z = directions = (moved / np.linalg.norm(moved, axis=1, keepdims=True)).T
    radius = 1 + 0.3 * np.sin(3 * x + 1) * np.cos(4 * y) + 0.4 * z**3
    order = rng.permutation(n)
    vertices = np.empty((n, 3))
    vertices[order] = (radius * directions).T
    return _of_unit_area(pa.Surface(vertices, order[rng.permutation(sphere.faces)]))


def cap(subdivisions: int) -> pa.Surface:
    """The part z > 0 of the icosphere: a disk."""
    sphere = icosphere(subdivisions)
    faces = sphere.faces[(sphere.vertices[sphere.faces, 2] > 0).all(axis=1)]
    used, compact = np.unique(faces, return_inverse=True)
    return pa.Surface(sphere.vertices[used], compact.reshape(-1, 3))


def halves(surface: pa.Surface, epsilon: float) -> Floats:
    """Two halves, as after a solve."""
    return _profile(surface.vertices @ np.array([1.0, 0.1, 0.0]), epsilon)


def caps(surface: pa.Surface, epsilon: float, count: int) -> Floats:
    """Caps around `count` directions spread over the sphere (a Fibonacci lattice).

    Together they take a quarter of it and are one component of the positive phase each.
    """
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * i
    ring = np.sqrt(1 - z * z)
    centres = np.stack([ring * np.cos(turn), ring * np.sin(turn), z])
    directions = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    nearest = np.sqrt(np.maximum(2 - 2 * (directions @ centres).max(axis=1), 0))
    return _profile(np.sqrt(0.25 / np.pi) * (np.sqrt(1 / count) - nearest), epsilon)


def noise(surface: pa.Surface, epsilon: float, count: int) -> Floats:
    """Random values, of the amplitude at which about `count` components arise."""
    functional = pa.functionals.Connectedness(surface, epsilon)
    values = np.random.default_rng(2).uniform(-1, 1, surface.n_vertices)
    low, high = 0.9, 1.5
    for _ in range(30):
        amplitude = 0.5 * (low + high)
        if functional.components(amplitude * values)[0] < count:
            low = amplitude
        else:
            high = amplitude
    return high * values


def _of_unit_area(surface: pa.Surface) -> pa.Surface:
    return surface.scaled(surface.area**-0.5)


def _profile(distance: Floats, epsilon: float) -> Floats:
    profile: Floats = np.tanh(3 * distance / (2 * np.sqrt(2) * epsilon))
    return profile
