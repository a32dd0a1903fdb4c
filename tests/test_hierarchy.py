"""The tree of segments: areas, connectedness, partition of unity, determinism, files."""

from __future__ import annotations

import hashlib
import io
import json
import math
import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh

import phaseatlas as pa
from phaseatlas.segmentation.bisect import bisect, split
from phaseatlas.segmentation.node import Node, confine, with_whole_fans


def same(first, second):
    """Whether two trees agree to the last bit."""
    return (
        first.fields.tobytes() == second.fields.tobytes()
        and first.labels.tobytes() == second.labels.tobytes()
        and first.diagnostics == second.diagnostics
    )


@pytest.fixture(scope="module")
def sphere():
    return pa.segment(pa.datasets.icosphere(5, radius=1.5), 1)


@pytest.fixture(scope="module")
def star():
    return pa.datasets.starfish(4)


@pytest.fixture(scope="module")
def tree(star):
    return pa.segment(star, 3)


def test_sphere_is_cut_along_a_great_circle(sphere):
    (record,) = sphere.diagnostics
    assert record.converged
    assert record.length == pytest.approx(2.0 * math.pi * 1.5, rel=0.02)
    diffuse = sphere.weights @ sphere.surface.mass
    np.testing.assert_allclose(diffuse, 0.5 * sphere.surface.area, rtol=1e-4)
    # Half a row of faces along the great circle.
    np.testing.assert_allclose(sphere.areas, 0.5 * sphere.surface.area, rtol=1e-3)
    assert sphere.areas.sum() == pytest.approx(sphere.surface.area)
    assert sphere.components.tolist() == [1, 1]
    # The interface is a plane section: the faces of one side look one way.
    centres = sphere.surface.vertices[sphere.surface.faces].mean(axis=1)
    axis = centres[sphere.labels == 0].mean(axis=0)
    height = centres @ axis / np.linalg.norm(axis)
    assert height[sphere.labels == 0].min() > -0.1
    assert height[sphere.labels == 1].max() < 0.1


def test_length_and_fields_follow_the_units(star, tree):
    large = pa.segment(star.scaled(1000.0), 1)
    assert large.diagnostics[0].length == pytest.approx(1000 * tree.diagnostics[0].length, rel=1e-3)
    assert large.epsilon == pytest.approx(1000.0 * tree.epsilon)
    assert (large.labels != tree.labels_at(1)).mean() < 0.01


def test_weights_are_a_partition_of_unity(tree):
    for level in range(4):
        weights = tree.weights_at(level)
        assert weights.shape == (2**level, tree.surface.n_vertices)
        np.testing.assert_allclose(weights.sum(axis=0), 1.0, rtol=0.0, atol=1e-12)
        assert weights.min() >= 0.0
    assert tree.weights.shape == (8, tree.surface.n_vertices)


def test_weights_of_a_level_are_sums_of_their_children(tree):
    for level in range(3):
        children = tree.weights_at(level + 1)
        np.testing.assert_allclose(tree.weights_at(level), children[::2] + children[1::2])


def test_every_level_halves_the_diffuse_areas(tree):
    area = tree.surface.area
    # Each node meets its area to 1e-5 of its parent's; the errors add up.
    for level in range(4):
        diffuse = tree.weights_at(level) @ tree.surface.mass
        np.testing.assert_allclose(diffuse, area / 2**level, rtol=1e-4)


def test_labels_are_nested_and_follow_the_weights(tree):
    for level in range(3):
        finer = tree.labels_at(level + 1)
        np.testing.assert_array_equal(tree.labels_at(level), finer // 2)
        assert set(np.unique(finer)) == set(range(2 ** (level + 1)))
    np.testing.assert_array_equal(tree.labels_at(3), tree.labels)
    heaviest = tree.surface.face_mean(tree.weights.T).argmax(axis=1)
    assert (heaviest == tree.labels).mean() > 0.9


@pytest.mark.parametrize("level", [-1, 4, 1.5])
def test_levels_outside_the_tree_are_refused(tree, level):
    with pytest.raises(ValueError, match=f"level: {level} must be a whole number in 0..3"):
        tree.weights_at(level)
    with pytest.raises(ValueError, match=f"level: {level} must be a whole number in 0..3"):
        tree.labels_at(level)


def test_interface_length_is_that_of_the_label_edges(tree):
    mesh = trimesh.Trimesh(tree.surface.vertices, tree.surface.faces, process=False)
    pairs, edges = mesh.face_adjacency, mesh.face_adjacency_edges
    seam = edges[tree.labels[pairs[:, 0]] != tree.labels[pairs[:, 1]]]
    ends = tree.surface.vertices[seam]
    expected = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum()
    assert tree.interface_length == pytest.approx(expected)


@pytest.mark.parametrize("name", ["spot", "bunny", "hand", "fertility", "camelhead"])
def test_real_meshes_fall_into_connected_eighths(mesh_path, name):
    tree = pa.segment(pa.load(mesh_path(name)), 3)
    np.testing.assert_allclose(tree.areas, tree.surface.area / 8.0, rtol=0.01)
    assert tree.components.tolist() == [1] * 8
    assert all(record.converged for record in tree.diagnostics)
    assert max(record.relabelled_area for record in tree.diagnostics) <= 1e-3
    # An independent count: components of the dual graph without the edges between leaves.
    mesh = trimesh.Trimesh(tree.surface.vertices, tree.surface.faces, process=False)
    pairs = mesh.face_adjacency
    inner = pairs[tree.labels[pairs[:, 0]] == tree.labels[pairs[:, 1]]]
    parts = trimesh.graph.connected_components(inner, nodes=np.arange(tree.surface.n_faces))
    assert len(parts) == 8


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_coarse_segments_of_a_hundred_faces_are_connected_too(seed):
    # A single face is more than a thousandth of such a segment.
    tree = pa.segment(pa.datasets.starfish(3), 3, seed=seed)
    assert tree.components.tolist() == [1] * 8
    np.testing.assert_allclose(tree.areas, tree.surface.area / 8.0, rtol=0.05)


def test_penalty_leaves_a_larger_violation(star):
    exact = pa.segment(star, 2)
    loose = pa.segment(star, 2, area="penalty", penalty=10.0)
    assert max(abs(d.violation) for d in exact.diagnostics) <= 1e-5
    assert max(abs(d.violation) for d in loose.diagnostics) > 1e-3
    diffuse = loose.weights_at(1) @ star.mass / star.area
    assert abs(diffuse[0] - 0.5) == pytest.approx(0.5 * abs(loose.diagnostics[0].violation))
    # The sharp segments are the signs of the field, not those that halve the area.
    assert {d.level_set for d in loose.diagnostics} == {0.0}
    assert loose.components.tolist() == [1] * 4


def test_the_same_seed_gives_the_same_tree(star, tree):
    assert same(pa.segment(star, 3), tree)
    other = pa.segment(star, 3, seed=1)
    assert not same(other, tree)
    assert other.components.tolist() == [1] * 8


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_executors_do_not_change_the_tree(star, tree, kind):
    if kind == "threads":
        executor = ThreadPoolExecutor(2)
    else:
        executor = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))
    heard = []
    with executor:
        assert same(pa.segment(star, 3, executor=executor, progress=heard.append), tree)
    # Workers cannot call back at every step, but each node is reported, in order.
    assert [(step.level, step.node) for step in heard] == [
        (level, node) for level in (1, 2, 3) for node in range(2 ** (level - 1))
    ]
    assert [step.iteration for step in heard] == [d.iterations for d in tree.diagnostics]


def run(script, timeout=60, **environment):
    """Standard output of a script in a process of its own."""
    process = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        timeout=timeout,
    )
    return process.stdout


# Beyond 10,000 vertices linear algebra libraries start to share sums among threads.
DIGEST = """
import hashlib
import phaseatlas as pa
tree = pa.segment(pa.datasets.icosphere(5, radius=1.5), 1)
print(hashlib.sha256(tree.fields.tobytes() + tree.labels.tobytes()).hexdigest())
"""


@pytest.mark.parametrize("variable", ["RAYON_NUM_THREADS", "OPENBLAS_NUM_THREADS"])
@pytest.mark.parametrize("count", ["1", "2"])
def test_thread_counts_do_not_change_the_tree(sphere, variable, count):
    here = hashlib.sha256(sphere.fields.tobytes() + sphere.labels.tobytes()).hexdigest()
    assert run(DIGEST, **{variable: count}).strip() == here


FORKED = """
import multiprocessing
import warnings
from concurrent.futures import ProcessPoolExecutor
import phaseatlas as pa
warnings.simplefilter("ignore")
# Large enough for the core to share out its construction too.
surface = pa.datasets.icosphere(4)
before = pa.segment(surface, 2)
with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork")) as executor:
    after = pa.segment(surface, 2, executor=executor)
print((before.labels == after.labels).all())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_forked_workers_do_not_hang(tmp_path):
    # The threads of the parent do not survive a fork; what waits for them waits forever.
    process = subprocess.Popen(
        [sys.executable, "-c", FORKED],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=20)
    except subprocess.TimeoutExpired:
        # The session holds the workers too.
        os.killpg(process.pid, 9)
        process.communicate()
        pytest.fail("a segmentation in forked workers hangs")
    assert output.strip() == "True"


def test_connectedness_joins_the_pieces_of_a_torus():
    torus = pa.datasets.torus(1.0, 0.15, 128, 20)
    epsilon = 2.0 * torus.mean_edge_length
    # From this seed, without continuation, the perimeter alone stops in a local minimum of four
    # stacked rings of alternating phase: each cut is as short as a cut of the tube can be.
    options = {"epsilon": epsilon, "epsilon_start": epsilon, "initial": "random", "seed": 5}
    pieces = pa.segment(torus, 1, connected=False, **options)
    assert pieces.components.tolist() == [2, 2]
    assert pieces.diagnostics[0].converged
    whole = pa.segment(torus, 1, connected=True, **options)
    assert whole.components.tolist() == [1, 1]
    # The functional did it: nothing was left for the repair of the sharp segments.
    assert whole.diagnostics[0].components == (1, 1)
    assert whole.diagnostics[0].repairs == 0
    # Two cuts of the tube instead of four.
    assert 2 * whole.diagnostics[0].length == pytest.approx(pieces.diagnostics[0].length, rel=0.02)
    assert whole.diagnostics[0].length == pytest.approx(2 * 2.0 * math.pi * 0.15, rel=0.03)


@pytest.mark.parametrize("distortion", [0.0, 0.3])
def test_coarse_surfaces_change_the_way_but_not_the_end(distortion):
    # A long capsule has one shortest cut into halves; with distortion too, at this weight.
    sphere = pa.datasets.icosphere(4)
    capsule = pa.Surface(sphere.vertices * [1.0, 1.0, 4.0], sphere.faces)
    options = {"distortion": distortion, "initial": "random", "seed": 3}
    coarse = pa.segment(capsule, 1, **options)
    fine = pa.segment(capsule, 1, coarse=False, **options)
    assert coarse.fields.shape == fine.fields.shape
    a, b = coarse.diagnostics[0], fine.diagnostics[0]
    assert a.converged
    assert b.converged
    assert abs(a.violation) <= 1e-5
    assert a.energy == pytest.approx(b.energy, rel=2e-3)
    assert a.length == pytest.approx(b.length, rel=1e-2)


def test_a_sphere_is_halved_from_the_first_width_on():
    # Where the interface is as wide as the sphere, mixing everywhere is no minimum, but a saddle
    # where a descent may stop.
    sphere = pa.datasets.icosphere(5)
    widths = {}
    pa.segment(
        sphere, 1, initial="random", progress=lambda p: widths.setdefault(p.epsilon, []).append(p)
    )
    for epsilon, steps in widths.items():
        mixed = 9.0 / 16.0 / epsilon
        assert steps[-1].energy < 0.9 * mixed or epsilon > 0.15


def test_the_best_of_the_random_starts_goes_on(star):
    energies = [
        pa.segment(star, 1, initial="random", seed=seed).diagnostics[0].energy for seed in range(6)
    ]
    assert max(energies) > 1.05 * min(energies)
    assert pa.segment(star, 1).diagnostics[0].energy < 1.01 * min(energies)


def test_given_fields_are_where_the_nodes_start(star):
    # Without continuation the interface stays in the basin of the start.
    height = star.vertices[:, 2] - np.average(star.vertices[:, 2], weights=star.mass)
    start = np.tanh(8.0 * height)
    kept = start.copy()
    heard = []
    flat = pa.segment(star, 1, initial=start, progress=heard.append)
    np.testing.assert_array_equal(start, kept)
    assert len({step.epsilon for step in heard}) == 1
    again = pa.segment(star, 1, initial=-start)
    # The mirror image of the problem: the children change places.
    assert (flat.labels == 1 - again.labels).mean() > 0.99
    assert flat.diagnostics[0].length == pytest.approx(again.diagnostics[0].length, rel=1e-3)


def test_a_solution_is_a_start_that_needs_few_steps(tree):
    again = pa.segment(tree.surface, 3, initial=tree.fields)
    assert (again.labels != tree.labels).mean() < 0.01
    first = sum(record.iterations for record in tree.diagnostics)
    assert 2 * sum(record.iterations for record in again.diagnostics) < first


def test_clusters_of_normals_are_a_start():
    # The normals of a thick slab fall into those of its two sides.
    sheet = pa.datasets.sheet(24, 24)
    vertices, faces = sheet.vertices, sheet.faces
    ridge = vertices * [1.0, 1.0, 0.0]
    ridge[:, 2] = 0.4 - 0.8 * np.abs(vertices[:, 0] - 0.5)
    roof = pa.Surface(ridge, faces)
    epsilon = 2.0 * roof.mean_edge_length
    options = {"epsilon": epsilon, "epsilon_start": epsilon}
    tree = pa.segment(roof, 1, initial="normals", **options)
    left = ridge[faces].mean(axis=1)[:, 0] < 0.5
    # Up to the order of the children.
    assert abs((tree.labels == left).mean() - 0.5) > 0.49
    noise = pa.segment(roof, 1, initial="random", **options)
    assert 2 * tree.diagnostics[0].iterations < noise.diagnostics[0].iterations
    assert same(tree, pa.segment(roof, 1, initial="normals", **options))


@pytest.fixture(scope="module")
def wand():
    """A ball with one long thin limb: the icosphere drawn out along z > 0."""
    ball = pa.datasets.icosphere(4)
    x, y, z = ball.vertices.T
    thin = 1.0 / (1.0 + 2.5 * np.clip(z, 0.0, None) ** 2)
    return pa.Surface(
        np.stack([x * thin, y * thin, z + 2.5 * np.clip(z, 0.0, None) ** 2], 1), ball.faces
    )


def yamabe(tree):
    """Distortion of the fields of the first level on the surface scaled to unit area."""
    unit = tree.surface.scaled(tree.surface.area**-0.5)
    functional = pa.functionals.Distortion(unit, tree.epsilon / tree.surface.area**0.5)
    return functional.value_and_gradient(tree.fields[0])[0]


def test_distortion_cuts_along_a_limb(wand):
    shortest = pa.segment(wand, 1)
    along = pa.segment(wand, 1, distortion=3.0)
    assert along.components.tolist() == [1, 1]
    assert along.diagnostics[0].length > 1.2 * shortest.diagnostics[0].length
    assert yamabe(along) < 0.1 * yamabe(shortest)
    # From the shortest interface the descent stays at the foot of the limb.
    stuck = pa.segment(wand, 1, distortion=3.0, initial=shortest.fields)
    assert along.diagnostics[0].energy < stuck.diagnostics[0].energy


def node_of_second_level(surface):
    """The positive child of the root, on the surface scaled to unit area."""
    root = pa.segment(surface, 1)
    inside = pa.functionals.indicator(root.fields[0], root.delta)
    unit = surface.scaled(surface.area**-0.5)
    return Node(unit, (True,), 0.5, inside, root.labels == 0)


def test_a_node_is_solved_on_its_part_of_the_surface(star):
    whole = node_of_second_level(star)
    part, vertices, faces = confine(whole)
    assert len(faces) < 0.8 * star.n_faces
    options = pa.segmentation.Options()
    widths = options.widths(star)
    on_whole = split(whole, options, widths)
    on_part = split(part, options, widths)
    u = np.zeros(star.n_vertices)
    u[vertices] = on_part.u
    for functional in (
        pa.functionals.Perimeter,
        pa.functionals.Area,
        pa.functionals.Distortion,
    ):
        values = [
            functional(node.surface, widths.epsilon, weight=node.indicator).value_and_gradient(f)[0]
            for node, f in ((whole, u), (part, on_part.u))
        ]
        assert values[1] == pytest.approx(values[0], rel=1e-5)
    # Both are minimisers, from other starts: the part is solved as well as the whole.
    assert on_part.diagnostics.energy == pytest.approx(on_whole.diagnostics.energy, rel=1e-2)
    assert bisect(whole, options, widths).u.tobytes() == u.tobytes()


def test_a_part_that_touches_itself_gets_whole_fans():
    sheet = pa.datasets.sheet(8, 8)
    # Two opposite fans of a vertex in the middle, without the faces between.
    vertex = 40
    around = (sheet.faces == vertex).any(axis=1)
    first = np.flatnonzero(around)[0]
    apart = ~np.isin(np.arange(sheet.n_faces), sheet.face_neighbours[first]) & around
    across = np.flatnonzero(apart & (np.arange(sheet.n_faces) != first))[-1]
    inside = np.zeros(sheet.n_faces, dtype=bool)
    inside[[first, across]] = True
    whole = with_whole_fans(sheet, inside)
    assert whole[around].all()
    sheet.submesh(whole)


def test_progress_tells_level_node_and_steps(star):
    heard = []
    # From one start, so that the interface only becomes narrower.
    tree = pa.segment(star, 2, initial="random", progress=heard.append)
    assert same(tree, pa.segment(star, 2, initial="random"))
    nodes = [(step.level, step.node) for step in heard]
    assert nodes == sorted(nodes)
    assert set(nodes) == {(1, 0), (2, 0), (2, 1)}
    for k, (level, node) in enumerate([(1, 0), (2, 0), (2, 1)]):
        mine = [step for step in heard if (step.level, step.node) == (level, node)]
        record = tree.diagnostics[k]
        assert (record.level, record.node) == (level - 1, node)
        assert [step.iteration for step in mine] == list(range(1, record.iterations + 1))
        epsilons = [step.epsilon for step in mine]
        assert epsilons == sorted(epsilons, reverse=True)
        assert len(set(epsilons)) > 1
        assert epsilons[-1] == pytest.approx(tree.epsilon / math.sqrt(star.area))
        assert mine[-1].energy == pytest.approx(record.energy, rel=1e-6)


def test_progress_can_stop_the_segmentation(star):
    def interrupt(step):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pa.segment(star, 1, progress=interrupt)


def test_step_limit_is_reported(star):
    with pytest.warns(RuntimeWarning, match="not converged"):
        tree = pa.segment(star, 1, connected=False, max_iterations=5)
    assert not tree.diagnostics[0].converged


@pytest.fixture(scope="module")
def small():
    return pa.datasets.icosphere(1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("levels", 0),
        ("levels", 17),
        ("levels", 2.5),
        ("epsilon", 0.0),
        ("epsilon", -1.0),
        ("epsilon", math.nan),
        ("epsilon", 1e6),
        ("epsilon", math.inf),
        ("epsilon_start", 0.0),
        ("epsilon_start", math.nan),
        ("delta", 1.0),
        ("delta", -0.1),
        ("delta", math.nan),
        ("sigma", -1.0),
        ("sigma", 0.0),
        ("eta", -1.0),
        ("eta", math.nan),
        ("kappa", math.nan),
        ("penalty", -1.0),
        ("penalty", math.nan),
        ("max_iterations", 0),
        ("seed", -1),
        ("initial", "zeros"),
        ("area", "barrier"),
        ("solver", "newton"),
        ("initial", np.zeros(7)),
        ("initial", np.zeros((2, 42))),
        ("initial", np.where(np.arange(42) == 5, math.nan, 0.0)),
    ],
    ids=lambda value: "array" if isinstance(value, np.ndarray) else str(value),
)
def test_bad_arguments_are_named(small, name, value):
    arguments = {"levels": 1, name: value}
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        pa.segment(small, **arguments)


def test_bad_start_is_named_by_index(small):
    start = np.zeros((3, small.n_vertices))
    start[1, 5] = math.nan
    with pytest.raises(ValueError, match=r"initial.*5.*nan"):
        pa.segment(small, 2, initial=start)


def test_save_and_load_round_trip(tree, tmp_path):
    path = tmp_path / "tree.npz"
    tree.save(path)
    loaded = pa.SegmentTree.load(path)
    assert same(loaded, tree)
    assert (loaded.levels, loaded.epsilon, loaded.delta) == (3, tree.epsilon, tree.delta)
    np.testing.assert_array_equal(loaded.surface.vertices, tree.surface.vertices)
    np.testing.assert_array_equal(loaded.surface.faces, tree.surface.faces)
    np.testing.assert_array_equal(loaded.weights, tree.weights)
    assert [entry.name for entry in tmp_path.iterdir()] == ["tree.npz"]


def test_file_has_the_documented_keys(tree, tmp_path):
    tree.save(tmp_path / "tree.npz")
    with np.load(tmp_path / "tree.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert set(arrays) == {
        "vertices",
        "faces",
        "fields",
        "weights",
        "labels",
        "levels",
        "epsilon",
        "delta",
        "diagnostics",
        "format",
        "parents",
        "positive",
        "shares",
        "source",
        "sha256",
    }
    np.testing.assert_array_equal(arrays["weights"], tree.weights)
    np.testing.assert_array_equal(arrays["labels"], tree.labels)
    records = json.loads(str(arrays["diagnostics"]))
    assert [record["length"] for record in records] == [d.length for d in tree.diagnostics]


def test_file_gets_the_name_and_the_rights_of_a_plain_open(tree, tmp_path):
    tree.save(tmp_path / "no-suffix")
    (tmp_path / "plain").write_text("")
    assert (tmp_path / "no-suffix").stat().st_mode == (tmp_path / "plain").stat().st_mode


def refused(path, error=ValueError):
    with pytest.raises(error) as caught:
        pa.SegmentTree.load(path)
    message = str(caught.value)
    assert str(path) in message
    assert len(message.splitlines()) == 1
    return message


def archive(path, arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    path.write_bytes(buffer.getvalue())
    return path


def test_files_that_hold_no_tree_are_refused(tree, tmp_path):
    refused(tmp_path / "missing.npz", FileNotFoundError)
    path = tmp_path / "bad.npz"
    path.write_bytes(b"")
    assert "no segmentation" in refused(path)
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert "no segmentation" in refused(path)
    tree.save(tmp_path / "good.npz")
    whole = (tmp_path / "good.npz").read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert "no segmentation" in refused(path)
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0xFF
    path.write_bytes(damaged)
    assert "no segmentation" in refused(path)
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    assert "no segmentation" in refused(path)


@pytest.mark.parametrize(
    "change",
    [
        {"format": None},
        {"labels": None},
        {"diagnostics": None},
        {"diagnostics": "not json"},
        {"diagnostics": "[1]"},
        {"fields": np.zeros((7, 5))},
        {"labels": np.zeros(5, dtype=np.int64)},
        {"labels": np.full(5120, 99)},
        {"levels": 2},
    ],
    ids=lambda change: "-".join(f"{key}" for key in change),
)
def test_archives_with_wrong_contents_are_refused(tree, tmp_path, change):
    tree.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        arrays = {**file, **change}
    arrays = {key: value for key, value in arrays.items() if value is not None}
    refused(archive(tmp_path / "bad.npz", arrays))


@pytest.mark.parametrize("version", [0, 99])
def test_unknown_formats_are_refused(tree, tmp_path, version):
    tree.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        arrays = {**file, "format": version}
    assert f"format {version} is not known" in refused(archive(tmp_path / "new.npz", arrays))


@pytest.mark.parametrize("existing", [False, True])
def test_failing_save_leaves_the_folder_as_it_was(tree, tmp_path, monkeypatch, existing):
    path = tmp_path / "tree.npz"
    if existing:
        path.write_bytes(b"precious")

    def full_disk(file, **arrays):
        file.write(b"half of it")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(OSError, match="no space left"):
        tree.save(path)
    if existing:
        assert path.read_bytes() == b"precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["tree.npz"] * existing


def test_save_into_a_missing_folder(tree, tmp_path):
    with pytest.raises(FileNotFoundError):
        tree.save(tmp_path / "missing" / "tree.npz")
    with pytest.raises(FileNotFoundError):
        pa.save_ply(tree, tmp_path / "missing" / "tree.ply")
    assert not list(tmp_path.iterdir())


def test_ply_carries_weights_and_labels(tree, tmp_path):
    path = tmp_path / "tree.ply"
    pa.save_ply(tree, path)
    mesh = trimesh.load(path, process=False)
    np.testing.assert_array_equal(mesh.faces, tree.surface.faces)
    np.testing.assert_allclose(mesh.vertices, tree.surface.vertices, rtol=1e-6, atol=1e-6)
    raw = mesh.metadata["_ply_raw"]
    for leaf in range(8):
        written = raw["vertex"]["data"][f"weight_{leaf}"]
        np.testing.assert_allclose(np.ravel(written), tree.weights[leaf], rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(np.ravel(raw["face"]["data"]["label"]), tree.labels)
    # The file is a mesh like any other.
    assert pa.load(path).n_faces == tree.surface.n_faces


def test_failing_ply_keeps_the_old_one(tree, tmp_path, monkeypatch):
    path = tmp_path / "tree.ply"
    path.write_bytes(b"precious")

    def fail(self, data):
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OSError, match="no space left"):
        pa.save_ply(tree, path)
    monkeypatch.undo()
    assert path.read_bytes() == b"precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["tree.ply"]


def test_files_of_halves_without_nodes_are_read(tree, tmp_path):
    # As they were written before trees had shares.
    tree.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as file:
        arrays = {k: v for k, v in file.items() if k not in ("parents", "positive", "shares")}
    records = json.loads(str(arrays["diagnostics"]))
    for record in records:
        for name in ("status", "share", "sharp_share", "seconds"):
            del record[name]
    arrays["diagnostics"] = json.dumps(records)
    np.savez(tmp_path / "old.npz", **arrays)
    old = pa.SegmentTree.load(tmp_path / "old.npz")
    assert old.fields.tobytes() == tree.fields.tobytes()
    assert old.weights.tobytes() == tree.weights.tobytes()
    assert old.levels == 3


def test_shares_are_met(star):
    shares = [1, 2, 4, 1.5, 0.5]
    tree = pa.segment(star, shares=shares)
    expected = np.array(shares) / 9.0
    np.testing.assert_allclose(tree.shares, expected, rtol=1e-12)
    np.testing.assert_allclose(tree.weights.sum(axis=0), 1.0, rtol=1e-12)
    # Each of up to three bisections meets its share to 1e-5.
    np.testing.assert_allclose(tree.weights @ star.mass / star.area, expected, rtol=1e-5)
    np.testing.assert_allclose(tree.areas / star.area, expected, rtol=0.01)
    assert tree.components.tolist() == [1] * 5
    for level in range(tree.levels + 1):
        upper = tree.at(level)
        np.testing.assert_allclose(upper.weights.sum(axis=0), 1.0, rtol=1e-12)
        # A segment of a level is a union of those of the next.
        below = tree.labels_at(min(level + 1, tree.levels))
        pairs = np.unique(np.stack([below, upper.labels]), axis=1)
        assert len(np.unique(pairs[0])) == pairs.shape[1]
    assert same(tree, pa.segment(star, shares=shares))


def test_equal_shares_are_levels(star, tree):
    assert same(pa.segment(star, shares=[2.0] * 8), tree)


def test_trees_with_shares_are_saved(star, tmp_path):
    tree = pa.segment(star, shares=[3, 1, 2])
    tree.save(tmp_path / "tree.npz")
    again = pa.SegmentTree.load(tmp_path / "tree.npz")
    assert same(tree, again)
    assert again.shares.tolist() == tree.shares.tolist()
    assert again.weights.tobytes() == tree.weights.tobytes()


@pytest.mark.parametrize(
    ("shares", "message"),
    [
        ([1.0], "shares: shape"),
        ([1.0, 0.0], r"shares\[1\]: 0.0 must be a positive number"),
        ([1.0, np.nan], r"shares\[1\]"),
        ([[1.0, 2.0]], "shares: shape"),
        ([1.0, 1e-9], r"shares\[1\]: 1e-09 must be at least"),
    ],
)
def test_bad_shares_are_named(small, shares, message):
    with pytest.raises(ValueError, match=message):
        pa.segment(small, shares=shares)
    with pytest.raises(ValueError, match="shares: must be given without levels"):
        pa.segment(small, 2, shares=[1, 2])


def test_progress_carries_the_field_and_can_stop(star):
    heard = []

    def stop(step):
        heard.append(step)
        return step.iteration == 3

    with pytest.raises(pa.StoppedError, match="level 1, node 0"):
        pa.segment(star, 1, initial="random", progress=stop)
    assert len(heard) == 3
    assert heard[-1].u.shape == (heard[-1].surface.n_vertices,)
    epsilon = heard[-1].epsilon
    perimeter = pa.functionals.Perimeter(heard[-1].surface, epsilon)
    value, _ = perimeter.value_and_gradient(heard[-1].u)
    assert value == pytest.approx(heard[-1].energy, rel=1e-12)


def test_diagnostics_say_why_and_how_long(star):
    (record,) = pa.segment(star, 1).diagnostics
    assert record.status == "converged"
    assert record.share == 0.5
    assert record.sharp_share == pytest.approx(0.5, abs=0.01)
    assert {"Perimeter", "Area", "Connectedness", "L-BFGS", "driver"} <= set(record.seconds)
    assert min(record.seconds.values()) >= 0
    with pytest.warns(pa.QualityWarning, match="the limit on the steps was reached"):
        (record,) = pa.segment(star, 1, connected=False, max_iterations=5).diagnostics
    assert record.status == "step_limit"


def test_widths_below_the_triangles_are_said():
    sphere = pa.datasets.icosphere(3)
    with pytest.warns(pa.QualityWarning, match="epsilon: .* is below the mean edge length"):
        pa.segment(sphere, 1, epsilon=0.9 * sphere.mean_edge_length, connected=False)


def test_sharp_areas_that_miss_their_shares_are_said():
    with pytest.warns(pa.QualityWarning, match="areas: sharp segment .* misses its share by"):
        pa.segment(pa.datasets.icosphere(0), 3)


def test_surfaces_with_boundary_and_handles():
    sheet = pa.segment(pa.datasets.sheet(30, 20, size=(1.5, 1.0)), 1)
    # The shortest cut that halves a rectangle is across its short side.
    assert sheet.diagnostics[0].length == pytest.approx(1.0, rel=0.02)
    cylinder = pa.segment(pa.datasets.cylinder(0.3, 2.0, 30, 32), 1)
    assert cylinder.diagnostics[0].length == pytest.approx(2.0 * math.pi * 0.3, rel=0.02)
    assert cylinder.components.tolist() == [1, 1]
