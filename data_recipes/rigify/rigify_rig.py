"""Make Rigify's face rig on a head, in Blender's Python (bpy and numpy only), in two calls.

    python rigify_rig.py metarig joints.json           the joints of the face's bones, as Rigify's metarig has them
    python rigify_rig.py build head.npz face.blend     the rig on the head, bound, with its animation

`head_file.py` writes head.npz. The skin is weighted by Blender's bone heat; teeth, gums and eyeballs follow one bone
each, the tongue three.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import traceback
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))  # Blender's Python finds the files beside this one, not the project
import face_acting

SPINE = "spine.004"  # the metarig's bone that neck, head and face hang on
SEED = 2020
EYES_APART_MM = 67.0  # of the face that the moves in `face_acting` are made for
SKIN_BONE = "DEF-spine.006"
INSIDE = {  # parts that bone heat doesn't reach: the start of the part's name → the bones that move it
    "tooth_upper": ["ORG-teeth.T"],
    "gum_upper": ["ORG-teeth.T"],
    "tooth_lower": ["ORG-teeth.B"],
    "gum_lower": ["ORG-teeth.B"],
    "tongue": ["DEF-tongue", "DEF-tongue.001", "DEF-tongue.002"],
    "eye_": [SKIN_BONE],  # a ball looks the same however it turns
}
FINE = ("Face (Primary)", "Face (Secondary)")


def to_scene(points_mm: np.ndarray) -> np.ndarray:
    """Return points in Blender's axes (z up, the face towards −y), metres, from those of our heads."""
    return np.stack([points_mm[..., 0], -points_mm[..., 2], points_mm[..., 1]], axis=-1) / 1000.0


def from_scene(points: np.ndarray) -> np.ndarray:
    """Return points in the axes of our heads, mm, from Blender's."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) * 1000.0


def add_metarig() -> object:
    """Return Rigify's human metarig, with neck, head and face alone."""
    import bpy

    add_ons = importlib.import_module("addon_utils")  # a module of bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if add_ons.enable("rigify", default_set=True) is None:
        raise RuntimeError("this Blender has no Rigify add-on")
    bpy.ops.object.armature_human_metarig_add()
    metarig = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bones = metarig.data.edit_bones
    kept = {SPINE, *(bone.name for bone in bones[SPINE].children_recursive)}
    for bone in [bone for bone in bones if bone.name not in kept]:
        bones.remove(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    metarig.pose.bones[SPINE].rigify_parameters.connect_chain = False  # there is no body to go on from
    return metarig


def read_joints(metarig: object) -> dict[str, list[float]]:
    """Return the joints of a metarig, "<bone>:head" and "<bone>:tail", mm, in the axes of our heads."""
    joints = {}
    for bone in metarig.data.bones:
        for end, place in (("head", bone.head_local), ("tail", bone.tail_local)):
            joints[f"{bone.name}:{end}"] = from_scene(np.array(place)).tolist()
    return joints


def generate_rig(metarig: object, joints: dict[str, np.ndarray]) -> object:
    """Move a metarig's joints and return the rig that Rigify generates from it."""
    import bpy
    from mathutils import Vector

    bpy.ops.object.mode_set(mode="EDIT")
    for bone in metarig.data.edit_bones:
        bone.head = Vector(to_scene(joints[f"{bone.name}:head"]))
        bone.tail = Vector(to_scene(joints[f"{bone.name}:tail"]))
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.pose.rigify_generate()
    rig = bpy.context.object
    bpy.data.objects.remove(metarig)
    return rig


def add_mesh(name: str, vertices_mm: np.ndarray, faces: np.ndarray, uv: np.ndarray, labels: list[str]) -> object:
    """Return a mesh object.

    uv: each vertex's place in its chart.
    labels: of each face; each becomes a material.
    """
    import bpy

    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(to_scene(vertices_mm).tolist(), [], faces.tolist())
    layer = mesh.uv_layers.new(name="charts")
    layer.data.foreach_set("uv", uv[faces.ravel()].astype(np.float32).ravel())
    names = list(dict.fromkeys(labels))
    for material in names:
        mesh.materials.append(bpy.data.materials.new(material))
    mesh.polygons.foreach_set("material_index", [names.index(label) for label in labels])
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    return obj


def bind(rig: object, obj: object, part_of_vertex: np.ndarray, bag: np.ndarray) -> None:
    """Bind a mesh by bone heat, and the parts inside it to named bones.

    part_of_vertex: (n,) names.
    bag: of the mouth's bag, see `head_file.mouth_bag`.
    Raises RuntimeError for vertices that no bone moves.
    """
    import bpy

    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    rig.select_set(True)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    places = np.array([vertex.co for vertex in obj.data.vertices])
    for start, bones in INSIDE.items():
        members = np.flatnonzero(np.char.startswith(part_of_vertex, start)).tolist()
        rows = closeness(places[members], [rig.data.bones[bone] for bone in bones]).tolist()
        set_weights(obj, {v: dict(zip(bones, row, strict=True)) for v, row in zip(members, rows, strict=True)})
        for bone in bones:
            rig.data.bones[bone].use_deform = True
    names = [group.name for group in obj.vertex_groups]
    hanging = {}
    for vertex, lip, share, upper in bag.tolist():
        weights = {names[g.group]: share * g.weight for g in obj.data.vertices[int(lip)].groups}
        for bone, part in (("ORG-teeth.T", upper), ("ORG-teeth.B", 1.0 - upper)):
            weights[bone] = weights.get(bone, 0.0) + (1.0 - share) * part
        hanging[int(vertex)] = weights
    set_weights(obj, hanging)
    lost = sum(not vertex.groups for vertex in obj.data.vertices)
    if lost:
        raise RuntimeError(f"bone heat finds no bone for {lost} vertices of {obj.name}")


def set_weights(obj: object, weights: dict[int, dict[str, float]]) -> None:
    """Replace the weights of some vertices by those given, vertex → bone → weight."""
    for group in obj.vertex_groups:
        group.remove(list(weights))
    for vertex, of_vertex in weights.items():
        for bone, weight in of_vertex.items():
            group = obj.vertex_groups.get(bone) or obj.vertex_groups.new(name=bone)
            group.add([vertex], weight, "REPLACE")


def closeness(places: np.ndarray, bones: list) -> np.ndarray:
    """Return weights (k, b) by the inverse square of the distances between places (k, 3) and bones; rows sum to 1."""
    distances = []
    for bone in bones:
        head, tail = np.array(bone.head_local), np.array(bone.tail_local)
        along = np.clip((places - head) @ (tail - head) / ((tail - head) @ (tail - head)), 0.0, 1.0)
        distances.append(np.linalg.norm(places - head - along[:, None] * (tail - head), axis=1))
    weights = 1.0 / np.maximum(np.stack(distances, axis=1), 1e-4) ** 2
    return weights / weights.sum(axis=1, keepdims=True)


def closing_lids(joints: dict[str, np.ndarray]) -> face_acting.Pose:
    """Return the moves of the left lids that shut the eye: the upper lid goes most of the way, the lower the rest."""
    moves = {}
    for i in (1, 2, 3):
        upper, lower = joints[f"lid.T.L.{i:03d}:head"], joints[f"lid.B.L.{4 - i:03d}:head"]
        moves[f"lid.T.L.{i:03d}"] = 0.80 * (lower - upper)
        moves[f"lid.B.L.{4 - i:03d}"] = 0.20 * (upper - lower)
    middle_up, middle_down = moves["lid.T.L.002"], moves["lid.B.L.002"]
    for i in (1, 3):  # the middle takes its neighbours along half the way
        moves[f"lid.T.L.{i:03d}"] = moves[f"lid.T.L.{i:03d}"] - 0.5 * middle_up
        moves[f"lid.B.L.{i:03d}"] = moves[f"lid.B.L.{i:03d}"] - 0.5 * middle_down
    return moves


def fine_controls(rig: object) -> list[str]:
    """Return the small controls of Rigify's face, those of its primary and secondary collections."""
    names = [bone.name for name in FINE for bone in rig.data.collections_all[name].bones]
    return sorted(name for name in names if not name.startswith("lid."))


def animate(rig: object, clips: dict[str, list[tuple[int, face_acting.Pose]]], scale: float) -> None:
    """Key clips as actions of a rig. scale: by which moves are multiplied on this head."""
    import bpy
    from mathutils import Quaternion, Vector

    animation = rig.animation_data or rig.animation_data_create()
    for name, keys in clips.items():
        action = bpy.data.actions.new(name)
        action.use_fake_user = True
        animation.action = action
        for control in sorted({control for _, pose in keys for control in pose}):
            bone = rig.pose.bones[control.split(":")[0]]
            turns = control.endswith(":turn")
            basis = np.array(bone.bone.matrix_local.to_3x3())
            if turns:
                bone.rotation_mode = "XYZ"
            for frame, pose in keys:
                value = np.asarray(pose.get(control, np.zeros(3)), float)
                in_scene = np.array([value[0], -value[2], value[1]])
                local = basis.T @ in_scene
                if turns:
                    bone.rotation_euler = Quaternion(Vector(np.radians(local))).to_euler("XYZ")
                    bone.keyframe_insert("rotation_euler", frame=frame)
                else:
                    bone.location = local * scale / 1000.0
                    bone.keyframe_insert("location", frame=frame)
            bone.location, bone.rotation_euler = (0, 0, 0), (0, 0, 0)
    animation.action = None


def build(head_file: Path, blend: Path) -> None:
    """Make the rig on a head and save it as a .blend file."""
    import bpy

    with np.load(head_file) as data:
        joints = dict(zip(data["joint_names"].tolist(), data["joints_mm"], strict=True))
        arrays, inside = [data[key] for key in ("vertices_mm", "faces", "uv")], (data["parts"], data["bag"])
        labels = data["labels"].tolist()
    rig = generate_rig(add_metarig(), joints)
    bind(rig, add_mesh("Head", *arrays, labels), *inside)
    scale = float(np.linalg.norm(joints["eye.L:head"] - joints["eye.R:head"])) / EYES_APART_MM
    lids = {name: move / scale for name, move in closing_lids(joints).items()}
    animate(rig, face_acting.clips(SEED, fine_controls(rig), lids), scale)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend.resolve()), compress=True)


def main(arguments: list[str]) -> int:
    """Run the step that the command line names, and return the exit code."""
    match arguments:
        case ["metarig", target]:
            Path(target).write_text(json.dumps(read_joints(add_metarig())), "utf-8")
        case ["build", head, blend]:
            build(Path(head), Path(blend))
        case _:
            print("error: expected metarig JOINTS.json, or build HEAD.npz FACE.blend", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    try:
        code = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    except (RuntimeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # without the clean-up of bpy, which complains of blocks that are still there
