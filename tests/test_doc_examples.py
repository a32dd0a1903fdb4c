"""The Python of the pages for engineers and artists runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """``run("engineering")`` is what the blocks of a page leave, run in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def page(name):
        text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        namespace = {}
        for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
            exec(block, namespace)
        return namespace

    return page


def test_engineering(run, tmp_path):
    left = run("engineering")
    shares = left["tree"].areas / left["surface"].area
    np.testing.assert_allclose(shares, np.array([1, 2, 4]) / 7, atol=2e-3)
    assert (left["diameters"] > 0).all()
    assert len(left["members"])
    assert {path.name for path in tmp_path.iterdir()} == {"clusters.npz", "pieces.svg"}


def test_blending(run, tmp_path):
    run("blending")
    assert [path.name for path in tmp_path.iterdir()] == ["charts.glb"]
