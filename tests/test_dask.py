"""Dask does the work: batches, and the nodes and pieces of one mesh."""

import json
import os
import signal

import numpy as np
import pytest

import phaseatlas as pa
from phaseatlas import datasets
from phaseatlas.cli.app import app
from phaseatlas.file_atlas import AtlasOptions

distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")

FAST = AtlasOptions(effort="fast")


@pytest.fixture(scope="module")
def client():
    """Of two processes, which are replaced when they die."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def models(tmp_path):
    folder = tmp_path / "models"
    (folder / "more").mkdir(parents=True)
    for k in range(6):
        pa.save_mesh(datasets.sheet(5 + k, 4), folder / f"sheet{k}.obj")
    pa.save_mesh(datasets.icosphere(1), folder / "more" / "ball.ply")
    return folder


def atlases(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.glb")}


def test_a_killed_worker_changes_no_byte(client, models, tmp_path):
    pa.batch(models, tmp_path / "serial", options=FAST, jobs=1)
    killed = []

    def kill(state):
        # In the middle: the other meshes are given out by then.
        if state.done == 2 and not killed:
            (pid, *_) = client.run(os.getpid).values()
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)

    result = pa.batch(models, tmp_path / "dask", options=FAST, executor=client, progress=kill)
    assert killed
    assert not result.failed
    assert len(atlases(tmp_path / "dask")) == 7
    assert atlases(tmp_path / "dask") == atlases(tmp_path / "serial")
    lines = (tmp_path / "dask" / "manifest.jsonl").read_text().splitlines()
    assert [json.loads(line)["output"] for line in lines] == [
        *(f"sheet{k}.glb" for k in range(6)),
        "more/ball.glb",
    ]
    assert not list((tmp_path / "dask").rglob("*.part"))


def test_the_command_line_takes_an_address(client, models, tmp_path, capsys):
    address = client.scheduler.address
    arguments = ["batch", f"{models}/*.obj", "-o", str(tmp_path / "out"), "--effort", "fast"]
    assert not app([*arguments, "--dask", address], standalone_mode=False)
    assert {"meshes: 6", "made: 6", "failed: 0"} <= set(capsys.readouterr().out.splitlines())
    assert not app([*arguments, "--dask", address, "--resume"], standalone_mode=False)
    assert {"finished before: 6", "made: 0"} <= set(capsys.readouterr().out.splitlines())


def test_nodes_and_pieces_go_through_a_client(client, tmp_path):
    ball, ring = datasets.icosphere(2), datasets.torus(1.0, 0.4, 16, 9)
    tree = pa.segment(ball, 2)
    executor = client.get_executor(pure=False)
    np.testing.assert_array_equal(pa.segment(ball, 2, executor=executor).fields, tree.fields)
    text = [f"v {x!r} {y!r} {z!r}" for x, y, z in ball.vertices.tolist()]
    text += [f"v {x + 9!r} {y!r} {z!r}" for x, y, z in ring.vertices.tolist()]
    faces = np.concatenate([ball.faces, ring.faces + ball.n_vertices]) + 1
    text += [f"f {a} {b} {c}" for a, b, c in faces.tolist()]
    (tmp_path / "two.obj").write_text("\n".join(text) + "\n")
    scene = pa.load_scene(tmp_path / "two.obj")
    for run in (pa.partition, lambda scene, **others: pa.segment(scene, 2, **others)):
        np.testing.assert_array_equal(run(scene, executor=executor).labels, run(scene).labels)
    assert client.submit(pow, 2, 3).result() == 8
