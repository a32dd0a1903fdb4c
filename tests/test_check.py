"""What must hold of texture coordinates before they are written."""

import dataclasses

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas.scene.check import check_layout
from phaseatlas.scene.repair import repair
from phaseatlas.scene.scene import Scene


def layout(change=lambda uv: uv):
    """The atlas of two spheres, each one a mesh, after a change of its coordinates."""
    sphere = pa.datasets.icosphere(2)
    scene = Scene(
        [
            (name, repair(sphere.vertices + shift, sphere.faces))
            for name, shift in [("a", 0), ("b", 3)]
        ]
    )
    atlas = pa.build_atlas(pa.partition(scene, effort="fast"))
    atlas = dataclasses.replace(atlas, uv=change(atlas.uv.copy()))
    return scene, scene.corners(atlas.uv), atlas


def turned(uv):
    uv[5] = uv[5, ::-1]
    return uv


def moved(uv):
    uv[10] += 2
    return uv


def lost(uv):
    uv[7, 1] = np.nan
    return uv


def doubled(uv):
    half = len(uv) // 2
    uv[half:] = uv[:half]
    return uv


def shrunk(uv):
    """One of the two spheres has all texels, but for a few."""
    half = len(uv) // 2
    uv[half:] = uv[half:] / 100
    uv[:half] = 0.1 + 0.9 * uv[:half]
    return uv


def test_a_good_layout_passes(recwarn):
    check_layout(*layout(), even=True)
    assert not recwarn.list


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (turned, "flips: 1 faces are turned over"),
        (moved, "3 corners have no place in the unit square"),
        (lost, "1 corners have no place in the unit square"),
        (doubled, "overlap: "),
    ],
)
@pytest.mark.parametrize("even", [False, True])
def test_a_bad_layout_is_refused(change, words, even):
    with pytest.raises(ValueError, match=words):
        check_layout(*layout(change), even=even)


def test_uneven_texels_are_refused_or_warned_of():
    found = layout(shrunk)
    with pytest.raises(ValueError, match="density: 50 % of the area"):
        check_layout(*found, even=True)
    with pytest.warns(pa.QualityWarning, match="density: 50 % of the area"):
        check_layout(*found, even=False)


def test_a_torn_polygon_is_refused():
    """A corner of a quad has one place, and its two triangles are apart."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    scene = Scene([("", repair(square, np.arange(4), np.array([4])))])
    atlas = pa.build_atlas(pa.partition(scene, effort="fast"))
    check_layout(scene, scene.corners(atlas.uv), atlas, even=True)
    uv = 0.4 * atlas.uv
    uv[1] += 0.5
    atlas = dataclasses.replace(atlas, uv=uv)
    with pytest.raises(ValueError, match="1 triangles lie in another chart than their polygon"):
        check_layout(scene, scene.corners(atlas.uv), atlas, even=True)
