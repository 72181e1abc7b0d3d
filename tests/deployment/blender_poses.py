"""Key a face's properties in Blender, a pose a frame, and write the vertices of all frames: model, params, out, n."""

import importlib.util
import os
import sys
import traceback

import bpy
import numpy as np


def main():
    script, model, params, out = sys.argv[-4:]
    spec = importlib.util.spec_from_file_location("blender_face", script)
    blender_face = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(blender_face)
    blender_face.register()
    bpy.ops.import_scene.deployed_face(filepath=model)
    face, poses = bpy.context.object, np.load(params)
    names = blender_face.properties(blender_face.Model(model))
    sliders = [face.id_properties_ui(name).as_dict() for name in names]
    limits = [[slider[name] for name in ("soft_min", "default", "soft_max")] for slider in sliders]
    for frame, pose in enumerate(poses):
        for name, value in zip(names, pose.tolist(), strict=True):
            face[name] = value
            face.keyframe_insert(f'["{name}"]', frame=frame)
    scene = bpy.context.scene
    frames = []
    for frame in np.random.default_rng(0).permutation(len(poses)):
        scene.frame_set(int(frame))
        frames.append((frame, shown(face)))
    keyed = np.stack([vertices for _, vertices in sorted(frames, key=lambda pair: pair[0])])
    face.animation_data_clear()
    for name, value in zip(names, poses[3].tolist(), strict=True):  # as a hand on the sliders does
        face[name] = value
    face.update_tag()
    bpy.context.view_layer.update()
    by_hand = shown(face)
    bpy.ops.object.rest_face()
    bpy.context.view_layer.update()
    own = [bpy.path.abspath(face[blender_face.FILE]), face.data.has_custom_normals]
    assert own == [model, False], own
    np.savez(out, keyed=keyed, by_hand=by_hand, rest=shown(face), limits=limits)


def shown(face):
    """Return an object's vertices as Blender shows them."""
    mesh = face.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    return vertices


try:
    main()
except BaseException:
    traceback.print_exc()
    sys.stderr.flush()
    os._exit(1)
os._exit(0)  # without the clean-up of bpy, which complains of blocks that are still there
