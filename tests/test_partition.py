"""Charts by energy: the figures against their twins, the moves, and what every partition keeps."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import phaseatlas as pa
import reference
from phaseatlas import _core, datasets
from phaseatlas.partitioning import Phase
from phaseatlas.partitioning.pieces import first_copies
from phaseatlas.scene.repair import repair
from phaseatlas.scene.scene import Scene


def figures(surface: pa.Surface, labels: np.ndarray, distortion: float = 600.0) -> dict:
    core = _core.Partition(surface._mesh, distortion)
    core.set_labels(np.ascontiguousarray(labels, dtype=np.int64), 0.0)
    names = ["energy", "seam", "cuts", "distortion", "overlap", "smallest", "charts", "overlapping"]
    return dict(zip(names, core.figures(), strict=True))


def cap(surface: pa.Surface, height: float) -> np.ndarray:
    """1 above a height, 0 below."""
    centroids = surface.vertices[surface.faces].mean(axis=1)
    return (centroids[:, 2] > height).astype(np.int64)


def globe(rings: int, radius: float) -> pa.Surface:
    """A sphere of parallels and meridians; the equator runs along edges."""
    around = 2 * rings
    polar = np.pi * np.arange(1, rings) / rings
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.stack(np.broadcast_arrays(np.cos(angle), np.sin(angle)), axis=1)
    inner = np.concatenate(
        [np.column_stack([np.sin(t) * ring, np.full(around, np.cos(t))]) for t in polar]
    )
    vertices = radius * np.concatenate([inner, [[0, 0, 1], [0, 0, -1]]])
    north, south = len(inner), len(inner) + 1
    i, j = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.column_stack([np.full(around, north), i, j])]
    for row in range(rings - 2):
        a, b = row * around, (row + 1) * around
        faces += [
            np.column_stack([a + i, b + i, b + j]),
            np.column_stack([a + i, b + j, a + j]),
        ]
    last = (rings - 2) * around
    faces.append(np.column_stack([last + i, np.full(around, south), last + j]))
    return pa.Surface(vertices, np.concatenate(faces))


def maps(surface: pa.Surface, labels: np.ndarray) -> list[np.ndarray]:
    """Boundary-first maps, made by the other route: (k, 3, 2) corners of each chart."""
    found = []
    for label in range(labels.max() + 1):
        faces = np.flatnonzero(labels == label)
        disk = surface.cut_to_disk(faces)
        found.append(_core.bff(disk.mesh).uv[disk.triangles])
    return found


def twice_signed_areas(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


# --------------------------------------------------------------------------------------------------
# figures
# --------------------------------------------------------------------------------------------------


def test_hemispheres() -> None:
    # 2 pi R^2 (2 ln^2 2 - 4 ln 2 + 2) for each, the equator between them.
    sphere = globe(60, 3.0)
    found = figures(sphere, cap(sphere, 0.0))
    log2 = np.log(2.0)
    expected = 2 * np.pi * (2 * log2**2 - 4 * log2 + 2) * 2 / (4 * np.pi)
    assert found["distortion"] == pytest.approx(expected, rel=2e-3)
    assert found["charts"] == 2
    assert found["overlapping"] == 0
    assert found["seam"] == pytest.approx(2 * np.pi / np.sqrt(4 * np.pi), rel=1e-3)


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_energy_of_disks(height: float) -> None:
    sphere = datasets.icosphere(2, radius=0.7)
    labels = cap(sphere, height)
    found = figures(sphere, labels, 50.0)
    expected = reference.partition_energy(sphere.vertices, sphere.faces, labels, 50.0)
    assert found["energy"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_figures_agree_with_the_flattening(seed: int) -> None:
    # Charts of any topology: the same cut, the same scale as in the mesh of the chart.
    torus = datasets.torus(1.0, 0.4, 28, 12)
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(1 + 2 * seed, 3))
    centroids = torus.vertices[torus.faces].mean(axis=1)
    labels = ((centroids[:, None] - centres) ** 2).sum(axis=2).argmin(axis=1)
    parts = torus.label_components(labels)
    cuts = total = 0.0
    for label in range(parts.max() + 1):
        disk = torus.cut_to_disk(np.flatnonzero(parts == label))
        log_scale = _core.bff(disk.mesh).log_scale
        cuts, total = cuts + disk.length, total + disk.mesh.mass() @ log_scale**2
    found = figures(torus, labels)
    assert found["charts"] == parts.max() + 1
    assert found["cuts"] == pytest.approx(cuts / np.sqrt(torus.area), rel=1e-12)
    assert found["distortion"] == pytest.approx(total / torus.area, rel=1e-9)


def test_flat_sheet_with_holes_needs_no_cut() -> None:
    sheet = datasets.sheet(16, 13, amplitude=0.0)
    centroids = sheet.vertices[sheet.faces].mean(axis=1)
    inside = np.linalg.norm(centroids - [0.3, 0.3, 0.0], axis=1) < 0.2
    found = figures(sheet, inside)
    assert found["charts"] == 2
    assert found["cuts"] == 0.0
    assert found["distortion"] == pytest.approx(0.0, abs=1e-20)


def test_units_do_not_matter() -> None:
    sphere = datasets.icosphere(3)
    small, large = (figures(sphere.scaled(s), cap(sphere, 0.2)) for s in (1e-6, 1e6))
    assert small == pytest.approx(large, rel=1e-9)


# --------------------------------------------------------------------------------------------------
# moves
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 5, 20])
def test_cells(count: int) -> None:
    # Random positions leave no ties.
    sheet = datasets.sheet(7, 5, amplitude=0.2)
    rng = np.random.default_rng(0)
    surface = pa.Surface(sheet.vertices + 0.01 * rng.normal(size=sheet.vertices.shape), sheet.faces)
    core = _core.Partition(surface._mesh, 600.0)
    core.set_cells(count)
    expected = reference.ward_cells(surface.vertices, surface.faces, count)
    found = core.labels()
    assert len(set(zip(found, expected, strict=True))) == count
    assert len(np.unique(found)) == len(np.unique(expected)) == count


def test_every_move_lowers_the_energy() -> None:
    surface = datasets.starfish(3)
    core = _core.Partition(surface._mesh, 300.0)
    core.set_cells(40)
    energies = [core.figures()[0]]
    core.merge()
    energies.append(core.figures()[0])
    for _ in range(4):
        core.sweep()
        energies.append(core.figures()[0])
    for k in range(6):
        core.perturb(0, 2 * k, 2 * k + 2)
        energies.append(core.figures()[0])
    assert np.all(np.diff(energies) <= 1e-9)
    assert energies[-1] < 0.7 * energies[0]
    # What the core says of its labels is what a fresh start says.
    assert figures(surface, core.labels(), 300.0)["energy"] == pytest.approx(
        energies[-1], rel=1e-12
    )


def test_merging_stops_where_no_pair_pays() -> None:
    surface = datasets.rounded_cube(8)
    core = _core.Partition(surface._mesh, 300.0)
    core.set_cells(20)
    core.merge()
    labels, energy = core.labels(), core.figures()[0]
    neighbours = surface.face_neighbours
    pairs = {
        (min(a, b), max(a, b))
        for f, around in enumerate(neighbours)
        for a, b in ((labels[f], labels[g]) for g in around if g >= 0)
        if a != b
    }
    assert pairs
    for a, b in pairs:
        merged = np.where(labels == b, a, labels)
        assert figures(surface, merged, 300.0)["energy"] > energy


def test_folded_sheet_stays_whole() -> None:
    # Two flat sheets at a right angle: developable, one chart without distortion.
    sheet = datasets.sheet(40, 20, size=(2.0, 1.0), amplitude=0.0)
    vertices = sheet.vertices.copy()
    bend = np.clip(vertices[:, 0] - 1.0, 0.0, None)
    vertices[:, 0] -= bend
    vertices[:, 2] += bend
    found = pa.partition(pa.Surface(vertices, sheet.faces))
    assert found.n_segments == 1
    assert found.diagnostics[-1].distortion == pytest.approx(0.0, abs=1e-18)


# --------------------------------------------------------------------------------------------------
# pa.partition
# --------------------------------------------------------------------------------------------------


def _box(x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Twelve faces."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [triangle for a, b, c, d in quads for triangle in ([a, b, c], [a, c, d])]
    return corners * [x, y, z], np.array(faces)


def check(surface: pa.Surface, found: pa.Partition) -> None:
    assert isinstance(found, pa.Segmentation)
    assert np.all(found.components == 1)
    np.testing.assert_allclose(found.weights.sum(axis=0), 1.0, atol=1e-12)
    assert np.all(found.weights >= 0.0)
    # A vertex inside a chart belongs to it alone.
    assert np.all(found.weights[found.labels[:, None], surface.faces] > 0.0)
    last = found.diagnostics[-1]
    assert last.n_charts == found.n_segments
    assert last.n_overlapping == 0
    assert last.smallest == pytest.approx(found.areas.min() / surface.area, rel=1e-9)
    assert last.smallest >= 1e-3
    for corners in maps(surface, found.labels):
        assert np.all(twice_signed_areas(corners) > 0.0)


@pytest.mark.parametrize(
    ("surface", "most"),
    [
        pytest.param(datasets.icosphere(4), 4, id="sphere"),
        pytest.param(datasets.rounded_cube(12), 6, id="cube"),
        pytest.param(datasets.torus(1.0, 0.4, 40, 16), 6, id="torus"),
        pytest.param(datasets.sheet(20, 14, amplitude=0.0), 1, id="sheet"),
        pytest.param(datasets.cylinder(), 1, id="cylinder"),
        pytest.param(datasets.icosphere(0), 20, id="icosahedron"),
        pytest.param(pa.Surface(*_box(1.0, 1.0, 1.0)), 6, id="box"),
        pytest.param(pa.Surface(*_box(1.0, 1.0, 0.01)), 2, id="plank"),
    ],
)
def test_plain_shapes(surface: pa.Surface, most: int) -> None:
    found = pa.partition(surface, effort="fast")
    check(surface, found)
    assert found.n_segments <= most


def strip(n: int, width: float, length: float, turn: bool = False) -> pa.Surface:
    """`n` squares in a row, or closed to a ring; a ring of three to a prism without ends."""
    i = np.arange(n if turn else n + 1)
    if turn:
        angle = 2 * np.pi * i / n
        along = length / (2 * np.pi) * np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        along = np.column_stack([length * i / n, np.zeros(len(i))])
    low = np.column_stack([along, np.zeros(len(i))])
    vertices = np.concatenate([low, low + np.array([0.0, 0.0, width])])
    a = np.arange(n)
    b = (a + 1) % len(i)
    c, d = a + len(i), b + len(i)
    faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    return pa.Surface(vertices, faces)


@pytest.mark.parametrize(
    ("surface", "cuts"),
    [
        pytest.param(pa.Surface(np.eye(3), np.array([[0, 1, 2]])), 0.0, id="one triangle"),
        pytest.param(strip(1, 1.0, 1.0), 0.0, id="two triangles"),
        pytest.param(strip(200, 1.0, 1e3), 0.0, id="long strip"),
        pytest.param(strip(60, 1e-5, 1.0), 0.0, id="needles"),
        # The seam of the development is the height.
        pytest.param(strip(3, 1.0, 3.0, turn=True), 1.0, id="prism"),
        pytest.param(strip(40, 1.0, 9.0, turn=True), 1.0, id="tube of 80 faces"),
    ],
)
def test_developable_pieces_stay_whole(surface: pa.Surface, cuts: float) -> None:
    found = pa.partition(surface, effort="fast")
    check(surface, found)
    last = found.diagnostics[-1]
    assert found.n_segments == 1
    assert last.seam == 0.0
    assert last.cuts == pytest.approx(cuts / np.sqrt(surface.area), rel=1e-9, abs=1e-15)
    assert last.distortion == pytest.approx(0.0, abs=1e-20)


def with_holes(bend: float) -> pa.Surface:
    """A sheet with three holes, bent along a line through one of them."""
    sheet = datasets.sheet(40, 30, amplitude=0.0)
    size = np.ptp(sheet.vertices, axis=0)[:2]
    centroids = sheet.vertices[sheet.faces].mean(axis=1)[:, :2]
    kept = np.ones(sheet.n_faces, dtype=bool)
    for place in ([0.3, 0.3], [0.7, 0.5], [0.3, 0.7]):
        kept &= np.linalg.norm(centroids - size * place, axis=1) > 0.1 * size.min()
    used, corners = np.unique(sheet.faces[kept], return_inverse=True)
    vertices = sheet.vertices[used].copy()
    beyond = np.clip(vertices[:, 0] - 0.7 * size[0], 0.0, None)
    vertices[:, 0] -= (1 - np.cos(bend)) * beyond
    vertices[:, 2] += np.sin(bend) * beyond
    return pa.Surface(vertices, corners.reshape(-1, 3))


def test_flat_sheet_with_holes_is_one_chart() -> None:
    found = pa.partition(with_holes(0.0), effort="fast")
    assert found.n_segments == 1
    assert found.diagnostics[-1].cuts == 0.0
    assert found.diagnostics[-1].distortion == 0.0
    assert found.diagnostics[-1].n_overlapping == 0


def test_banks_of_a_cut_may_touch() -> None:
    # Bent, the sheet is cut to its holes; in its development the banks of the cuts touch.
    found = pa.partition(with_holes(0.5 * np.pi), effort="fast")
    last = found.diagnostics[-1]
    assert found.n_segments == 1
    assert last.cuts > 0.0
    assert last.distortion == pytest.approx(0.0, abs=1e-20)
    assert last.n_overlapping == 0


@pytest.mark.parametrize(("around", "along"), [(3, 3), (4, 3), (5, 4), (7, 3)])
def test_tori_of_few_faces(around: int, along: int) -> None:
    surface = datasets.torus(1.0, 0.4, around, along)
    check(surface, pa.partition(surface, effort="fast"))


def test_flat_disk_is_one_chart() -> None:
    sheet = datasets.sheet(20, 20, amplitude=0.0)
    centroids = sheet.vertices[sheet.faces].mean(axis=1)
    round_ = np.linalg.norm(centroids - centroids.mean(axis=0), axis=1) < 0.4
    used, corners = np.unique(sheet.faces[round_], return_inverse=True)
    disk = pa.Surface(sheet.vertices[used], corners.reshape(-1, 3))
    found = pa.partition(disk)
    assert found.n_segments == 1
    assert found.diagnostics[-1].seam == 0.0
    assert found.diagnostics[-1].distortion == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("name", ["bunny", "fertility"])
def test_real_meshes(mesh_path, name: str) -> None:
    surface = pa.load(mesh_path(name))
    found = pa.partition(surface, effort="fast")
    check(surface, found)
    assert found.n_segments <= 9


def test_same_bytes_for_any_number_of_threads(tmp_path) -> None:
    program = (
        "import sys, numpy as np, phaseatlas as pa\n"
        "surface = pa.datasets.starfish(3)\n"
        "np.save(sys.argv[1], pa.partition(surface, effort='fast', seed=3).labels)\n"
    )
    for threads in "12":
        environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        path = str(tmp_path / threads)
        subprocess.run([sys.executable, "-c", program, path], env=environment, check=True)
    one, two = (np.load(tmp_path / f"{threads}.npy") for threads in "12")
    np.testing.assert_array_equal(one, two)


def test_bounds_are_met() -> None:
    surface = datasets.starfish(3)
    free = pa.partition(surface, effort="fast")
    few = pa.partition(surface, effort="fast", max_charts=2)
    assert few.n_segments <= 2
    # Less weight of the distortion jumps to one chart, of a hundred times as much of it.
    assert few.n_segments == 2
    assert few.diagnostics[-1].distortion < 0.02
    even = pa.partition(surface, effort="fast", max_distortion=0.02)
    assert even.diagnostics[-1].distortion <= 0.02**2
    assert free.diagnostics[-1].distortion > 0.02**2


def test_more_weight_on_distortion_gives_less_of_it() -> None:
    surface = datasets.starfish(3)
    rough, even = (
        pa.partition(surface, effort="fast", distortion=weight).diagnostics[-1]
        for weight in (100.0, 3000.0)
    )
    assert even.distortion < rough.distortion
    assert even.seam + even.cuts > rough.seam + rough.cuts


def test_progress_and_diagnostics() -> None:
    seen: list[Phase] = []
    found = pa.partition(datasets.rounded_cube(12), effort="fast", progress=seen.append)
    names = [phase.name for phase in found.diagnostics]
    assert names == ["cells", "merge", "relax", "perturb", "repair"]
    assert [phase for phase in seen if phase in found.diagnostics] == list(found.diagnostics)
    assert len(seen) > len(names)


def test_progress_can_stop_it() -> None:
    def stop(phase: Phase) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pa.partition(datasets.icosphere(3), progress=stop)


def test_a_true_answer_stops_it() -> None:
    with pytest.raises(pa.StoppedError, match=r"^merge: stopped by the progress callback$"):
        pa.partition(datasets.icosphere(3), progress=lambda phase: phase.name == "merge")


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"distortion": 0.0}, "distortion: value must be a positive number, got 0.0"),
        ({"distortion": np.nan}, "distortion: value must be a positive number"),
        ({"max_distortion": -1.0}, "max_distortion: value must be a positive number, got -1.0"),
        ({"max_charts": 0}, "max_charts: value must be at least 1, got 0"),
        ({"effort": "most"}, "effort: value must be one of"),
        ({"seed": -1}, "seed: value must not be negative, got -1"),
    ],
)
def test_bad_options(keywords: dict, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        pa.partition(datasets.icosphere(1), **keywords)


def test_copies_of_a_piece_are_cut_once_and_alike() -> None:
    sphere, other = datasets.icosphere(2), datasets.torus(1.0, 0.4, 16, 8)
    rng = np.random.default_rng(0)
    moved = [scale * sphere.vertices + 100 * rng.random(3) for scale in (1.0, 1.0, 1e-3)]
    # The same vertices in another shape, and another surface.
    moved.append(moved[0] * (1, 1, 2))
    surfaces = [pa.Surface(places, sphere.faces) for places in moved] + [other]
    assert first_copies(surfaces) == [0, 0, 0, 3, 4]
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    ends = np.cumsum([0, *(surface.n_vertices for surface in surfaces)])
    faces = np.concatenate(
        [surface.faces + end for surface, end in zip(surfaces, ends, strict=False)]
    )
    found = pa.partition(Scene([("", repair(vertices, faces))]), effort="fast")
    labels = [part.labels for part in found.parts]
    np.testing.assert_array_equal(labels[0], labels[1])
    np.testing.assert_array_equal(labels[0], labels[2])
    assert (labels[0] != labels[3]).any()
    for part, piece in zip(found.parts, found.surface.pieces, strict=True):
        assert part.surface is piece.surface


def test_pieces_that_are_painted_differently_are_no_copies() -> None:
    ball = datasets.icosphere(1)
    n, m = ball.n_vertices, ball.n_faces
    of_edges, at_vertices = np.full((m, 3), 2.0), np.full(n, 2.0)
    surfaces = [
        ball,
        ball.with_seam_costs(of_edges),
        ball.with_seam_costs(None, at_vertices),
        ball.with_seam_costs(None, 2 * at_vertices),
        ball.with_seam_costs(of_edges, at_vertices),
        ball.with_seam_costs(None, at_vertices),
    ]
    assert first_copies(surfaces) == [0, 1, 2, 3, 4, 2]


def test_carried_boundaries_are_drawn_straight() -> None:
    surface = datasets.sheet(40, 40)
    x, y, _ = surface.vertices[surface.faces].mean(axis=1).T
    middle = 0.5 * surface.vertices[:, 0].max()
    jagged = x + 0.03 * np.sign(np.sin(60 * y)) > middle
    core = surface.one_chart(600.0)
    core.carry_labels(jagged.astype(np.int64), np.zeros(surface.n_faces), 3.0)
    seam, charts = core.figures()[1], core.figures()[6]
    assert charts == 2
    assert seam == pytest.approx(1.0, rel=0.02)
    # On a flat sheet nothing else tells where a boundary belongs; the sensitivity does.
    pushed = np.where(jagged, 0.0, 1.0)
    core.carry_labels(jagged.astype(np.int64), pushed, 3.0)
    moved = np.bincount(core.labels(), surface.face_areas)
    assert not np.isclose(moved[0], moved[1], rtol=0.02)


def test_condemned_chart_is_split() -> None:
    surface = datasets.sheet(12, 10)
    core = surface.one_chart(600.0)
    core.forbid_overlap()
    assert core.failing().tolist() == []
    core.condemn(np.array([0]))
    assert core.failing().tolist() == [0]
    assert core.figures()[7] == 1
    assert core.split_failing(2) == 1
    core.merge()
    assert core.figures()[6] > 1
    assert core.failing().tolist() == []
    with pytest.raises(ValueError, match=r"labels"):
        core.condemn(np.array([9]))
