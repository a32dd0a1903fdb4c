"""Batches: every mesh has its line and its atlas, whatever is killed and whoever works."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import jsonschema
import pytest

import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.batching.manifest import Manifest, locked
from phaseatlas.batching.memory import peak, triangles
from phaseatlas.batching.plan import plan
from phaseatlas.batching.workers import WorkerDiedError, Workers
from phaseatlas.file_atlas import AtlasOptions, atlas_file

NO_PROC = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="children are found in /proc alone"
)
FAST = AtlasOptions(effort="fast")


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Five small meshes in two folders, one of them without a face."""
    folder = tmp_path_factory.mktemp("models")
    (folder / "more").mkdir()
    pa.save_mesh(datasets.icosphere(0), folder / "ball.obj")
    pa.save_mesh(datasets.sheet(9, 4), folder / "flag.ply")
    pa.save_mesh(datasets.sheet(6, 5), folder / "more" / "sheet.obj")
    pa.save_mesh(datasets.sheet(7, 4, amplitude=0.1, periods=1), folder / "more" / "patch.obj")
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    return folder


OUTPUTS = ["ball.glb", "flag.glb", "points.glb", "more/patch.glb", "more/sheet.glb"]


@pytest.fixture(scope="module")
def serial(models, tmp_path_factory):
    """The bytes of each atlas, made one after the other by the function for one file."""
    folder = tmp_path_factory.mktemp("serial")
    found = {}
    for output in OUTPUTS:
        if output != "points.glb":
            source = next(models.glob(output.replace(".glb", ".*")))
            (folder / output).parent.mkdir(exist_ok=True)
            atlas_file(source, folder / output, FAST)
            found[output] = (folder / output).read_bytes()
    return found


def written(folder):
    """The bytes of all files below a folder but the manifest."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "manifest.jsonl"
    }


def lines(folder):
    return [json.loads(line) for line in (folder / "manifest.jsonl").read_text().splitlines()]


def check_whole(folder, serial):
    """One line a mesh in order, the atlases of all but one, and nothing else."""
    assert [line["output"] for line in lines(folder)] == OUTPUTS
    assert [line["output"] for line in lines(folder) if "error" in line] == ["points.glb"]
    assert written(folder) == serial


def touch(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("x")
    return path


def go_on(models, out):
    """A batch, or the rest of one, in this process."""
    with ThreadPoolExecutor(1) as thread:
        return pa.batch(models, out, options=FAST, executor=thread, resume=True)


# Which files, and where to.


def test_results_lie_as_their_inputs_do(tmp_path):
    for name in ("a.obj", "b.STL", "notes.txt", ".hidden.obj", "x/c.glb", "x/y/d.off", ".z/e.obj"):
        touch(tmp_path / "in" / name)
    out = tmp_path / "in" / "out"
    touch(out / "a.glb")
    found = plan([tmp_path / "in"], out)
    assert [job.output for job in found] == ["a.glb", "b.glb", "x/c.glb", "x/y/d.glb"]
    assert [job.source for job in found][2] == tmp_path / "in" / "x" / "c.glb"
    same = plan([tmp_path / "in"], out, "same")
    assert [job.output for job in same] == ["a.obj", "b.ply", "x/c.glb", "x/y/d.ply"]
    pattern = plan([f"{tmp_path}/in/x/**/*.*"], out)
    assert [job.output for job in pattern] == ["c.glb", "y/d.glb"]
    # Each once, however often it is named.
    assert len(plan([tmp_path / "in", tmp_path / "in" / "a.obj"], out)) == 4


def test_no_two_results_share_a_name(tmp_path):
    for name in ("a.obj", "a.stl", "a.obj.glb", "b.obj"):
        touch(tmp_path / "in" / name)
    found = {job.source.name: job.output for job in plan([tmp_path / "in"], tmp_path / "out")}
    assert found == {
        "a.obj": "a.obj.glb",
        "a.stl": "a.stl.glb",
        "a.obj.glb": "a.obj.glb.glb",
        "b.obj": "b.glb",
    }
    touch(tmp_path / "other" / "b.obj")
    both = plan([tmp_path / "in" / "b.obj", tmp_path / "other"], tmp_path / "out")
    assert [job.output for job in both] == ["in/b.glb", "other/b.glb"]


def test_a_name_with_wildcards_is_a_name(tmp_path):
    odd = touch(tmp_path / "a[1].obj")
    assert [job.source for job in plan([odd], tmp_path / "out")] == [odd]


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (["none.obj"], r"^inputs: .*none.obj: no such file or folder"),
        (["*.none"], r"^inputs: there is no mesh in .*\*.none"),
        (["empty"], r"^inputs: there is no mesh in .*empty"),
        ([], r"^inputs: value must be"),
        (["out/a.obj"], r"^folder: .*out must not hold an input, .*a.obj"),
    ],
)
def test_inputs_that_cannot_be_used(tmp_path, inputs, message):
    (tmp_path / "empty").mkdir()
    touch(tmp_path / "out" / "a.obj")
    with pytest.raises(ValueError, match=message):
        pa.batch([tmp_path / name for name in inputs], tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"jobs": 0}, "^jobs: value must be at least 1"),
        ({"timeout": 0}, "^timeout: value must be a positive number"),
        ({"memory": float("nan")}, "^memory: value must be a positive number"),
        ({"format": "stl"}, "^format: value must be one of"),
    ],
)
def test_options_that_cannot_be_used(models, tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        pa.batch(models, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


# The manifest.


def test_a_part_of_a_line_is_left_out(tmp_path):
    manifest = Manifest(tmp_path)
    manifest.append({"input": "x", "output": "a", "n": 1})
    manifest.append({"input": "y", "output": "b"})
    manifest.append({"input": "x", "output": "a", "n": 2})
    with manifest.path.open("ab") as file:
        file.write(b'{"output": "c", "n')
    assert manifest.read() == [
        {"input": "y", "output": "b"},
        {"input": "x", "output": "a", "n": 2},
    ]


@pytest.mark.parametrize("line", ['{"output": "c", "n', '{"output": "c"}', '{"input": "x"}', "[1]"])
def test_a_line_that_is_no_record_is_named(models, tmp_path, line):
    manifest = Manifest(tmp_path)
    manifest.append({"input": "x", "output": "a"})
    with manifest.path.open("a") as file:
        file.write(f'{line}\n{{"input": "y", "output": "d"}}\n')
    with pytest.raises(ValueError, match=r"manifest.jsonl: line 2 is no record"):
        pa.batch(models, tmp_path, resume=True)


def test_two_batches_do_not_share_a_folder(models, tmp_path):
    pytest.importorskip("fcntl")
    with locked(tmp_path), pytest.raises(ValueError, match=r"^folder: another batch is at work"):
        pa.batch(models, tmp_path, resume=True)


# The workers.


def test_workers_give_results_and_errors():
    with Workers(2) as workers:
        futures = [workers.submit(pow, 2, k) for k in range(5)]
        assert [future.result() for future in futures] == [1, 2, 4, 8, 16]
        with pytest.raises(ZeroDivisionError):
            workers.submit(divmod, 1, 0).result()
        # What is printed does not come between the answers.
        assert workers.submit(print, "printed by a worker").result() is None


def test_a_worker_that_dies_fails_its_call_alone():
    with Workers(1) as workers:
        killed = workers.submit(signal.raise_signal, signal.SIGKILL)
        ended = workers.submit(os._exit, 7)
        after = workers.submit(pow, 2, 3)
        with pytest.raises(WorkerDiedError, match=r"^worker was killed \(signal 9\)$"):
            killed.result()
        with pytest.raises(WorkerDiedError, match=r"^worker ended with code 7$"):
            ended.result()
        assert after.result() == 8


def test_workers_start_whatever_the_path_of_modules_holds(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [tmp_path, *sys.path, None])
    with Workers(1) as workers:
        assert workers.submit(pow, 2, 3).result() == 8


def test_a_call_that_takes_too_long_is_ended():
    with Workers(1, timeout=0.2) as workers:
        late = workers.submit(time.sleep, 600)
        with pytest.raises(TimeoutError, match=r"^took longer than 0.2 s$"):
            late.result()
        assert workers.submit(pow, 2, 3).result() == 8


# Whole batches.


def test_the_bytes_do_not_depend_on_who_works(models, serial, tmp_path):
    told = []
    result = pa.batch(models, tmp_path, options=FAST, jobs=2, progress=told.append)
    check_whole(tmp_path, serial)
    assert [(state.done, state.total) for state in told] == [(k, 5) for k in range(6)]
    assert list(result.records) == lines(tmp_path)
    (failed,) = result.failed
    assert failed["error"] == "no faces: points or lines alone"
    (ball,) = (record for record in result.records if record["output"] == "ball.glb")
    assert ball["input"] == str(models / "ball.obj")
    assert ball["sha256"] == hashlib.sha256((models / "ball.obj").read_bytes()).hexdigest()
    assert ball["options"] == {"effort": "fast"}
    assert ball["version"] == pa.__version__
    assert ball["metrics"]["flips"] == 0
    assert ball["warnings"] == []
    assert ball["seconds"] > 0
    with ThreadPoolExecutor(2) as threads:
        pa.batch(models, tmp_path / "threads", options=FAST, executor=threads)
    check_whole(tmp_path / "threads", serial)


def test_resume_does_what_is_missing_has_failed_or_has_changed(models, tmp_path):
    sources = tmp_path / "in"
    sources.mkdir()
    for name in ("ball.obj", "flag.ply", "points.obj"):
        (sources / name).write_bytes((models / name).read_bytes())
    out = tmp_path / "out"

    def made_again(**options):
        done = []
        with ThreadPoolExecutor(1) as thread:
            result = pa.batch(
                sources,
                out,
                executor=thread,
                progress=lambda state: state.record and done.append(state.record["output"]),
                **{"options": FAST, "resume": True, **options},
            )
        assert result.skipped == 3 - len(done)
        assert [line["output"] for line in lines(out)] == ["ball.glb", "flag.glb", "points.glb"]
        return done

    assert len(made_again()) == 3
    with pytest.raises(ValueError, match=r"^folder: .*resume"):
        made_again(resume=False)
    assert made_again() == ["points.glb"]
    (sources / "points.obj").write_bytes((models / "more" / "sheet.obj").read_bytes())
    assert made_again() == ["points.glb"]
    assert made_again() == []
    (out / "flag.glb").unlink()
    assert made_again() == ["flag.glb"]
    (sources / "ball.obj").write_bytes((models / "more" / "patch.obj").read_bytes())
    assert made_again() == ["ball.glb"]
    assert made_again(options=AtlasOptions(effort="fast", seed=1)) == [
        "ball.glb",
        "flag.glb",
        "points.glb",
    ]


def test_lines_of_other_meshes_stay(models, tmp_path):
    for name in ("ball.obj", "flag.ply"):
        go_on(models / name, tmp_path)
    assert [line["output"] for line in lines(tmp_path)] == ["ball.glb", "flag.glb"]


def test_the_estimates_see_the_triangles(models, serial, tmp_path):
    surface = datasets.icosphere(3)
    for suffix in (".obj", ".ply"):
        pa.save_mesh(surface, tmp_path / f"a{suffix}")
        assert surface.n_faces <= triangles(tmp_path / f"a{suffix}") <= 2 * surface.n_faces
    # A glTF file says how many, whatever else it holds.
    ball = tmp_path / "ball.glb"
    ball.write_bytes(serial["ball.glb"] + bytes(10000))
    assert triangles(ball) == 20
    ball.write_bytes(b"glTF and nothing else")
    assert triangles(ball) > 0
    options = [FAST, AtlasOptions(texture="checker"), AtlasOptions(rebake=True)]
    plain, textured, baked = (peak(tmp_path / "a.obj", each) for each in options)
    assert 1e8 < plain < textured < baked
    assert peak(tmp_path / "none.obj", FAST) == 0


class Slow(Executor):
    """Counts the calls that it has, and ends them only when nothing else can go on."""

    def __init__(self):
        self.calls = []
        self.most = 0

    def submit(self, function, *args):
        future = Future()
        self.calls.append(future)
        self.most = max(self.most, len(self.calls))
        future.add_done_callback(self.calls.remove)
        return future


@pytest.mark.parametrize(("meshes", "most"), [(0.5, 1), (2.5, 2), (5.5, 5)])
def test_meshes_in_work_fit_into_the_memory(models, tmp_path, meshes, most):
    import threading

    size = max(peak(file, FAST) for file in models.rglob("*.*"))
    slow = Slow()
    over = threading.Event()

    def end():
        while not over.wait(0.05):
            before = list(slow.calls)
            if not over.wait(0.1) and slow.calls == before and before:
                before[0].set_exception(RuntimeError("not done"))

    thread = threading.Thread(target=end)
    thread.start()
    try:
        result = pa.batch(models, tmp_path, executor=slow, memory=meshes * size)
    finally:
        over.set()
        thread.join()
    assert slow.most == most
    assert [record["error"] for record in result.failed] == ["not done"] * 5


# Processes that are killed.


def start(models, out, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "phaseatlas", "batch", str(models), "-o", str(out), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def until(condition, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError("it did not happen")


def children(process):
    path = Path(f"/proc/{process.pid}/task")
    found = set()
    for task in path.iterdir():
        try:
            found |= {int(pid) for pid in (task / "children").read_text().split()}
        except OSError:
            continue
    return found


def gone(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def n_lines(out):
    path = out / "manifest.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


@NO_PROC
@pytest.mark.parametrize("after", [0, 2])
def test_a_batch_that_was_killed_goes_on(models, serial, tmp_path, after):
    process = start(models, tmp_path, "--jobs", "2", "--effort", "fast")
    until(lambda: n_lines(tmp_path) >= after and len(children(process)) == 2)
    workers = children(process)
    process.kill()
    process.communicate()
    # Nobody works on without the batch.
    until(lambda: all(map(gone, workers)))
    good = sum("metrics" in line for line in lines(tmp_path))
    with (tmp_path / "manifest.jsonl").open("ab") as file:
        file.write(b'{"input": "half a li')
    # As a process leaves it that is killed while it writes.
    (tmp_path / ".ball.glb.abcd1234.part").write_text("half a fi")
    assert go_on(models, tmp_path).skipped == good
    check_whole(tmp_path, serial)


@NO_PROC
def test_a_mesh_whose_workers_are_killed_fails_alone(models, serial, tmp_path):
    process = start(models / "more", tmp_path, "--jobs", "1", "--effort", "fast")
    (first,) = until(lambda: children(process))
    os.kill(first, signal.SIGKILL)
    (second,) = until(lambda: children(process) - {first})
    os.kill(second, signal.SIGKILL)
    said, errors = process.communicate()
    assert process.returncode == 1
    assert {"meshes: 2", "made: 1", "failed: 1"} <= set(said.splitlines())
    assert errors.splitlines() == [
        f"phaseatlas: {models}/more/patch.obj: worker was killed (signal 9)",
        "phaseatlas: 1 of 2 meshes failed; --resume tries them again",
    ]
    patch, sheet = lines(tmp_path)
    assert patch["error"] == "worker was killed (signal 9)"
    assert patch["sha256"] == hashlib.sha256((models / "more/patch.obj").read_bytes()).hexdigest()
    assert "metrics" in sheet
    assert not go_on(models / "more", tmp_path).failed
    assert written(tmp_path) == {
        name.removeprefix("more/"): data for name, data in serial.items() if "more/" in name
    }


@NO_PROC
def test_one_killed_worker_is_no_failure(models, serial, tmp_path):
    process = start(models, tmp_path, "--jobs", "2", "--effort", "fast")
    os.kill(min(until(lambda: children(process))), signal.SIGKILL)
    _, errors = process.communicate()
    assert process.returncode == 1
    assert errors.splitlines() == [
        f"phaseatlas: {models}/points.obj: no faces: points or lines alone",
        "phaseatlas: 1 of 5 meshes failed; --resume tries them again",
    ]
    check_whole(tmp_path, serial)


def test_the_command_keeps_its_record(models, tmp_path):
    schema = json.loads((Path(__file__).parents[1] / "docs" / "record.schema.json").read_text())
    go_on(models / "ball.obj", tmp_path)
    process = start(models / "ball.obj", tmp_path, "--effort", "fast", "--resume", "--json", "-")
    said, errors = process.communicate()
    assert (process.returncode, errors) == (0, "")
    record = json.loads(said)
    jsonschema.validate(record, schema)
    assert (record["meshes"], record["skipped"]) == (1, 1)
    assert record["files"] == [str(tmp_path / "manifest.jsonl")]


@NO_PROC
def test_ctrl_c_ends_the_batch(models, serial, tmp_path):
    process = start(models, tmp_path, "--jobs", "2", "--effort", "fast")
    until(lambda: n_lines(tmp_path))
    workers = children(process)
    # A terminal sends it to all.
    for pid in (*workers, process.pid):
        os.kill(pid, signal.SIGINT)
    _, errors = process.communicate()
    assert process.returncode == 130
    assert errors == "phaseatlas: interrupted\n"
    until(lambda: all(map(gone, workers)))
    assert not list(tmp_path.rglob("*.part"))
    for line in lines(tmp_path):
        assert "error" in line or (tmp_path / line["output"]).exists()
    go_on(models, tmp_path)
    check_whole(tmp_path, serial)
