"""A file's own textures, carried from its old texture coordinates to new ones."""

import io

import numpy as np
import pytest
from PIL import Image

import gltf_samples as samples
import phaseatlas as pa
from phaseatlas.scene.document import read_document
from phaseatlas.scene.looks import SLOTS
from phaseatlas.scene.rebake import rebake
from phaseatlas.scene.scene import scene_in

SIDE = 256
RESOLUTION = 256


def light(shown):
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def shown(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def waves(uv):
    """A picture as a function of places in [0, 1], v down: smooth where its copies meet."""
    u, v = 2 * np.pi * np.asarray(uv).T
    return 0.5 + 0.3 * np.stack([np.cos(u), np.sin(v), np.cos(u + v)], axis=1)


def png(function, side=SIDE):
    """The picture of a function of places, first row on top."""
    axis = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(axis, axis)
    values = function(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(side, side, -1)
    data = io.BytesIO()
    Image.fromarray(np.rint(255 * values).astype(np.uint8)).save(data, format="png")
    return data.getvalue()


def wrapped(x, wrap):
    if wrap == 10497:
        return x % 1
    if wrap == 33648:
        return 1 - np.abs(x % 2 - 1)
    return np.clip(x, 0.5 / SIDE, 1 - 0.5 / SIDE)


# A tent of two squares: vertices, triangles, and texture coordinates with v down.
TENT = np.array([[0, 0, 0], [1, 0, 0.5], [2, 0, 0], [0, 1, 0], [1, 1, 0.5], [2, 1, 0]])
FACES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
OLD = np.array([[-0.4, 0.1], [0.5, 0.2], [1.4, 0.1], [-0.4, 1.3], [0.5, 1.2], [1.4, 1.3]])
COLOURS = np.array([[1, 1, 1], [0.5, 1, 1], [1, 1, 0.3], [1, 0.6, 1], [1, 1, 1], [0.8, 1, 1]])


def tent(material, pictures, *, sampler=None, colours=None, tangents=None, uv=OLD):
    """A GLB file of a tent with a material, whose textures are those pictures in turn."""
    build = samples.Builder()
    single = TENT.astype(np.float32)
    flat = np.repeat(single[FACES], 1, axis=0).reshape(-1, 3)
    at = FACES.reshape(-1)
    normals = np.cross(flat[1::3] - flat[::3], flat[2::3] - flat[::3])
    normals = np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), 3, axis=0)
    box = {"min": flat.min(0).tolist(), "max": flat.max(0).tolist()}
    attributes = {
        "POSITION": build.add(flat, **box),
        "NORMAL": build.add(normals.astype(np.float32)),
        "TEXCOORD_0": build.add(np.zeros((len(at), 2), dtype=np.float32)),
        "TEXCOORD_1": build.add(uv[at].astype(np.float32)),
    }
    if colours is not None:
        attributes["COLOR_0"] = build.add(colours[at].astype(np.float32))
    if tangents is not None:
        attributes["TANGENT"] = build.add(tangents.astype(np.float32))
    primitive = {"attributes": attributes, "material": 0}
    images = [{"bufferView": build.view(data), "mimeType": "image/png"} for data in pictures]
    document = build.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[{"mesh": 0, "scale": [2, 1, 1]}],
        scenes=[{"nodes": [0]}],
        materials=[material],
        images=images,
        textures=[
            {"source": k, **({"sampler": 0} if sampler else {})} for k in range(len(pictures))
        ],
        **({"samplers": [sampler]} if sampler else {}),
    )
    return samples.glb(document, build.blob)


def rebaked(path, out):
    """Write a file with its textures baked anew; the notes of it."""
    document = read_document(path)
    scene = scene_in(document)
    charts = pa.build_atlas(pa.partition(scene), resolution=RESOLUTION)
    uvs = scene.corners(charts.uv)
    baked = rebake(document, scene, uvs, resolution=RESOLUTION)
    document.save(out, uvs, baked=baked)
    return baked.notes


def picture_of(document, blob, reference):
    texture = document["textures"][reference["index"]]
    view = document["bufferViews"][document["images"][texture["source"]]["bufferView"]]
    data = blob[view["byteOffset"] :][: view["byteLength"]]
    return np.asarray(Image.open(io.BytesIO(data)), dtype=np.float64) / 255


def look_up(picture, uv):
    """Bilinear, v down, inside of the picture."""
    height, width = picture.shape[:2]
    at = np.clip(uv * [width, height] - 0.5, 0, [width - 1.001, height - 1.001])
    low = at.astype(int)
    part = at - low
    found = 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            found = found + weight[:, None] * picture[low[:, 1] + dy, low[:, 0] + dx]
    return found


def spread(count=2000):
    """Faces, and barycentric coordinates within, of points all over a surface."""
    rng = np.random.default_rng(3)
    return rng.integers(0, len(FACES), count), rng.dirichlet([1, 1, 1], count)


def at_points(document, blob, name, face, weights):
    primitive = document["meshes"][0]["primitives"][0]
    values = samples.values(document, blob, primitive["attributes"][name])
    corners = samples.corners(primitive, document, blob).reshape(-1, 3)[face]
    return np.einsum("kcd,kc->kd", values[corners].astype(np.float64), weights)


@pytest.mark.parametrize("wrap", [10497, 33648, 33071])
def test_colours_on_the_surface_stay(tmp_path, wrap):
    """Through a transform, with factors and colours of vertices, for each way to wrap."""
    angle, scale, offset = 0.3, np.array([0.8, 1.1]), np.array([0.15, -0.2])
    transform = {"rotation": angle, "scale": scale.tolist(), "offset": offset.tolist()}
    extensions = {"KHR_texture_transform": {**transform, "texCoord": 1}}
    base = {"index": 0, "texCoord": 0, "extensions": extensions}
    factor = [0.5, 0.9, 1.0, 0.7]
    material = {"pbrMetallicRoughness": {"baseColorTexture": base, "baseColorFactor": factor}}
    sampler = {"wrapS": wrap, "wrapT": wrap}
    data = tent(material, [png(waves)], sampler=sampler, colours=COLOURS)
    (tmp_path / "a.glb").write_bytes(data)
    assert rebaked(tmp_path / "a.glb", tmp_path / "b.glb") == ()
    document, blob = samples.parse((tmp_path / "b.glb").read_bytes())
    face, weights = spread()
    # Counter-clockwise as seen, with v down.
    u, v = (np.einsum("kcd,kc->kd", OLD[FACES][face], weights) * scale).T
    u, v = np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u
    places = wrapped(np.stack([u, v], axis=1) + offset, wrap)
    tints = np.einsum("kcd,kc->kd", COLOURS[FACES][face], weights)
    expected = shown(light(waves(places)) * factor[:3] * tints)
    pbr = document["materials"][0]["pbrMetallicRoughness"]
    assert pbr["baseColorFactor"] == [1, 1, 1, 0.7]
    # The old picture is gone, as nothing names it any more.
    assert pbr["baseColorTexture"] == {"index": 0, "texCoord": 0}
    assert (len(document["textures"]), len(document["images"])) == (1, 1)
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    assert "COLOR_0" not in attributes
    assert "_COLOR_0" in attributes
    new = at_points(document, blob, "TEXCOORD_0", face, weights)
    found = look_up(picture_of(document, blob, pbr["baseColorTexture"]), new)
    # A texel is 1 / 100 of a side of the surface, over which the picture changes by some 0.02.
    assert np.abs(found - expected).max() < 0.05
    assert np.sqrt(((found - expected) ** 2).mean()) < 0.006


def bumps(uv):
    u, v = 2 * np.pi * np.asarray(uv).T
    normal = np.stack([0.5 * np.cos(u), 0.4 * np.sin(v), np.ones_like(u)], axis=1)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def plane_frames(uv, face):
    """Directions of u and of v up, and the normal, of each face, as texture coordinates have it."""
    points, uv = TENT[FACES], uv * [1, -1]
    ways = np.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], axis=1)
    steps = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=1)
    tangent = np.linalg.solve(steps, ways)[:, 0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.cross(ways[:, 0], ways[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    binormal = np.sign(np.linalg.det(steps))[:, None] * np.cross(normal, tangent)
    return np.stack([tangent, binormal, normal], axis=1)[face]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("given", [False, True])
def test_normals_on_the_surface_stay(tmp_path, mirrored, given):
    """Of a tent of two tilted planes, by tangents that the file has or has not."""
    uv = OLD * [-1, 1] if mirrored else OLD
    # Another way for u in each plane.
    frames = plane_frames(uv[FACES], np.arange(len(FACES)))
    tangents = None
    if given:
        turned = 0.8 * frames[:, 0] + 0.6 * frames[:, 1]
        sign = -np.ones(len(FACES))
        tangents = np.repeat(np.column_stack([turned, sign]), 3, axis=0)
        frames = np.stack([turned, -np.cross(frames[:, 2], turned), frames[:, 2]], axis=1)
    reference = {"index": 0, "texCoord": 1, "scale": 0.7}
    bump = png(lambda uv: bumps(uv) * 0.5 + 0.5)
    data = tent({"normalTexture": reference}, [bump], tangents=tangents, uv=uv)
    (tmp_path / "a.glb").write_bytes(data)
    assert rebaked(tmp_path / "a.glb", tmp_path / "b.glb") == ()
    document, blob = samples.parse((tmp_path / "b.glb").read_bytes())
    face, weights = spread()
    places = np.einsum("kcd,kc->kd", uv[FACES][face], weights) % 1
    expected = np.einsum("kc,kcd->kd", bumps(places) * [0.7, 0.7, 1], frames[face])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert "TANGENT" not in document["meshes"][0]["primitives"][0]["attributes"]
    reference = document["materials"][0]["normalTexture"]
    assert reference == {"index": reference["index"], "texCoord": 0}
    primitive = document["meshes"][0]["primitives"][0]
    corners = samples.corners(primitive, document, blob).reshape(-1, 3)
    laid = samples.values(document, blob, primitive["attributes"]["TEXCOORD_0"])[corners]
    new = np.einsum("kcd,kc->kd", laid[face].astype(np.float64), weights)
    found = 2 * look_up(picture_of(document, blob, reference), new) - 1
    found = np.einsum("kc,kcd->kd", found, plane_frames(laid.astype(np.float64), face))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    # At the ridge, where a chart bends, frames of vertices are those of both planes.
    angle = np.degrees(np.arccos(np.clip(np.vecdot(found, expected), -1, 1)))
    assert np.median(angle) < 1
    assert angle.max() < 5


def test_the_other_textures_go_with_their_materials(tmp_path):
    """Occlusion, metallic roughness and emission; factors stay, and so do other extensions."""
    material = {
        "pbrMetallicRoughness": {
            "metallicRoughnessTexture": {"index": 0, "texCoord": 1},
            "metallicFactor": 0.5,
        },
        "occlusionTexture": {"index": 0, "texCoord": 1, "strength": 0.5},
        "emissiveTexture": {"index": 0, "texCoord": 1, "extensions": {"EXT_other": {"a": 1}}},
        "emissiveFactor": [1, 0.5, 0],
        "extensions": {
            "KHR_materials_clearcoat": {"clearcoatTexture": {"index": 0, "texCoord": 1}}
        },
    }
    (tmp_path / "a.glb").write_bytes(tent(material, [png(waves)]))
    assert rebaked(tmp_path / "a.glb", tmp_path / "b.glb") == ()
    document, blob = samples.parse((tmp_path / "b.glb").read_bytes())
    made = document["materials"][0]
    assert made["pbrMetallicRoughness"]["metallicFactor"] == 0.5
    assert made["occlusionTexture"]["strength"] == 0.5
    assert made["emissiveTexture"]["extensions"] == {"EXT_other": {"a": 1}}
    assert made["emissiveFactor"] == [1, 0.5, 0]
    # What is not baked is still seen through the old coordinates.
    assert made["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"]["texCoord"] == 2
    assert "normalTexture" not in made
    face, weights = spread()
    new = at_points(document, blob, "TEXCOORD_0", face, weights)
    expected = waves(np.einsum("kcd,kc->kd", OLD[FACES][face], weights))
    for slot in ("metallic_roughness", "occlusion", "emissive"):
        reference = made
        for key in SLOTS[slot]:
            reference = reference[key]
        assert reference["texCoord"] == 0
        found = look_up(picture_of(document, blob, reference), new)
        assert np.sqrt(((found - expected) ** 2).mean()) < 0.006


@pytest.mark.parametrize("kept", [False, True])
def test_pictures_that_nothing_shows_any_more_go(tmp_path, kept):
    """Those that an extension of the material shows stay, and no number is wrong after it."""
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1, "texCoord": 1}}}
    if kept:
        coat = {"clearcoatTexture": {"index": 2, "texCoord": 1}}
        material["extensions"] = {"KHR_materials_clearcoat": coat}
    noise = np.random.default_rng(0).random((SIDE * SIDE, 3))
    pictures = [png(lambda uv: 0 * waves(uv)), png(lambda uv: noise), png(waves)]
    (tmp_path / "a.glb").write_bytes(tent(material, pictures))
    rebaked(tmp_path / "a.glb", tmp_path / "b.glb")
    document, blob = samples.parse((tmp_path / "b.glb").read_bytes())
    # What nothing ever showed stays as well.
    assert len(document["textures"]) == len(document["images"]) == 3
    assert pictures[1] not in blob
    assert pictures[0] in blob
    made = document["materials"][0]
    picture = picture_of(document, blob, made["pbrMetallicRoughness"]["baseColorTexture"])
    assert picture.shape[:2] == (RESOLUTION, RESOLUTION)
    if kept:
        reference = made["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"]
        expected = np.asarray(Image.open(io.BytesIO(pictures[2]))) / 255
        np.testing.assert_array_equal(picture_of(document, blob, reference), expected)


def write_tent_obj(folder, options):
    lines = ["mtllib a.mtl", "usemtl painted"]
    lines += [f"v {x} {y} {z}" for x, y, z in TENT]
    lines += [f"vt {u} {1 - v}" for u, v in OLD]
    lines += ["f " + " ".join(f"{k + 1}/{k + 1}" for k in face) for face in FACES]
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    (folder / "a.mtl").write_text(f"newmtl painted\nKd 0.5 1 1\nmap_Kd {options}waves.png\n")


@pytest.mark.parametrize("options", ["", "-s 2 0.5 -o 0.25 0.1 ", "-clamp on "])
def test_an_obj_file_and_its_base_colour(tmp_path, options):
    write_tent_obj(tmp_path, options)
    (tmp_path / "waves.png").write_bytes(png(waves))
    assert rebaked(tmp_path / "a.obj", tmp_path / "b.obj") == ()
    library = (tmp_path / "b.mtl").read_text()
    assert "Kd 1 1 1\n" in library
    assert "map_Kd b.png\n" in library
    face, weights = spread()
    places = np.einsum("kcd,kc->kd", OLD[FACES][face], weights) * [1, -1] + [0, 1]
    if "-s" in options:
        places = places * [2, 0.5] + [0.25, 0.1]
    if "-clamp" in options:
        places = wrapped(places, 33071)
    expected = waves(places * [1, -1] + [0, 1])
    expected[:, 0] = shown(light(expected[:, 0]) * light(np.float64(0.5)))
    again = read_document(tmp_path / "b.obj")
    new = np.einsum("kcd,kc->kd", again.corners(0).uvs[0].reshape(-1, 3, 2)[face], weights)
    picture = np.asarray(Image.open(tmp_path / "b.png"), dtype=np.float64) / 255
    found = look_up(picture, new * [1, -1] + [0, 1])
    assert np.sqrt(((found - expected) ** 2).mean()) < 0.012


def test_a_texture_that_is_missing_gives_a_note(tmp_path):
    write_tent_obj(tmp_path, "")
    (note,) = rebaked(tmp_path / "a.obj", tmp_path / "b.obj")
    assert note == "the texture waves.png is missing and was not baked"
    picture = np.asarray(Image.open(tmp_path / "b.png"))
    assert (picture == [128, 255, 255]).all()
    (tmp_path / "waves.png").write_bytes(b"noise")
    (note,) = rebaked(tmp_path / "a.obj", tmp_path / "b.obj")
    assert note == "the texture waves.png cannot be read and was not baked"
