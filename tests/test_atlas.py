"""Atlases: overlapping charts, their maps, the packed layout and the files."""

from __future__ import annotations

import io
import json
import math
import struct
import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import phaseatlas as pa
from phaseatlas import _core

RESOLUTION = 512


def smooth(uv):
    """A texture without edges, which tells places apart in three channels."""
    u, v = uv[:, 0], uv[:, 1]
    waves = [np.sin(1.5 * u + 0.3), np.cos(1.7 * v - 0.5), np.sin(1.1 * (u - v))]
    return 0.5 + 0.45 * np.stack(waves, axis=1)


@pytest.fixture(scope="module")
def star():
    return pa.segment(pa.datasets.starfish(4), 3)


@pytest.fixture(scope="module")
def atlas(star):
    return pa.build_atlas(star)


def signed_areas(corners):
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def is_disk(triangles):
    """Connected, Euler characteristic 1 and, with one border loop, no pinch."""
    directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, count = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    vertices = np.unique(triangles)
    loops = trimesh.graph.connected_components(edges[count == 1])
    parts = trimesh.graph.connected_components(edges, nodes=vertices)
    euler = len(vertices) - len(edges) + len(triangles)
    degree = np.bincount(edges[count == 1].ravel())
    return euler == 1 and len(parts) == len(loops) == 1 and set(degree) <= {0, 2}


def check_charts(tree, atlas):
    """What holds of every atlas, whatever the surface."""
    surface = tree.surface
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in atlas.charts])
    np.testing.assert_array_equal(np.sort(labelled), np.arange(surface.n_faces))
    total = np.zeros(surface.n_vertices)
    for chart in atlas.charts:
        assert is_disk(chart.triangles)
        np.testing.assert_array_equal(chart.vertices[chart.triangles], surface.faces[chart.faces])
        own = tree.labels[chart.faces] == chart.segment
        assert own[chart.labelled].all()
        # A segment that is split has several charts, each with faces of the others around it.
        if sum(other.segment == chart.segment for other in atlas.charts) == 1:
            np.testing.assert_array_equal(own, chart.labelled)
        assert np.isfinite(chart.uv).all()
        assert chart.weights.min() >= 0.0
        # The copies of a vertex on a cut carry the same weight, which counts once.
        weight = np.full(surface.n_vertices, np.nan)
        weight[chart.vertices] = chart.weights
        np.testing.assert_array_equal(weight[chart.vertices], chart.weights)
        total += np.nan_to_num(weight)
    np.testing.assert_allclose(total, 1.0, rtol=0.0, atol=1e-12)
    assert atlas.uv.shape == (surface.n_faces, 3, 2)
    assert np.isfinite(atlas.uv).all()
    assert atlas.uv.min() >= 0.0
    assert atlas.uv.max() <= 1.0


def test_charts_cover_the_surface(star, atlas):
    check_charts(star, atlas)
    assert sorted(chart.segment for chart in atlas.charts) == list(range(8))
    np.testing.assert_array_equal(atlas.labels, star.labels)


def test_spot_has_no_flips_and_no_overlap(mesh_path):
    tree = pa.segment(pa.load(mesh_path("spot")), 3)
    atlas = pa.build_atlas(tree)
    check_charts(tree, atlas)
    metrics = atlas.metrics()
    assert metrics["flips"] == 0
    assert metrics["overlap"] == 0.0
    assert metrics["non_disk"] == 0
    assert metrics["degenerate"] == 0
    assert (signed_areas(atlas.uv) > 0.0).all()


def test_starfish_has_no_flips_and_no_overlap(atlas):
    metrics = atlas.metrics()
    assert metrics["flips"] == 0
    assert metrics["overlap"] == 0.0
    assert metrics["charts"] == 8
    assert metrics["packing"] > 40.0


def test_maps_keep_the_labelled_area(star, atlas):
    for chart in atlas.charts:
        flat = signed_areas(chart.uv[chart.triangles])
        assert (flat > 0.0).all()
        area = star.surface.face_areas[chart.faces][chart.labelled].sum()
        assert flat[chart.labelled].sum() == pytest.approx(area, rel=1e-12)


def test_layout_has_one_scale_for_all_charts(atlas):
    ratios = []
    for chart in atlas.charts:
        flat = signed_areas(chart.uv[chart.triangles])[chart.labelled]
        ratios.append(signed_areas(atlas.uv[chart.faces[chart.labelled]]) / flat)
    ratios = np.concatenate(ratios)
    np.testing.assert_allclose(ratios, ratios.mean(), rtol=1e-6)


def test_log_scale_is_that_of_the_map(star, atlas):
    for chart in atlas.charts:
        corner = chart.triangles.ravel()
        flat = np.repeat(signed_areas(chart.uv[chart.triangles]), 3)
        solid = np.repeat(star.surface.face_areas[chart.faces], 3)
        expected = 0.5 * np.log(np.bincount(corner, flat) / np.bincount(corner, solid))
        np.testing.assert_allclose(chart.log_scale, expected, atol=1e-9)


def test_a_cap_shrinks_inside():
    tree = pa.segment(pa.datasets.icosphere(4), 1)
    for chart in pa.build_atlas(tree, threshold=0.0).charts:
        # Conformal maps of a cap shrink its pole against its border, like the stereographic
        # projection, whose scale is 1 / (1 + cos(angle from the pole)).
        places = tree.surface.vertices[chart.vertices]
        centres = tree.surface.vertices[tree.surface.faces[chart.faces]].mean(axis=1)
        pole = centres.mean(axis=0) / np.linalg.norm(centres.mean(axis=0))
        height = places @ pole
        inside, equator = chart.log_scale[height > 0.95], chart.log_scale[np.abs(height) < 0.05]
        assert inside.max() < equator.min()
        assert inside.mean() < 0.0 < equator.mean()
        assert equator.mean() - inside.mean() == pytest.approx(math.log(2.0), abs=0.1)


def test_domains_of_neighbours_overlap(star, atlas):
    neighbours = star.surface.face_neighbours
    ring = star.labels[neighbours]
    pairs = np.unique(np.stack([np.repeat(star.labels, 3), ring.ravel()], axis=1), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    assert len(pairs) >= 7
    domain = {chart.segment: set(chart.faces.tolist()) for chart in atlas.charts}
    for first, second in pairs:
        assert domain[first] & domain[second]
    for chart in atlas.charts:
        # All faces across the border of the segment are in the domain.
        own = chart.faces[chart.labelled]
        assert set(neighbours[own].ravel().tolist()) <= domain[chart.segment]


def test_domains_stay_wide_where_that_costs_little():
    # A cap's log scale varies by more than is free at any width; the widest is little worse.
    tree = pa.segment(pa.datasets.icosphere(4), 1)
    default, wide = (pa.build_atlas(tree, threshold=threshold) for threshold in (None, 0.02))
    for first, second in zip(default.charts, wide.charts, strict=True):
        assert np.array_equal(first.faces, second.faces)


def test_threshold_zero_gives_larger_domains_that_still_are_disks(star, atlas):
    full = pa.build_atlas(star, threshold=0.0)
    check_charts(star, full)
    for large, small in zip(full.charts, atlas.charts, strict=True):
        assert large.segment == small.segment
        assert set(small.faces) <= set(large.faces)
    assert sum(len(c.faces) for c in full.charts) > 1.1 * sum(len(c.faces) for c in atlas.charts)
    # The paper's weights as they are.
    for chart in full.charts:
        np.testing.assert_allclose(
            chart.weights, star.weights[chart.segment, chart.vertices], atol=1e-12
        )


def test_rings_of_a_torus_are_cut_open():
    tree = pa.segment(pa.datasets.torus(1.0, 0.4, 48, 20), 1)
    assert tree.surface.genus == 1
    atlas = pa.build_atlas(tree)
    check_charts(tree, atlas)
    for chart in atlas.charts:
        assert chart.cut_length > 0.0
        assert len(chart.vertices) > len(np.unique(chart.vertices))
    assert atlas.metrics()["non_disk"] == 0


@pytest.mark.parametrize("height", [0.1, 1.0, 10.0])
def test_closed_charts_whose_vertices_are_all_neighbours_are_slit(height):
    # On a tetrahedron every vertex is one edge away from every other, on a cone from its tip.
    tetrahedron = pa.Surface(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, height)],
        [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    )
    cone = trimesh.creation.cone(radius=1.0, height=height, sections=16)
    for surface in (tetrahedron, pa.Surface(cone.vertices, cone.faces)):
        whole = one_segment(surface)
        atlas = pa.build_atlas(whole)
        check_charts(whole, atlas)
        assert atlas.charts[0].cut_length > 0.0


def one_segment(surface):
    labels = np.zeros(surface.n_faces, dtype=np.int64)
    return pa.Segmentation(surface, labels, np.ones((1, surface.n_vertices)))


def test_vertices_below_every_threshold_are_in_all_charts_that_label_a_face_there():
    # The weights are those of a third segment that labels nothing. All corners of face 0 touch
    # segment 1, whose domain ends at the neighbours of face 0.
    surface = pa.datasets.icosphere(2)
    labels = np.ones(surface.n_faces, dtype=np.int64)
    labels[[0, *surface.face_neighbours[0]]] = 0
    weights = np.zeros((3, surface.n_vertices))
    weights[2] = 1.0
    segmentation = pa.Segmentation(surface, labels, weights)
    atlas = pa.build_atlas(segmentation)
    check_charts(segmentation, atlas)
    first, second = (dict(zip(c.vertices, c.weights, strict=True)) for c in atlas.charts)
    for vertex in surface.faces[0]:
        assert first[vertex] == second[vertex] == 0.5
    assert (atlas.bake(lambda uv: np.full((len(uv), 3), 0.4), resolution=64) == 102).all()


@st.composite
def segmentations(draw):
    """Cells around random faces of a legal surface; their weights need not fit the labels."""
    side = st.floats(0.1, 5.0)
    kind = draw(st.sampled_from(["box", "cone", "cylinder", "capsule", "torus", "tetrahedron"]))
    if kind == "torus":
        rings, sides = draw(st.integers(3, 16)), draw(st.integers(3, 12))
        surface = pa.datasets.torus(1.0, draw(st.floats(0.1, 0.9)), rings, sides)
    elif kind == "tetrahedron":
        surface = pa.Surface(
            [(0, 0, 0), (draw(side), 0, 0), (0, draw(side), 0), (0, 0, draw(side))],
            [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
        )
    else:
        sections, radius, height = draw(st.integers(3, 16)), draw(side), draw(side)
        make = {
            "box": lambda: trimesh.creation.box((radius, draw(side), height)),
            "cone": lambda: trimesh.creation.cone(radius, height, sections=sections),
            "cylinder": lambda: trimesh.creation.cylinder(radius, height, sections=sections),
            "capsule": lambda: trimesh.creation.capsule(height, radius, [sections, sections]),
        }
        mesh = make[kind]()
        surface = pa.Surface(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(1, min(8, surface.n_faces)))
    centres = surface.vertices[surface.faces].mean(axis=1)
    seeds = centres[rng.choice(surface.n_faces, count, replace=False)]
    labels = np.linalg.norm(centres[:, None] - seeds, axis=2).argmin(axis=1)
    distance = np.linalg.norm(surface.vertices[:, None] - seeds, axis=2) / np.sqrt(surface.area)
    if draw(st.booleans()):
        distance = rng.random(distance.shape)
    sharpness = draw(st.sampled_from([0.0, 5.0, 50.0, 1e4]))
    weights = np.exp(-sharpness * (distance - distance.min(axis=1, keepdims=True)))
    return pa.Segmentation(surface, labels, (weights / weights.sum(axis=1, keepdims=True)).T)


@settings(deadline=None, max_examples=40, derandomize=True, database=None)
@given(segmentations(), st.sampled_from(["bff", "lscm", "isometric"]))
def test_charts_of_random_segments_never_fail(segmentation, flatten):
    with warnings.catch_warnings():
        # Coarse charts may overlap themselves, which is said.
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", pa.QualityWarning)
        atlas = pa.build_atlas(segmentation, flatten=flatten, padding=1, resolution=128)
    check_charts(segmentation, atlas)
    assert (atlas.bake(lambda uv: np.full((len(uv), 3), 0.4), resolution=64) == 102).all()


def test_cut_length_is_zero_where_nothing_was_cut(atlas):
    for chart in atlas.charts:
        copies = len(chart.vertices) - len(np.unique(chart.vertices))
        assert (chart.cut_length > 0.0) == (copies > 0)


def test_atlas_is_deterministic(star, atlas):
    again = pa.build_atlas(star)
    np.testing.assert_array_equal(again.uv, atlas.uv)
    for first, second in zip(again.charts, atlas.charts, strict=True):
        np.testing.assert_array_equal(first.uv, second.uv)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"flatten": "abf"}, "flatten"),
        ({"threshold": -0.1}, "threshold"),
        ({"threshold": 0.125}, "threshold"),
        ({"threshold": math.nan}, "threshold"),
        ({"padding": -1}, "padding"),
        ({"resolution": 0}, "resolution"),
    ],
)
def test_bad_arguments_are_named(star, options, name):
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        pa.build_atlas(star, **options)


def blend_at_centroids(atlas, texture):
    """The blend of the chart functions at the centre of every face, (m, 3)."""
    tiles = 4.0 / math.sqrt(atlas.surface.area)
    total = np.zeros((atlas.surface.n_faces, 3))
    weights = np.zeros(atlas.surface.n_faces)
    for chart in atlas.charts:
        weight = chart.weights[chart.triangles].mean(axis=1)
        values = texture(tiles * chart.uv[chart.triangles].mean(axis=1))
        total[chart.faces] += weight[:, None] * values
        weights[chart.faces] += weight
    np.testing.assert_allclose(weights, 1.0, atol=1e-12)
    return total


def look_up(pixels, u, row_fraction):
    """Nearest texel; the row counts from the top of the image."""
    height, width = pixels.shape[:2]
    row = np.clip((row_fraction * height).astype(int), 0, height - 1)
    column = np.clip((u * width).astype(int), 0, width - 1)
    return pixels[row, column] / 255.0


def check_picture(atlas, pixels, u, row_fraction):
    """The image at the centre of every face is the blend there.

    The texture changes by less than 0.01 across a texel, and bytes add 0.002; an image that is
    upside down, mirrored or turned is off by a third on average.
    """
    error = np.abs(look_up(pixels, u, row_fraction) - blend_at_centroids(atlas, smooth))
    assert error.mean() < 0.005
    assert error.max() < 0.05
    for wrong in (look_up(pixels, u, 1.0 - row_fraction), look_up(pixels, 1.0 - u, row_fraction)):
        assert np.abs(wrong - blend_at_centroids(atlas, smooth)).mean() > 0.05


def test_baked_image_shows_the_blend(atlas):
    pixels = atlas.bake(smooth, resolution=RESOLUTION)
    assert (pixels.shape, pixels.dtype) == ((RESOLUTION, RESOLUTION, 3), np.uint8)
    centre = atlas.uv.mean(axis=1)
    check_picture(atlas, pixels, centre[:, 0], 1.0 - centre[:, 1])


def read_glb(path):
    """Positions, texture coordinates, indices and image, read by the letter of the format."""
    data = path.read_bytes()
    magic, _, length = struct.unpack_from("<4sII", data)
    assert (magic, length) == (b"glTF", len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + size])
    binary = data[28 + size :]

    def view(index):
        entry = header["bufferViews"][index]
        start = entry.get("byteOffset", 0)
        return binary[start : start + entry["byteLength"]]

    def accessor(index):
        entry = header["accessors"][index]
        dtype = {5126: np.float32, 5125: np.uint32, 5123: np.uint16}[entry["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[entry["type"]]
        start = entry.get("byteOffset", 0)
        values = np.frombuffer(view(entry["bufferView"])[start:], dtype)
        return values[: width * entry["count"]].reshape(-1, width)

    (mesh,) = header["meshes"]
    (primitive,) = mesh["primitives"]
    material = header["materials"][primitive["material"]]
    texture = header["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    image = Image.open(io.BytesIO(view(header["images"][texture["source"]]["bufferView"])))
    return (
        accessor(primitive["attributes"]["POSITION"]),
        accessor(primitive["attributes"]["TEXCOORD_0"]),
        accessor(primitive["indices"]).reshape(-1, 3),
        np.asarray(image.convert("RGB")),
    )


def test_glb_holds_geometry_texture_and_coordinates(atlas, tmp_path):
    path = tmp_path / "star.glb"
    atlas.save(path, texture=smooth, resolution=RESOLUTION)
    assert [entry.name for entry in tmp_path.iterdir()] == ["star.glb"]
    positions, uv, triangles, pixels = read_glb(path)
    surface = atlas.surface
    assert len(triangles) == surface.n_faces
    corners = surface.vertices[surface.faces].astype(np.float32)
    np.testing.assert_array_equal(positions[triangles], corners)
    # In this format v points down from the top of the image.
    np.testing.assert_allclose(uv[triangles][..., 0], atlas.uv[..., 0], atol=1e-6)
    np.testing.assert_allclose(uv[triangles][..., 1], 1.0 - atlas.uv[..., 1], atol=1e-6)
    np.testing.assert_array_equal(pixels, atlas.bake(smooth, resolution=RESOLUTION))
    centre = uv[triangles].mean(axis=1)
    check_picture(atlas, pixels, centre[:, 0], centre[:, 1])


def test_glb_reads_back_as_the_same_textured_mesh(atlas, tmp_path):
    path = tmp_path / "star.glb"
    atlas.save(path, texture=smooth, resolution=RESOLUTION)
    mesh = trimesh.load(path, force="mesh", process=False)
    assert len(mesh.visual.uv) == len(mesh.vertices)
    np.testing.assert_allclose(mesh.visual.uv[mesh.faces], atlas.uv, atol=1e-6)
    image = mesh.visual.material.baseColorTexture
    assert image.size == (RESOLUTION, RESOLUTION)
    centre = mesh.visual.uv[mesh.faces].mean(axis=1)
    check_picture(atlas, np.asarray(image.convert("RGB")), centre[:, 0], 1.0 - centre[:, 1])
    # Without its seams it is the surface again.
    surface = pa.load(path)
    assert (surface.n_vertices, surface.n_boundary_loops) == (atlas.surface.n_vertices, 0)


@pytest.mark.parametrize("stem", ["star", "a star"])
def test_obj_comes_with_material_and_image(atlas, tmp_path, stem):
    path = tmp_path / f"{stem}.obj"
    atlas.save(path, texture=smooth, resolution=RESOLUTION)
    names = {entry.name for entry in tmp_path.iterdir()}
    assert names == {f"{stem}.obj", f"{stem}.mtl", f"{stem}.png"}
    rows = [line.split(maxsplit=1) for line in path.read_text().splitlines() if line]
    assert ["mtllib", f"{stem}.mtl"] in rows
    materials = [
        row.split(maxsplit=1) for row in (tmp_path / f"{stem}.mtl").read_text().split("\n")
    ]
    assert ["map_Kd", f"{stem}.png"] in materials
    (used,) = [row[1] for row in rows if row[0] == "usemtl"]
    assert ["newmtl", used] in materials
    vertices = np.array([row[1].split()[:3] for row in rows if row[0] == "v"], dtype=float)
    places = np.array([row[1].split()[:2] for row in rows if row[0] == "vt"], dtype=float)
    corners = np.array(
        [[c.split("/")[:2] for c in row[1].split()] for row in rows if row[0] == "f"], dtype=int
    )
    surface = atlas.surface
    assert len(corners) == surface.n_faces
    np.testing.assert_allclose(
        vertices[corners[..., 0] - 1], surface.vertices[surface.faces], atol=1e-7
    )
    # In this format v points up.
    uv = places[corners[..., 1] - 1]
    np.testing.assert_allclose(uv, atlas.uv, atol=1e-7)
    with Image.open(tmp_path / f"{stem}.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    np.testing.assert_array_equal(pixels, atlas.bake(smooth, resolution=RESOLUTION))
    centre = uv.mean(axis=1)
    check_picture(atlas, pixels, centre[:, 0], 1.0 - centre[:, 1])


@pytest.mark.parametrize("name", ["star.stl", "star", "star.glb.zip"])
def test_unknown_suffix_is_refused_before_any_work(atlas, tmp_path, name):
    with pytest.raises(ValueError, match=r"must be \.glb, \.obj, \.npz or \.html"):
        atlas.save(tmp_path / name, texture=lambda uv: pytest.fail("baked in vain"))
    assert not list(tmp_path.iterdir())


def test_failing_save_keeps_the_old_file(atlas, tmp_path):
    path = tmp_path / "star.glb"
    path.write_bytes(b"precious")
    with pytest.raises(ValueError, match="texture"):
        atlas.save(path, texture=np.zeros((4, 4, 2)), resolution=64)
    with pytest.raises(FileNotFoundError):
        atlas.save(tmp_path / "missing" / "star.obj", resolution=64)
    assert path.read_bytes() == b"precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["star.glb"]


def seam_jump(atlas, pixels):
    """Mean difference of the image between the two sides of the edges between segments."""
    surface = atlas.surface
    f, k = np.nonzero(surface.face_neighbours >= 0)
    g = surface.face_neighbours[f, k]
    seam = (f < g) & (atlas.labels[f] != atlas.labels[g])
    f, k, g = f[seam], k[seam], g[seam]
    start = surface.faces[f, k]
    # The other face runs along the edge from its end to its start.
    j = (np.argmax(surface.faces[g] == start[:, None], axis=1) + 2) % 3
    assert (surface.faces[g, (j + 1) % 3] == start).all()
    here = 0.5 * (atlas.uv[f, k] + atlas.uv[f, (k + 1) % 3])
    there = 0.5 * (atlas.uv[g, j] + atlas.uv[g, (j + 1) % 3])
    assert np.abs(here - there).max() > 0.1
    first = look_up(pixels, here[:, 0], 1.0 - here[:, 1])
    second = look_up(pixels, there[:, 0], 1.0 - there[:, 1])
    return np.abs(first - second).mean()


def test_blended_texture_is_continuous_across_seams(atlas):
    blended = seam_jump(atlas, atlas.bake(smooth, resolution=1024))
    sharp = seam_jump(atlas, atlas.bake(smooth, resolution=1024, blend=False))
    assert sharp > 0.1
    # What is left is the change of the texture over the texel on either side.
    assert blended < 0.01
    assert blended < 0.1 * sharp


def test_vertex_colors_are_the_blend_at_the_vertices(star, atlas):
    tiles = 4.0 / math.sqrt(star.surface.area)
    expected = np.zeros((star.surface.n_vertices, 3))
    for chart in atlas.charts:
        copies = np.bincount(chart.vertices, minlength=star.surface.n_vertices)[chart.vertices]
        np.add.at(
            expected,
            chart.vertices,
            (chart.weights / copies)[:, None] * smooth(tiles * chart.uv),
        )
    np.testing.assert_allclose(atlas.vertex_colors(smooth), expected, atol=1e-12)


def disk_of(surface, faces):
    """The faces as a disk of their own, and the surface vertex of each of its vertices."""
    cut = surface.cut_to_disk(np.flatnonzero(faces))
    disk, triangles, vertices = cut.mesh, cut.triangles, cut.vertices
    return disk, triangles, vertices


def test_boundary_first_map_of_a_cap_has_the_scale_of_the_closed_form():
    sphere = pa.datasets.icosphere(5)
    z = sphere.vertices[:, 2]
    disk, triangles, vertices = disk_of(sphere, (z[sphere.faces] >= 0.3).all(axis=1))
    flat = _core.bff(disk)
    uv, log_scale = flat.uv, flat.log_scale
    # The rim is jagged: the closed form takes the mean of cos t0 along it.
    height = z[vertices]
    expected = np.log((1 + height[disk.on_border()].mean()) / (1 + height))
    inside = height > 0.5
    assert np.abs(log_scale - expected)[inside].max() < 0.02
    # What is reported is what was done: lengths of the plane over lengths of the surface.
    measured = edge_scale(uv, sphere.vertices[vertices], triangles)
    reported = log_scale[triangles].mean(axis=1)
    kept = inside[triangles].all(axis=1)
    assert np.abs(measured - reported)[kept].max() < 0.03


def edge_scale(uv, positions, triangles):
    """Half the log ratio of the area of each triangle in the plane and on the surface."""
    a, b, c = (uv[triangles[:, k]] for k in range(3))
    flat = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    p, q, r = (positions[triangles[:, k]] for k in range(3))
    return 0.5 * np.log(flat / np.linalg.norm(np.cross(q - p, r - p), axis=1))


@pytest.mark.parametrize("flatten", ["bff", "lscm"])
def test_a_developable_chart_keeps_its_shape(flatten):
    cylinder = pa.datasets.cylinder(0.5, 1.0, 60, 20)
    x = cylinder.vertices[:, 0]
    disk, triangles, vertices = disk_of(cylinder, (x[cylinder.faces] >= -1e-9).all(axis=1))
    uv = _core.bff(disk).uv if flatten == "bff" else _core.lscm(disk)
    measured = edge_scale(uv, cylinder.vertices[vertices], triangles)
    assert np.abs(measured - measured.mean()).max() < 2e-3


@pytest.mark.parametrize(
    "name", ["cone_16_sections.obj", "annulus_raw.obj", "cylinder_28_sections_flat.obj"]
)
def test_coarse_solids_of_the_collection_get_an_atlas(case_path, name):
    surface = pa.load(case_path(name))
    atlas = pa.build_atlas(pa.segment(surface, 3))
    assert atlas.bake(resolution=64).shape == (64, 64, 3)
    labelled = np.concatenate([chart.faces[chart.labelled] for chart in atlas.charts])
    assert np.array_equal(np.sort(labelled), np.arange(surface.n_faces))


def test_a_tetrahedron_is_one_chart():
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    surface = pa.Surface(points, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    labels, weights = np.zeros(4, dtype=np.int64), np.ones((1, 4))
    (chart,) = pa.build_atlas(pa.Segmentation(surface, labels, weights)).charts
    assert len(chart.uv) > 4


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("labels", [0, 0, 1, 0], r"labels\[2\]: 1 must be in 0\.\.0"),
        ("labels", [0.0] * 4, "labels: dtype float64 must be an integer type"),
        ("labels", [0] * 3, "labels: shape"),
        ("weights", [[1, 1, 1, np.nan]], r"weights\[0, 3\]: nan must be in \[0, 1\]"),
        ("weights", [[1, -0.5, 1, 1]], r"weights\[0, 1\]: -0\.5 must be in \[0, 1\]"),
        ("weights", [[1, 1, 1]], "weights: shape"),
    ],
)
def test_labels_and_weights_that_make_no_segmentation_are_named(name, value, message):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    surface = pa.Surface(points, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    arguments = {"labels": [0, 0, 0, 0], "weights": [[1, 1, 1, 1]]}
    assert pa.Segmentation(surface, **arguments).areas.shape == (1,)
    with pytest.raises(ValueError, match=f"^{message}"):
        pa.Segmentation(surface, **arguments | {name: value})


def test_faces_whose_weights_fall_below_the_threshold_are_in_their_charts():
    # Even weights are above no threshold that a domain may have.
    surface = pa.datasets.icosphere(2)
    labels = np.arange(surface.n_faces) % 4
    weights = np.full((4, surface.n_vertices), 0.25)
    atlas = pa.build_atlas(pa.Segmentation(surface, labels, weights))
    total = np.zeros(surface.n_vertices)
    for chart in atlas.charts:
        copies = np.bincount(chart.vertices, minlength=surface.n_vertices)
        np.add.at(total, chart.vertices, chart.weights / copies[chart.vertices])
        corners = chart.weights[chart.triangles[chart.labelled]]
        assert (corners > 0).any(axis=1).all()
    np.testing.assert_allclose(total, 1, rtol=1e-12)
    assert np.isfinite(atlas.vertex_colors()).all()
