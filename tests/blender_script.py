"""What Blender has of a file, as JSON: run by `test_blender.py` in a process of its own."""

import json
import sys

import bpy


def of_mesh(thing):
    mesh = thing.data
    groups = [group.name for group in thing.vertex_groups]
    vertices = mesh.vertices
    return {
        "name": thing.name,
        "matrix": [list(row) for row in thing.matrix_world],
        "materials": [slot.material.name if slot.material else "" for slot in thing.material_slots],
        "material": [face.material_index for face in mesh.polygons],
        "faces": [[list(vertices[v].co) for v in face.vertices] for face in mesh.polygons],
        "uvs": {
            layer.name: [
                [list(layer.data[k].uv) for k in face.loop_indices] for face in mesh.polygons
            ]
            for layer in mesh.uv_layers
        },
        "weights": [
            [
                {groups[entry.group]: entry.weight for entry in vertices[v].groups}
                for v in face.vertices
            ]
            for face in mesh.polygons
        ],
        "shapes": [key.name for key in mesh.shape_keys.key_blocks] if mesh.shape_keys else [],
    }


def main(path, output):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".obj"):
        bpy.ops.wm.obj_import(filepath=path)
    else:
        # Vertices as the file has them; no shapes that stand for bones.
        bpy.ops.import_scene.gltf(filepath=path, merge_vertices=False, disable_bone_shape=True)
    meshes = sorted((o for o in bpy.data.objects if o.type == "MESH"), key=lambda o: o.name)
    found = {
        "meshes": [of_mesh(thing) for thing in meshes],
        "actions": sorted(action.name for action in bpy.data.actions),
        "bones": sorted(bone.name for a in bpy.data.armatures for bone in a.bones),
        "cameras": len(bpy.data.cameras),
    }
    with open(output, "w") as file:
        json.dump(found, file)


main(*sys.argv[1:])
