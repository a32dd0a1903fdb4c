"""Pictures: nothing mirrored, hidden or missing, and no half-written files."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from phaseatlas import datasets, plot
from phaseatlas.atlas import Atlas, Chart
from phaseatlas.surface import Surface

SIZE = 80
FRONT = (0.0, 0.0, 1.0)


def read(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=int)


def quadrants(pixels):
    """Mean colours of the upper left, upper right, lower left and lower right of what is drawn."""
    row, column = np.nonzero((pixels < 250).any(axis=2))
    drawn = pixels[row.min() : row.max() + 1, column.min() : column.max() + 1]
    h, w = drawn.shape[0] // 2, drawn.shape[1] // 2
    parts = drawn[:h, :w], drawn[:h, w:], drawn[h:, :w], drawn[h:, w:]
    return [part[part.shape[0] // 4 : -2, 2:-2].mean(axis=(0, 1)) for part in parts]


@pytest.fixture(scope="module")
def sheet():
    return datasets.sheet(6, 6)


@pytest.fixture(scope="module")
def four_colours():
    """Red upper left, green upper right, blue lower left, grey lower right."""
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32] = [220, 0, 0]
    image[:32, 32:] = [0, 220, 0]
    image[32:, :32] = [0, 0, 220]
    image[32:, 32:] = [120, 120, 120]
    return image


def check_four_colours(parts):
    assert [int(np.argmax(part)) for part in parts[:3]] == [0, 1, 2]
    assert np.ptp(parts[3]) < 10.0


def test_textures_are_neither_mirrored_nor_upside_down(sheet, four_colours, tmp_path):
    uv = sheet.vertices[sheet.faces][..., :2]
    path = tmp_path / "a.png"
    plot.textured(sheet, uv, four_colours, path, views=1, size=SIZE, direction=FRONT)
    check_four_colours(quadrants(read(path)))


def test_layout_is_neither_mirrored_nor_upside_down(sheet, four_colours, tmp_path):
    only = Chart(
        segment=0,
        faces=np.arange(sheet.n_faces),
        labelled=np.ones(sheet.n_faces, dtype=bool),
        vertices=np.arange(sheet.n_vertices),
        triangles=np.asarray(sheet.faces),
        uv=sheet.vertices[:, :2].copy(),
        weights=np.ones(sheet.n_vertices),
        log_scale=np.zeros(sheet.n_vertices),
    )
    uv = sheet.vertices[sheet.faces][..., :2]
    labels = np.zeros(sheet.n_faces, dtype=np.int64)
    atlas = Atlas(surface=sheet, charts=(only,), labels=labels, uv=uv)
    path = tmp_path / "a.png"
    plot.uv_layout(atlas, four_colours, path, views=0, size=SIZE, tint=0.0)
    check_four_colours(quadrants(read(path)))
    plot.uv_layout(atlas, four_colours, path, views=2, size=SIZE, title="Layout")
    assert read(path).shape[1] > 3 * SIZE


def test_front_hides_back(tmp_path):
    strip = datasets.sheet(16, 4, size=(2.0, 1.0))
    along = strip.vertices[:, 0]
    behind = along <= 1.0
    across = np.where(behind, along, 2.0 - along)
    folded = np.column_stack([across, strip.vertices[:, 1], np.where(behind, -1.0, 0.0)])
    hidden = behind[strip.faces].all(axis=1)
    colours = np.where(hidden[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    surface = Surface(folded, strip.faces)
    path = tmp_path / "a.png"
    plot.segments(surface, colours, path, views=1, size=SIZE, direction=FRONT)
    assert all(part.argmax() == 2 for part in quadrants(read(path)))


def test_a_sphere_is_drawn_without_holes(tmp_path):
    surface = datasets.icosphere(3)
    path = tmp_path / "a.png"
    black = np.zeros((surface.n_faces, 3))
    plot.segments(surface, black, path, views=1, size=300, direction=FRONT)
    dark = (read(path) < 128).all(axis=2)
    row, column = np.nonzero(dark)
    radius = 0.5 * (np.ptp(row) + 1)
    distance = np.hypot(*(np.indices(dark.shape) - [[[row.mean()]], [[column.mean()]]]))
    assert dark[distance < 0.97 * radius].all()
    assert not dark[distance > radius + 2.0].any()


@pytest.mark.parametrize("kind", ["labels", "weights", "vertices", "faces"])
def test_segments_takes_every_kind_of_values(kind, tmp_path):
    surface = datasets.icosphere(2)
    weight = 0.5 + 0.5 * surface.vertices[:, 0]
    centre = surface.vertices[surface.faces].mean(axis=1)
    values = {
        "labels": (centre[:, 0] > 0.0).astype(np.int32),
        "weights": np.stack([weight, 1.0 - weight]),
        "vertices": np.repeat(weight[:, None], 3, axis=1),
        "faces": np.full((surface.n_faces, 3), 0.5),
    }[kind]
    path = tmp_path / "a.png"
    plot.segments(surface, values, path, size=SIZE)
    assert (read(path) < 200).any()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


def test_segments_have_colours_of_their_own():
    surface = datasets.icosphere(2)
    centre = surface.vertices[surface.faces].mean(axis=1)
    labels = (centre[:, 0] > 0.0).astype(np.int64) + 2 * (centre[:, 1] > 0.0)
    colours = plot.segment_colors(surface, labels)
    assert len(np.unique(colours, axis=0)) == 4
    assert plot.segment_colors(surface, labels, 6).shape == (6, 3)
    with pytest.raises(ValueError, match="labels: 3 must be below count, 2"):
        plot.segment_colors(surface, labels, 2)


def test_render_returns_what_segments_writes(tmp_path):
    surface = datasets.icosphere(2)
    colours = plot.scalar_colors(surface.vertices[:, 0])
    first, second = plot.render(surface, colours, size=SIZE)
    plot.segments(surface, colours, tmp_path / "a.png", size=SIZE)
    written = read(tmp_path / "a.png")
    gap = (written.shape[1] - first.shape[1] - second.shape[1]) // 3
    h, w = first.shape[:2]
    shown = written[gap : gap + h, gap : gap + w]
    assert np.abs(shown - 255.0 * first).max() < 1.0
    assert first.shape == second.shape
    assert np.abs(first - second).max() > 0.3


def test_scalar_colours_run_from_blue_to_red():
    colours = plot.scalar_colors([-2.0, -1.0, 0.0, 1.0, 3.0])
    blue, white, red = colours[[0, 2, 4]]
    assert blue.argmax() == 2
    assert red.argmax() == 0
    assert np.ptp(white) < 0.02
    np.testing.assert_array_equal(colours[[0, 4]], colours[[1, 3]])
    scaled = plot.scalar_colors([3.0, 5.0, 7.0], low=3.0, high=7.0)
    np.testing.assert_array_equal(scaled, colours[1:4])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"values": np.zeros((3, 1))}, r"values: shape \(3, 1\) must be \(k,\)"),
        ({"values": [0.0, np.nan]}, r"values\[1\]: nan must be a finite number"),
        ({"low": 1.0}, "low: 1.0 must be below high, 1.0"),
        ({"colormap": "what"}, "colormap: 'what' must be one of matplotlib's"),
    ],
)
def test_scalar_colours_name_wrong_input(options, message):
    with pytest.raises(ValueError, match=message):
        plot.scalar_colors(**{"values": np.zeros(3), **options})


@pytest.mark.parametrize("count", [1, 2, 9, 10, 64])
def test_palette_colours_differ(count):
    colours = plot.palette(count)
    assert colours.shape == (count, 3)
    assert colours.min() >= 0.0
    assert colours.max() <= 1.0
    gaps = np.linalg.norm(colours[:, None] - colours[None], axis=2) + 9.0 * np.eye(count)
    assert gaps.min() > 0.08


def test_a_failure_leaves_no_file(sheet, tmp_path):
    labels = np.zeros(sheet.n_faces, dtype=np.int64)
    with pytest.raises(ValueError, match=r"path: .*a\.what must end in a known image suffix"):
        plot.segments(sheet, labels, tmp_path / "a.what", size=SIZE)
    with pytest.raises(FileNotFoundError):
        plot.segments(sheet, labels, tmp_path / "missing" / "a.png", size=SIZE)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": 3}, "views: 3 must be 1 or 2"),
        ({"size": 4}, "size: 4 must be at least 16 pixels"),
        ({"direction": (0.0, 0.0, 0.0)}, "direction: .* must be"),
        (
            {"values": np.zeros(5, dtype=int)},
            r"values: int64 of shape \(5,\) must be integers \(m,\)",
        ),
        ({"values": np.full(72, -1)}, r"labels\[0\]: -1 must be at least 0"),
    ],
)
def test_wrong_input_is_named(sheet, tmp_path, options, message):
    arguments = {"values": np.zeros(sheet.n_faces, dtype=int), **options}
    with pytest.raises(ValueError, match=message):
        plot.segments(sheet, path=tmp_path / "a.png", **arguments)
