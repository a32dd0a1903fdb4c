"""What holds for every functional: checks that the tests of each share."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

# Sums of a few thousand doubles in another order.
AGREE = 1e-10


def check_agreement(actual, expected, tolerance=AGREE):
    """A value and a gradient are of the right types and those of the twin."""
    assert isinstance(actual[0], float)
    assert actual[1].dtype == np.float64
    assert actual[1].shape == expected[1].shape
    assert actual[0] == pytest.approx(expected[0], rel=tolerance)
    assert np.linalg.norm(actual[1] - expected[1]) <= tolerance * np.linalg.norm(expected[1])


def check_gradient(functional, u, directions: Iterable[np.ndarray], step, tolerance):
    """The gradient is the derivative along some directions, by central differences."""
    gradient = functional.value_and_gradient(u)[1]
    for direction in directions:
        plus = functional.value_and_gradient(u + step * direction)[0]
        minus = functional.value_and_gradient(u - step * direction)[0]
        size = np.linalg.norm(gradient) * np.linalg.norm(direction)
        assert abs((plus - minus) / (2.0 * step) - gradient @ direction) < tolerance * size


def check_gradient_of_every_vertex(functional, u, step, tolerance):
    """The gradient is the derivative by each value, to a part of its largest entry."""
    gradient = functional.value_and_gradient(u)[1]
    differences = [
        (functional.value_and_gradient(u + e)[0] - functional.value_and_gradient(u - e)[0])
        / (2.0 * step)
        for e in step * np.eye(len(u))
    ]
    assert np.abs(differences - gradient).max() < tolerance * np.abs(gradient).max()


def random_field(surface, reach=1.0):
    """A field without any structure, in [-reach, reach]."""
    return np.random.default_rng(3).uniform(-reach, reach, surface.n_vertices)


def random_directions(surface, count=3):
    """Directions without any structure."""
    rng = np.random.default_rng(0)
    return [rng.standard_normal(surface.n_vertices) for _ in range(count)]
