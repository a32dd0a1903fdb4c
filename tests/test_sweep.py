"""Legal surfaces never break the trunk: segments and charts of generated shapes, default options.

`python tests/test_sweep.py [WORD]` runs all of them at levels 1 to 3, without and with distortion,
which takes the better part of an hour; the tests here run each shape once.
"""

from __future__ import annotations

import itertools
import sys
import time
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import generated
import phaseatlas as pa

# Coarse shapes may have no segments; a refusal says what helps.
REFUSALS = (pa.DisconnectedError, pa.CollapsedError)


def one_line_with_a_cure(refusal):
    assert "help" in refusal
    assert "\n" not in refusal
    return refusal


def check(surface, levels, distortion=0.0):
    """Segment a surface and make its atlas; what is not as asked for is refused or said."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            tree = pa.segment(surface, levels, distortion=distortion)
        except REFUSALS as refusal:
            return one_line_with_a_cure(str(refusal))
        atlas = pa.build_atlas(tree)
    assert all(issubclass(warning.category, pa.QualityWarning) for warning in said)
    messages = " ".join(str(warning.message) for warning in said)
    assert (tree.components == 1).all()
    weights = tree.weights
    assert weights.min() >= 0
    assert weights.max() <= 1
    np.testing.assert_allclose(weights.sum(axis=0), 1, rtol=1e-12)
    off = np.abs(tree.areas / (tree.shares * surface.area) - 1).max()
    assert (off > 0.01) == ("misses its share" in messages)
    converged = all(record.converged for record in tree.diagnostics)
    assert converged == ("not converged" not in messages)
    if converged:
        assert max(abs(record.violation) for record in tree.diagnostics) <= 1e-5
    assert np.isfinite(atlas.uv).all()
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    return "good" if not said else f"good, said: {messages}"


def _cases():
    """Every shape once, at one of the levels, every fourth with distortion."""
    for k, name in enumerate(generated.SURFACES):
        distortion = 3.0 if k % 4 == 3 else 0.0
        yield pytest.param(name, 1 + k % 3 if not distortion else 1 + k % 2, distortion, id=name)


@pytest.mark.parametrize(("name", "levels", "distortion"), list(_cases()))
def test_generated_surfaces(name, levels, distortion):
    surface = generated.SURFACES[name]()
    if distortion and surface.n_faces > 4000:
        # Minutes with distortion, and nothing that smaller ones do not show.
        distortion = 0.0
    assert check(surface, levels, distortion).startswith("good")


@st.composite
def legal_surfaces(draw):
    """Boxes, cones, cylinders, blobs and terrains of any proportions, of a few hundred faces."""
    side = st.floats(0.05, 4.0)
    kind = draw(st.sampled_from(["box", "cone", "cylinder", "blob", "terrain", "torus"]))
    if kind == "box":
        sides = draw(side), draw(side), draw(side)
        return generated.box(*sides, edge=0.12 * sum(sides))
    if kind in ("cone", "cylinder"):
        radius, height = draw(side), draw(side)
        return generated.round_solid(
            kind, radius, height, draw(st.integers(5, 20)), 0.2 * (2 * radius + height)
        )
    if kind == "torus":
        ratio = draw(st.floats(0.1, 0.9))
        around, across = draw(st.integers(8, 40)), draw(st.integers(5, 16))
        return pa.datasets.torus(1.0, ratio, around, across)
    if kind == "terrain":
        rows, columns = draw(st.integers(5, 24)), draw(st.integers(5, 24))
        return generated.terrain(rows, columns, draw(st.floats(0, 0.2)), draw(st.integers(0, 99)))
    return generated.blob(
        2, draw(st.integers(1, 6)), draw(st.floats(-0.3, 1.5)), draw(st.integers(0, 99))
    )


@settings(deadline=None, max_examples=25, derandomize=True, database=None)
@given(legal_surfaces(), st.integers(1, 2))
def test_random_legal_surfaces(surface, levels):
    check(surface, levels)


def main() -> None:
    word = sys.argv[1] if len(sys.argv) > 1 else ""
    runs = itertools.product(generated.SURFACES, (0.0, 3.0), (1, 2, 3))
    for name, distortion, levels in runs:
        if word not in name:
            continue
        start = time.process_time()
        result = check(generated.SURFACES[name](), levels, distortion)
        seconds = time.process_time() - start
        print(f"{name}, distortion {distortion:g}, levels {levels}: {seconds:.1f} s, {result}")


if __name__ == "__main__":
    main()
