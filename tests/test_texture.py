"""Textures: lookup, blending over charts, baking."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import reference
from phaseatlas import _core, datasets
from phaseatlas.atlas import Atlas, Chart
from phaseatlas.atlas.bake import (
    bake,
    blend_vertices,
    check_resolution,
    checker,
    load_image,
    sample,
)


def chart(surface, labelled, weights, uv, segment=0):
    """A chart over the whole sheet."""
    return Chart(
        segment=segment,
        faces=np.arange(surface.n_faces),
        labelled=labelled,
        vertices=np.arange(surface.n_vertices),
        triangles=np.asarray(surface.faces),
        uv=uv,
        weights=weights,
        log_scale=np.zeros(surface.n_vertices),
    )


def atlas_of(surface, charts, labels):
    uv = surface.vertices[surface.faces][..., :2].copy()
    return Atlas(surface=surface, charts=charts, labels=labels, uv=uv)


@pytest.fixture(scope="module")
def single():
    """The unit square as one chart, its layout the square itself."""
    surface = datasets.sheet(7, 5)
    every = np.ones(surface.n_faces, dtype=bool)
    only = chart(surface, every, np.ones(surface.n_vertices), surface.vertices[:, :2].copy())
    return atlas_of(surface, (only,), np.zeros(surface.n_faces, dtype=np.int64))


@pytest.fixture(scope="module")
def double():
    """Two charts over all of the unit square, blended along x; the second is shifted."""
    surface = datasets.sheet(8, 8)
    labels = (surface.vertices[surface.faces].mean(axis=1)[:, 0] > 0.5).astype(np.int64)
    place = surface.vertices[:, :2]
    x = place[:, 0]
    charts = (
        chart(surface, labels == 0, 1.0 - x, place.copy()),
        chart(surface, labels == 1, x.copy(), place + np.array([10.0, 0.0]), 1),
    )
    return atlas_of(surface, charts, labels)


@pytest.fixture(scope="module")
def generic():
    """Two charts that overlap in a part of a sheet, a layout of two islands away from the grid."""
    surface = datasets.sheet(5, 4)
    x = surface.vertices[:, 0]
    middle = x[surface.faces].mean(axis=1)
    labels = (middle > 0.5).astype(np.int64)
    rng = np.random.default_rng(5)
    charts = []
    for segment, faces in enumerate([np.flatnonzero(middle < 0.7), np.flatnonzero(middle > 0.3)]):
        vertices, triangles = np.unique(surface.faces[faces], return_inverse=True)
        charts.append(
            Chart(
                segment=segment,
                faces=faces,
                labelled=labels[faces] == segment,
                vertices=vertices,
                triangles=triangles.reshape(-1, 3),
                uv=surface.vertices[vertices, :2] + 0.2 * rng.random((len(vertices), 2)) - 3.0,
                # Of some vertices one chart has no weight.
                weights=np.clip([0.9 - x, x - 0.1][segment], 0.0, 1.0)[vertices],
                log_scale=np.zeros(len(vertices)),
            )
        )
    place = surface.vertices[surface.faces][..., :2]
    uv = 0.0723 + 0.61 * place + labels[:, None, None] * np.array([0.1917, 0.1131])
    return Atlas(surface=surface, charts=tuple(charts), labels=labels, uv=uv)


def linear(uv):
    return np.stack([uv[:, 0], uv[:, 1], 2.0 * uv[:, 0] - uv[:, 1]], axis=1)


def first_coordinate(uv):
    """Tells the charts of `double` apart: 0.2 on the first, 0.8 on the second."""
    return np.where(uv[:, :1] < 5.0, 0.2, 0.8) * np.ones((1, 3))


def texel_centres(resolution):
    column, row = np.meshgrid(np.arange(resolution), np.arange(resolution))
    return np.stack([column + 0.5, resolution - 0.5 - row], axis=-1) / resolution


def test_checker_is_light_at_the_lower_left_and_tiles():
    image = checker(16, 4, light=(200, 200, 200), dark=(10, 10, 10))
    assert image.shape == (16, 16, 3)
    assert image.dtype == np.uint8
    assert image[-1, 0, 0] == 200
    assert image[-1, 4, 0] == 10
    assert (image == 200).mean() == 0.5
    np.testing.assert_array_equal(image[:, 0], 210 - image[:, -1])


@pytest.mark.parametrize("squares", [0, 3])
def test_checker_refuses_what_does_not_tile(squares):
    with pytest.raises(ValueError, match=f"squares: {squares} must be even and at least 2"):
        checker(16, squares)
    with pytest.raises(ValueError, match="size"):
        checker(2, 4)


def test_load_image(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    np.testing.assert_array_equal(load_image(tmp_path / "a.png"), pixels)
    with pytest.raises(OSError, match="missing"):
        load_image(tmp_path / "missing.png")


def test_sample_at_texel_centres_returns_the_texels():
    image = np.random.default_rng(0).integers(0, 256, (6, 6, 3), dtype=np.uint8)
    values = sample(image, texel_centres(6).reshape(-1, 2)).reshape(6, 6, 3)
    np.testing.assert_allclose(255.0 * values, image, atol=1e-9)


def test_sample_is_bilinear_and_tiled():
    image = np.zeros((2, 4, 1))
    image[0, 1] = 1.0
    # Rows run from the top: the lit texel has its centre at u = 3/8, v = 3/4.
    assert sample(image, np.array([[0.375, 0.75]]))[0, 0] == pytest.approx(1.0)
    assert sample(image, np.array([[0.5, 0.75]]))[0, 0] == pytest.approx(0.5)
    assert sample(image, np.array([[0.5, 0.5]]))[0, 0] == pytest.approx(0.25)
    uv = np.random.default_rng(1).random((50, 2))
    moved = sample(image, uv + np.array([-3.0, 7.0]))
    np.testing.assert_allclose(moved, sample(image, uv), atol=1e-12)


def test_sample_refuses_what_is_no_texture():
    with pytest.raises(ValueError, match=r"texture: shape .* must be \(H, W, c\)"):
        sample(np.zeros((4, 4)), np.zeros((1, 2)))
    with pytest.raises(ValueError, match=r"texture: returned shape .* must be \(2, c\)"):
        sample(lambda uv: uv[:1], np.zeros((2, 2)))


def test_blend_of_a_linear_function(single):
    expected = linear(3.0 * single.surface.vertices[:, :2])
    np.testing.assert_allclose(blend_vertices(single, linear, scale=3.0), expected, atol=1e-12)


def test_blend_weighs_the_charts(double):
    x = double.surface.vertices[:, 0]
    values = blend_vertices(double, first_coordinate, scale=1.0)
    np.testing.assert_allclose(values[:, 0], 0.2 * (1.0 - x) + 0.8 * x, atol=1e-12)


def test_blend_of_one_is_one(double):
    ones = blend_vertices(double, lambda uv: np.ones((len(uv), 2)))
    np.testing.assert_allclose(ones, 1.0, atol=1e-12)


def test_vertices_on_a_cut_count_once():
    surface = datasets.sheet(2, 1)
    # Every face has its own copies of its vertices, as if all edges were cut.
    only = Chart(
        segment=0,
        faces=np.arange(surface.n_faces),
        labelled=np.ones(surface.n_faces, dtype=bool),
        vertices=np.asarray(surface.faces).ravel(),
        triangles=np.arange(3 * surface.n_faces).reshape(-1, 3),
        uv=surface.vertices[surface.faces].reshape(-1, 3)[:, :2],
        weights=np.ones(3 * surface.n_faces),
        log_scale=np.zeros(3 * surface.n_faces),
    )
    atlas = atlas_of(surface, (only,), np.zeros(surface.n_faces, dtype=np.int64))
    expected = linear(surface.vertices[:, :2])
    np.testing.assert_allclose(blend_vertices(atlas, linear, scale=1.0), expected, atol=1e-12)


def test_blend_refuses_a_vertex_without_weight():
    surface = datasets.sheet(2, 2)
    every, weights = np.ones(surface.n_faces, dtype=bool), np.ones(surface.n_vertices)
    weights[4] = 0.0
    only = chart(surface, every, weights, surface.vertices[:, :2])
    atlas = atlas_of(surface, (only,), np.zeros(surface.n_faces, dtype=np.int64))
    with pytest.raises(ValueError, match="at vertex 4 add up to 0"):
        blend_vertices(atlas, linear)


def test_bake_of_a_constant_is_constant(double):
    image = bake(double, lambda uv: np.full((len(uv), 3), 0.4), resolution=64)
    assert image.shape == (64, 64, 3)
    assert image.dtype == np.uint8
    assert (image == 102).all()


@pytest.mark.parametrize("blend", [True, False])
def test_single_chart_bake_is_the_sampled_texture(single, blend):
    texture = np.random.default_rng(2).random((9, 13, 3))
    scale = 2.5
    image = bake(single, texture, resolution=50, scale=scale, blend=blend)
    expected = sample(texture, scale * texel_centres(50).reshape(-1, 2)).reshape(50, 50, 3)
    assert np.abs(image / 255.0 - expected).max() <= 0.5 / 255.0 + 1e-9


def test_bake_blends_the_charts(double):
    image = bake(double, first_coordinate, resolution=40, scale=1.0)
    x = texel_centres(40)[..., 0]
    expected = 255.0 * (0.2 + 0.6 * x)
    assert np.abs(image[..., 0] - expected).max() <= 0.5 + 1e-9


def test_bake_without_blending_is_sharp(double):
    image = bake(double, first_coordinate, resolution=40, scale=1.0, blend=False)
    face, _ = _core.rasterize(np.ascontiguousarray(double.uv), 40)
    np.testing.assert_array_equal(image[..., 1], np.where(double.labels[face] == 0, 51, 204))


def test_bake_takes_grey_textures(single):
    image = bake(single, np.full((2, 2, 1), 128, dtype=np.uint8), resolution=8)
    assert (image == 128).all()


def test_gutters_copy_the_nearest_texel(single):
    inner = Atlas(
        surface=single.surface,
        charts=single.charts,
        labels=single.labels,
        uv=0.25 + 0.5 * single.uv,
    )
    texture = np.random.default_rng(3).random((8, 8, 3))
    full = bake(inner, texture, resolution=32)
    bare = bake(inner, texture, resolution=32, padding=0, background=(1, 2, 3))
    some = bake(inner, texture, resolution=32, padding=2, background=(1, 2, 3))
    np.testing.assert_array_equal(full[8:24, 8:24], bare[8:24, 8:24])
    assert (bare[:8] == [1, 2, 3]).all()
    np.testing.assert_array_equal(full[:8, 12], np.tile(full[8, 12], (8, 1)))
    np.testing.assert_array_equal(some[6:26, 12], full[6:26, 12])
    assert (some[:6] == [1, 2, 3]).all()


def waves(uv):
    return 0.5 + 0.5 * np.sin(uv @ np.array([[5.0, 9.0, 3.0], [2.0, -7.0, 8.0]]))


def random_image(channels, dtype):
    image = np.random.default_rng(channels).random((7, 10, channels))
    return np.rint(255 * image).astype(np.uint8) if dtype == np.uint8 else image.astype(dtype)


@pytest.mark.parametrize(
    ("texture", "blend", "padding"),
    [
        (random_image(3, np.uint8), True, None),
        (random_image(1, np.uint8), False, 0),
        (random_image(3, np.float64), False, 2),
        (random_image(1, np.float32), True, 1),
        (waves, True, 2),
        (waves, False, None),
        (lambda uv: waves(uv)[:, 1:2], True, 3),
    ],
    ids=["bytes", "grey bytes", "floats", "grey floats", "blend", "sharp", "grey"],
)
def test_bake_is_that_of_the_slow_twin(generic, texture, padding, blend):
    def colours(uv):
        uv = 2.5 * uv  # the sheet has area 1
        values = texture(uv) if callable(texture) else reference.bilinear(texture, uv)
        return np.broadcast_to(values, (len(uv), 3))

    charts = []
    for chart in generic.charts:
        kept = np.ones(len(chart.faces), dtype=bool) if blend else chart.labelled
        weights = chart.weights if blend else np.ones(len(chart.vertices))
        pairs = zip(chart.faces[kept], chart.triangles[kept], strict=True)
        charts.append({face: (chart.uv[corners], weights[corners]) for face, corners in pairs})
    options = {"resolution": 23, "padding": padding, "background": (1, 2, 3)}
    expected = reference.bake(generic.uv, charts, colours, **options)
    image = bake(generic, texture, scale=2.5, blend=blend, **options)
    np.testing.assert_array_equal(image, expected)


def test_lookup_is_that_of_the_slow_twin():
    uv = np.random.default_rng(4).uniform(-3.0, 3.0, (200, 2))
    uv[:4] = [[0.0, 0.0], [1.0, -1.0], [0.5, -1e-20], [-1e-20, 2.0]]
    for image in (random_image(2, np.uint8), random_image(5, np.float64), random_image(1, float)):
        np.testing.assert_allclose(sample(image, uv), reference.bilinear(image, uv), atol=1e-12)


def test_tiles_of_an_image_join(generic):
    texture = random_image(3, np.uint8)
    asked = []

    def function(uv):
        asked.append(len(uv))
        return sample(texture, uv)

    resolution = 1100
    image = bake(generic, texture, resolution=resolution)
    np.testing.assert_array_equal(image, bake(generic, function, resolution=resolution))
    assert len(asked) > 1
    # The same texels as in one piece: every fourth centre of a layout four times as fine.
    coarse = bake(generic, texture, resolution=resolution // 5, padding=0)
    fine = bake(generic, texture, resolution=resolution, padding=0)
    np.testing.assert_array_equal(coarse, fine[2::5, 2::5])


BAKE_AND_HASH = """
import hashlib
import numpy as np
from phaseatlas import datasets
from phaseatlas.atlas import Atlas, Chart
from phaseatlas.atlas.bake import bake, checker

surface = datasets.sheet(40, 40)
n, m = surface.n_vertices, surface.n_faces
place = surface.vertices[:, :2]
charts = tuple(
    Chart(
        segment=k,
        faces=np.arange(m),
        labelled=np.full(m, k == 0),
        vertices=np.arange(n),
        triangles=np.asarray(surface.faces),
        uv=place * (k + 1.7),
        weights=[place[:, 0], 1 - place[:, 0]][k],
        log_scale=np.zeros(n),
    )
    for k in range(2)
)
uv = 0.1 + 0.7 * place[surface.faces]
atlas = Atlas(surface=surface, charts=charts, labels=np.zeros(m, dtype=np.int64), uv=uv)
image = bake(atlas, checker(64), resolution=1200)
print(hashlib.sha256(image.tobytes()).hexdigest())
"""


def test_bytes_do_not_depend_on_the_threads():
    hashes = {
        subprocess.run(
            [sys.executable, "-c", BAKE_AND_HASH],
            env=os.environ | {"RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2")
    }
    assert len(hashes) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere address space has no limit")
def test_a_resolution_beyond_the_memory_is_refused(single):
    import resource

    limits = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    used = pages * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**30, limits[1]))
    try:
        check_resolution(4096)
        with pytest.raises(MemoryError, match="resolution: 16384 takes"):
            check_resolution(16384)
        with pytest.raises(MemoryError, match="resolution: 16384 takes"):
            bake(single, checker(8, 2), resolution=16384)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"scale": 0.0}, "scale"),
        ({"scale": math.nan}, "scale"),
        ({"resolution": 0}, "resolution"),
        ({"resolution": 32769}, "resolution"),
        ({"background": (0, 0, 256)}, "background"),
        ({"padding": -1}, "padding"),
    ],
)
def test_bake_refuses_bad_options(single, options, name):
    with pytest.raises(ValueError, match=f"^{name}: .* must"):
        bake(single, checker(8, 2), **options)


def test_bake_refuses_two_channels(single):
    with pytest.raises(ValueError, match="texture: 2 channels must be 1 or 3"):
        bake(single, np.zeros((4, 4, 2)), resolution=8)


def test_bake_refuses_faces_without_a_chart(generic):
    atlas = Atlas(
        surface=generic.surface, charts=generic.charts[:1], labels=generic.labels, uv=generic.uv
    )
    with pytest.raises(ValueError, match=r"face \d+ is in no chart with a positive weight"):
        bake(atlas, checker(8, 2), resolution=64)
    with pytest.raises(ValueError, match=r"charts: must not be empty"):
        bake(
            Atlas(surface=atlas.surface, charts=(), labels=atlas.labels, uv=atlas.uv),
            checker(8, 2),
        )


def test_textures_that_are_not_finite_are_refused(generic):
    with pytest.raises(ValueError, match="texture: returned values must be finite"):
        bake(generic, lambda uv: np.full((len(uv), 3), np.nan), resolution=16)


def test_images_of_sixteen_bits_keep_their_picture(tmp_path):
    ramp = np.arange(0, 65536, 257, dtype=np.uint16).reshape(16, 16)
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    image = load_image(tmp_path / "ramp.png")
    assert np.array_equal(image, np.repeat(np.arange(256).reshape(16, 16, 1), 3, axis=2))
    np.testing.assert_allclose(
        sample(ramp[..., None], np.array([[0.5, 0.5]])),
        sample((ramp / 65535)[..., None], np.array([[0.5, 0.5]])),
    )


def test_the_image_of_sixteen_bits_of_the_collection(case_path):
    image = load_image(case_path("texture_16bit.png"))
    assert len(np.unique(image)) == 256
    assert (image == 255).mean() < 0.01


def test_images_of_floats_are_scaled_or_refused(tmp_path):
    ramp = np.linspace(0, 1, 256, dtype=np.float32).reshape(16, 16)
    Image.fromarray(ramp).save(tmp_path / "ramp.tif")
    image = load_image(tmp_path / "ramp.tif")
    assert np.array_equal(image[..., 0], np.arange(256).reshape(16, 16))
    Image.fromarray(2 * ramp).save(tmp_path / "bright.tif")
    with pytest.raises(ValueError, match=r"floats must be in \[0, 1\]"):
        load_image(tmp_path / "bright.tif")
