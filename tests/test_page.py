"""Pages: whole in themselves, right in what they name, and seen by a browser where there is one."""

from __future__ import annotations

import base64
import io
import json
import os
import re
import shutil
import subprocess
import sys
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest
import trimesh
from PIL import Image

import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.atlas.metrics import uv_topology
from phaseatlas.file_atlas import AtlasOptions, atlas_file
from phaseatlas.meanings import METRICS, SEGMENTS, SURFACE
from phaseatlas.page import as_frame, html_of
from phaseatlas.page.colours import chart_colours
from phaseatlas.page.drawing import drawing, outlines
from phaseatlas.page.files import subject_of_file
from phaseatlas.page.looks import measured
from phaseatlas.page.subject import subject
from phaseatlas.points import flat_areas

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
LOOKS = ["texture", "checker", "charts", "level-1", "weights", "stretch", "density"]


@pytest.fixture(scope="module")
def tree():
    return pa.segment(datasets.icosphere(3), 2, initial="random", coarse=False, connected=False)


@pytest.fixture(scope="module")
def atlas(tree):
    return pa.build_atlas(tree)


def data_of(page, name="data"):
    found = re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', page, re.S)
    return json.loads(found[1])


def numbers(text, dtype):
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


def chart_of_faces(atlas):
    chart = np.full(atlas.surface.n_faces, -1)
    for k, each in enumerate(atlas.charts):
        chart[each.faces[each.labelled]] = k
    return chart


# What a page is made of.


def test_outlines_bound_the_area_of_their_charts(atlas):
    chart = chart_of_faces(atlas)
    topology = uv_topology(atlas.surface, atlas.uv)
    found = outlines(chart, topology, atlas.uv, len(atlas.charts))
    areas = np.bincount(chart, flat_areas(atlas.uv))
    for loops, area in zip(found, areas, strict=True):
        shoelace = 0.0
        for loop in loops:
            after = np.roll(loop, -1, axis=0)
            shoelace += 0.5 * (loop[:, 0] @ after[:, 1] - loop[:, 1] @ after[:, 0])
        assert shoelace == pytest.approx(area, rel=1e-9)


def test_a_chart_with_a_hole_has_two_outlines():
    surface = datasets.sheet(6, 6)
    middle = surface.vertices[surface.faces].mean(axis=1)[:, :2]
    inner = np.abs(middle - 0.5).max(axis=1) < 0.2
    assert 0 < inner.sum() < surface.n_faces
    uv = surface.vertices[surface.faces][..., :2].copy()
    uv[inner] += 3.0
    found = outlines(inner.astype(np.int64), uv_topology(surface, uv), uv, 2)
    assert [len(loops) for loops in found] == [2, 1]


def test_vertices_are_split_where_charts_meet_and_values_are_means(atlas):
    surface, chart = atlas.surface, chart_of_faces(atlas)
    plain = np.zeros(surface.n_faces, dtype=np.int64)
    drawn = drawing(surface, chart, plain, atlas.uv, uv_topology(surface, atlas.uv))
    assert not drawn.simplified
    assert (drawn.chart[drawn.faces] == chart[:, None]).all()
    np.testing.assert_array_equal(drawn.positions[drawn.faces], surface.vertices[surface.faces])
    np.testing.assert_allclose(drawn.uv[drawn.faces], atlas.uv, atol=1e-12)
    values = np.random.default_rng(1).random(surface.n_faces)
    found = drawn.means(values)
    for vertex in (0, 17, len(found) - 1):
        around = (drawn.faces == vertex).any(axis=1)
        mean = np.average(values[around], weights=surface.face_areas[around])
        assert found[vertex] == pytest.approx(mean)


def test_a_fine_surface_is_drawn_with_fewer_faces_and_the_same_seams():
    sphere = datasets.icosphere(7)
    left = (sphere.vertices[sphere.faces].mean(axis=1)[:, 0] > 0).astype(np.int64)
    drawn = drawing(sphere, left, np.zeros_like(left))
    assert drawn.simplified
    assert len(drawn.faces) <= 101_000
    # Every corner of a seam is there, in place, once a side.
    on_seam = np.flatnonzero(
        np.bincount(sphere.faces[left == 0].ravel(), minlength=sphere.n_vertices).astype(bool)
        & np.bincount(sphere.faces[left == 1].ravel(), minlength=sphere.n_vertices).astype(bool)
    )
    origin = drawn.origin[drawn.kept]
    for side in (0, 1):
        mine = np.flatnonzero(drawn.chart[drawn.kept] == side)
        place = dict(zip(origin[mine].tolist(), mine.tolist(), strict=True))
        found = drawn.positions[[place[vertex] for vertex in on_seam.tolist()]]
        np.testing.assert_allclose(found, sphere.vertices[on_seam], atol=1e-6)
    centres = drawn.positions[drawn.faces].mean(axis=1)
    assert np.abs(np.linalg.norm(centres, axis=1) - 1).max() < 0.01


def test_stretch_and_density_of_a_scaled_sheet():
    """Twice as long one way and half the other: every face is stretched by 2 at one scale."""
    surface = datasets.sheet(6, 6)
    uv = surface.vertices[surface.faces][..., :2] * [0.5, 0.125]
    shown = subject(surface)
    rated = measured(type(shown)(surface, shown.chart, 1, "chart", uv, resolution=512))
    np.testing.assert_allclose(rated.stretch, 2.0)
    np.testing.assert_allclose(rated.density, 512 * 0.25)


def test_neighbours_differ_in_colour(atlas):
    surface = atlas.surface
    rng = np.random.default_rng(0)
    seeds = rng.normal(size=(40, 3))
    middle = surface.vertices[surface.faces].mean(axis=1)
    labels = np.argmax(middle @ (seeds / np.linalg.norm(seeds, axis=1, keepdims=True)).T, axis=1)
    _, labels = np.unique(labels, return_inverse=True)
    colours = chart_colours(surface, labels, int(labels.max()) + 1)[labels].astype(int)
    face, side = np.nonzero(surface.face_neighbours >= 0)
    other = surface.face_neighbours[face, side]
    differ = labels[face] != labels[other]
    assert (np.abs(colours[face] - colours[other]).sum(axis=1)[differ] > 0).all()


# The page as text.


def test_a_page_names_nothing_outside_of_itself(atlas):
    page = html_of(
        atlas, title="</script><script>alert(1)</script>", image=atlas.bake(resolution=64)
    )
    assert "<script>alert" not in page
    own = re.sub(r"<script>\s*!function.*?</script>", "", page, count=1, flags=re.S)
    assert len(own) < len(page) - 1_000_000
    links = re.findall(r"""<[^<>]*\s(?:src|href)=["']?([^"'\s>]+)""", own)
    assert set(links) == {"data:,"}
    assert "url(" not in own
    assert set(re.findall(r"https?://[^\s\"']+", own)) == {"http://www.w3.org/2000/svg"}


def test_the_figures_of_a_page_are_those_of_the_atlas(atlas):
    page = html_of(atlas)
    assert data_of(page, "metrics") == pytest.approx(atlas.metrics())
    chart = chart_of_faces(atlas)
    shares = [each["share"] for each in data_of(page)["charts"]]
    areas = np.bincount(chart, atlas.surface.face_areas)
    np.testing.assert_allclose(shares, 100 * areas / areas.sum(), rtol=1e-3)


def test_all_figures_are_explained(tree, atlas):
    known = METRICS | SEGMENTS | SURFACE
    for thing in (tree, atlas, atlas.surface, tree.at(1)):
        assert set(subject(thing).metrics) <= set(known)


def test_buttons_of_each_kind(tree, atlas, tmp_path):
    def names(page):
        return [look["id"] for look in data_of(page)["looks"]]

    assert names(html_of(atlas, image=atlas.bake(resolution=64), of=tree)) == LOOKS
    assert names(html_of(atlas.surface)) == ["surface"]
    assert names(html_of(tree)) == ["segments", "level-1", "weights"]
    sharp = pa.build_atlas(pa.Partition(tree.surface, tree.labels), overlap=False)
    assert names(html_of(sharp)) == ["checker", "charts", "stretch", "density"]


def test_what_was_unwrapped_has_the_page_of_its_atlas(tree):
    made = pa.unwrap(tree.surface, levels=1, pages=2)
    options = {"image": [TWO[:, :32], TWO[:, 32:]], "of": tree}
    assert made.atlas.n_pages == 2
    assert html_of(made, **options) == html_of(made.atlas, **options)


def test_levels_of_a_tree_are_those_of_its_labels(tree, atlas):
    shown = subject(tree)
    np.testing.assert_array_equal(shown.levels[0][shown.chart], tree.labels_at(1))
    np.testing.assert_array_equal(shown.levels[1][shown.chart], tree.labels)


def test_weights_blend_the_colours_of_the_segments(tree):
    shown = subject(tree)
    colours = chart_colours(tree.surface, tree.labels, 4)
    found = shown.weights.colours(colours)
    np.testing.assert_allclose(found, tree.weights.T @ colours, atol=1e-9)


def test_a_page_takes_what_has_no_good_figures():
    """A closed surface as one chart has figures that are not numbers; JSON has null for them."""
    sphere = datasets.icosphere(1)
    uv = sphere.vertices[sphere.faces][..., :2] * 0.5 + 0.5
    shown = subject(sphere)
    bad = type(shown)(sphere, shown.chart, 1, "chart", uv, metrics={"yamabe": float("nan")})
    assert data_of(html_of(bad), "metrics") == {"yamabe": None}


# Files.


TWO = np.zeros((32, 64, 3), dtype=np.uint8)
TWO[:, 32:] = [250, 40, 20]


@pytest.fixture
def textured(tmp_path):
    """A sheet with a texture, black and red."""
    sheet = datasets.sheet(5, 5)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(TWO))
    visual = trimesh.visual.TextureVisuals(uv=sheet.vertices[:, :2], material=material)
    mesh = trimesh.Trimesh(sheet.vertices, sheet.faces, visual=visual, process=False)
    mesh.export(tmp_path / "sheet.glb")
    return tmp_path / "sheet.glb"


def test_a_mesh_with_texture_coordinates_is_viewed_with_its_texture(textured):
    shown = subject_of_file(textured)
    assert (shown.noun, shown.count) == ("chart", 1)
    assert shown.metrics["l2"] == pytest.approx(1, abs=1e-3)
    page = html_of(shown)
    looks = data_of(page)["looks"]
    assert [look["id"] for look in looks] == ["texture", "checker", "charts", "stretch", "density"]
    (source,) = [p["data"] for p in data_of(page)["pictures"] if p["data"]]
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2]))))
    assert pixels.shape == TWO.shape
    assert np.abs(pixels[16, [8, 56]].astype(int) - TWO[16, [8, 56]]).max() < 12


def test_the_atlas_of_a_file_is_a_page_with_the_textures_of_the_file(textured, tmp_path):
    made = atlas_file(textured, tmp_path / "atlas.html", AtlasOptions(effort="fast"))
    assert made.files == (tmp_path / "atlas.html",)
    page = made.output.read_text(encoding="utf-8")
    assert "<h1>sheet.glb</h1>" in page
    assert data_of(page, "metrics") == pytest.approx(made.atlas.metrics())
    (picture,) = data_of(page)["pictures"]
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture["data"].partition(",")[2]))))
    # Black and red, as they are in the file, and what is between.
    assert pixels[..., 0].min() < 10
    assert pixels[..., 0].max() > 240
    assert pixels[..., 1].max() < 80


def test_a_file_is_viewed_in_the_browser_where_no_page_is_asked_for(textured, tmp_path):
    command = [sys.executable, "-m", "phaseatlas", "view", str(textured)]
    places = {"BROWSER": "echo %s", "TMPDIR": str(tmp_path)}
    result = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, **places}
    )
    (page,) = tmp_path.glob("phaseatlas-*/sheet.html")
    assert result.stdout.split() == ["wrote", str(page), page.as_uri()]


def test_colours_of_vertices_are_shown(tmp_path):
    sheet = datasets.sheet(5, 5)
    mesh = trimesh.Trimesh(sheet.vertices, sheet.faces, process=False)
    mesh.visual.vertex_colors = np.tile([10, 200, 90, 255], (sheet.n_vertices, 1))
    mesh.export(tmp_path / "sheet.ply")
    page = html_of(subject_of_file(tmp_path / "sheet.ply"))
    (look,) = data_of(page)["looks"]
    assert look["label"] == "Colours"
    tint = numbers(look["tint"], np.uint8).reshape(-1, 3)
    linear = ((np.array([10, 200, 90]) / 255 + 0.055) / 1.055) ** 2.4
    assert np.abs(tint[:, 1:] - 255 * linear[1:]).max() < 1


def test_segments_and_atlases_that_were_saved_are_viewed(tree, atlas, tmp_path):
    tree.save(tmp_path / "tree.npz")
    assert subject_of_file(tmp_path / "tree.npz").count == 4
    atlas.save(tmp_path / "atlas.npz")
    assert subject_of_file(tmp_path / "atlas.npz").metrics == pytest.approx(atlas.metrics())
    (tmp_path / "nothing.npz").write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"nothing\.npz: neither"):
        subject_of_file(tmp_path / "nothing.npz")


def test_atlases_are_saved_as_pages(atlas, tmp_path):
    atlas.save(tmp_path / "sphere.html", resolution=64)
    page = (tmp_path / "sphere.html").read_text(encoding="utf-8")
    assert "<h1>sphere</h1>" in page
    assert data_of(page)["looks"][0]["id"] == "texture"


# Notebooks, and words.


def test_notebooks_show_a_frame_of_what_is_not_too_large(tree, atlas):
    for thing in (tree.surface, tree, tree.at(1), atlas):
        assert thing._repr_html_().startswith("<iframe srcdoc=")
    assert as_frame(datasets.icosphere(7)) is None


def test_what_is_too_large_for_a_frame_is_not_gathered():
    class Weighed(pa.Segmentation):
        def weight(self, segment):
            pytest.fail(f"segment {segment} weighed in vain")

    sphere = datasets.icosphere(7)
    labels = (sphere.vertices[sphere.faces].mean(axis=1)[:, 2] > 0).astype(np.int64)
    assert as_frame(Weighed(sphere, labels)) is None


def test_reprs_say_what_a_thing_is_in_two_lines(tree, atlas):
    scene = pa.unwrap(tree.surface.vertices, tree.surface.faces).atlas
    partition = pa.Partition(tree.surface, tree.labels)
    things = [tree.surface, tree, tree.at(2), partition, partition.merge_tree(), atlas]
    things += [atlas.charts[0], scene.surface, pa.unwrap(tree.surface)]
    for thing in things:
        said = repr(thing)
        assert said.startswith(f"{type(thing).__name__}(")
        assert said.count("\n") <= 1
        assert max(map(len, said.split("\n"))) <= 100
    assert "4 segments" in repr(tree)
    assert f"{len(atlas.charts)} charts" in repr(atlas)


def test_figures_are_arrays(tree, atlas, tmp_path):
    from phaseatlas import plot

    image = atlas.bake(resolution=64)
    for picture in (
        plot.segments(tree.surface, tree.labels, size=60),
        plot.textured(tree.surface, atlas.uv, image, size=60),
        plot.uv_layout(atlas, image, size=60),
    ):
        assert picture.dtype == np.uint8
        assert picture.shape[2] == 3
        assert picture.std() > 10
    written = plot.segments(tree.surface, tree.labels, tmp_path / "a.png", size=60)
    with Image.open(tmp_path / "a.png") as file:
        np.testing.assert_array_equal(np.asarray(file.convert("RGB")), written)


def test_show_says_what_it_needs(tree, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ImportError, match=r"^show needs the package viser: pip install"):
        pa.show(tree)


def test_show_serves_a_page(tree):
    pytest.importorskip("viser", reason="the extra view is not installed")
    server = pa.show(tree, port=18_080)
    try:
        port = server.get_port()
        with urllib.request.urlopen(f"http://localhost:{port}", timeout=10) as answer:
            assert answer.status == 200
    finally:
        server.stop()


# In a browser.


# Some frames later.
FRAMES = """new Promise((done) => {
    let left = 6;
    const step = () => (left-- ? requestAnimationFrame(step) : done());
    step();
})"""


@pytest.fixture(scope="module")
def chromium():
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as playwright:
        flags = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield browser
        browser.close()


@contextmanager
def opened(chromium, address, **options):
    """A page that has drawn its surface, and no error or request beyond its own file."""
    page = chromium.new_page(viewport={"width": 940, "height": 560}, **options)
    faults, requests = [], []
    page.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    # Until the load event.
    page.goto(address)
    page.wait_for_selector("html[data-ready]", timeout=90_000)
    yield page
    assert faults == []
    assert [url for url in requests if not url.startswith(("data:", "blob:"))] == [
        address.partition("#")[0]
    ]
    page.close()


def pixels(page, *places):
    """What is seen of elements, by their selectors."""
    shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    seen = {}
    for place in places:
        box = page.locator(place).bounding_box()
        corners = (box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"])
        seen[place] = np.asarray(shot.crop(tuple(map(round, corners)))).astype(float)
    return seen


def test_in_a_browser_looks_differ_and_charts_are_named(chromium, tree, atlas, tmp_path):
    path = tmp_path / "sphere.html"
    image = atlas.bake(resolution=256)
    path.write_text(html_of(atlas, image=image, of=tree), encoding="utf-8")
    with opened(chromium, f"{path.as_uri()}#stretch") as page:
        pressed = page.locator("#looks [aria-pressed=true]")
        assert pressed.get_attribute("value") == "stretch"
        assert page.locator("#legend").is_visible()
        assert page.locator("#ticks span").first.inner_text().endswith(" 1")
        shots = {}
        for look in LOOKS:
            # By the keyboard.
            page.locator(f"#looks [value={look}]").press("Enter")
            page.wait_for_selector(f"html[data-look={look}]")
            page.evaluate(FRAMES)
            assert pressed.get_attribute("value") == look
            shots[look] = pixels(page, "#viewer", "#paper")
        for first in LOOKS:
            for place, shot in shots[first].items():
                assert shot.std() > 10, f"{first} in {place} is blank"
            for second in LOOKS[LOOKS.index(first) + 1 :]:
                for place, shot in shots[first].items():
                    apart = np.abs(shot - shots[second][place]).mean()
                    assert apart > 1, f"{first} and {second} are the same in {place}"
        _check_names(page, atlas)
        assert json.loads(page.locator("#metrics").text_content()) == pytest.approx(atlas.metrics())
        page.set_viewport_size({"width": 360, "height": 640})
        assert page.evaluate("document.documentElement.scrollWidth") <= 360


def _check_names(page, atlas):
    """What is pointed at is named, in the layout by its path, in 3D by the nearest face there."""
    chart = chart_of_faces(atlas)
    page.locator("#outlines path").nth(1).hover(force=True)
    assert page.locator("#readout").inner_text().startswith("Chart 1 · ")
    page.locator("#outlines path").nth(2).focus()
    assert page.locator("#readout").inner_text().startswith("Chart 2 · ")
    box = page.locator("#viewer").bounding_box()
    middles = atlas.surface.vertices[atlas.surface.faces].mean(axis=1)
    low, high = atlas.surface.vertices.min(axis=0), atlas.surface.vertices.max(axis=0)
    named = set()
    for right, down in ((0.5, 0.5), (0.3, 0.3), (0.7, 0.3), (0.3, 0.7), (0.7, 0.7)):
        x, y = box["x"] + right * box["width"], box["y"] + down * box["height"]
        page.mouse.move(x, y)
        place = page.evaluate(
            f"(({{x, y, z}}) => [x, y, z])(viewer.positionAndNormalFromPoint({x}, {y}).position)"
        )
        point = np.array(place) * (high - low).max() + 0.5 * (low + high)
        nearest = int(chart[np.argmin(np.linalg.norm(middles - point, axis=1))])
        page.locator(f"#outlines .named[data-chart='{nearest}']").wait_for(timeout=10_000)
        assert page.locator("#readout").inner_text().startswith(f"Chart {nearest} · ")
        named.add(nearest)
    assert len(named) > 1


def test_in_a_browser_a_frame_of_a_notebook_is_drawn(chromium, tree, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<!DOCTYPE html><body>{tree._repr_html_()}", encoding="utf-8")
    page = chromium.new_page(viewport={"width": 600, "height": 700}, color_scheme="dark")
    page.goto(path.as_uri())
    page.frame_locator("iframe").locator("html[data-ready]").wait_for(timeout=90_000)
    frame = page.frame_locator("iframe")
    frame.locator("#looks [value=weights]").click()
    frame.locator("html[data-look=weights]").wait_for()
    assert pixels(page, "iframe")["iframe"].std() > 10
    page.close()
