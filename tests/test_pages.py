"""Charts apart at every mip level, at a texel density, and shared out over pages."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import phaseatlas as pa
from phaseatlas import _core, datasets
from phaseatlas.atlas import Atlas
from phaseatlas.atlas.metrics import flaws
from phaseatlas.atlas.pages import MAX_SIDE, PackOptions, lay_out, pages_of_subtrees
from phaseatlas.quality import QualityWarning
from phaseatlas.scene.components import as_it_is
from phaseatlas.scene.document import read_document
from phaseatlas.scene.scene import Scene
from phaseatlas.segmentation import SceneSegmentation
from test_packing import charts_of, cut_sheet, lengths, signed_areas


@pytest.fixture(scope="module")
def sheet():
    return cut_sheet()


@pytest.fixture(scope="module")
def squares():
    """A sheet of unit squares, each a chart of two faces."""
    surface = datasets.sheet(6, 3, size=(6.0, 3.0))
    corner = surface.vertices[surface.faces].mean(axis=1)
    labels = np.floor(corner[:, 0]).astype(int) + 6 * np.floor(corner[:, 1]).astype(int)
    return surface, labels, charts_of(surface, labels)


def points_of(corners, spacing):
    """Points on the sides of faces, no further than `spacing` apart."""
    found = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        side = corners[:, b] - corners[:, a]
        count = int(np.ceil(np.linalg.norm(side, axis=1).max() / spacing)) + 1
        t = np.linspace(0.0, 1.0, count)[:, None, None]
        found.append((corners[:, a] + t * side).reshape(-1, 2))
    return np.concatenate(found)


def apart(uv, labels):
    """Least distance of the sides of two charts, a little more than it is."""
    points = [points_of(uv[labels == k], 1 / 2000) for k in np.unique(labels)]
    trees = [cKDTree(cloud) for cloud in points]
    return min(trees[i].query(points[j])[0].min() for i in range(len(points)) for j in range(i))


def pyramid(uv, labels, resolution, level):
    """Part of each texel of a level that each chart touches: a box filter of full-size images."""
    images = []
    for k in np.unique(labels):
        image = np.zeros((resolution, resolution))
        own = uv[labels == k]
        inside, _ = _core.rasterize(np.ascontiguousarray(own), resolution)
        image[np.unravel_index(np.flatnonzero(inside >= 0), image.shape)] = 1.0
        # What is touched without its centre lies on a side of a face.
        at = np.minimum(points_of(own, 0.1 / resolution) * resolution, resolution - 1e-9)
        image[resolution - 1 - at[:, 1].astype(int), at[:, 0].astype(int)] = 1.0
        for _ in range(level):
            image = 0.25 * (
                image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]
            )
        images.append(image)
    return np.array(images)


@pytest.mark.parametrize(("mips", "padding", "resolution"), [(2, 0, 256), (3, 1, 512), (3, 4, 512)])
def test_no_texel_of_the_pyramid_is_touched_by_two_charts(squares, mips, padding, resolution):
    surface, labels, charts = squares
    options = PackOptions(padding=padding, mips=mips, resolution=resolution)
    uv = lay_out(charts, surface.n_faces, options).uv
    for level in range(mips + 1):
        touched = (pyramid(uv, labels, resolution, level) > 0).sum(axis=0)
        assert touched.max() == 1
    assert apart(uv, labels) * resolution >= padding * 2**mips * (1 - 1e-9)
    # The same without the levels: texels of the last are touched by several.
    uv = lay_out(charts, surface.n_faces, PackOptions(padding, resolution)).uv
    assert (pyramid(uv, labels, resolution, mips) > 0).sum(axis=0).max() > 1


def test_gutters_keep_colours_apart_at_every_level(squares):
    surface, labels, charts = squares
    mips, resolution = 3, 512
    made = lay_out(charts, surface.n_faces, PackOptions(3, resolution, mips))
    atlas = Atlas(surface, labels, charts, made.uv, made.pages, made.resolution)

    def colour_of_chart(places):
        # The charts lie a hundred units from each other in their planes.
        scale = 4.0 / np.sqrt(surface.area)
        number = np.round((places / scale).mean(axis=1) / 100.0)
        return np.repeat(number[:, None] / 255.0, 3, axis=1)

    image = atlas.bake(colour_of_chart, blend=False)[..., 0].astype(float)
    assert image.shape == (resolution, resolution)
    for level in range(mips + 1):
        touched = pyramid(made.uv, labels, resolution, level) > 0
        rows, columns = np.nonzero(touched.any(axis=0))
        np.testing.assert_array_equal(image[rows, columns], touched.argmax(axis=0)[rows, columns])
        image = 0.25 * (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2])


def test_levels_that_cannot_be_kept_apart_are_refused_or_said(squares):
    surface, _, _ = squares
    with pytest.raises(ValueError, match=r"mips: 6 puts 256 texels between charts, .* most 128"):
        PackOptions(mips=6)
    with pytest.raises(ValueError, match="resolution: 1000 must be a multiple of 16 for mips 4"):
        PackOptions(resolution=1000, mips=4)
    with pytest.raises(ValueError, match=r"mips: -1 must be in 0\.\.14"):
        PackOptions(mips=-1)
    # A chart a face leaves no room for as much as is allowed.
    labels = np.arange(surface.n_faces)
    options = PackOptions(padding=2, resolution=128, mips=3)
    with pytest.warns(QualityWarning) as said:
        lay_out(charts_of(surface, labels), surface.n_faces, options)
    words = [str(warning.message) for warning in said]
    assert "mips: texels of level 3 are touched by several charts" in words


@pytest.mark.parametrize(("density", "padding", "mips"), [(100.0, 4, 0), (37.0, 2, 2), (5.0, 1, 3)])
def test_density_is_the_same_for_every_mesh(squares, sheet, density, padding, mips):
    for surface, labels, charts in (squares, sheet):
        options = PackOptions(padding=padding, density=density, mips=mips)
        made = lay_out(charts, surface.n_faces, options)
        side = made.resolution
        texels = side * lengths(made.uv) / lengths(surface.vertices[surface.faces])
        np.testing.assert_allclose(texels, density, rtol=1e-9)
        assert side % max(4, 2**mips) == 0
        assert apart(made.uv, labels) * side >= options.texels * (1 - 1e-6)
        # One step less has no room for the square of the charts and half the padding around it.
        extent = np.ptp(made.uv, axis=(0, 1)).max() * side + options.texels
        assert extent > side - max(4, 2**mips)
        assert made.uv.min() >= 0.5 * options.texels / side - 1e-12
        atlas = Atlas(surface, labels, charts, made.uv, made.pages, side)
        assert atlas.density == pytest.approx(density, rel=1e-9)


def test_a_density_that_is_too_large_names_the_pages_it_takes(sheet):
    surface, _, charts = sheet
    message = rf"density: 20000 texels a unit take pages of \d+ texels .* more than {MAX_SIDE}; "
    with pytest.raises(ValueError, match=message + r"pages must be at least \d+, or") as early:
        PackOptions(density=20000.0).check_area(surface.area)
    with pytest.raises(ValueError, match=message) as late:
        lay_out(charts, surface.n_faces, PackOptions(density=20000.0))
    assert "\n" not in str(late.value)
    # The one before the packing guesses.
    words = [str(error.value).split("at least ")[1].split(",")[0] for error in (early, late)]
    assert abs(int(words[0]) - int(words[1])) <= 1
    with pytest.raises(ValueError, match="resolution: value must be left out with density"):
        PackOptions(density=1.0, resolution=64)
    with pytest.raises(ValueError, match=r"density: -1\.0 must be a positive number"):
        PackOptions(density=-1.0)


@pytest.mark.parametrize("options", [{"mips": 2, "resolution": 512}, {"density": 40.0}])
def test_pages_share_one_scale_and_keep_the_gap(squares, options):
    surface, labels, charts = squares
    given = PackOptions(pages=3, **options)
    made = lay_out(charts, surface.n_faces, given)
    assert sorted(np.unique(made.pages)) == [0, 1, 2]
    texels = made.resolution * lengths(made.uv) / lengths(surface.vertices[surface.faces])
    np.testing.assert_allclose(texels, texels[0, 0], rtol=1e-9)
    page_of_face = made.pages[labels]
    for page in range(3):
        mine = page_of_face == page
        assert mine.sum() == surface.n_faces // 3
        assert (signed_areas(made.uv[mine]) > 0.0).all()
        assert _core.rasterize(made.uv[mine], 1024)[1].max() == 1
        least = given.texels / made.resolution
        assert apart(made.uv[mine], labels[mine]) >= least * (1 - 1e-6)
        assert made.uv[mine].min() >= 0.5 * least - 1e-12
        assert made.uv[mine].max() <= 1.0 - 0.5 * least + 1e-12
    # Three pages have texels for three times the area.
    alone = lay_out(charts, surface.n_faces, PackOptions(**options))
    if given.density is None:
        grown = signed_areas(made.uv).sum() / signed_areas(alone.uv).sum()
        assert 2.2 < grown < 3.5
    else:
        assert made.resolution < 0.75 * alone.resolution


def test_large_and_small_charts_are_shared_out_evenly(sheet):
    surface, labels, charts = sheet
    made = lay_out(charts, surface.n_faces, PackOptions(pages=2))
    areas = np.bincount(made.pages[labels], weights=surface.face_areas)
    # No chart could change its page for better.
    smallest = np.bincount(labels, weights=surface.face_areas).min()
    assert abs(areas[0] - areas[1]) <= max(smallest, 0.2 * surface.area)
    with pytest.warns(QualityWarning, match="pages: 5 charts fill 5 pages, not 7"):
        lay_out(charts, surface.n_faces, PackOptions(pages=7))
    with pytest.raises(ValueError, match=r"pages: 0 must be in 1\.\.100"):
        PackOptions(pages=0)


def test_subtrees_of_equal_area_fill_equal_pages():
    surface = datasets.icosphere(2)
    tree = pa.segment(surface, 2)
    atlas = pa.build_atlas(tree, pages=2, resolution=256)
    np.testing.assert_array_equal(atlas.face_pages, tree.labels_at(1))
    areas = np.bincount(atlas.face_pages, weights=surface.face_areas)
    np.testing.assert_allclose(areas, 0.5 * surface.area, rtol=0.05)
    # A scene has a tree for each piece.
    scene = Scene([("", as_it_is(surface.vertices, surface.faces))])
    of_scene = SceneSegmentation.of_trees(scene, [tree])
    np.testing.assert_array_equal(pages_of_subtrees(of_scene, atlas.charts, 2), atlas.pages)
    # Three pages are no level of the tree.
    assert (pages_of_subtrees(tree, atlas.charts, 3) == -1).all()
    other = atlas.packed(pages=3, resolution=256)
    assert other.n_pages == 3


def test_an_atlas_of_pages_is_rated_page_by_page(squares):
    surface, labels, charts = squares
    made = lay_out(charts, surface.n_faces, PackOptions(pages=2))
    atlas = Atlas(surface, labels, charts, made.uv, made.pages, made.resolution)
    assert atlas.n_pages == 2
    assert atlas.diagnostics.fatal() == []
    # Seen as one page they cover each other.
    assert flaws(surface, atlas.uv).overlap > 0
    metrics = atlas.metrics()
    assert metrics["charts"] == len(charts)
    assert metrics["overlap"] == 0
    assert 50 < metrics["packing"] <= 100
    tiles = np.floor(atlas.udim.mean(axis=1)).astype(int)
    np.testing.assert_array_equal(tiles[:, 0] + 10 * tiles[:, 1], atlas.face_pages)
    np.testing.assert_allclose(atlas.udim - tiles[:, None], atlas.uv, atol=1e-12)
    again = atlas.packed(pages=2, padding=8)
    np.testing.assert_array_equal(again.pages, atlas.pages)
    single = atlas.packed()
    assert single.n_pages == 1


def test_each_page_is_baked_by_itself(squares):
    surface, labels, charts = squares
    made = lay_out(charts, surface.n_faces, PackOptions(pages=2, resolution=128))
    atlas = Atlas(surface, labels, charts, made.uv, made.pages, made.resolution)
    with pytest.raises(ValueError, match="page: value must be given, for there are 2 of them"):
        atlas.bake()
    with pytest.raises(ValueError, match=r"page: 2 must be in 0\.\.1"):
        atlas.bake(page=2)

    def colour_of_chart(places):
        number = np.round((places * np.sqrt(surface.area) / 4.0).mean(axis=1) / 100.0)
        return np.repeat(number[:, None] / 255.0, 3, axis=1)

    for page in range(2):
        image = atlas.bake(colour_of_chart, blend=False, page=page)
        assert image.shape == (128, 128, 3)
        assert set(np.unique(image)) == set(np.flatnonzero(atlas.pages == page).tolist())


def test_unwrap_gives_tiles():
    surface = datasets.icosphere(2)
    made = pa.unwrap(surface.vertices, surface.faces, pages=2, udim=True, effort="fast")
    column = np.floor(made.corners.mean(axis=1)).astype(int)
    np.testing.assert_array_equal(column[:, 0], made.pages)
    assert set(made.pages) == {0, 1}
    assert (column[:, 1] == 0).all()


def test_pages_are_saved_and_drawn(squares, tmp_path):
    surface, labels, charts = squares
    made = lay_out(charts, surface.n_faces, PackOptions(pages=2, resolution=128))
    atlas = Atlas(surface, labels, charts, made.uv, made.pages, made.resolution)
    images = [np.full((128, 128, 3), colour, dtype=np.uint8) for colour in (60, 180)]
    for name in ("a.obj", "a.glb"):
        atlas.save(tmp_path / name, image=images)
        (mesh,) = read_document(tmp_path / name).meshes
        names = [material.name for material in read_document(tmp_path / name).materials]
        of = [int(names[k][-4:]) - 1001 for k in mesh.material_of]
        middles = mesh.positions[mesh.corners].reshape(-1, 3, 3).mean(axis=1)
        given = surface.vertices[surface.faces].mean(axis=1)
        nearest = cKDTree(given).query(middles)[1]
        np.testing.assert_array_equal(of, atlas.face_pages[nearest])
    with pytest.raises(ValueError, match="image: 1 images must be 2, one a page"):
        atlas.save(tmp_path / "a.obj", image=images[0])
    atlas.save(tmp_path / "a.html", image=images)
    assert (tmp_path / "a.html").stat().st_size > 10_000
    atlas.save(tmp_path / "a.npz")
    again = pa.Atlas.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.pages, atlas.pages)
    assert "2 pages" in repr(again)
    picture = pa.plot.uv_layout(atlas, images, views=0, size=64)
    assert picture.shape[1] > 2 * 64
    with pytest.raises(ValueError, match="image: 1 images must be 2, one a page"):
        pa.plot.uv_layout(atlas, images[:1], views=0, size=64)


def test_a_density_that_leaves_no_texel_is_refused():
    tiny = pa.datasets.icosphere(2).scaled(1e-6)
    with pytest.raises(ValueError, match="density: 64 texels a unit leave less than a texel"):
        pa.unwrap(tiny, density=64.0, effort="fast")
    assert pa.unwrap(tiny, density=1e7, effort="fast").atlas.resolution >= 32
