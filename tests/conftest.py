"""Shared fixtures: surfaces to test on, the folder of real meshes, smooth phase fields."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas import datasets

MESHES = Path(os.environ.get("PHASEATLAS_MESHES", Path(__file__).parents[2] / "shared" / "meshes"))


def _mesh_path(name: str) -> Path:
    path = MESHES / (name if name.endswith(".obj") else f"{name}.obj")
    if not path.is_file():
        pytest.skip(
            f"{path.name} is not in {MESHES}; set PHASEATLAS_MESHES to the folder of meshes"
        )
    return path


@pytest.fixture(scope="session")
def mesh_path() -> Callable[[str], Path]:
    """``mesh_path("bunny")`` is the path of a real mesh; the test is skipped without it."""
    return _mesh_path


@pytest.fixture(scope="session")
def case_path() -> Callable[[str], Path]:
    """``case_path("long_strip.obj")`` is a small difficult input; skipped without the folder."""

    def path(name: str) -> Path:
        found = MESHES.parent / "cases" / name
        if not found.is_file():
            pytest.skip(f"{name} is not in {found.parent}")
        return found

    return path


def _read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    # A reader of its own keeps the tests of the operators apart from those of the file formats.
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=float)
    faces = np.array([row[1:4] for row in rows if row[:1] == ["f"]], dtype=np.int64) - 1
    return vertices, faces


@pytest.fixture(scope="session", params=["icosphere", "torus", "sheet", "bunny"])
def surfaces(request: pytest.FixtureRequest) -> pa.Surface:
    """One after the other: a sphere, a torus, an open wavy sheet and a real mesh."""
    if request.param == "icosphere":
        return datasets.icosphere(3, radius=0.7)
    if request.param == "torus":
        return datasets.torus(1.0, 0.4, 28, 12)
    if request.param == "sheet":
        return datasets.sheet(16, 13, size=(1.3, 1.0), amplitude=0.15, periods=1)
    return pa.Surface(*_read_obj(_mesh_path("bunny")))


@pytest.fixture(scope="session")
def smooth_field() -> Callable[..., np.ndarray]:
    """``smooth_field(surface, seed=0)`` is a (n,) field in (-1, 1) with several bumps."""

    def field(surface: pa.Surface, seed: int = 0) -> np.ndarray:
        vertices = np.asarray(surface.vertices)
        scaled = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
        rng = np.random.default_rng(seed)
        # Random phases leave no symmetry, so no two shortest paths have the same length and the
        # gradient of the connectedness is unique.
        waves = np.sin(2.0 * np.pi * (1.6 * scaled + rng.random(3)))
        return np.tanh(2.0 * (waves.sum(axis=1) - 0.1))

    return field


@pytest.fixture(scope="session")
def smooth_weight() -> Callable[..., np.ndarray]:
    """``smooth_weight(surface)`` is a (n,) weight that reaches both 0 and 1 exactly."""

    def weight(surface: pa.Surface) -> np.ndarray:
        vertices = np.asarray(surface.vertices)
        scaled = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
        return np.clip(0.6 + 0.9 * np.sin(scaled @ np.array([3.0, 4.0, 5.0])), 0.0, 1.0)

    return weight
