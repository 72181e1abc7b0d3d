"""The constants of a face, from its head: what each layer of `face.py` needs, computed once per character."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from data_recipes.controls import Control, control_groups, control_index, handle_names
from data_recipes.deformers import (
    creature_fields,
    face_fields,
    flesh,
    handles,
    head_shape,
    jaw,
    lids,
    lips,
    mouth_fields,
    node_chain,
    pose_curves,
    riders,
    rigid_teeth,
    skull_slide,
    upper_face_fields,
    wrinkles,
)
from data_recipes.deformers.correctives import add_correctives
from data_recipes.deformers.face import GAZE, HEAD_CONTROLS, JAW_CONTROLS
from data_recipes.deformers.face_chain import LADDER, ROTATIONS, SHORT_WAVES, TARGETS, prepare_rivets, sample_targets
from data_recipes.deformers.face_fields import fade
from data_recipes.deformers.face_points import handle_vertices
from data_recipes.deformers.node_chain import Chain, selection
from data_recipes.deformers.pose_curves import limits
from data_recipes.deformers.sculpting import Path, Sculptor
from data_recipes.deformers.wrinkle_regions import build_regions
from data_recipes.head.frills import frill_parts
from data_recipes.head.neutral_head import Head
from data_recipes.head.shape import smoothstep

HANDLE_RADIUS_MM = 44.0
HANDLE_TRAVEL_MM = (5.0, 5.0, 4.0)
LEAST_HEADROOM_MM = 4.0
BESIDE_NOSE = 2.0  # headroom that the lip gains per millimetre away from the nose
LIP_RING_REACH = 0.9  # share of the mouth's rings that a closing seam moves


def build_constants(head: Head, controls: tuple[Control, ...], wave: float = 1.0) -> dict[str, Any]:
    """Return the constants of every layer for a head and its controls (see `face.NODES`).

    wave: length of the wrinkles' waves over the usual one.
    """
    s = Sculptor(head)
    columns, m = control_index(controls), len(controls)
    ranges = np.array([[c.lower, c.upper, c.default] for c in controls], np.float64)
    pose, bulge = _pose_fields(s, columns, m)
    # layer by layer
    constants: dict[str, Any] = {
        "neutral": np.ascontiguousarray(s.x.T, np.float32),
        "limits": limits(*ranges.T),
        "pose": pose,
        "slide": skull_slide.prepare(head.sdf, s.x, _slide_weight(s)),
        "bulge": bulge,
        "handles": _handles(s, controls, columns, m),
        "jaw_controls": selection(_columns(JAW_CONTROLS, columns, m), m),
        "jaw": jaw.prepare(_jaw_weight(s), head.jaw_pivot),
        "lips": _lips(s, columns, m),
        "gaze_controls": selection(_columns(GAZE, columns, m), m),
        "flesh": flesh.prepare(s.x, head.faces, s.graph, _flesh_weight(s)),
        "wrinkles": wrinkles.prepare(build_regions(s, columns, m, wave), s.x, head.faces),
        "riders": riders.prepare(
            s.x,
            [head.grids[name] for name in frill_parts(head.recipe)],
            np.flatnonzero(s.in_parts("face", "cranium", "neck")),
        ),
        "head_controls": selection(_columns(HEAD_CONTROLS, columns, m), m),
        "shape": head_shape.prepare(
            base_y=float(s.x[:, 1].min() + 22.0),
            eye_y=float(head.eyes["left"].centre[1]),
            mouth_y=float(s.point("mouth_corner_left")[1]),
            chin=s.point("chin"),
            cheek=s.point("cheek_left"),
            axis_z=float(head.jaw_pivot[2]),
        ),
        "teeth": rigid_teeth.prepare(
            s.x, list(head.grids["teeth"]), [j < 0 for j in head.teeth_jaw.tolist()], head.jaw_pivot
        ),
    }
    # two rows of teeth for the lips to roll over
    for name, upper in (("wall_upper", True), ("wall_lower", False)):
        constants[name] = _wall(s, upper)
    # two eyes, whose controls go on with the products of gaze and follow gain
    lid_columns = columns | {name: m + i for i, name in enumerate(upper_face_fields.GAZE_PRODUCTS)}
    lid_count = m + len(upper_face_fields.GAZE_PRODUCTS)
    for side in ("left", "right"):
        eye = head.eyes[side]
        constants[f"lids_{side}"] = lids.prepare(
            s.x,
            upper_face_fields.build_patch(s, side, lid_columns, lid_count),
            np.asarray(eye.frame),
            np.asarray(eye.centre),
            float(eye.radius),
            columns.get(f"blink_{side}", lid_count),
        )
    return constants


def _columns(names: tuple[str, ...], columns: dict[str, int], m: int) -> Int[np.ndarray, " k"]:
    return np.array([columns.get(name, m) for name in names], np.int32)


def _pose_fields(s: Sculptor, columns: dict[str, int], m: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Sculpt every action that the rig has on both sides, with correctives; return offsets and bulges."""
    offsets, bulges = pose_curves.PoseFields(s.n), pose_curves.PoseFields(s.n)
    paths: dict[str, Path] = face_fields.sculpt(s) | upper_face_fields.sculpt(s)
    for name, action in mouth_fields.ACTIONS.items():
        if name.replace("*", "left") in columns:
            path = mouth_fields.sculpt(s, action)
            paths[name] = paths[name] + path if name in paths else path

    if any(control.name in columns for control in control_groups()["creature"]):
        for name, path in creature_fields.sculpt(s).items():
            paths[name] = paths[name] + path if name in paths else path

    def add(name: str, path: Path) -> None:
        if name in columns:
            offsets.add_path(columns[name], path.half, path.full)
            bulges.add_path(columns[name], path.half_bulge[:, None] * s.normals, path.full_bulge[:, None] * s.normals)

    for name, path in paths.items():
        add(name.replace("*", "left"), path)
        if "*" in name:
            add(name.replace("*", "right"), path.mirrored(s.head.mirror))
    for name in columns:
        if name.startswith("lip_") and name[-2:] in ("_x", "_y", "_z"):
            add(name, mouth_fields.sculpt_point(s, name))
    add_correctives(s, columns, offsets, bulges)
    return offsets.constants(m), bulges.constants(m)


def _slide_weight(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return how firmly the skin is bound to the skull: forehead and temples most, lips, lids, nose and neck not."""
    nose = np.maximum.reduce([s.bump(name, 34.0) for name in ("nose_tip", "nose_wing_left", "nose_wing_right")])
    weight = 0.9 * fade(s, "mouth") * fade(s, "eye") * (1 - nose)
    chin = s.point("chin")[1]
    weight = weight * smoothstep(s.x[:, 1], chin - 6, chin + 12)
    return np.where(s.in_parts("face", "cranium"), weight, 0.0)


def _flesh_weight(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return how far delta mush evens out the skin: the soft parts, not lips, lids, nostrils or ears."""
    nostrils = np.maximum.reduce([s.bump(f"nose_wing_{side}", 16.0) for side in ("left", "right")])
    weight = 0.85 * fade(s, "mouth") * fade(s, "eye") * (1 - nostrils)
    inside = s.in_parts("face", "neck", "cranium")
    for side in ("left", "right"):
        ears = s.head.grids[f"ear_{side}"].ravel()
        inside[ears] = False
        for name in ("nostril", "nostril_cap"):
            inside[s.head.grids[f"{name}_{side}"].ravel()] = False
    bottom = s.head.grids["body"][:2]
    inside[bottom[bottom >= 0]] = False
    return np.where(inside, weight, 0.0)


def _handles(s: Sculptor, controls: tuple[Control, ...], columns: dict[str, int], m: int) -> dict[str, np.ndarray]:
    names = handle_names(controls)
    vertices = handle_vertices(s, names)
    axes = np.array([[columns.get(f"handle_{name}_{axis}", m) for axis in "xyz"] for name in names], int).reshape(-1, 3)
    mask = np.where(s.is_outer, (0.3 + 0.7 * fade(s, "mouth")) * fade(s, "eye"), 0.0)
    bag = s.head.grids["mouth_bag"]
    for j, share in enumerate(mouth_fields.BAG_SHARES[: len(bag)]):
        mask[bag[j]] = 0.3 * share
    return handles.prepare(
        s.x, vertices, HANDLE_RADIUS_MM, mask, axes, np.tile(HANDLE_TRAVEL_MM, (len(names), 1)).reshape(-1, 3)
    )


def _jaw_weight(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return each vertex's share of the jaw's motion: 1 on chin, lower gum and tongue, 0 from the cheekbones up."""
    head = s.head
    mouth, bag = head.grids["mouth"], head.grids["mouth_bag"]
    lip_rings = head.recipe.template.lip_rings
    # A lens that is round at the corners; 0/1 weights would give a square mouth.
    opening = np.clip(1 - np.abs(head.ring_parameter["mouth_u"]) ** 2.2, 0, 1) ** 0.7
    profile = 0.5 - 0.5 * head.ring_parameter["mouth_side"] * opening
    anchors: dict[int, float] = {}
    for rings in (mouth[: lip_rings + 1], bag):
        for ring in rings:
            anchors.update(zip(ring.tolist(), profile.tolist(), strict=True))
    wing, chin, corner = s.point("nose_wing_left"), s.point("chin"), s.point("jaw_corner_left")
    x, body = s.x, head.grids["body"]
    still = s.is_outer & (x[:, 1] > wing[1] + 6 + 0.12 * np.maximum(wing[2] - x[:, 2], 0))
    still |= s.is_outer & (x[:, 2] < corner[2] - 26)
    still |= s.in_parts("cranium", "ear_left", "ear_right", "lid_inner_left", "lid_inner_right")
    neck = body[: max(head.recipe.template.neck_rows // 2, 1)]
    still[neck[neck >= 0]] = True
    hard = (
        s.is_outer & (np.abs(x[:, 0]) < 26) & (x[:, 1] < s.point("lip_lower_bottom")[1] - 4) & (x[:, 1] > chin[1] - 6)
    )
    hard &= x[:, 2] > chin[2] - 26
    for vertex in np.flatnonzero(hard & ~np.isin(np.arange(s.n), mouth[: lip_rings + 1])).tolist():
        anchors[vertex] = 1.0
    for vertex in head.curves["jawline"].tolist():
        reach = np.clip(abs(x[vertex, 0]) / corner[0], 0, 1)
        if x[vertex, 2] > corner[2] - 10:
            anchors[vertex] = float(1 - 0.45 * smoothstep(np.array(reach), 0.4, 1.0))
    for vertex in np.flatnonzero(still).tolist():
        anchors[vertex] = 0.0
    ids = np.array(list(anchors), int)
    mouth_vertices = np.concatenate([mouth[: lip_rings + 1].ravel(), bag.ravel()])
    weight = jaw.jaw_weights(s.graph, ids, np.array([anchors[i] for i in ids.tolist()]), mouth_vertices)
    weight[~s.is_skin] = 0.0
    weight[s.in_parts("gum_lower", "tongue")] = 1.0
    return weight


def _lips(s: Sculptor, columns: dict[str, int], m: int) -> dict[str, np.ndarray]:
    mouth, bag = s.head.grids["mouth"], s.head.grids["mouth_bag"]
    inner = min(len(mouth_fields.BAG_SHARES), len(bag))
    rings = np.concatenate([mouth[:-1], bag[:inner]])
    t = np.linspace(0, 1, len(mouth))[:-1] / LIP_RING_REACH
    shares = np.concatenate([1 - smoothstep(t, 0.0, 1.0), np.array(mouth_fields.BAG_SHARES[:inner])])
    names = ("lips_together", "sticky_left", "sticky_right")
    return lips.prepare(s.x, rings, shares, _columns(names, columns, m), m, _headroom(s))


def _headroom(s: Sculptor) -> Float[np.ndarray, " k"]:
    """Return how far each column of the mouth can rise, in mm, before the red of the lip meets the nostrils.

    Beside the nose there is more room, the more the further out.
    """
    mouth = s.head.grids["mouth"]
    nose = s.x[np.concatenate([s.head.grids[f"nostril_{side}"].ravel() for side in ("left", "right")])]
    border = s.x[mouth[s.head.recipe.template.lip_rings], 1]
    middle = mouth.shape[1] // 4
    beside = np.maximum(np.abs(s.x[mouth[0], 0]) - np.abs(nose[:, 0]).max(), 0.0)
    return max(nose[:, 1].min() - border[middle], LEAST_HEADROOM_MM) + BESIDE_NOSE * beside


def _wall(s: Sculptor, upper: bool) -> dict[str, np.ndarray]:
    head = s.head
    rows = head.grids["teeth"][head.teeth_jaw > 0] if upper else head.grids["teeth"][head.teeth_jaw < 0]
    mouth, bag = head.grids["mouth"], head.grids["mouth_bag"]
    vertices = np.concatenate([mouth.ravel(), bag[: max(len(bag) * 2 // 3, 1)].ravel()])
    points = s.x[rows.ravel()]
    clearance = lips.LIP_CLEARANCE_MM * max(1.0, head.recipe.mouth.half_width / 24.0)
    return lips.prepare_wall(s.x, vertices, points, float(points[:, 2].min()), upper, head.jaw_pivot, clearance)


# A face on one step of the ladder (see `face_chain`): its chain, and the constants that this chain needs.

BATCH = 32


def build_step(head: Head, controls: tuple[Control, ...], step: int) -> tuple[Chain, dict[str, Any]]:
    """Return the chain of a step, 1 to 6, and its constants."""
    chain, wave = LADDER[step], 0.5 if step == SHORT_WAVES else 1.0
    constants = build_constants(head, controls, wave)
    if chain is TARGETS:
        constants |= _target_constants(head, controls, constants, curved=step > 1)
    return chain, constants


def _target_constants(head: Head, controls: tuple[Control, ...], constants: dict, curved: bool) -> dict[str, Any]:
    """Return the targets of steps 1 and 2, sampled from step 3 without its limits, and the rivets of the teeth."""
    chain = Chain(ROTATIONS.name, ROTATIONS.nodes[1:], ROTATIONS.pose_props)
    arrays, neutral = jax.tree.map(jnp.asarray, constants), head.vertices.astype(np.float32)
    evaluate = jax.jit(lambda u: node_chain.evaluate(chain, arrays, u + arrays["limits"]["default"]))

    def offsets(u: np.ndarray) -> np.ndarray:
        padded = np.concatenate([u, np.zeros((-len(u) % BATCH, u.shape[1]), np.float32)])
        parts = [np.asarray(evaluate(padded[i : i + BATCH])) - neutral for i in range(0, len(padded), BATCH)]
        return np.concatenate(parts)[: len(u)]

    one_sided = np.array([control.lower >= control.default for control in controls])
    columns = control_index(controls)
    return {
        "targets": sample_targets(offsets, one_sided, columns, len(neutral), curved),
        "rivets": prepare_rivets(head.vertices, list(head.grids["teeth"]), constants["teeth"]["place"]),
    }
