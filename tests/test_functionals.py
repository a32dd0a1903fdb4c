"""The contract of the functionals: what each of them accepts, refuses and remembers."""

from __future__ import annotations

import functools
import hashlib
import math
import os
import subprocess
import sys

import numpy as np
import pytest

import phaseatlas as pa
from contract import check_agreement
from phaseatlas import datasets, functionals

FUNCTIONALS = {
    "perimeter": functionals.Perimeter,
    "area": functionals.Area,
    "connectedness, pairs": functionals.Connectedness,
    "connectedness, tree": functools.partial(
        functionals.Connectedness, form="tree", saturation=1e-2
    ),
    "distortion, sharp": functionals.Distortion,
    "distortion, paper": functools.partial(functionals.Distortion, law="paper"),
}


@pytest.fixture(params=FUNCTIONALS.values(), ids=FUNCTIONALS)
def functional(request):
    return request.param


@pytest.fixture(scope="module")
def small():
    return datasets.icosphere(1)


def evaluations(functional):
    """The methods that take a field."""
    names = ("value_and_gradient", "hessian", "log_scale", "components", "length")
    return [getattr(functional, name) for name in names if hasattr(functional, name)]


@pytest.mark.parametrize("epsilon", [0.0, -0.1, math.nan, math.inf])
def test_bad_epsilon_is_named(small, functional, epsilon):
    with pytest.raises(ValueError, match="epsilon"):
        functional(small, epsilon)


@pytest.mark.parametrize("bad", [-0.01, 1.01, math.nan])
def test_bad_weight_is_named_by_index(small, functional, bad):
    weight = np.full(small.n_vertices, 0.5)
    weight[7] = bad
    with pytest.raises(ValueError, match=r"weight.*7"):
        functional(small, 0.1, weight=weight)


def test_weight_of_wrong_shape_is_named(small, functional):
    with pytest.raises(ValueError, match="weight"):
        functional(small, 0.1, weight=np.ones(small.n_faces))


def test_bad_field_is_named_by_index(small, functional):
    for evaluate in evaluations(functional(small, 0.1)):
        for shape in [(small.n_vertices - 1,), (small.n_vertices + 1,), (small.n_vertices, 1), ()]:
            with pytest.raises(ValueError, match=r"\bu\b"):
                evaluate(np.zeros(shape))
        for bad in (math.nan, math.inf):
            u = np.zeros(small.n_vertices)
            u[11] = bad
            with pytest.raises(ValueError, match=r"\bu\b.*11"):
                evaluate(u)


@pytest.mark.parametrize("delta", [1.0, 1.5, -0.1, math.nan])
@pytest.mark.parametrize("name", ["area", "distortion, sharp", "distortion, paper"])
def test_bad_delta_is_named(small, name, delta):
    with pytest.raises(ValueError, match="delta"):
        FUNCTIONALS[name](small, 0.1, delta=delta)


def test_unit_weight_changes_nothing(surfaces, smooth_field, functional):
    u = smooth_field(surfaces, seed=5)
    plain = functional(surfaces, 0.1).value_and_gradient(u)
    weighted = functional(surfaces, 0.1, weight=np.ones(surfaces.n_vertices))
    check_agreement(weighted.value_and_gradient(u), plain)


def test_evaluations_do_not_depend_on_those_before(smooth_field, functional):
    surface = datasets.icosphere(3)
    evaluated = functional(surface, 0.2)
    u = smooth_field(surface)
    value, gradient = evaluated.value_and_gradient(u)
    kept = gradient.tobytes()
    evaluated.value_and_gradient(-np.ones(surface.n_vertices))
    evaluated.value_and_gradient(smooth_field(surface, seed=1))
    again, again_gradient = evaluated.value_and_gradient(u)
    assert again == value
    assert again_gradient.tobytes() == gradient.tobytes() == kept


THREADS = """
import hashlib
import numpy as np
import phaseatlas as pa
from phaseatlas import functionals
digest = hashlib.sha256()
for surface in (pa.datasets.icosphere(5), pa.datasets.sheet(50, 40, amplitude=0.1)):
    u = np.random.default_rng(0).uniform(-1, 1, surface.n_vertices)
    weight = np.clip(0.5 + surface.vertices[:, 0], 0, 1)
    for make in (
        functionals.Perimeter,
        functionals.Area,
        functionals.Connectedness,
        lambda *a, **k: functionals.Connectedness(*a, form="tree", saturation=1e-2, **k),
        functionals.Distortion,
        lambda *a, **k: functionals.Distortion(*a, law="paper", **k),
    ):
        for options in ({}, {"weight": weight}):
            functional = make(surface, 0.1, **options)
            value, gradient = functional.value_and_gradient(u)
            digest.update(np.float64(value).tobytes() + gradient.tobytes())
            if hasattr(functional, "log_scale"):
                digest.update(b"".join(scale.tobytes() for scale in functional.log_scale(u)))
print(digest.hexdigest())
"""


def test_threads_do_not_change_a_bit():
    digests = {
        subprocess.run(
            [sys.executable, "-c", THREADS],
            env={**os.environ, "RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout
        for threads in ("1", "2", "3")
    }
    assert len(digests) == 1
    assert len(digests.pop().strip()) == hashlib.sha256().digest_size * 2


def test_length_is_part_of_the_contract_of_the_perimeter(small):
    perimeter = pa.functionals.Perimeter(small, 0.1)
    assert perimeter.length(np.ones(small.n_vertices)) == 0
