"""Files whose meshes are cut along straightened seams: what they carry is interpolated."""

import numpy as np
import pytest

import gltf_samples as samples
import phaseatlas as pa
from phaseatlas.scene.cut import cut_document
from phaseatlas.scene.document import read_document
from phaseatlas.scene.scene import scene_in


def linear(positions):
    """Texture coordinates that are linear in the positions."""
    return positions @ np.array([[0.4, 0.1], [-0.2, 0.5], [0.3, 0.2]]) + [0.2, 0.3]


def shade(positions):
    """Colours in [0, 1] that are linear in the positions, x and y of which are in [0, 1]."""
    return 0.2 + 0.5 * np.stack([positions[:, 0], positions[:, 1], 1 - positions[:, 0]], axis=1)


def sheet():
    surface = pa.datasets.sheet(12, 9, amplitude=0.05)
    return surface.vertices, surface.faces


def write_obj(path):
    """A sheet of two materials, a copy of a face, one without area, and two turned over."""
    vertices, faces = sheet()
    faces = np.concatenate([faces, faces[[40]], [[0, 1, 1]]])
    faces[[3, 100]] = faces[[3, 100]][:, ::-1]
    lines = ["mtllib none.mtl"]
    lines += ["v {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}".format(*p, *c)
              for p, c in zip(vertices, shade(vertices), strict=True)]  # fmt: skip
    lines += ["vt {:.9f} {:.9f}".format(*uv) for uv in linear(vertices)]
    for k, face in enumerate(faces + 1):
        lines += {0: ["usemtl left"], 90: ["usemtl right"]}.get(k, [])
        lines.append("f " + " ".join(f"{v}/{v}" for v in face))
    path.write_text("\n".join(lines) + "\n")


def cut(path):
    """The document, cut along a slanted line that does not follow its edges, and a layout of it."""
    document = read_document(path)
    scene = scene_in(document, whole=False)
    parts = []
    for piece in scene.pieces:
        x, y, _ = piece.surface.face_mean(piece.surface.vertices).T
        parts.append(pa.Segmentation(piece.surface, (x + 0.4 * y > 0.7).astype(np.int64)))
    made, cut_scene, segmentation = cut_document(
        document, scene, pa.SceneSegmentation(scene, parts)
    )
    assert cut_scene.n_faces > scene.n_faces
    assert segmentation.length < 0.97 * sum(part.length for part in parts)
    atlas = pa.build_atlas(segmentation, flatten="isometric")
    assert atlas.diagnostics.sentences() == []
    return document, made, cut_scene.corners(atlas.uv)


def areas(mesh):
    a, b, c = mesh.positions[mesh.corners].reshape(-1, 3, 3).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def upwards(mesh):
    a, b, c = mesh.positions[mesh.corners].reshape(-1, 3, 3).transpose(1, 0, 2)
    return np.cross(b - a, c - a)[:, 2]


def of(mesh, material):
    """Polygons of a material; what has none gets a plain one in a glTF file."""
    return mesh.material_of == material if material >= 0 else np.ones(len(mesh.sizes), dtype=bool)


@pytest.mark.parametrize("source", [".obj", ".glb", ".ply"])
@pytest.mark.parametrize("target", [".obj", ".glb", ".gltf", ".ply"])
def test_what_corners_carry_is_interpolated(tmp_path, source, target):
    if target == ".ply" and source != ".ply":
        pytest.skip("a PLY file is written of a PLY file")
    path = tmp_path / f"a{source}"
    write_obj(tmp_path / "a.obj")
    if source != ".obj":
        first = read_document(tmp_path / "a.obj")
        if source == ".ply":
            vertices, faces = sheet()
            colours = "".join(f"property float {name}\n" for name in ("s", "t"))
            path.write_text(
                f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
                + "".join(f"property double {name}\n" for name in "xyz")
                + colours
                + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
                + "".join(
                    " ".join(map(repr, row)) + "\n"
                    for row in np.hstack([vertices, linear(vertices)]).tolist()
                )
                + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist())
            )
        else:
            first.save(path, [linear(m.positions)[m.corners] for m in first.meshes], uv_set=1)
    old, made, uvs = cut(path)
    made.save(tmp_path / f"b{target}", uvs)
    again = read_document(tmp_path / f"b{target}")
    (before,), (after,) = old.meshes, again.meshes
    carried = again.corners(0)
    points = after.positions[after.corners]
    np.testing.assert_allclose(carried.uvs[0], uvs[0], atol=1e-7)
    if target in (".glb", ".gltf"):
        for uv in carried.uvs[1:]:
            np.testing.assert_allclose(uv, linear(points), atol=1e-6)
        assert len(carried.uvs) > 1
    if carried.colours is not None:
        # glTF files that are made have colours of a byte each, rounded once a file.
        rounded = (source == ".glb") + (target in (".glb", ".gltf"))
        atol = 1e-6 + rounded * 0.5 / 255
        np.testing.assert_allclose(carried.colours[:, :3], shade(points), atol=atol)
    assert (carried.colours is None) == (source == ".ply")
    # The same areas, material by material, in the same windings, and the copy is there twice.
    assert set(after.sizes.tolist()) == {3}
    for material in {*before.material_of.tolist()}:
        for sign in (-1, 1):
            expected, found = (
                areas(m)[of(m, material) & (sign * upwards(m) > 0)].sum() for m in (before, after)
            )
            assert found == pytest.approx(expected, rel=1e-6)
    if source != ".ply":
        assert after.materials == ("left", "right")


def test_a_cut_gltf_file_keeps_its_skin_animation_and_morph_targets(tmp_path):
    vertices, faces = sheet()
    single = vertices.astype(np.float32)
    build = samples.Builder()
    box = {"min": single.min(0).tolist(), "max": single.max(0).tolist()}
    joints = (np.arange(len(vertices))[:, None] % 2 * [1, 0, 0, 0]).astype(np.uint8)
    attributes = {
        "POSITION": build.add(single, **box),
        "NORMAL": build.add(np.tile(np.float32([0, 0, 1]), (len(vertices), 1))),
        "TANGENT": build.add(np.tile(np.float32([1, 0, 0, -1]), (len(vertices), 1))),
        "TEXCOORD_0": build.add(linear(vertices).astype(np.float32)),
        "COLOR_0": build.add(np.rint(shade(vertices) * 65535).astype(np.uint16), normalized=True),
        "JOINTS_0": build.add(joints),
        "WEIGHTS_0": build.add(np.tile(np.float32([1, 0, 0, 0]), (len(vertices), 1))),
    }
    primitive = {
        "attributes": attributes,
        "indices": build.add(faces.reshape(-1).astype(np.uint16)),
        "targets": [{"POSITION": build.add(single @ np.float32(np.ones((3, 3))))}],
    }
    document = build.document(
        meshes=[{"name": "cloth", "primitives": [primitive], "weights": [0.5]}],
        nodes=[{"mesh": 0, "skin": 0, "name": "who"}, {"name": "a"}, {"name": "b"}],
        scenes=[{"nodes": [0, 1, 2]}],
        skins=[{"joints": [1, 2]}],
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
    )
    (tmp_path / "a.glb").write_bytes(samples.glb(document, build.blob))
    _, made, uvs = cut(tmp_path / "a.glb")
    assert made.save(tmp_path / "b.glb", uvs) == ()
    after, blob = samples.parse((tmp_path / "b.glb").read_bytes())
    for key in ("nodes", "scenes", "skins", "cameras"):
        assert after[key] == document[key]
    new = after["meshes"][0]["primitives"][0]
    found = {name: samples.values(after, blob, k) for name, k in new["attributes"].items()}
    points = found["POSITION"].astype(np.float64)
    assert len(points) > len(vertices)
    np.testing.assert_array_equal(found["NORMAL"], np.tile([0, 0, 1], (len(points), 1)))
    np.testing.assert_array_equal(found["TANGENT"], np.tile([1, 0, 0, -1], (len(points), 1)))
    np.testing.assert_allclose(found["TEXCOORD_1"], linear(points), atol=1e-6)
    np.testing.assert_allclose(found["COLOR_0"] / 65535, shade(points), atol=1 / 65535)
    assert set(found["JOINTS_0"][:, 0].tolist()) == {0, 1}
    np.testing.assert_array_equal(found["WEIGHTS_0"][:, 0], 1)
    target = samples.values(after, blob, new["targets"][0]["POSITION"])
    np.testing.assert_allclose(target, points @ np.ones((3, 3)), atol=1e-6)
    corners = samples.corners(new, after, blob)
    np.testing.assert_allclose(found["TEXCOORD_0"][corners] * [1, -1] + [0, 1], uvs[0], atol=1e-7)


def test_unwrap_does_not_cut():
    with pytest.raises(TypeError, match="cut"):
        pa.unwrap(*sheet(), cut=True)
