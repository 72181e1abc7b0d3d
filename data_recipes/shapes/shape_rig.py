"""The rig of a face of shapes: the neutral and a weighted sum of offsets, and joints where they are asked for.

A control with several shapes, each for a part of its way, goes through them in straight lines.
Vertices that coincide and move alike, as on both sides of a texture's seam, are one vertex of the rig: networks would
tear them apart. The constants' `file_vertices` say where the file's vertices are among the rig's, −1 for what is only
shown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from data_recipes.controls import Control
from data_recipes.deformers.node_chain import Chain, FaceConstants, Node, State, place_of, spread
from data_recipes.deformers.posed_props import NEAREST, RestProp
from data_recipes.face_rig import FaceParts, FaceRig
from data_recipes.gltf.scene import unique
from data_recipes.recipe.shapes import AXES, ShapeFace, ShapeRecipe
from data_recipes.recipe_paths import FACE_FILE
from data_recipes.rig import Clip, check_rig
from data_recipes.sampled.importing import (
    CONTROL_POINTS,
    EYES_MM,
    LANDMARKS,
    motion_mm,
    placement,
    segments_named,
    spread_out,
)
from data_recipes.sampled.mesh_file import NeutralFile
from data_recipes.sampled.segment_charts import make_mesh
from data_recipes.shapes.control_names import WITHOUT_REGION, region_of_control, side_of
from data_recipes.shapes.shape_acting import act_shapes
from data_recipes.shapes.shape_file import ShapeSource, check_names, read_source
from replicate.base.exceptions import InputError
from replicate.base.user_files import shown_path

SAME_MM = 1e-4  # vertices that are no farther apart, at rest and in each shape, are one
STILL_MM = 1e-3  # shapes that move nothing farther have no effect
NEAR = 0.35  # of the size of what moves: still parts up to so far around it are shown
MOVES_ALL = 0.6  # a control that moves a larger share of the vertices says nothing about regions
# Words in the names of parts: what our own faces call such a part, and its colour where the file has none for it.
PARTS = (
    ("teeth", "teeth|tooth|dent", (0.90, 0.87, 0.78)),
    ("eye", "eye(?!.?(brow|lash|lid|wear))|cornea|sclera", (0.93, 0.92, 0.90)),
    ("hair", "hair|beard", (0.20, 0.14, 0.10)),
    ("brow", "brow|lash", (0.20, 0.14, 0.10)),
    ("tongue", "tongue|gum|mouth", (0.62, 0.30, 0.30)),
    ("glasses", "glass|eye.?wear", (0.12, 0.12, 0.13)),
    ("", "", (0.76, 0.60, 0.52)),
)


# The nodes: the sum of shapes, then the joints.


def add_shapes(constants: FaceConstants, state: State) -> State:
    """Add each control's shape times its value."""
    shapes = constants["shapes"]
    offset = (state["u"] @ shapes["fields"]).reshape(len(state["u"]), 3, -1)
    return state | {"x": constants["neutral"] + spread(offset, shapes["place"])}


def add_shapes_in_turn(constants: FaceConstants, state: State) -> State:
    """Add each shape times how far its control, one of `column`, has gone between `low` and `high`."""
    shapes = constants["shapes"]
    u, low, high = state["u"], shapes["low"], shapes["high"]
    gone = jnp.clip(u[:, shapes["column"]], low, high) - jnp.clip(0.0, low, high)
    return add_shapes(constants, state | {"u": gone}) | {"u": u}


def turn_joints(constants: FaceConstants, state: State) -> State:
    """Turn the joints by their controls' angles, and carry every vertex by the mean of its joints' motions."""
    joints, x = constants["joints"], state["x"]
    motion = joint_motions(joints, state["u"]) - jnp.eye(4)  # (b, k, 4, 4)
    blended = jnp.einsum("kn,bkrc->brcn", joints["weights"], motion[:, :, :3])  # (b, 3, 4, n)
    return state | {"x": x + (blended[:, :, :3] * x[:, None]).sum(2) + blended[:, :, 3]}


def joint_motions(joints: Mapping[str, Any], u: Float[Array, "b m"]) -> Float[Array, "b k 4 4"]:
    """Return how each joint that has controls moves what it carries at rest, in mm.

    joints: `world` and `back` (k, 4, 4), each joint's frame at rest and its inverse; `radians` (m, 3 k), the angles
    about its axes x, y, z that a control's unit makes; `above` (k, k), 1 for the next such joint above, which comes
    earlier.
    """
    angles = (u @ joints["radians"]).reshape(len(u), -1, 3)
    turns = joints["world"] @ _rotations(angles) @ joints["back"]  # (b, k, 4, 4)
    motions: list[Array] = []
    for k in range(turns.shape[1]):
        motion = turns[:, k]
        if motions:
            of_above = joints["above"][k, :k]
            carried = jnp.einsum("k,bkrc->brc", of_above, jnp.stack(motions, 1)) + (1 - of_above.sum()) * jnp.eye(4)
            motion = carried @ motion
        motions.append(motion)
    return jnp.stack(motions, 1)


def _rotations(angles: Float[Array, "b k 3"]) -> Float[Array, "b k 4 4"]:
    """Return the turns about x, then y, then z, by these angles (radians), as 4 × 4 matrices for columns."""
    cosine, sine = jnp.cos(angles), jnp.sin(angles)
    one, zero = jnp.ones_like(cosine[..., 0]), jnp.zeros_like(cosine[..., 0])
    whole = jnp.eye(4)
    for axis in range(3):
        c, s = cosine[..., axis], sine[..., axis]
        a, b = (axis + 1) % 3, (axis + 2) % 3
        rows = [[zero] * 4 for _ in range(4)]
        rows[axis][axis], rows[3][3] = one, one
        rows[a][a], rows[b][b], rows[a][b], rows[b][a] = c, c, -s, s
        whole = jnp.stack([jnp.stack(row, -1) for row in rows], -2) @ whole
    return whole


def pose_props(
    props: tuple[RestProp, ...],
    constants: Mapping[str, Any],
    columns: dict[str, int],
    params: Float[np.ndarray, "1 m"],
    vertices: Float[np.ndarray, "n 3"],
    neutral: Float[np.ndarray, "n 3"],
) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return the parts that no shape moves, each as name, vertices (k, 3), faces and colours (k, 3).

    Joints carry them: a prop's `index` and `weight` are of joints. The skin, posed and at rest, moves none of them.
    """
    posed = [(prop.name, prop.vertices, prop.faces, prop.colours) for prop in props]
    if not len(constants["joints"]["world"]):
        return posed
    u = jnp.asarray(params - constants["limits"]["default"])
    motion = np.asarray(joint_motions(constants["joints"], u))[0] - np.eye(4)
    for k, prop in enumerate(props):
        blended = np.einsum("vi,virc->vrc", prop.weight, motion[prop.index])
        moved = prop.vertices + np.einsum("vrc,vc->vr", blended[:, :3, :3], prop.vertices) + blended[:, :3, 3]
        posed[k] = (prop.name, moved.astype(np.float32), prop.faces, prop.colours)
    return posed


SHAPES = Chain("shapes", (Node("shapes", add_shapes, ("neutral", "shapes")),), pose_props, True)
IN_TURN = Chain("shapes_in_turn", (Node("shapes", add_shapes_in_turn, ("neutral", "shapes")),), pose_props, True)
JOINTED = Chain("shapes_and_joints", (*SHAPES.nodes, Node("joints", turn_joints, ("joints",))), pose_props, True)


# From a file's content to the rig.


def build_shape_rig(recipe: ShapeRecipe, files: Sequence[Path]) -> FaceRig:
    """Return the rig of a face of shapes, from the files that `source_files` lists.

    Raises InputError, naming the file, for bad content.
    """
    face, where = recipe.face, shown_path(files[0])
    source = read_source(face, tuple(files))
    joint_names = source.skin.names if source.skin is not None else ()
    by_control = [shape.control for shape in source.shapes]
    check_names(face, by_control, joint_names, where)

    # which parts are approximated, and which are only shown
    offsets = np.reshape([shape.offsets for shape in source.shapes], (-1, *source.neutral.vertices.shape))
    at_rest = np.array([source.weights.get(name, 0.0) for name in by_control])
    vertices = source.neutral.vertices + np.tensordot(at_rest, offsets, 1)
    joints = _joints(face, source)
    moves = (np.abs(offsets).max(axis=(0, 2)) > STILL_MM) if len(offsets) else np.zeros(len(vertices), bool)
    moves |= joints["weights"].sum(axis=0) > 0 if len(joints["weights"]) else False
    labels = np.array(source.neutral.groups)
    moving = [
        name for name in dict.fromkeys(source.neutral.groups) if moves[source.neutral.faces[labels == name]].any()
    ]
    if not moving:
        raise InputError(f"{where}: no shape and no joint moves a vertex: nothing is left to approximate")
    ours = np.isin(labels, [*moving, *face.keep])

    # its vertices, each once
    used = np.unique(source.neutral.faces[ours])
    columns = np.concatenate([vertices[used], *offsets[:, used], joints["weights"].T[used]], axis=1)
    place = np.full(len(vertices), -1)
    first, place[used] = same_rows(columns)
    kept = used[first]
    neutral = NeutralFile(
        vertices[kept],
        place[source.neutral.faces[ours]],
        source.neutral.uv,
        None if source.neutral.uv_faces is None else source.neutral.uv_faces[ours],
        tuple(labels[ours].tolist()),
        tuple(np.array(source.neutral.materials)[ours].tolist()),
        {name: sorted({*place[own].tolist()} - {-1}) for name, own in source.neutral.members.items()},
    )

    # controls, their shapes and their joints
    effect = np.abs(offsets[:, kept]).max(axis=(1, 2)) > STILL_MM if len(offsets) else np.zeros(0, bool)
    moving_shapes = [shape for shape, moved in zip(source.shapes, effect, strict=True) if moved]
    names = list(dict.fromkeys(shape.control for shape in moving_shapes))
    controls = [_control(name, face, source) for name in names]
    controls += [control for control in joints["controls"] if control.name not in names]
    if not controls:
        raise InputError(f"{where}: no shape moves a vertex farther than {STILL_MM:g} mm")
    shift = _placement(vertices[kept], offsets[:, kept], by_control, face, source.to_ours)
    mesh = make_mesh(neutral, face.segments, vertices[kept] + shift, where)
    column = [*(names.index(shape.control) for shape in moving_shapes), *range(len(names), len(controls))]
    shapes = np.zeros((len(column), len(kept), 3))
    shapes[: len(moving_shapes)] = offsets[effect][:, kept]

    # what the nodes read, what is shown beside it
    support = np.flatnonzero(np.abs(shapes).max(axis=(0, 2)) > 0)
    way = np.ones(len(column))
    way[: len(moving_shapes)] = [shape.way for shape in moving_shapes]
    planes = (shapes[:, support] / way[:, None, None]).transpose(0, 2, 1)
    fields = np.ascontiguousarray(planes, np.float32).reshape(len(column), -1)
    limits = np.array([(shape.low, shape.high) for shape in moving_shapes]).reshape(-1, 2)
    in_turn = {"column": np.array(column), "low": np.float32(limits[:, 0]), "high": np.float32(limits[:, 1])}
    default = np.array([control.default for control in controls], np.float32)
    constants = {
        "neutral": np.ascontiguousarray(mesh.neutral.T, np.float32),
        "limits": {"default": default},
        "shapes": {"fields": fields, "place": place_of(support, len(kept))},
        "joints": _joint_constants(joints, controls, kept, shift),
        "file_vertices": {"place": place.astype(np.int32)},
    }
    paint = _paint(source)
    props = _props(source, vertices + shift, ours, mesh.neutral, paint, joints)
    chain = JOINTED if len(joints["controls"]) else SHAPES
    if np.isfinite(limits).any():
        chain = IN_TURN
        constants["shapes"] |= in_turn
    rigid = segments_named(face.rigid, mesh, where)
    parts = FaceParts(constants, props, paint[kept], chain, rigid)
    clips = tuple(Clip(name, values) for name, values in act_shapes(controls, face.acting)) or None
    rig = _with_points(recipe, mesh, tuple(controls), clips, parts, shapes, column)
    return check_rig(rig, tolerance_mm=1e-3)


def same_rows(columns: Float[np.ndarray, "n k"]) -> tuple[Int[np.ndarray, " u"], Int[np.ndarray, " n"]]:
    """Return the first of each set of equal rows, in their order, and the place among these of every row.

    Rows are equal if all their numbers are, rounded to `SAME_MM`.
    """
    whole = np.ascontiguousarray(np.rint(columns / SAME_MM).astype(np.int64))
    keys = whole.view(np.dtype((np.void, whole.dtype.itemsize * whole.shape[1]))).ravel()
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return first[order], rank[place.ravel()]


def _control(name: str, face: ShapeFace, source: ShapeSource) -> Control:
    weight = source.weights.get(name, 0.0)
    usual = Control(name, min(0.0, weight), float(weight), max(1.0, weight), WITHOUT_REGION)
    known = source.controls.get(name, usual)
    lower, upper = face.limits.get(name, (known.lower, known.upper))
    region = region_of_control(name) if known.region == WITHOUT_REGION else known.region
    return Control(name, float(lower), known.default, float(upper), region)


def _paint(source: ShapeSource) -> UInt8[np.ndarray, "n 3"]:
    """Return the vertices' colours: the file's where they are any, else by the names of parts."""
    colours = np.ones((len(source.neutral.vertices), 3)) if source.colours is None else source.colours.copy()
    labels = np.array([f"{a} {b}" for a, b in zip(source.neutral.groups, source.neutral.materials, strict=True)])
    for label in dict.fromkeys(labels.tolist()):
        members = np.unique(source.neutral.faces[labels == label])
        if (colours[members] > 0.97).all():  # white is what a file says that has a texture
            colours[members] = _known_part(label)[2]
    return np.rint(255 * np.clip(colours, 0, 1)).astype(np.uint8)


def _known_part(name: str) -> tuple[str, str, tuple[float, ...]]:
    return next(part for part in PARTS if re.search(part[1], name, re.IGNORECASE))


def prop_name(name: str) -> str:
    """Return what our own faces would call a part that is only shown: EyeLeft is eye_left, Hair hair_Hair.

    Pictures go by the first word: eyes shine and look about, hair may hide a forehead. Other names stay.
    """
    kind = _known_part(name)[0]
    stem, side = side_of(name)
    if kind == "eye" and side:
        stem = re.sub("[^a-z]", "", stem.lower().replace("eye", ""))
        return "_".join(filter(None, ("eye", stem, side)))
    if kind == "eye":
        return f"eyes_{name}"  # both of them, it seems: no catchlight can be placed
    return f"{kind}_{name}" if kind in ("hair", "brow", "glasses") else name or "part"


def _joints(face: ShapeFace, source: ShapeSource) -> dict[str, Any]:
    """Return the joints that have controls: these, their frames, and the share of each vertex that they carry.

    A vertex of a joint without controls is carried by the next one above that has some.
    """
    n = len(source.neutral.vertices)
    controls: list[Control] = []
    skin = source.skin
    wanted = [] if skin is None else [j for j, name in enumerate(skin.names) if name in face.joints]
    if skin is None or not wanted:
        return {
            "controls": controls,
            "weights": np.zeros((0, n)),
            "world": np.zeros((0, 4, 4)),
            "above": [],
            "axes": [],
        }
    world = np.empty((len(skin.names), 4, 4))
    carrier = np.full(len(skin.names), -1)
    for j, parent in enumerate(skin.parents):
        world[j] = skin.local[j] if parent < 0 else world[parent] @ skin.local[j]
        carrier[j] = wanted.index(j) if j in wanted else (carrier[parent] if parent >= 0 else -1)
    weights = np.zeros((len(wanted), n))
    dense = np.asarray(skin.weights.todense())
    for j, k in enumerate(carrier):
        if k >= 0:
            weights[k] += dense[:, j]
    above = [int(carrier[skin.parents[j]]) if skin.parents[j] >= 0 else -1 for j in wanted]
    axes = []
    for k, j in enumerate(wanted):
        for axis, (least, greatest) in face.joints[skin.names[j]].items():
            largest = max(abs(least), abs(greatest))
            controls.append(
                Control(f"{skin.names[j]}_{axis}", least / largest, 0.0, greatest / largest, WITHOUT_REGION)
            )
            axes.append((k, AXES.index(axis), np.radians(largest)))
    frames = world[wanted]
    frames[:, :3] = source.to_ours @ frames[:, :3]
    return {"controls": controls, "weights": weights, "world": frames, "above": above, "axes": axes}


def _joint_constants(
    joints: dict[str, Any], controls: Sequence[Control], kept: np.ndarray, shift: np.ndarray
) -> dict[str, np.ndarray]:
    count = len(joints["world"])
    world = np.array(joints["world"], np.float64)
    world[:, :3, 3] = world[:, :3, 3] + shift
    world[:, :3, :3] /= np.cbrt(np.linalg.det(world[:, :3, :3]))[:, None, None] if count else 1.0
    radians = np.zeros((len(controls), 3 * count))
    columns = {control.name: k for k, control in enumerate(controls)}
    for control, (joint, axis, angle) in zip(joints["controls"], joints["axes"], strict=True):
        radians[columns[control.name], 3 * joint + axis] = angle
    above = np.zeros((count, count))
    for k, parent in enumerate(joints["above"]):
        if parent >= 0:
            above[k, parent] = 1.0
    constants = {"world": world, "back": np.linalg.inv(world), "radians": radians, "above": above}
    constants["weights"] = joints["weights"][:, kept]
    return {name: np.asarray(array, np.float32) for name, array in constants.items()}


def _placement(
    vertices: np.ndarray, offsets: np.ndarray, names: Sequence[str], face: ShapeFace, to_ours: np.ndarray
) -> Float[np.ndarray, " 3"]:
    """Return the shift that brings the eyes where the cameras expect them: stated, where lids close, or guessed."""
    if face.eyes:
        return np.array(EYES_MM) - to_ours @ face.eyes
    middles = []
    for name, offset in zip(names, offsets, strict=True):
        if region_of_control(name) in ("eye_left", "eye_right") and "blink" in name.lower():
            motion = np.linalg.norm(offset, axis=1)
            if motion.max() > STILL_MM:
                middles.append((vertices * motion[:, None]).sum(0) / motion.sum())
    if len(middles) >= 2:
        return np.array(EYES_MM) - np.mean(middles, axis=0)
    return placement(vertices)


def _props(
    source: ShapeSource,
    vertices: np.ndarray,
    ours: np.ndarray,
    moving: Float[np.ndarray, "n 3"],
    paint: UInt8[np.ndarray, "v 3"],
    joints: dict[str, Any],
) -> tuple[RestProp, ...]:
    """Return the parts that nothing moves and that lie at the face: hair and eyes, but no body."""
    low, high = moving.min(axis=0), moving.max(axis=0)
    room = NEAR * (high - low).max()
    labels, props, taken = np.array(source.neutral.groups), [], set()
    for name in dict.fromkeys(source.neutral.groups):
        faces = source.neutral.faces[(labels == name) & ~ours]
        if not len(faces):
            continue
        used, inner = np.unique(faces, return_inverse=True)
        if (vertices[used] < low - room).any() or (vertices[used] > high + room).any():
            continue
        weights = joints["weights"][:, used].T  # (v, k)
        index = np.argsort(-weights, axis=1)[:, :NEAREST]
        weight = np.take_along_axis(weights, index, 1)
        missing = NEAREST - index.shape[1]
        index, weight = (np.pad(array, ((0, 0), (0, missing))) for array in (index, weight))
        props.append(
            RestProp(
                name=unique(prop_name(name), taken),
                follow="skin",
                colours=paint[used],
                vertices=vertices[used].astype(np.float32),
                faces=inner.reshape(-1, 3).astype(np.int32),
                index=index.astype(np.int32),
                weight=weight.astype(np.float32),
            )
        )
    return tuple(props)


def _with_points(
    recipe: ShapeRecipe,
    mesh: Any,
    controls: tuple[Control, ...],
    clips: tuple[Clip, ...] | None,
    parts: FaceParts,
    shapes: Float[np.ndarray, "s n 3"],
    column: Sequence[int],
) -> FaceRig:
    """Return the rig with its landmarks and control points: stated, or vertices that controls of a part move far.

    column: of each shape its control.
    """
    stated, n = recipe.face.points, len(mesh.neutral)
    local = (np.abs(shapes).max(axis=2) > STILL_MM).mean(axis=1) <= MOVES_ALL
    local &= np.abs(shapes).max(axis=(1, 2)) > 0
    chosen = shapes[local] if local.any() else shapes
    motion = motion_mm(chosen) if len(chosen) else np.zeros(n)
    if not motion.any():
        motion = parts.constants["joints"]["weights"].sum(axis=0)
    place = parts.constants["file_vertices"]["place"]
    for key, vertices in {"landmarks": stated.landmarks, **stated.control_points}.items():
        if wrong := next((vertex for vertex in vertices if vertex >= len(place) or place[vertex] < 0), None):
            expected = f"expected vertices of the file, 0 to {len(place) - 1}, in parts that move"
            raise InputError(f"{FACE_FILE}: points.{key}: {expected}, got {wrong}")
    named = place[list(stated.landmarks)]
    landmarks = named if len(named) else spread_out(mesh.neutral, motion, LANDMARKS)
    if stated.control_points:
        pairs = [(place[vertex], region) for region, vertices in stated.control_points.items() for vertex in vertices]
        points, regions = np.array([v for v, _ in pairs], np.int32), tuple(region for _, region in pairs)
    else:
        points = spread_out(mesh.neutral, motion, CONTROL_POINTS)
        strength = (shapes[:, points] ** 2).sum(axis=2) * local[:, None]  # (s, c)
        regions = tuple(controls[column[k]].region for k in strength.argmax(axis=0))
    return FaceRig(
        name=recipe.name,
        mesh=mesh,
        controls=controls,
        landmarks=np.asarray(landmarks, np.int32),
        control_points=points,
        control_point_regions=regions,
        clips=clips,
        face=parts,
    )
