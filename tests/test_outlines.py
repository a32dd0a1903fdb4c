"""Outlines: lengths, seams and notches, in the record and in the files that are written."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from collections import defaultdict
from xml.etree import ElementTree

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas.atlas.chains import chains

SVG = "{http://www.w3.org/2000/svg}"


def atlases():
    """Atlases of closed, open and cut-open surfaces, by name."""
    star = pa.datasets.starfish(3)
    ball = pa.datasets.icosphere(3)
    cap = (ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0.6).astype(int)
    sheet = pa.datasets.sheet(14, 12, amplitude=0.1)
    middle = np.linalg.norm(
        sheet.vertices[sheet.faces].mean(axis=1) - sheet.vertices.mean(axis=0), axis=1
    )
    return {
        "star": pa.partition(star),
        # The seam of the cap is closed, and has no end.
        "cap": pa.Segmentation(ball, cap),
        # One chart that is cut open: it is its own neighbour.
        "torus": pa.Segmentation(pa.datasets.torus(n_major=24, n_minor=12), np.zeros(576, int)),
        # A ring around a disk, with the surface's own boundary outside.
        "ring": pa.Segmentation(sheet, (middle < 0.25).astype(int)),
        "flat": pa.Segmentation(
            pa.datasets.sheet(14, 12, amplitude=0.0),
            (middle < 0.25).astype(int),
        ),
    }


@pytest.fixture(scope="module", params=["star", "cap", "torus", "ring", "flat"])
def atlas(request):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pa.QualityWarning)
        return pa.build_atlas(atlases()[request.param], flatten="isometric", overlap=False)


@pytest.fixture(scope="module")
def outlines(atlas):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pa.QualityWarning)
        return atlas.outlines(spacing=0.3)


def boundary_length(chart):
    """Length of the boundary of a chart's labelled faces in its own plane, edge by edge."""
    triangles = chart.triangles[chart.labelled].tolist()
    edges = {edge for t in triangles for edge in zip(t, t[1:] + t[:1], strict=True)}
    return sum(np.linalg.norm(chart.uv[a] - chart.uv[b]) for a, b in edges if (b, a) not in edges)


def ring_length(points):
    return np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()


def signed_area(points):
    (x, y), (x1, y1) = points.T, np.roll(points, -1, axis=0).T
    return 0.5 * (x * y1 - x1 * y).sum()


def lifted(outlines, surface, point):
    """Points of the surface at a point of the sheet, from the nearest place on an outline."""
    best, found = np.inf, None
    for piece in outlines.pieces:
        for loop, vertices in zip(piece.loops, piece.vertices, strict=True):
            ends, ahead = np.roll(loop, -1, axis=0), np.roll(vertices, -1)
            along = ends - loop
            t = np.clip(((point - loop) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
            apart = np.linalg.norm(loop + t[:, None] * along - point, axis=1)
            k = int(np.argmin(apart))
            if apart[k] < best:
                best = apart[k]
                a, b = surface.vertices[[vertices[k], ahead[k]]]
                found = a + t[k] * (b - a)
    assert best < 1e-9
    return found


def test_lengths_and_areas_are_those_of_the_charts(atlas, outlines):
    lengths, areas = defaultdict(float), defaultdict(float)
    for piece in outlines.pieces:
        assert atlas.charts[piece.chart].segment == piece.segment
        lengths[piece.chart] += sum(map(ring_length, piece.loops))
        # Holes run the other way.
        areas[piece.chart] += sum(map(signed_area, piece.loops))
        assert signed_area(piece.loops[0]) > 0
        assert all(signed_area(loop) < 0 for loop in piece.loops[1:])
    for number, chart in enumerate(atlas.charts):
        assert lengths[number] == pytest.approx(boundary_length(chart), rel=1e-9)
        own = atlas.surface.face_areas[chart.faces[chart.labelled]].sum()
        assert areas[number] == pytest.approx(own, rel=1e-9)
    points = np.concatenate([loop for piece in outlines.pieces for loop in piece.loops])
    assert (points > 0).all()
    assert (points < outlines.size).all()


def test_labels_lie_inside(outlines):
    for piece in outlines.pieces:
        x, y = piece.label
        crossings = 0
        for loop in piece.loops:
            for (x0, y0), (x1, y1) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
                if (y0 > y) != (y1 > y):
                    crossings += x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        assert crossings % 2 == 1


def test_seams_are_all_edges_between_pieces(atlas, outlines):
    """Each edge inside the surface at which the layout is open is on one seam, once."""
    surface, uv = atlas.surface, atlas.uv
    corner = {}
    for face, places in zip(surface.faces.tolist(), uv, strict=True):
        for k in range(3):
            corner[face[k], face[(k + 1) % 3]] = places[[k, (k + 1) % 3]]
    expected = {
        tuple(sorted(edge))
        for edge, places in corner.items()
        if edge[::-1] in corner and np.abs(corner[edge[::-1]][::-1] - places).max() > 1e-7
    }
    found = [
        tuple(sorted(edge))
        for seam in outlines.seams
        for edge in zip(seam.vertices[:-1].tolist(), seam.vertices[1:].tolist(), strict=True)
    ]
    assert len(found) == len(set(found))
    assert set(found) == expected
    for seam in outlines.seams:
        along = np.diff(surface.vertices[seam.vertices], axis=0)
        assert seam.length == pytest.approx(np.linalg.norm(along, axis=1).sum())


def test_notches_pair_up(atlas, outlines):
    notches = outlines.notches
    assert set(notches.seam) == set(range(len(outlines.seams)))
    for seam, arclength, position, points in zip(
        notches.seam, notches.arclength, notches.position, notches.points, strict=True
    ):
        assert 0 < arclength < outlines.seams[seam].length
        for point in points:
            place = lifted(outlines, atlas.surface, point)
            np.testing.assert_allclose(place, position, atol=1e-9)
        # They are apart on the sheet.
        assert np.linalg.norm(points[0] - points[1]) > 1e-3
    for number, seam in enumerate(outlines.seams):
        at = notches.arclength[notches.seam == number]
        np.testing.assert_allclose(np.diff(at), seam.length / len(at))
        assert abs(seam.length / len(at) - 0.3) < 0.3


def test_notches_point_into_their_pieces(outlines):
    notches = outlines.notches
    inside = notches.points + 1e-6 * notches.inward
    for seam, ends in zip(notches.seam, inside, strict=True):
        for number, (x, y) in zip(outlines.seams[seam].pieces, ends, strict=True):
            crossings = 0
            for loop in outlines.pieces[number].loops:
                ahead = np.roll(loop, -1, axis=0)
                spans = (loop[:, 1] > y) != (ahead[:, 1] > y)
                a, b = loop[spans], ahead[spans]
                part = (y - a[:, 1]) / (b[:, 1] - a[:, 1])
                crossings += (x < a[:, 0] + part * (b[:, 0] - a[:, 0])).sum()
            assert crossings % 2 == 1


def test_shapes_of_seams():
    found = atlases()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pa.QualityWarning)
        sheets = {
            name: pa.build_atlas(found[name], flatten="isometric", overlap=False).outlines()
            for name in ("cap", "torus", "flat")
        }
    (seam,) = sheets["cap"].seams
    assert seam.vertices[0] == seam.vertices[-1]
    assert {tuple(seam.pieces) for seam in sheets["torus"].seams} == {(0, 0)}
    # A flat ring keeps its hole, and flat sides are as long as the seam.
    assert sorted(len(piece.loops) for piece in sheets["flat"].pieces) == [1, 2]
    (seam,) = sheets["flat"].seams
    np.testing.assert_allclose(seam.flat, seam.length, rtol=1e-6)


def test_sides_that_differ_are_said():
    segments = pa.segment(pa.datasets.starfish(3), 2)
    with pytest.warns(pa.QualityWarning, match=r"seams: the sides of \d+ of \d+ differ in length"):
        pa.build_atlas(segments).outlines()


def test_a_disk_has_no_seam(tmp_path):
    sheet = pa.datasets.sheet(8, 8, amplitude=0.0)
    alone = pa.build_atlas(pa.Segmentation(sheet, np.zeros(sheet.n_faces, int))).outlines()
    assert alone.seams == ()
    assert alone.notches.points.shape == (0, 2, 2)
    alone.save(tmp_path / "a.svg")
    alone.save(tmp_path / "a.dxf")


def svg_rings(path):
    """Loops, strokes and texts of an SVG file, y up, in its user units; and its size in mm."""
    root = ElementTree.parse(path).getroot()
    _, _, _, height = map(float, root.get("viewBox").split())
    groups = {group.get("id"): group for group in root.iter(f"{SVG}g")}

    def paths(name):
        for path in groups[name].iter(f"{SVG}path"):
            runs = re.findall(r"M ([^MZ]*)", path.get("d"))
            yield [
                np.array([point.split(",") for point in run.split()], float) * [1, -1] + [0, height]
                for run in runs
            ]

    texts = [text.text for text in groups["labels"].iter(f"{SVG}text")]
    size = tuple(float(root.get(side).removesuffix("mm")) for side in ("width", "height"))
    return list(paths("outlines")), list(paths("notches")), texts, size


@pytest.mark.parametrize(("unit", "millimetres"), [("mm", 1), ("m", 1000), ("in", 25.4)])
def test_svg(atlas, outlines, tmp_path, unit, millimetres):
    outlines.save(tmp_path / "a.svg", unit=unit)
    pieces, strokes, texts, size = svg_rings(tmp_path / "a.svg")
    np.testing.assert_allclose(size, millimetres * outlines.size)
    for rings, piece in zip(pieces, outlines.pieces, strict=True):
        for ring, loop in zip(rings, piece.loops, strict=True):
            np.testing.assert_allclose(ring, loop, atol=1e-12)
    # Both strokes of a notch start at one point of the surface.
    for pair in strokes:
        first, second = (lifted(outlines, atlas.surface, stroke[0]) for stroke in pair)
        np.testing.assert_allclose(first, second, atol=1e-8)
    numbers = [str(k) for k in range(len(strokes)) for _ in range(2)]
    assert sorted(texts) == sorted([*numbers, *(str(piece.chart) for piece in outlines.pieces)])
    assert f"is 1 {unit}." in (tmp_path / "a.svg").read_text()


@pytest.mark.parametrize(("unit", "number"), [("mm", 4), ("m", 6), ("in", 1)])
def test_dxf(atlas, outlines, tmp_path, unit, number):
    ezdxf = pytest.importorskip("ezdxf", reason="ezdxf is not installed")
    outlines.save(tmp_path / "a.dxf", unit=unit)
    document = ezdxf.readfile(tmp_path / "a.dxf")
    assert not document.audit().errors
    assert document.units == number
    space = document.modelspace()
    loops = [loop for piece in outlines.pieces for loop in piece.loops]
    drawn = space.query('LWPOLYLINE[layer=="outlines"]')
    for line, loop in zip(drawn, loops, strict=True):
        assert line.closed
        np.testing.assert_allclose(np.array(line.get_points("xy")), loop, atol=1e-12)
    strokes = [np.array(line.dxf.start)[:2] for line in space.query('LINE[layer=="notches"]')]
    assert len(strokes) == 2 * len(outlines.notches.seam)
    for first, second in zip(strokes[::2], strokes[1::2], strict=True):
        places = [lifted(outlines, atlas.surface, point) for point in (first, second)]
        np.testing.assert_allclose(*places, atol=1e-8)
    texts = [text.dxf.text for text in space.query('TEXT[layer=="labels"]')]
    assert len(texts) == len(strokes) + len(outlines.pieces)
    outlines.save(tmp_path / "b.dxf", unit=unit)
    assert (tmp_path / "a.dxf").read_bytes() == (tmp_path / "b.dxf").read_bytes()


def test_what_cannot_be_drawn_is_refused(outlines, atlas, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"outlines: .* must end in .svg or .dxf"):
        outlines.save(tmp_path / "a.pdf")
    with pytest.raises(ValueError, match="unit: 'ell' must be one of"):
        outlines.save(tmp_path / "a.svg", unit="ell")
    with pytest.raises(ValueError, match="spacing: 0 must be a positive number"):
        atlas.outlines(spacing=0)
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ImportError, match=r"needs ezdxf: pip install 'phaseatlas\[dxf\]'"):
        outlines.save(tmp_path / "a.dxf")
    assert not list(tmp_path.iterdir())


def test_command_line(tmp_path):
    model = tmp_path / "model.obj"
    pa.save_mesh(pa.datasets.starfish(3), model)
    command = [sys.executable, "-m", "phaseatlas", "atlas", model, "-o", tmp_path / "out.glb"]
    drawing = tmp_path / "pieces.svg"
    command += ["--outlines", drawing, "--unit", "cm", "--cut"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    pieces, strokes, _, _ = svg_rings(drawing)
    assert pieces
    assert strokes
    assert "is 1 cm." in drawing.read_text()


def test_members_of_rings_and_chains_are_in_order():
    # A ring 0, 3, 1; a chain 5, 2, 4; and one member alone.
    following = np.array([3, 0, 4, 1, -1, 2, -1])
    found = [each.tolist() for each in chains(following)]
    assert found == [[0, 3, 1], [5, 2, 4], [6]]
    assert chains(np.zeros(0, dtype=np.int64)) == []
