import re
import subprocess
import sys

import numpy as np
import pytest
import scipy.spatial

import phaseatlas as pa
from phaseatlas import datasets, mmg
from test_cli import run, write_obj

mmgpy = pytest.importorskip("mmgpy", reason="remeshing needs the extra: pip install '.[remesh]'")


def cube():
    vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return pa.Surface(vertices, faces)


def uneven(surface, seed=0):
    """The same sheet or sphere with its vertices moved within the surface: needles."""
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-0.25, 0.25, surface.vertices.shape) * surface.mean_edge_length
    vertices = surface.vertices + np.where(surface.on_border[:, None], 0, shift)
    if surface.n_boundary_loops:
        vertices[:, 2] = surface.vertices[:, 2]
    else:
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return pa.Surface(vertices, surface.faces)


SURFACES = {
    "coarse sphere": lambda: datasets.icosphere(1),
    "uneven sphere": lambda: uneven(datasets.icosphere(4)),
    "uneven sheet": lambda: uneven(datasets.sheet(20, 20, size=(2, 1))),
    "torus": lambda: datasets.torus(1.0, 0.4, 60, 16),
    "cylinder": lambda: datasets.cylinder(),
    "starfish": lambda: datasets.starfish(4),
    "cube": cube,
}


def lengths(surface):
    a, b = surface.vertices[surface.edges.T]
    return np.linalg.norm(a - b, axis=1)


def signed_volume(surface):
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return (a * np.cross(b, c)).sum() / 6


def check_even(surface, remeshed, edge_length, area=0.01):
    assert isinstance(remeshed, pa.Surface)
    assert remeshed.genus == surface.genus
    assert remeshed.n_boundary_loops == surface.n_boundary_loops
    assert remeshed.area == pytest.approx(surface.area, rel=area)
    edges = lengths(remeshed) / edge_length
    assert edges.mean() == pytest.approx(1, abs=0.1)
    assert edges.std() < 0.25
    assert edges.max() <= 2.0 * (1 + 1e-9)
    assert np.percentile(remeshed.face_quality, 1) > 0.6


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("n_vertices", [1500, 4000])
def test_even_triangles_on_the_same_surface(name, n_vertices):
    surface = SURFACES[name]()
    edge_length = np.sqrt(2 / np.sqrt(3) * surface.area / n_vertices)
    remeshed = pa.remesh(surface, edge_length)
    check_even(surface, remeshed, edge_length)
    assert remeshed.face_quality.min() > 0.4
    distance, _ = scipy.spatial.cKDTree(samples(surface, edge_length / 10)).query(remeshed.vertices)
    assert distance.max() < edge_length / 2
    if not surface.n_boundary_loops:
        assert signed_volume(remeshed) == pytest.approx(signed_volume(surface), rel=0.02)


def samples(surface, spacing):
    """Points of the surface that no point of it is further from than about `spacing`."""
    n = int(np.ceil(surface.face_diameters.max() / spacing))
    i, j = np.nonzero(np.add.outer(np.arange(n + 1), np.arange(n + 1)) <= n)
    weights = np.stack([i, j, n - i - j], axis=1) / n
    return np.einsum("qk,fkx->fqx", weights, surface.vertices[surface.faces]).reshape(-1, 3)


@pytest.mark.parametrize(
    ("name", "area"),
    [("bob", 0.01), ("camelhead", 0.01), ("fertility", 0.01), ("fandisk", 0.002), ("bunny", 0.01)],
)
def test_real_meshes(mesh_path, name, area):
    surface = pa.load(mesh_path(name))
    remeshed = pa.remesh(surface)
    edge_length = np.sqrt(2 / np.sqrt(3) * surface.area / 10_000)
    check_even(surface, remeshed, min(edge_length, surface.mean_edge_length), area)
    assert remeshed.face_quality.min() > max(surface.face_quality.min(), 0.2)


@pytest.mark.parametrize("ratio", [0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4])
def test_the_mean_follows_the_target_on_regular_input(ratio):
    surface = datasets.icosphere(4)
    edge_length = ratio * surface.mean_edge_length
    assert pa.remesh(surface, edge_length).mean_edge_length == pytest.approx(edge_length, rel=0.1)


def distances(points, surface):
    distance, _ = scipy.spatial.cKDTree(surface.vertices).query(points)
    return distance


def test_creases_are_kept_or_rounded():
    surface = cube()
    kept, rounded = pa.remesh(surface, 0.06), pa.remesh(surface, 0.06, feature_angle=180)
    assert kept.area == pytest.approx(6, rel=1e-9)
    assert distances(surface.vertices, kept).max() < 1e-9
    assert distances(surface.vertices, rounded).min() > 0.01
    assert 0.93 < rounded.area / 6 < 0.99


def test_short_creases_are_noise():
    # A spike of one vertex: as sharp as the cube, but no longer than an edge.
    flat = datasets.sheet(20, 20)
    vertices = flat.vertices.copy()
    vertices[10 * 21 + 10, 2] = 0.05
    remeshed = pa.remesh(pa.Surface(vertices, flat.faces), 0.1)
    check_even(flat, remeshed, 0.1, area=0.02)
    assert remeshed.face_quality.min() > 0.4


def test_border_stays_on_its_curve():
    surface = uneven(datasets.sheet(20, 20, size=(2, 1)))
    remeshed = pa.remesh(surface, 0.05)
    x, y, z = remeshed.vertices[remeshed.on_border].T
    to_border = np.minimum(np.minimum(x, 2 - x), np.minimum(y, 1 - y))
    assert np.abs(to_border).max() < 1e-9
    assert np.abs(z).max() < 1e-9
    assert remeshed.area == pytest.approx(2, rel=1e-9)
    surface = datasets.cylinder()
    remeshed = pa.remesh(surface, 0.1)
    rim = remeshed.vertices[remeshed.on_border]
    radius = np.linalg.norm(surface.vertices[surface.on_border][:, :2], axis=1).max()
    assert np.linalg.norm(rim[:, :2], axis=1) == pytest.approx(radius, rel=0.01)
    height = np.ptp(surface.vertices[:, 2])
    middle = surface.vertices[:, 2].mean()
    assert np.abs(rim[:, 2] - middle) == pytest.approx(height / 2, rel=1e-6)


@pytest.mark.parametrize(("scale", "shift"), [(1e-6, 0), (1e5, 0), (1, 1e6)])
def test_any_unit_and_place(scale, shift):
    surface = uneven(datasets.icosphere(3))
    moved = pa.Surface(scale * surface.vertices + shift, surface.faces)
    expected, remeshed = pa.remesh(surface, 0.1), pa.remesh(moved, 0.1 * scale)
    assert remeshed.area == pytest.approx(scale**2 * expected.area, rel=1e-3)
    assert remeshed.n_vertices == pytest.approx(expected.n_vertices, rel=0.05)
    assert remeshed.vertices.mean(axis=0) == pytest.approx(shift, abs=0.02 * scale)


def test_same_input_same_output():
    surface = uneven(datasets.icosphere(3))
    first, second = pa.remesh(surface, 0.1), pa.remesh(surface, 0.1)
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def test_default_edge_length():
    assert pa.remesh(cube()).n_vertices == pytest.approx(10_000, rel=0.1)
    fine = datasets.torus(1.0, 0.4, 200, 100)
    assert pa.remesh(fine).mean_edge_length == pytest.approx(fine.mean_edge_length, rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"edge_length": 0}, "edge_length: 0 must be a positive number"),
        ({"edge_length": -0.1}, "edge_length: -0.1 must be a positive number"),
        ({"edge_length": np.nan}, "edge_length: nan must be a positive number"),
        ({"edge_length": np.inf}, "edge_length: inf must be a positive number"),
        ({"edge_length": 5.0}, "edge_length: 5 must be smaller: on a surface of area"),
        ({"edge_length": 0.9}, "edge_length: 0.9 must be smaller to follow the surface"),
        ({"edge_length": 1e-6}, "edge_length: 1e-06 must be larger: on a surface of area"),
        ({"edge_length": 0.1, "feature_angle": 0}, "feature_angle: 0 must be in (0, 180]"),
        ({"edge_length": 0.1, "feature_angle": np.nan}, "feature_angle: nan must be in"),
        ({"edge_length": 0.1, "feature_angle": 181}, "feature_angle: 181 must be in"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        pa.remesh(datasets.icosphere(2), **arguments)


def test_broken_results_are_refused(monkeypatch):
    class Flipped(mmgpy.MmgMeshS):
        def get_triangles(self):
            faces = super().get_triangles()
            faces[0] = faces[0, ::-1]
            return faces

    monkeypatch.setattr(mmgpy, "MmgMeshS", Flipped)
    with pytest.raises(RuntimeError, match=r"MMG returned no valid surface.*: .*orientation"):
        pa.remesh(datasets.icosphere(2), 0.2)


def test_failure_of_the_library_is_one_error(monkeypatch):
    class Failing(mmgpy.MmgMeshS):
        def remesh(self, **_):
            raise RuntimeError("Remeshing failed in mmgs")

    monkeypatch.setattr(mmgpy, "MmgMeshS", Failing)
    with pytest.raises(RuntimeError, match="MMG failed: Remeshing failed in mmgs"):
        pa.remesh(datasets.icosphere(2), 0.2)


@pytest.mark.parametrize("longest", [0.7, 0.2])
@pytest.mark.parametrize("name", ["coarse sphere", "uneven sheet", "cube"])
def test_split_is_conforming_and_flat(name, longest):
    surface = SURFACES[name]()
    result = pa.Surface(*mmg.split(surface.vertices, surface.faces, longest))
    assert lengths(result).max() <= longest
    assert result.area == pytest.approx(surface.area, rel=1e-12)
    assert result.euler_characteristic == surface.euler_characteristic
    assert np.array_equal(result.vertices[: surface.n_vertices], surface.vertices)


def box(*sides):
    return pa.Surface(cube().vertices * sides, cube().faces)


# Its creases are closer to each other than twice the edge length asked for.
BEAM, BEAM_EDGE = box(1, 0.1, 0.1), 0.2


def test_a_mean_that_is_missed_is_said():
    with pytest.warns(pa.QualityWarning) as caught:
        remeshed = pa.remesh(BEAM, BEAM_EDGE)
    assert remeshed.mean_edge_length < 0.9 * BEAM_EDGE
    (said,) = caught
    expected = f"the mean edge length is {remeshed.mean_edge_length:.6g}, not {BEAM_EDGE}: "
    assert str(said.message).startswith(expected)
    # It points at the caller's own line.
    assert said.filename == __file__


def test_bad_triangles_are_said():
    with pytest.warns(pa.QualityWarning, match="the worst face has a quality of") as caught:
        remeshed = pa.remesh(box(1, 1, 0.02), 0.1)
    worst = f"{remeshed.face_quality.min():.2g}"
    assert any(f"quality of {worst};" in str(said.message) for said in caught)


INTERRUPTS = """
import os, signal, sys, threading, time
import phaseatlas as pa

def heard():
    try:
        signal.raise_signal(signal.SIGINT)
        time.sleep(10)
    except KeyboardInterrupt:
        return "heard"
    return "lost"

sphere = pa.datasets.icosphere(2)
pa.remesh(sphere, 0.2)
print(heard())
thread = threading.Thread(target=pa.remesh, args=(sphere, 0.2))
thread.start()
thread.join()
print(heard())
timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
timer.start()
try:
    pa.remesh(sphere, 0.004)
    print("lost")
except KeyboardInterrupt:
    print("heard")
print(heard())
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of a process are those of POSIX")
def test_ctrl_c_is_heard_during_and_after_remeshing():
    result = subprocess.run([sys.executable, "-c", INTERRUPTS], capture_output=True, text=True)
    assert result.stdout.split() == ["heard"] * 4, result.stderr


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "off", "stl"])
def test_command_line(tmp_path, suffix):
    surface = cube()
    write_obj(tmp_path / "cube.obj", surface.vertices, surface.faces)
    out = tmp_path / f"even.{suffix}"
    result = run("remesh", tmp_path / "cube.obj", "-o", out, "--edge-length", 0.1)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert "worst face quality" in result.stdout
    even = pa.load(out)
    check_even(surface, even, 0.1)
    assert even.vertices.min() == pytest.approx(0, abs=1e-6)


def test_coarse_mesh_to_segments(tmp_path):
    surface = cube()
    write_obj(tmp_path / "cube.obj", surface.vertices, surface.faces)
    even = tmp_path / "even.ply"
    assert run("remesh", tmp_path / "cube.obj", "-o", even, "--edge-length", 0.07).returncode == 0
    result = run("segment", even, "-o", tmp_path / "even.npz", "--levels", 2)
    assert result.returncode == 0, result.stderr
    tree = pa.SegmentTree.load(tmp_path / "even.npz")
    assert tree.components.tolist() == [1] * 4
    assert tree.areas == pytest.approx(1.5, rel=0.01)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "a.txt"], "must end in"),
        (["-o", "cube.obj"], "overwrite an input"),
        (["-o", "a.obj", "--edge-length", "nan"], "edge_length: nan"),
        (["-o", "a.obj", "--edge-length", "9"], "edge_length: 9 must be smaller"),
        (["-o", "a.obj", "--feature-angle", "-3"], "feature_angle: -3 must be"),
    ],
)
def test_bad_arguments_write_nothing(tmp_path, arguments, words):
    surface = cube()
    write_obj(tmp_path / "cube.obj", surface.vertices, surface.faces)
    result = run("remesh", "cube.obj", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert words in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cube.obj"]


def test_strict_writes_the_file_and_fails_on_a_warning(tmp_path):
    write_obj(tmp_path / "beam.obj", BEAM.vertices, BEAM.faces)
    arguments = ["remesh", tmp_path / "beam.obj", "--edge-length", BEAM_EDGE]
    lax = run(*arguments, "-o", tmp_path / "lax.obj")
    assert lax.returncode == 0
    strict = run(*arguments, "-o", tmp_path / "strict.obj", "--strict")
    assert strict.returncode == 3
    assert lax.stderr == strict.stderr
    assert re.fullmatch(r"phaseatlas: warning: the mean edge length .*\n", strict.stderr)
    assert (tmp_path / "lax.obj").read_bytes() == (tmp_path / "strict.obj").read_bytes()
    good = run("remesh", tmp_path / "beam.obj", "-o", tmp_path / "a.obj", "--edge-length", 0.02)
    assert (good.returncode, good.stderr) == (0, "")
