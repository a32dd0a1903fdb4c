"""The command line: exit codes, one line for each failure, and what it takes to start."""

import dataclasses
import hashlib
import inspect
import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import get_args

import jsonschema
import numpy as np
import pytest
import trimesh
from PIL import Image

import phaseatlas as pa
from phaseatlas import optimise, quality, segmentation
from phaseatlas.cli import options
from phaseatlas.cli.atlas import atlas
from phaseatlas.cli.process import checked
from phaseatlas.cli.segment import segment


def run(*arguments, **options):
    command = [sys.executable, "-m", "phaseatlas", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def failure(result, code):
    """What a run that failed with this code said, in one line and nowhere else."""
    assert result.returncode == code, result.stderr
    assert result.stdout == ""
    assert re.fullmatch(r"phaseatlas: .*\n", result.stderr), result.stderr
    return result.stderr[len("phaseatlas: ") : -1]


def write_obj(path, vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def model(tmp_path):
    surface = pa.datasets.starfish(3)
    path = tmp_path / "model.obj"
    write_obj(path, surface.vertices, surface.faces)
    return path


TETRAHEDRON = (
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
)


def bad_meshes():
    """Meshes that hold no surface, with what is said of them."""
    vertices, faces = TETRAHEDRON
    return {
        "nan": ([[0, 0, "nan"], *vertices[1:]], faces, r"vert.*0.* finite"),
        "points": (vertices, [], "no faces"),
    }


def rough_meshes():
    """Meshes that are no clean surface, with what a strict reader says, and a defect's sentence."""
    vertices, faces = TETRAHEDRON
    shifted = [[x + 5, y, z] for x, y, z in vertices]
    return {
        "non-manifold": (
            [*vertices, [1, 1, 1]],
            [*faces, [0, 1, 4]],
            r"edge \(0, 1\)",
            "1 edge of more than two faces was opened.",
        ),
        "flipped": (
            vertices,
            [*faces[:3], [1, 3, 2]],
            "orientation",
            "1 face was turned over to agree with its neighbours.",
        ),
        "degenerate": (
            vertices,
            [*faces, [1, 1, 2]],
            r"faces\[4\]: degenerate",
            "1 triangle has no area and was set aside.",
        ),
        "two": (
            vertices + shifted,
            faces + [[v + 4 for v in f] for f in faces],
            "2 components",
            "Repaired, it has 8 triangles in 2 components with 0 boundary loops.",
        ),
    }


@pytest.mark.parametrize("kind", sorted(bad_meshes()))
@pytest.mark.parametrize("command", ["segment", "atlas", "remesh", "info"])
def test_bad_meshes_give_one_line_and_no_file(tmp_path, kind, command):
    vertices, faces, culprit = bad_meshes()[kind]
    mesh = tmp_path / "bad.obj"
    write_obj(mesh, vertices, faces)
    check_refused(tmp_path, mesh, command, culprit)


def test_faces_without_any_area_have_texture_coordinates(tmp_path):
    mesh = tmp_path / "line.obj"
    write_obj(mesh, TETRAHEDRON[0], [[0, 0, 1], [1, 2, 1]])
    result = run("atlas", mesh, "-o", tmp_path / "out.obj")
    assert (result.returncode, result.stderr) == (0, "")
    assert "note: no face has an area: all texture coordinates are 0" in result.stdout
    lines = (tmp_path / "out.obj").read_text().splitlines()
    assert lines[-2:] == ["f 1/1 1/1 2/1", "f 2/1 3/1 2/1"]
    refused = [("segment", "npz"), ("info", None), ("atlas", "npz"), ("atlas", "html")]
    for command, suffix in refused:
        output = ["-o", tmp_path / f"a.{suffix}"] if suffix else []
        line = failure(run(command, mesh, *output), 1)
        assert line == f"{mesh}: faces: no face has an area"


@pytest.mark.parametrize("kind", sorted(rough_meshes()))
def test_rough_meshes_are_described_and_mapped_but_not_remeshed(tmp_path, kind):
    vertices, faces, culprit, sentence = rough_meshes()[kind]
    mesh = tmp_path / "rough.obj"
    write_obj(mesh, vertices, faces)
    check_refused(tmp_path, mesh, "remesh", culprit)
    result = run("info", mesh)
    assert (result.returncode, result.stderr) == (0, "")
    assert sentence in result.stdout.splitlines()
    result = run("atlas", mesh, "-o", tmp_path / "out.obj")
    assert result.returncode == 0, result.stderr
    lines = (tmp_path / "out.obj").read_text().splitlines()
    assert sum(line.startswith("f ") for line in lines) == len(faces)


def test_info_as_json(tmp_path):
    """Two objects: a square of one quad with colours, and a pentagon with a copy of itself."""
    lines = [f"v {x} {y} 0 1 0 0" for x, y in [(0, 0), (2, 0), (2, 2), (0, 2)]]
    lines += ["vt 0 0", "mtllib none.mtl", "o square", "usemtl red", "f 1/1 2/1 3/1 4/1"]
    lines += [f"v {x} {y} 0 1 0 0" for x, y in [(5, 0), (6, 0), (6, 1), (5.5, 2), (5, 1)]]
    lines += ["o house", "f 5 6 7 8 9", "f 5 6 7 8 9", "v 9 9 9 1 0 0"]
    (tmp_path / "two.obj").write_text("\n".join(lines) + "\n")
    result = run("info", "two.obj", "--json", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    found = json.loads(result.stdout, parse_constant=pytest.fail)
    assert found["file"] == "two.obj"
    assert (found["components"], found["faces"], found["boundary_loops"]) == (2, 5, 2)
    assert found["polygons"] == {"4": 1, "5": 2}
    assert found["area"] == pytest.approx(4 + 1.5)
    assert found["extent"] == [6, 2, 0]
    assert found["materials"] == ["red"]
    defects = {name: count for name, count in found["defects"].items() if count}
    assert defects == {"isolated_vertices": 1, "duplicate_faces": 3}
    square, house = found["meshes"]
    assert (square["name"], square["area"], square["uv_sets"]) == ("square", 4, 1)
    assert (square["vertex_colours"], square["instances"], square["genus"]) == (True, 1, 0)
    assert square["transforms"] == [np.eye(4).tolist()]
    # A material holds until the next.
    assert (house["materials"], house["faces"]) == (["red"], 3)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
@pytest.mark.parametrize("content", ["empty", "random"])
def test_bad_files_give_one_line_and_no_file(tmp_path, suffix, content):
    mesh = tmp_path / f"bad.{suffix}"
    mesh.write_bytes(b"" if content == "empty" else np.random.default_rng(0).bytes(5000))
    check_refused(tmp_path, mesh, "segment", "empty file" if content == "empty" else "bad")


def check_refused(folder, mesh, command, culprit):
    suffixes = {"segment": "npz", "atlas": "glb", "remesh": "ply"}
    output = {name: ["-o", folder / f"out.{suffix}"] for name, suffix in suffixes.items()}
    result = run(command, mesh, *output.get(command, []))
    line = failure(result, 1)
    assert line.startswith(f"{mesh}: ")
    assert re.search(culprit, line)
    assert sorted(p.name for p in folder.iterdir()) == [mesh.name]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("", "Usage: phaseatlas"),
        ("nonsense", "nonsense"),
        ("info", "MESH"),
        ("info model.obj more.obj", "more.obj"),
        ("info --nonsense model.obj", "--nonsense"),
        ("segment model.obj", "--output"),
        ("segment model.obj -o a.txt", "output: a.txt must end in .npz or .ply"),
        ("atlas model.obj -o nowhere/a.glb", "output: the folder of nowhere/a.glb does not exist"),
        ("atlas model.obj -o model.obj", "output: model.obj would overwrite an input"),
        ("segment model.obj -o a.npz --levels x", "--levels"),
        ("segment model.obj -o a.npz --levels 0", "levels: 0 must be"),
        ("segment model.obj -o a.npz --levels 17", "levels: 17 must be"),
        ("segment model.obj -o a.npz --epsilon -1", "epsilon: -1.0 must be a positive number"),
        ("segment model.obj -o a.npz --epsilon nan", "epsilon: nan must be a positive number"),
        ("segment model.obj -o a.npz --epsilon 100", "epsilon: "),
        ("segment model.obj -o a.npz --distortion -1", "distortion: -1.0 must be"),
        ("segment model.obj -o a.npz --distortion nan", "distortion: nan must be"),
        ("segment model.obj -o a.npz --seed -1", "seed: -1 must be"),
        ("segment model.obj -o a.npz --solver nonsense", "--solver"),
        ("segment model.obj -o a.npz --area nonsense", "--area"),
        ("segment model.obj -o a.npz --law nonsense", "--law"),
        ("segment model.obj -o a.npz --initial nonsense", "--initial"),
        ("atlas model.obj -o a.glb --flatten nonsense", "--flatten"),
        ("atlas model.obj -o a.glb --resolution 31", "--resolution"),
        ("atlas model.obj -o a.glb --epsilon 0.1", "epsilon: value must be given with levels"),
        ("atlas model.obj -o a.glb --no-connected", "connected: value must be given with"),
        ("atlas model.obj -o a.glb --solver ipopt", "solver: value must be given with levels"),
        ("atlas model.obj -o a.glb --levels 1 --max-charts 3", "max_charts: value must not be"),
        ("atlas model.obj -o a.glb --levels 1 --effort fast", "effort: value must not be given"),
        ("atlas model.obj -o a.glb --effort nonsense", "--effort"),
        ("atlas model.obj -o a.glb --density 3 --resolution 64", "resolution: value must be left"),
        ("atlas model.obj -o a.glb --stack", "stack: value must be given with symmetry alone"),
        ("atlas model.obj -o a.glb --mips 6", "mips: 6 puts 256 texels between charts"),
        ("atlas model.obj -o a.glb --symmetry w", "--symmetry"),
        ("atlas model.obj -o a.glb --max-charts 0", "max_charts: value must be at least 1"),
        ("atlas model.obj -o a.glb --max-distortion 0", "max_distortion: value must be"),
        ("atlas model.obj -o a.glb --distortion 0", "distortion: value must be a positive number"),
        (
            "atlas model.obj -o a.glb --rebake --texture checker",
            "rebake: value must not be given with texture",
        ),
        ("demo model.obj", "folder: model.obj must be a folder"),
    ],
)
def test_arguments_that_cannot_be_used(model, arguments, words):
    before = sorted(model.parent.iterdir())
    result = run(*arguments.split(), cwd=model.parent)
    if arguments:
        assert words in failure(result, 2)
    else:
        assert result.returncode == 2
        assert result.stderr.startswith(words)
    assert sorted(model.parent.iterdir()) == before


@pytest.mark.parametrize("command", ["info", "segment", "atlas", "remesh"])
def test_files_that_cannot_be_opened(model, command):
    output = {"segment": ["-o", "a.npz"], "atlas": ["-o", "a.glb"], "remesh": ["-o", "a.ply"]}
    folder = model.parent
    for name, reason in [("missing.obj", "no such file"), ("folder", "a folder, not a file")]:
        (folder / "folder").mkdir(exist_ok=True)
        result = run(command, name, *output.get(command, []), cwd=folder)
        assert failure(result, 1) == f"{name}: {reason}"


def test_textures_that_cannot_be_used(model):
    folder = model.parent
    (folder / "noise.png").write_bytes(b"noise" * 100)
    # Nothing but zeros, which compress well: a small file of more pixels than Pillow reads.
    Image.new("1", (20_000, 20_000)).save(folder / "bomb.png")
    for name, words in [
        ("missing.png", "no such file"),
        ("noise.png", "cannot be read as an image"),
        ("bomb.png", "400000000 pixels"),
    ]:
        result = run("atlas", model, "-o", "a.glb", "--texture", name, cwd=folder)
        line = failure(result, 1)
        assert line.startswith(f"{name}: ")
        assert words in line
    assert not (folder / "a.glb").exists()


def test_extensions_that_are_missing(tmp_path):
    name = "EXT_meshopt_compression"
    header = {"asset": {"version": "2.0"}, "extensionsRequired": [name], "extensionsUsed": [name]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    path = tmp_path / "packed.glb"
    path.write_bytes(struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text)
    assert name in failure(run("info", path), 1)


def test_exit_codes_of_warnings(capsys):
    """The library's warnings are lines, its other warnings are not; strict makes them a failure."""

    def command(strict: bool = False) -> None:
        quality.warn("the cut\nis long; a larger epsilon helps")
        quality.warn("the cut\nis long; a larger epsilon helps")
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)

    def quiet(strict: bool = False) -> None:
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)

    assert checked(command)() == 0
    line = "phaseatlas: warning: the cut is long; a larger epsilon helps\n"
    assert capsys.readouterr().err == 2 * line
    assert checked(command)(strict=True) == 3
    assert capsys.readouterr().err == 2 * line
    assert checked(quiet)(strict=True) == 0
    assert capsys.readouterr().err == ""


def test_only_options_make_a_usage_error():
    """The same error is a usage error where the command has an option of its name."""

    def command(epsilon: float = 1.0) -> None:
        raise ValueError(f"epsilon: {epsilon} must be smaller")

    def without() -> None:
        command()

    with pytest.raises(ValueError, match="epsilon") as usage:
        checked(command)()
    with pytest.raises(ValueError, match="epsilon") as other:
        checked(without)()
    assert type(usage.value) is not ValueError
    assert type(other.value) is ValueError


def test_options_are_those_of_the_library():
    names = {
        "area": options.Area,
        "law": options.Formulation,
        "solver": options.Solver,
        "initial": options.Initial,
    }
    for name, option in names.items():
        with pytest.raises(ValueError, match=name) as caught:
            segmentation.Options(**{name: "nonsense"})
        assert str(get_args(get_args(option)[0])) in str(caught.value)
    library = {field.name: field.default for field in dataclasses.fields(segmentation.Options)}
    for command in (segment, atlas):
        for name, parameter in inspect.signature(command).parameters.items():
            # It depends on the way to charts; see `test_distortion_of_an_atlas`.
            if (command, name) != (atlas, "distortion"):
                assert parameter.default == library.get(name, parameter.default)


def interrupted(delay, *arguments, **settings):
    """A run that gets Ctrl-C after `delay` seconds."""
    command = [sys.executable, "-m", "phaseatlas", *map(str, arguments)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, **settings) as process:
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


posix = pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as POSIX does")


@posix
@pytest.mark.parametrize("command", ["segment", "atlas", "remesh"])
def test_ctrl_c_while_working(tmp_path, command):
    if command == "remesh":
        pytest.importorskip("mmgpy", reason="needs the extra remesh")
    surface = pa.datasets.icosphere(5)
    write_obj(tmp_path / "sphere.obj", surface.vertices, surface.faces)
    suffix = {"segment": "npz", "atlas": "glb", "remesh": "obj"}[command]
    more = ["--edge-length", 0.004] if command == "remesh" else ["--levels", 6]
    result = interrupted(2, command, "sphere.obj", "-o", f"a.{suffix}", *more, cwd=tmp_path)
    assert failure(result, 130) == "interrupted"
    assert [path.name for path in tmp_path.iterdir()] == ["sphere.obj"]


@posix
@pytest.mark.parametrize("module", ["typer", "numpy", "scipy"])
def test_ctrl_c_while_importing(model, tmp_path, module):
    # In the place of the real one: waits, says so, and turns the interrupt into something else.
    text = "import sys, time\n"
    text += "try:\n    print('here', flush=True)\n    time.sleep(60)\n"
    text += "except BaseException:\n    raise ImportError('something else')\n"
    (tmp_path / f"{module}.py").write_text(text)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "phaseatlas", "segment", str(model), "-o", "a.npz"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert process.stdout.readline() == "here\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "phaseatlas: interrupted\n")


@posix
def test_a_reader_that_leaves_is_no_failure(model):
    for command in (["info", model], ["segment", model, "-o", "a.npz", "--levels", "1"]):
        read, write = os.pipe()
        os.close(read)
        command = [sys.executable, "-m", "phaseatlas", *map(str, command)]
        result = subprocess.run(
            command, stdout=write, stderr=subprocess.PIPE, text=True, cwd=model.parent
        )
        os.close(write)
        assert (result.returncode, result.stderr) == (0, "")
    assert (model.parent / "a.npz").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no full device")
def test_a_full_disk_is_one_line(model):
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "phaseatlas", "info", str(model)]
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    message = "phaseatlas: no space left on device\n"
    assert (result.returncode, result.stderr) == (1, message)


def test_no_window_system_plays_a_part(tmp_path):
    environment = {**os.environ, "MPLBACKEND": "nonsense"}
    result = run("demo", tmp_path / "out", "--levels", 1, env=environment)
    assert (result.returncode, result.stderr) == (0, "")


def test_version():
    # What is installed, where anything is, was built from the same manifest.
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*", pa.__version__)
    manifest = Path(__file__).parents[1] / "Cargo.toml"
    assert f'version = "{pa.__version__}"' in manifest.read_text(encoding="utf-8")
    result = run("--version")
    assert (result.returncode, result.stdout) == (0, f"phaseatlas {pa.__version__}\n")


def imported(code):
    """Names of the modules that a piece of code imports."""
    code += "\nimport sys; print(*sys.modules, file=sys.stderr)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return set(result.stderr.split())


def test_what_is_imported_is_what_is_used(model):
    heavy = {"numpy", "scipy", "matplotlib", "trimesh", "PIL", "rich", "typer"}
    assert heavy & imported("import phaseatlas") == set()
    command = f"import sys; sys.argv[1:] = ['info', {str(model)!r}]\n"
    command += "from phaseatlas.cli import main\ntry:\n    main()\nexcept SystemExit:\n    pass"
    used = imported(command)
    assert heavy & used <= {"numpy", "scipy", "typer"}


def test_names_of_the_package():
    for name in pa.__all__:
        assert getattr(pa, name) is not None
        assert name in dir(pa)
    assert pa.optimise is optimise
    with pytest.raises(AttributeError, match="nonsense"):
        _ = pa.nonsense
    # The module of the same name does not take the function's place.
    code = "from phaseatlas.remesh import remesh; import phaseatlas as pa\n"
    code += "import phaseatlas.remesh; assert pa.remesh is remesh"
    imported(code)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux does")
@pytest.mark.parametrize(("asked", "most"), [("1000", os.cpu_count()), ("1", 1), ("x", None)])
def test_threads_are_not_more_than_cores(asked, most):
    code = (
        "import os, phaseatlas as pa\nsphere = pa.datasets.icosphere(2)\n"
        "count = lambda: len(os.listdir('/proc/self/task'))\nbefore = count()\n"
        "pa.functionals.Area(sphere, 0.1).value_and_gradient(sphere.vertices[:, 0].copy())\n"
        "print(before, count(), len(os.sched_getaffinity(0)))"
    )
    environment = {**os.environ, "RAYON_NUM_THREADS": asked}
    result = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    before, after, cores = map(int, result.stdout.split())
    # The surface may have started them.
    assert after <= before + cores
    assert after <= 1 + (most or cores) + before


def test_segment_and_atlas(model):
    folder = model.parent
    result = run("segment", model, "-o", folder / "a.npz", "--levels", 2, "--seed", 3)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    tree = segmentation.SegmentTree.load(folder / "a.npz")
    expected = pa.segment(pa.load(model), 2, seed=3)
    assert np.array_equal(tree.labels, expected.labels)
    assert run("segment", model, "-o", folder / "a.ply", "--levels", 1).returncode == 0
    assert len(trimesh.load(folder / "a.ply", process=False).faces) == tree.surface.n_faces
    result = run("atlas", model, "-o", folder / "a.glb", "--levels", 1, "--resolution", 128)
    assert result.returncode == 0, result.stderr
    assert "flips: 0" in result.stdout.splitlines()
    assert result.stdout.endswith(f"wrote {folder / 'a.glb'}\n")
    assert (folder / "a.glb").stat().st_size > 0


def test_segments_of_several_pieces(tmp_path):
    """Of two spheres, the larger with a second copy of a face; all faces have a label."""
    sphere = pa.datasets.icosphere(2)
    vertices = np.concatenate([sphere.vertices, 2 * sphere.vertices + [5, 0, 0]])
    faces = np.concatenate([sphere.faces, sphere.faces + sphere.n_vertices])
    faces = np.concatenate([faces, faces[-1:]])
    write_obj(tmp_path / "two.obj", vertices, faces)
    options = ["--levels", 2, "--seed", 1]
    result = run("segment", "two.obj", "-o", "a.npz", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "pieces 2, segments 4" in result.stdout
    found = segmentation.SceneSegmentation.load(tmp_path / "a.npz")
    expected = pa.segment(pa.load_scene(tmp_path / "two.obj"), 2, seed=1)
    assert np.array_equal(found.labels, expected.labels)
    digest = hashlib.sha256((tmp_path / "two.obj").read_bytes()).hexdigest()
    assert (found.surface.file.path, found.surface.file.sha256) == ("two.obj", digest)
    result = run("segment", "two.obj", "-o", "a.ply", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    shown = trimesh.load(tmp_path / "a.ply", process=False)
    labels = shown.metadata["_ply_raw"]["face"]["data"]["label"].reshape(-1)
    assert np.array_equal(labels, expected.labels)


def test_atlas_of_charts_by_energy(model):
    """Without a number of levels; each option does what the library's does."""
    expected = pa.partition(pa.load(model), distortion=300.0, effort="fast", seed=2)
    options = ["--distortion", 300, "--effort", "fast", "--seed", 2, "--texture", "checker"]
    result = run("atlas", model, "-o", model.parent / "a.glb", "--resolution", 128, *options)
    assert result.returncode == 0, result.stderr
    assert f"energy {expected.diagnostics[-1].energy:.4g}," in result.stdout
    lines = result.stdout.splitlines()
    assert {f"charts: {expected.n_segments}", "non_disk: 0", "flips: 0", "overlap: 0"} <= set(lines)
    result = run("atlas", model, "-o", model.parent / "b.glb", "--max-charts", 2)
    assert re.match(r"charts [12], ", result.stdout)


def test_atlas_of_a_cut_mesh(model):
    result = run("atlas", model, "-o", model.parent / "a.obj", "--cut", "--effort", "fast")
    assert (result.returncode, result.stderr) == (0, "")
    line = r"cut: the mesh is a new one, (\d+) triangles before and (\d+) after\n"
    before, after = map(int, re.search(line, result.stdout).groups())
    assert before == pa.load(model).n_faces < after == pa.load(model.parent / "a.obj").n_faces


def test_textures_of_a_file_go_with_it(model):
    """The colour of a material becomes a picture, and a texture that is missing is named."""
    folder = model.parent
    text = model.read_text()
    model.write_text("mtllib model.mtl\nusemtl red\n" + text)
    (folder / "model.mtl").write_text("newmtl red\nKd 1 0 0.2\nmap_Kd none.png\n")
    options = ["--effort", "fast", "--resolution", 64, "--rebake"]
    for more in ([], ["--cut"]):
        result = run("atlas", model, "-o", folder / "a.obj", *options, *more)
        assert (result.returncode, result.stderr) == (0, "")
        line = "note: the texture none.png is missing and was not baked"
        assert line in result.stdout.splitlines()
        picture = np.asarray(Image.open(folder / "a.png"))
        assert picture.shape == (64, 64, 3)
        assert (picture == [255, 0, 51]).all()


def test_distortion_of_an_atlas(model):
    """Its default is that of the library for both ways to charts."""
    for levels in ([], ["--levels", 1]):
        sizes = []
        for weight in ([], ["--distortion", 0 if levels else 600]):
            run("atlas", model, "-o", model.parent / "a.obj", "--resolution", 64, *levels, *weight)
            sizes.append((model.parent / "a.obj").read_bytes())
        assert sizes[0] == sizes[1]


def test_segment_with_ipopt(model):
    pytest.importorskip("ipyopt", reason="needs the extra ipopt")
    output = model.parent / "a.npz"
    result = run("segment", model, "-o", output, "--levels", 1, "--solver", "ipopt")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    expected = pa.segment(pa.load(model), 1, solver="ipopt")
    assert np.array_equal(segmentation.SegmentTree.load(output).fields, expected.fields)


def test_demo(tmp_path):
    result = run("demo", tmp_path / "out", "--levels", 1)
    assert result.returncode == 0, result.stderr
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["atlas.glb", "atlas.png", "blended.glb", "blended.png", "segments.png"]
    for word in ("charts", "segment", "interface length", "hencky", "seconds"):
        assert word in result.stdout


def test_missing_extra_is_one_line(model):
    (model.parent / "mmgpy.py").write_text("raise ImportError\n")
    path = os.pathsep.join([str(model.parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    result = run("remesh", model, "-o", model.parent / "a.obj", env=environment)
    assert "pip install 'phaseatlas[remesh]'" in failure(result, 1)
    assert not (model.parent / "a.obj").exists()


SCHEMA = json.loads((Path(__file__).parents[1] / "docs" / "record.schema.json").read_text())


@pytest.mark.parametrize(
    "arguments",
    [
        "info model.obj",
        "atlas model.obj -o a.glb --effort fast",
        "atlas model.obj -o a.glb --levels 1",
        "segment model.obj -o a.npz --levels 1",
        "segment none.obj -o a.npz",
        "batch none.obj -o a",
    ],
)
def test_records(model, arguments):
    """They keep their schema; nothing else is on standard output; a file holds the same."""
    folder = model.parent
    result = run(*arguments.split(), "--json", cwd=folder)
    record = json.loads(result.stdout, parse_constant=pytest.fail)
    jsonschema.validate(record, SCHEMA)
    assert record["command"] == arguments.split()[0]
    assert ("error" in record) == (result.returncode != 0) == ("none.obj" in arguments)
    written = run(*arguments.split(), "--json", "r.json", "--threads", 1, "-q", cwd=folder)
    assert (written.returncode, written.stdout) == (result.returncode, "")
    again = json.loads((folder / "r.json").read_text())
    assert {**again, "seconds": 0} == {**record, "seconds": 0}
    if record["command"] == "atlas":
        assert record["files"] == ["a.glb"]
        assert sum(record["shares"]) == pytest.approx(1)
        options = {"effort": "fast"} if "--effort" in arguments else {"levels": 1}
        assert record["options"] == options


def test_the_place_of_a_record_is_checked_first(model):
    before = sorted(model.parent.iterdir())
    for where, words in (
        ("none/r.json", "json: the folder of"),
        (model.name, "unexpected extra argument"),
    ):
        arguments = ["segment", model.name, "-o", "a.npz", "--json", where]
        assert words in failure(run(*arguments, cwd=model.parent), 2)
    assert sorted(model.parent.iterdir()) == before


def test_steps_are_told_and_hidden(model):
    """Lines of the steps on the error stream with -v, nothing at all with --quiet."""
    out = model.parent / "a.glb"
    result = run("atlas", model, "-o", out, "--effort", "fast", "-v")
    assert re.match(r"phaseatlas: \d+\.\d s: cells, \d+ charts, energy", result.stderr)
    result = run("segment", model, "-o", out.with_suffix(".npz"), "--levels", 2, "-v")
    for step in ("level 1 of 2, node 1 of 1", "level 2 of 2, node 2 of 2"):
        assert step in result.stderr
    result = run("atlas", model, "-o", out, "--effort", "fast", "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.parametrize("option", ["-h", "--help"])
@pytest.mark.parametrize("command", [None, "segment", "atlas", "batch", "remesh", "info", "demo"])
def test_help(command, option):
    result = run(*filter(None, [command, option]))
    assert (result.returncode, result.stderr) == (0, "")
    assert f"Usage: phaseatlas {command or ''}" in result.stdout
    strict = command not in (None, "info")
    assert ("--strict" in result.stdout) == strict


def test_distortion_with_free_areas_and_the_printed_law(tmp_path, model):
    out = tmp_path / "out.npz"
    options = ["--levels", 1, "--distortion", 3, "--no-connected"]
    result = run("segment", model, "-o", out, *options)
    assert result.returncode == 0, result.stderr
    kept = pa.SegmentTree.load(out)
    result = run("segment", model, "-o", out, *options, "--area", "none", "--law", "paper")
    assert result.returncode == 0, result.stderr
    free = pa.SegmentTree.load(out)
    assert abs(kept.diagnostics[0].violation) < 1e-5 < abs(free.diagnostics[0].violation)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere address space has no limit")
def test_memory_for_the_texture_is_checked_before_the_mesh_is_read(tmp_path):
    def confine():
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))

    arguments = ["atlas", tmp_path / "none.obj", "-o", tmp_path / "a.glb", "--resolution", 16384]
    message = failure(run(*arguments, preexec_fn=confine), 1)
    assert re.fullmatch(r"resolution: 16384 takes [\d.]+ GiB of memory; must be smaller", message)
    assert failure(run(*arguments[:-1], 1024, preexec_fn=confine), 1).endswith("no such file")
