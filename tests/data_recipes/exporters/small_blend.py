"""A Blender file with a small sheet that two bones, a shape key and a driven one move; run in Blender's Python."""

import os
import sys

import bpy
import numpy as np

N = 17  # vertices along an edge; the sheet spans 0.2 m
COORDINATES = np.linspace(-0.1, 0.1, N)


def sheet():
    mesh = bpy.data.meshes.new("Sheet")
    x, z = (grid.ravel() for grid in np.meshgrid(COORDINATES, COORDINATES))
    vertices = np.stack([x, np.zeros_like(x), z], 1)
    quads = [
        (i * N + j, i * N + j + 1, (i + 1) * N + j + 1, (i + 1) * N + j) for i in range(N - 1) for j in range(N - 1)
    ]
    mesh.from_pydata(vertices.tolist(), [], quads)
    layer = mesh.uv_layers.new(name="uv")
    for loop in mesh.loops:
        layer.data[loop.index].uv = vertices[loop.vertex_index, [0, 2]] * 5 + 0.5
    obj = bpy.data.objects.new("Sheet", mesh)
    bpy.context.collection.objects.link(obj)
    obj.location = (0.0, 0.0, 0.5)
    obj.shape_key_add(name="Basis")
    for name, axis in (("Puff", 1), ("Lift", 2)):
        key = obj.shape_key_add(name=name, from_mix=False)
        key.value = 0.0  # not so by itself in every Blender
        for i, point in enumerate(key.data):
            point.co[axis] += 0.02 * (1 - 100 * vertices[i, 0] ** 2)
    obj.data.shape_keys.name = "Keys"
    return obj, vertices


def armature():
    data = bpy.data.armatures.new("Bones")
    obj = bpy.data.objects.new("Bones", data)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    for name, x in (("left", -0.05), ("right", 0.05)):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail = (x, 0, 0.5), (x, 0, 0.6)
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.pose.bones["right"].lock_location = (False, True, True)
    obj.pose.bones["left"].rotation_mode = "XYZ"
    limit = obj.pose.bones["left"].constraints.new("LIMIT_LOCATION")
    limit.owner_space, limit.use_transform_limit = "LOCAL", True
    for side, value in (("min", -0.02), ("max", 0.02)):
        setattr(limit, f"use_{side}_x", True)
        setattr(limit, f"{side}_x", value)
    return obj


def bind(obj, vertices, bones):
    for name, chosen in (("left", vertices[:, 0] < 0), ("right", vertices[:, 0] >= 0)):
        obj.vertex_groups.new(name=name).add(np.flatnonzero(chosen).tolist(), 1.0, "REPLACE")
    obj.modifiers.new("Armature", "ARMATURE").object = bones


def act(obj, bones, with_animation):
    bones["lift"] = 0.0
    bones.id_properties_ui("lift").update(min=-1.0, max=2.0, default=0.0)
    curve = obj.data.shape_keys.driver_add('key_blocks["Lift"].value')
    variable = curve.driver.variables.new()
    variable.name, curve.driver.type = "lift", "SUM"
    variable.targets[0].id, variable.targets[0].data_path = bones, '["lift"]'
    if not with_animation:
        return
    data = bones.animation_data_create()
    data.action = bpy.data.actions.new("nod")
    data.action.use_fake_user = True  # Blender saves no action that nobody uses
    left, right = bones.pose.bones["left"], bones.pose.bones["right"]
    for frame, angle, x in ((1, 0.0, 0.0), (6, 0.5, 0.015), (11, 0.0, 0.0)):
        left.rotation_euler, left.location = (angle, 0.0, 0.0), (x, 0.0, 0.0)
        left.keyframe_insert("rotation_euler", frame=frame)
        left.keyframe_insert("location", frame=frame)
        bones["lift"] = 40 * x
        bones.keyframe_insert('["lift"]', frame=frame)
    left.rotation_euler, left.location, bones["lift"] = (0, 0, 0), (0, 0, 0), 0.0
    data.action = bpy.data.actions.new("turn")
    for frame, w, x in ((3, 1.0, 0.0), (9, 0.9, 0.01), (17, 1.0, 0.0)):
        right.rotation_quaternion = (w, 0.0, np.sqrt(1 - w * w), 0.0)
        right.location = (x, 0.0, 0.0)
        right.keyframe_insert("rotation_quaternion", frame=frame)
        right.keyframe_insert("location", frame=frame)
    keys = obj.data.shape_keys
    keys.animation_data.action = bpy.data.actions.new("puff")
    for frame, value in ((1, 0.0), (5, 0.8)):
        keys.key_blocks["Puff"].value = value
        keys.key_blocks["Puff"].keyframe_insert("value", frame=frame)


def main(target, extra):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    obj, vertices = sheet()
    bones = armature()
    bind(obj, vertices, bones)
    act(obj, bones, extra != "still")
    if extra == "subdivided":
        obj.modifiers.new("Finer", "SUBSURF").levels = 2
    elif extra == "thick":
        obj.modifiers.new("Thicker", "SOLIDIFY").thickness = 0.01
    elif extra == "loose":
        obj.shape_key_clear()
        obj.data.vertices.add(3)
    bpy.ops.wm.save_as_mainfile(filepath=target)


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(*arguments)
    os._exit(0)
