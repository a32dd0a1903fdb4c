"""The overlapping charts as a glTF file, read back apart from the package, and the page of them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from PIL import Image

import phaseatlas as pa
from phaseatlas import _core
from phaseatlas.atlas.charts import Chart, Layout
from phaseatlas.atlas.overlap import injective, pack_domains

ROOT = Path(__file__).parents[1]
TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def star():
    return pa.segment(pa.datasets.starfish(3), 3)


@pytest.fixture(scope="module", params=["bff", "isometric", "partition", "wide"])
def atlas(request, star):
    """Atlases whose domains overlap themselves not at all, or here and there."""
    if request.param == "partition":
        return pa.build_atlas(pa.partition(star.surface))
    if request.param == "wide":
        # Weights that reach around the limbs.
        wide = pa.Segmentation(star.surface, star.labels, epsilon=1.0)
        return pa.build_atlas(wide, flatten="isometric", threshold=0.0)
    return pa.build_atlas(star, flatten=request.param)


def read(path):
    """Nodes of a file, and the arrays of the mesh of each."""
    file = pygltflib.GLTF2().load(path)
    blob = file.binary_blob()

    def values(number):
        accessor = file.accessors[number]
        view = file.bufferViews[accessor.bufferView]
        width = WIDTHS[accessor.type]
        kind = np.dtype(TYPES[accessor.componentType])
        assert view.byteStride in (None, width * kind.itemsize)
        start = view.byteOffset + (accessor.byteOffset or 0)
        return np.frombuffer(blob, kind, accessor.count * width, start).reshape(-1, width)

    found = []
    for node in file.nodes:
        (primitive,) = file.meshes[node.mesh].primitives
        names = [name for name, at in vars(primitive.attributes).items() if at is not None]
        arrays = {name: values(getattr(primitive.attributes, name)) for name in names}
        found.append((node, arrays, values(primitive.indices).reshape(-1, 3)))
    return file, found


def numbered(surface, positions):
    """The vertex of a surface at each position of single precision."""
    place = {tuple(row): k for k, row in enumerate(surface.vertices.astype(np.float32).tolist())}
    return np.array([place[tuple(row)] for row in positions.tolist()])


def test_weights_sum_to_one_at_each_vertex(atlas, tmp_path):
    atlas.save_charts(tmp_path / "charts.glb")
    _, found = read(tmp_path / "charts.glb")
    assert len(found) == len(atlas.charts)
    total = np.zeros(atlas.surface.n_vertices)
    for number, ((node, arrays, _), chart) in enumerate(zip(found, atlas.charts, strict=True)):
        assert node.extras == {"chart": number, "segment": chart.segment}
        weight = arrays["_WEIGHT"][:, 0]
        assert np.array_equal(arrays["COLOR_0"][:, 3], weight)
        assert (arrays["COLOR_0"][:, :3] == 1).all()
        # A vertex on a cut is there once a side, with one weight.
        vertex, first, inverse = np.unique(
            numbered(atlas.surface, arrays["POSITION"]), return_index=True, return_inverse=True
        )
        assert np.array_equal(weight, weight[first][inverse])
        total[vertex] += weight[first]
    # Eight weights of single precision.
    np.testing.assert_allclose(total, 1, atol=1e-6)


def test_meshes_are_the_domains(atlas, tmp_path):
    atlas.save_charts(tmp_path / "charts.glb")
    _, found = read(tmp_path / "charts.glb")
    charts = injective(atlas)
    for (_, arrays, triangles), chart in zip(found, charts, strict=True):
        vertices = numbered(atlas.surface, arrays["POSITION"])
        assert np.array_equal(vertices[triangles], atlas.surface.faces[chart.faces])
        # v points down in the file.
        plane = arrays["TEXCOORD_1"] * [1, -1] + [0, 1]
        np.testing.assert_allclose(plane[triangles], chart.uv[chart.triangles], atol=1e-5)
        normals = atlas.surface.vertex_normals[vertices]
        np.testing.assert_allclose(arrays["NORMAL"], normals, atol=1e-6)


def test_what_overlaps_is_left_out_and_no_more(atlas):
    for chart, given in zip(injective(atlas), atlas.charts, strict=True):
        assert set(given.faces[given.labelled]) == set(chart.faces[chart.labelled])
        assert set(chart.faces) <= set(given.faces)
        corners = given.uv[given.triangles]
        flips, crosses, _ = _core.faults(given.triangles, given.uv, 1e-9)
        if not (flips or crosses):
            assert np.array_equal(chart.faces, given.faces)
        low, side = corners.min(axis=(0, 1)), np.ptp(corners, axis=(0, 1)).max()
        places = (chart.uv[chart.triangles] - low) / side
        _, count = _core.rasterize(np.ascontiguousarray(places), 1024)
        assert count.max() == 1
        # Over the edge of what is left out nothing jumps.
        out = np.setdiff1d(given.faces, chart.faces)
        own = atlas.surface.faces[chart.faces[chart.labelled]]
        edge = np.setdiff1d(atlas.surface.faces[out], own)
        assert (chart.weights[np.isin(chart.vertices, edge)] == 0).all()
        # Every face has a weight in its own chart.
        own_weights = chart.weights[chart.triangles[chart.labelled]]
        assert (own_weights.max(axis=1) > 0).all()


def test_many_charts_take_no_array_of_charts_times_vertices():
    sheet = pa.datasets.sheet(200, 100)
    x, y, _ = sheet.vertices[sheet.faces].mean(axis=1).T
    labels = (10 * (10 * x).astype(int) + 10 * y).astype(int)
    charts = []
    for label in range(100):
        faces = np.flatnonzero(labels == label)
        vertices, triangles = np.unique(sheet.faces[faces], return_inverse=True)
        charts.append(
            Chart(
                segment=label,
                faces=faces,
                labelled=np.ones(len(faces), dtype=bool),
                vertices=vertices,
                triangles=triangles.reshape(-1, 3),
                uv=sheet.vertices[vertices, :2],
                weights=np.ones(len(vertices)),
                log_scale=np.zeros(len(vertices)),
            )
        )
    m = sheet.n_faces
    corners = sheet.vertices[sheet.faces][..., :2]
    pages, stack = np.zeros(100, dtype=int), np.full((m, 3), -1)
    layout = Layout(sheet, labels, tuple(charts), corners, pages, 1024, stack)
    tracemalloc.start()
    found = injective(layout)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 * len(charts) * sheet.n_vertices
    # Each vertex is shared out evenly among the charts that have it.
    count = np.bincount(np.concatenate([chart.vertices for chart in charts]))
    for chart, given in zip(found, charts, strict=True):
        assert np.array_equal(chart.faces, given.faces)
        np.testing.assert_array_equal(chart.weights, 1 / count[chart.vertices])


def test_some_domains_overlap_themselves(star):
    """Or the test above shows nothing."""
    atlas = pa.build_atlas(pa.partition(star.surface))
    before = sum(len(chart.faces) for chart in atlas.charts)
    assert sum(len(chart.faces) for chart in injective(atlas)) < before


def test_domains_lie_side_by_side_on_one_scale(atlas, tmp_path):
    atlas.save_charts(tmp_path / "charts.glb")
    file, found = read(tmp_path / "charts.glb")
    side = file.scenes[0].extras["side"]
    covered = []
    for _, arrays, triangles in found:
        uv = arrays["TEXCOORD_0"].astype(np.float64) * [1, -1] + [0, 1]
        assert 0 <= uv.min() <= uv.max() <= 1
        # Moved and turned: lengths are those of the chart's own map.
        lengths = [
            np.linalg.norm(np.diff(places[triangles], axis=1), axis=2)
            for places in (side * uv, arrays["TEXCOORD_1"].astype(np.float64))
        ]
        np.testing.assert_allclose(*lengths, atol=1e-4)
        covered.append(_core.rasterize(np.ascontiguousarray(uv[triangles]), 512)[1])
    assert np.sum(covered, axis=0).max() == 1


def test_padding_is_kept(atlas):
    narrow, wide = (pack_domains(atlas.charts, padding=p, resolution=128) for p in (0, 12))
    assert sum(map(np.ptp, wide)) < sum(map(np.ptp, narrow))
    with pytest.raises(ValueError, match="padding: 20 must be in"):
        pack_domains(atlas.charts, padding=20, resolution=128)


def test_far_from_the_origin_positions_keep_their_digits(star, tmp_path):
    surface = star.surface
    far = pa.Surface(surface.vertices + np.array([1e6, 0, 0]), surface.faces)
    pa.build_atlas(pa.Segmentation(far, star.labels)).save_charts(tmp_path / "far.glb")
    for node, arrays, triangles in read(tmp_path / "far.glb")[1]:
        assert triangles.max() < len(arrays["POSITION"])
        placed = arrays["POSITION"].astype(np.float64) + node.translation
        assert np.abs(placed - [1e6, 0, 0]).max() < 3


def test_another_suffix_is_refused(atlas, tmp_path):
    with pytest.raises(ValueError, match=r"path: suffix '.obj' of .* must be .glb"):
        atlas.save_charts(tmp_path / "charts.obj")
    assert not list(tmp_path.iterdir())


def shot(page, picture, settings):
    """State and words of the page in a browser, and its picture."""
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--window-size=500,400",
    ]
    address = f"{page.resolve().as_uri()}#{settings}"
    subprocess.run(
        [*command, f"--screenshot={picture}", address], capture_output=True, check=True, timeout=120
    )
    shown = subprocess.run(
        [*command, "--dump-dom", address], capture_output=True, text=True, timeout=120
    ).stdout
    with Image.open(picture) as image:
        return shown, np.asarray(image.convert("RGB")).astype(float)


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")
def test_page_blends(tmp_path):
    page = tmp_path / "blend.html"
    printed = subprocess.run(
        [sys.executable, ROOT / "examples" / "blend.py", page], capture_output=True, text=True
    )
    assert printed.stdout == f"wrote {page}\n", printed.stderr
    smooth, blended = shot(page, tmp_path / "1.png", "sharpness=1")
    _, sharp = shot(page, tmp_path / "8.png", "sharpness=8")
    assert 'data-state="drawn"' in smooth
    assert "8 charts" in smooth
    middle = (slice(100, 400), slice(100, 400))
    assert blended[middle].std() > 20
    # Most of a chart is its own at any sharpness, and the blends are not.
    changed = (np.abs(blended - sharp)[middle].max(axis=-1) > 8).mean()
    assert 0.01 < changed < 0.5


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")
def test_page_says_what_it_cannot_read(tmp_path):
    (tmp_path / "charts.glb").write_bytes(b"no model")
    page = tmp_path / "blend.html"
    script = ROOT / "examples" / "blend.py"
    subprocess.run(
        [sys.executable, script, page, "--charts", tmp_path / "charts.glb"],
        capture_output=True,
        check=True,
    )
    shown, _ = shot(page, tmp_path / "1.png", "")
    assert 'data-state="failed"' in shown


def test_page_needs_no_network():
    text = (ROOT / "examples" / "blend.html").read_text(encoding="utf-8")
    assert not re.findall(r"""(?:src|href)\s*=|https?:|fetch\(|import\(""", text)


def test_shaders_of_the_documentation_are_those_of_the_page():
    page = (ROOT / "examples" / "blend.html").read_text(encoding="utf-8")
    text = (ROOT / "docs" / "blending.md").read_text(encoding="utf-8")
    snippets = re.findall(r"```glsl\n(.*?)```", text, flags=re.DOTALL)
    assert len(snippets) == 3
    for snippet in snippets:
        assert snippet.strip() in page


def test_command_line(star, tmp_path):
    model = tmp_path / "model.obj"
    pa.save_mesh(star.surface, model)
    command = [sys.executable, "-m", "phaseatlas", "atlas", model, "-o", tmp_path / "out.obj"]
    command += ["--shares", "1,3", "--charts", tmp_path / "charts.glb"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    _, found = read(tmp_path / "charts.glb")
    assert len(found) == 2
    # Without a texture the charts overlap all the same.
    assert sum(len(triangles) for _, _, triangles in found) > star.surface.n_faces


def test_files_of_a_scene_name_all_that_was_written(star, tmp_path):
    from phaseatlas.file_atlas import AtlasOptions, atlas_file

    model = tmp_path / "model.obj"
    pa.save_mesh(star.surface, model)
    more = {"charts": tmp_path / "charts.glb", "outlines": tmp_path / "outlines.svg"}
    made = atlas_file(model, tmp_path / "out.obj", AtlasOptions(**more))
    assert set(more.values()) < set(made.files)
    assert all(path.stat().st_size for path in made.files)
    assert json.dumps(made.record())
