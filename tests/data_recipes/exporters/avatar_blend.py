"""A Blender file of an avatar in three sheets, whose head, teeth and eye share shape keys; run in Blender's Python."""

import os
import sys

import bpy
import numpy as np

N = 9  # vertices along an edge
SHEETS = {"Head": (0.2, 0.0), "Teeth": (0.06, 0.01), "Eye": (0.03, -0.02)}  # edge and place along y, m
KEYS = {  # what each key moves a mesh by, m; on the head, a bump of this height
    "Head": {
        "jawOpen": (0, 0, -0.02), "jawLeft": (0.01, 0, 0), "jawRight": (-0.01, 0, 0), "lookUp": (0, 0.001, 0.002),
        "browInnerUp": (0, -0.004, 0.01), "wrinkle": (0, -0.006, 0), "empty": (0, 0, 0),
    },
    "Teeth": {"jawOpen": (0, 0, -0.018), "jawLeft": (0.009, 0, 0), "jawRight": (-0.009, 0, 0), "empty": (0, 0, 0)},
    "Eye": {"jawOpen": (0, 0, 0), "lookUp": (0, 0, 0.005), "lookDown": (0, 0, -0.005)},
}  # fmt: skip
LONG = "avatar_of_a_very_long_name_with_a_group_and_a_rig_in_front_of__"  # 63 bytes, where Blender cuts


def sheet(name, keys):
    edge, y = SHEETS[name]
    x, z = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(-edge / 2, edge / 2, N)]))
    vertices = np.stack([x, np.full_like(x, y), z], 1)
    quads = [
        (i * N + j, i * N + j + 1, (i + 1) * N + j + 1, (i + 1) * N + j) for i in range(N - 1) for j in range(N - 1)
    ]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], quads)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    obj.shape_key_add(name="Basis")
    bump = 1 - (2 * x / edge) ** 2 if name == "Head" else np.ones_like(x)
    for key_name, offset in keys.items():
        key = obj.shape_key_add(name=key_name, from_mix=False)
        key.value = 0.0
        for point, place in zip(key.data, vertices + bump[:, None] * offset, strict=True):
            point.co = place
    return obj


def drive(obj, key, expression, **properties):
    """Let a key have the value of an expression of custom properties or shape keys, given as (block, path)."""
    driver = obj.data.shape_keys.driver_add(f'key_blocks["{key}"].value').driver
    for name, (block, path) in properties.items():
        variable = driver.variables.new()
        variable.name, variable.targets[0].id_type = name, block.id_type
        variable.targets[0].id, variable.targets[0].data_path = block, path
    driver.type, driver.expression = "SCRIPTED", expression


def keyed(obj, action, frames, **values):
    """Give the keys of a mesh an action: a key's values in these frames."""
    keys = obj.data.shape_keys
    (keys.animation_data or keys.animation_data_create()).action = bpy.data.actions.new(action)
    keys.animation_data.action.use_fake_user = True
    for name, of_frames in values.items():
        for frame, value in zip(frames, of_frames, strict=True):
            keys.key_blocks[name].value = value
            keys.key_blocks[name].keyframe_insert("value", frame=frame)
        keys.key_blocks[name].value = 0.0


def main(target, variant):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    head, teeth, eye = (sheet(name, keys) for name, keys in KEYS.items())
    for name, default in (("strength", 0.0), ("mood", 0.5)):  # one acts only with the brow's key, one not at all
        head[name] = default
        head.id_properties_ui(name).update(min=0.0, max=1.0, default=default)
    brow = (head.data.shape_keys, 'key_blocks["browInnerUp"].value')
    drive(head, "wrinkle", "strength * brow", strength=(head, '["strength"]'), brow=brow)
    if variant == "driven":
        drive(teeth, "jawOpen", "jaw", jaw=(head.data.shape_keys, 'key_blocks["jawOpen"].value'))
    elif variant == "long":
        for mesh, ending in ((head, "jawOpen"), (teeth, "jawShut")):
            mesh.data.shape_keys.key_blocks["jawOpen"].name = LONG + ending
    elif variant == "limits":
        teeth.data.shape_keys.key_blocks["jawOpen"].slider_max = 0.5
        head.data.shape_keys.key_blocks["jawOpen"].slider_max = 2.0
    elif variant == "acted":  # a take of all, its part for the teeth once more, and a take in which left is not left
        keyed(head, "talk", (1, 11, 21), jawOpen=(0, 1, 0), lookUp=(0, 0.5, 0), browInnerUp=(0, 0.6, 0))
        keyed(teeth, "talk of the teeth", (1, 11, 21), jawOpen=(0, 1, 0))
        keyed(eye, "look", (1, 6, 12), lookUp=(0, 0.4, 0), lookDown=(0, 0, 0.7))
    bpy.ops.wm.save_as_mainfile(filepath=target)


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(*arguments)
    os._exit(0)
