"""Blender reads the same mesh from what `atlas` wrote, with the coordinates of the atlas."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gltf_samples import Builder, character, glb
from phaseatlas.file_atlas import atlas_file
from phaseatlas.scene.document import read_document

SCRIPT = Path(__file__).with_name("blender_script.py")
# Blender keeps single precision.
EXACT = 1e-6


def in_blender(path):
    output = path.with_suffix(f"{path.suffix}.json")
    command = [sys.executable, str(SCRIPT), str(path), str(output)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if not output.exists():
        raise RuntimeError(run.stdout + run.stderr)
    return json.loads(output.read_text())


@pytest.fixture(scope="module", autouse=True)
def blender():
    # In a process of its own: what it loads stays there.
    run = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True, check=False)
    if run.returncode:
        pytest.skip("bpy, which the extra blender installs, cannot be imported")


def two_materials():
    """The skinned, animated character, and a box of two materials under a turned node."""
    document, blob = character()
    build = Builder()
    build.blob, build.views, build.accessors = (
        blob,
        document["bufferViews"],
        document["accessors"],
    )
    corner = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([(f[0], *f[k : k + 2]) for f in sides for k in (1, 2)], dtype=np.uint16)
    position = build.add(corner, min=[0, 0, 0], max=[1, 1, 1])
    document["materials"] += [{"name": "red"}, {"name": "blue"}]
    document["meshes"].append(
        {
            "name": "box",
            "primitives": [
                {"attributes": {"POSITION": position}, "indices": build.add(part), "material": m}
                for part, m in ((faces[:8].reshape(-1), 1), (faces[8:].reshape(-1), 2))
            ],
        }
    )
    document["nodes"].append(
        {"name": "box", "mesh": 1, "translation": [9, 0, 0], "rotation": [0, 0.6, 0, 0.8]}
    )
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    # Blender refuses pictures that are none.
    for key in ("images", "textures", "materials"):
        document[key] = [{"name": m["name"]} for m in document[key]] if key == "materials" else []
    document = {key: value for key, value in document.items() if value != []}
    document["extensionsUsed"] = []
    document["buffers"] = [{"byteLength": len(build.blob)}]
    return {k: v for k, v in document.items() if k != "extensions" and v != []}, build.blob


def check_same(before, after):
    """All but the texture coordinates."""
    for key in ("actions", "bones", "cameras"):
        assert before[key] == after[key]
    assert len(before["meshes"]) == len(after["meshes"]) > 0
    for old, new in zip(before["meshes"], after["meshes"], strict=True):
        for key in ("name", "materials", "material", "shapes"):
            assert old[key] == new[key]
        np.testing.assert_array_equal(old["matrix"], new["matrix"])
        assert old["faces"] == new["faces"]
        assert old["weights"] == new["weights"]


def of_faces(mesh, layer):
    return np.concatenate([np.array(face) for face in mesh["uvs"][layer]])


def test_a_skinned_and_animated_file(tmp_path) -> None:
    source, output = tmp_path / "in.glb", tmp_path / "out.glb"
    source.write_bytes(glb(*two_materials()))
    made = atlas_file(source, output)
    before, after = in_blender(source), in_blender(output)
    check_same(before, after)
    assert before["actions"]
    assert before["bones"]
    assert any(group for mesh in before["meshes"] for face in mesh["weights"] for group in face)
    # Names of meshes differ in case, which sorts as in Blender.
    document = read_document(output)
    assert made.scene is not None
    assert made.atlas is not None
    named = {"body": 0, "box": 1}
    corners = made.scene.corners(made.atlas.uv)
    for mesh in after["meshes"]:
        index = named[mesh["name"]]
        found = of_faces(mesh, "UVMap")
        np.testing.assert_allclose(found, corners[index], atol=EXACT)
        np.testing.assert_allclose(found, document.corners(index).uvs[0], atol=EXACT)
        # The old sets follow.
        assert len(mesh["uvs"]) == len(document.corners(index).uvs)


def test_polygons_of_a_text(tmp_path) -> None:
    source, output = tmp_path / "in.obj", tmp_path / "out.obj"
    n = 7
    ring = [(np.cos(t), np.sin(t)) for t in 2 * np.pi * np.arange(n) / n]
    lines = [f"v {x:.6f} {y:.6f} {z}" for z in (0, 2) for x, y in ring]
    lines += ["o prism", "usemtl side"]
    lines += [f"f {k + 1} {(k + 1) % n + 1} {(k + 1) % n + n + 1} {k + n + 1}" for k in range(n)]
    lines += ["usemtl end", "f " + " ".join(str(k) for k in range(n, 0, -1))]
    lines += ["f " + " ".join(str(k + n) for k in range(1, n + 1))]
    lines += ["o roof", "v 0 0 3", *(f"f {k + n + 1} {(k + 1) % n + n + 1} 15" for k in range(n))]
    source.write_text("\n".join(lines) + "\n")
    made = atlas_file(source, output)
    before, after = in_blender(source), in_blender(output)
    check_same(before, after)
    assert [len(mesh["faces"]) for mesh in after["meshes"]] == [n + 2, n]
    assert made.scene is not None
    assert made.atlas is not None
    for mesh, corners in zip(after["meshes"], made.scene.corners(made.atlas.uv), strict=True):
        np.testing.assert_allclose(of_faces(mesh, "UVMap"), corners, atol=EXACT)
