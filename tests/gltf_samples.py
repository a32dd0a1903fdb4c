"""glTF documents made by hand, and a plain reader of them that shares nothing with the package."""

from __future__ import annotations

import json
import struct

import numpy as np

TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
CODES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125}
CODES["float32"] = 5126


class Builder:
    """Collects accessors in one buffer, a view each."""

    def __init__(self):
        self.blob = b""
        self.views = []
        self.accessors = []

    def view(self, data, **more):
        self.blob += bytes(-len(self.blob) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more}
        self.views.append(entry)
        self.blob += data
        return len(self.views) - 1

    def add(self, values, **more):
        values = np.asarray(values)
        rows = values.reshape(len(values), -1)
        width, size = rows.shape[1], rows.itemsize
        entry = {
            "bufferView": None,
            "componentType": CODES[values.dtype.name],
            "count": len(values),
            "type": TYPES[width],
            **more,
        }
        data, stride = rows.tobytes(), {}
        if width > 1 and width * size % 4:
            pad = -width * size % 4
            raw = rows.view(np.uint8).reshape(len(rows), -1)
            data = np.pad(raw, [(0, 0), (0, pad)]).tobytes()
            stride = {"byteStride": width * size + pad}
        entry["bufferView"] = self.view(data, **stride)
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def document(self, **rest):
        return {
            "asset": {"version": "2.0"},
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.blob)}],
            **rest,
        }


def glb(document, blob):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += bytes(-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if blob:
        chunks += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def parse(data):
    """The JSON and the binary chunk of a GLB file."""
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[20 + size + 8 :]


def values(document, blob, index):
    """An accessor row by row."""
    accessor = document["accessors"][index]
    code = {code: name for name, code in CODES.items()}[accessor["componentType"]]
    width = {name: width for width, name in TYPES.items()}[accessor["type"]]
    rows = np.zeros((accessor["count"], width), dtype=code)
    if "bufferView" in accessor:
        view = document["bufferViews"][accessor["bufferView"]]
        stride = view.get("byteStride", width * rows.itemsize)
        for k in range(len(rows)):
            at = view["byteOffset"] + accessor.get("byteOffset", 0) + k * stride
            rows[k] = np.frombuffer(blob, code, width, at)
    return rows


def corners(primitive, document, blob):
    """Vertices of the triangles of a primitive, three a triangle."""
    if "indices" in primitive:
        listed = values(document, blob, primitive["indices"])[:, 0].tolist()
    else:
        listed = range(document["accessors"][primitive["attributes"]["POSITION"]]["count"])
    mode = primitive.get("mode", 4)
    triangles = []
    if mode == 4:
        triangles = [listed[k : k + 3] for k in range(0, len(listed), 3)]
    elif mode == 5:
        for k in range(len(listed) - 2):
            a, b, c = listed[k : k + 3]
            triangles.append((a, b, c) if k % 2 == 0 else (a, c, b))
    elif mode == 6:
        triangles = [(listed[k + 1], listed[k + 2], listed[0]) for k in range(len(listed) - 2)]
    return np.array([corner for triangle in triangles for corner in triangle], dtype=np.int64)


def character():
    """A skinned, animated, morphing strip of squares with two UV sets, and things around it."""
    build = Builder()
    rng = np.random.default_rng(7)
    n = 10
    position = np.array([(k // 2, k % 2, 0.1 * k) for k in range(n)], dtype=np.float32)
    normal = np.tile(np.array([0, 0, 1], dtype=np.float32), (n, 1))
    faces = [(2 * k, 2 * k + 2, 2 * k + 1) for k in range(4)]
    faces += [(2 * k + 1, 2 * k + 2, 2 * k + 3) for k in range(4)]
    weights = rng.random((n, 4)).astype(np.float32)
    box = {"min": position.min(0).tolist(), "max": position.max(0).tolist()}
    attributes = {
        "POSITION": build.add(position, **box),
        "NORMAL": build.add(normal),
        "TANGENT": build.add(rng.random((n, 4)).astype(np.float32)),
        "TEXCOORD_0": build.add(rng.random((n, 2)).astype(np.float32)),
        "TEXCOORD_1": build.add((rng.random((n, 2)) * 65535).astype(np.uint16), normalized=True),
        "COLOR_0": build.add((rng.random((n, 3)) * 255).astype(np.uint8), normalized=True),
        "JOINTS_0": build.add(rng.integers(0, 2, (n, 4)).astype(np.uint8)),
        "WEIGHTS_0": build.add(weights / weights.sum(axis=1, keepdims=True)),
        "_BAKED": build.add(rng.random(n).astype(np.float32)),
    }
    targets = [
        {"POSITION": build.add(rng.random((n, 3)).astype(np.float32))},
        {
            "POSITION": build.add(rng.random((n, 3)).astype(np.float32)),
            "NORMAL": build.add(rng.random((n, 3)).astype(np.float32)),
        },
    ]
    body = {
        "attributes": attributes,
        "targets": targets,
        "indices": build.add(np.array(faces, dtype=np.uint8).reshape(-1)),
        "material": 0,
        "extras": {"mine": 3},
    }
    times = build.add(np.array([0, 1], dtype=np.float32), min=[0], max=[1])
    turns = build.add(np.array([[0, 0, 0, 1], [0, 0, 1, 0]], dtype=np.float32))
    bind = build.add(np.tile(np.eye(4, dtype=np.float32).reshape(1, 16), (2, 1)))
    picture = build.view(b"\x89PNG of a kind")
    texture = {"index": 0, "texCoord": 1}
    moved = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "texCoord": 1}}}
    document = build.document(
        extensionsUsed=["KHR_texture_transform", "KHR_materials_clearcoat", "EXT_unknown"],
        scene=0,
        scenes=[{"nodes": [0, 1, 2, 3], "name": "all"}],
        nodes=[
            {"name": "body", "mesh": 0, "skin": 0, "extras": {"a": [1, {"b": None}]}},
            {"name": "root", "translation": [0, 0, 2], "scale": [3, 3, 3], "children": [4]},
            {"name": "eye", "camera": 0, "rotation": [0, 0.6, 0, 0.8]},
            {"name": "joint", "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
            {"name": "tip", "rotation": [0, 0, 0.6, 0.8]},
        ],
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        skins=[{"joints": [3, 4], "inverseBindMatrices": bind}],
        animations=[
            {
                "name": "wave",
                "channels": [{"sampler": 0, "target": {"node": 4, "path": "rotation"}}],
                "samplers": [{"input": times, "output": turns}],
            }
        ],
        meshes=[{"name": "Körper", "primitives": [body], "weights": [0.5, 0.25]}],
        materials=[
            {
                "name": "skin",
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                "normalTexture": {**texture, "scale": 0.5},
                "emissiveTexture": moved,
                "extensions": {"KHR_materials_clearcoat": {"clearcoatNormalTexture": {"index": 0}}},
                "extras": {"index": 4, "someTexture": {"index": 0}},
            }
        ],
        textures=[{"source": 0}],
        images=[{"bufferView": picture, "mimeType": "image/png"}],
        extensions={"EXT_unknown": {"keep": [1.5, "as it is"]}},
        somethingNew={"not": "in the specification"},
    )
    return document, build.blob
