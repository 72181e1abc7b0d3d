"""The chains of our faces: all deformers of `face.py`, and the steps of a ladder from a simple face to the whole one.

1: a target for each control, its soft limit and rigid teeth. 2: + targets half-way and for combinations. 3: + rotation:
jaw, lids and the head's shape. 4: + sliding on the skull, contact of lips and teeth, flesh. 5: + wrinkles, the whole
face. 6: wrinkles of half the wave length.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from data_recipes.deformers.correctives import corrective_drivers
from data_recipes.deformers.face import NODES
from data_recipes.deformers.node_chain import Chain, Constants, FaceConstants, Node, State, Values, spread
from data_recipes.deformers.pose_curves import PoseFields, move
from data_recipes.deformers.posed_props import pose
from data_recipes.deformers.rigid_teeth import polar_rotation, tooth_vertices

# A face as blendshapes: targets taken from the deformers, one control at a time (the first two steps of the ladder).

Offsets = Callable[[Float[np.ndarray, "b m"]], Float[np.ndarray, "b n 3"]]


def sample_targets(
    offsets: Offsets, one_sided: np.ndarray, columns: dict[str, int], n: int, curved: bool
) -> dict[str, np.ndarray]:
    """Return the fields of a blendshape face, for `pose_curves.move`.

    offsets: controls without limits, relative to their defaults → offsets from the neutral, mm
    one_sided: (m,), which controls never fall below their default
    columns: the controls' columns by name
    n: the number of vertices
    curved: whether there are targets half-way and for combinations
    """
    m = len(one_sided)
    every = np.eye(m, dtype=np.float32)
    full, fields = offsets(every), PoseFields(n)
    other = offsets(np.where(one_sided[:, None], 0.5, -1.0) * every) if curved else None
    for i in range(m):
        if not curved:
            fields.add((i,), full[i])
        elif one_sided[i]:
            fields.add_path(i, other[i], full[i])
        else:
            fields.add((i,), 0.5 * (full[i] - other[i]))
            fields.add((i, i), 0.5 * (full[i] + other[i]))
    if curved:
        groups = corrective_drivers(columns)
        together = offsets(np.stack([every[list(group)].sum(0) for group in groups])) if groups else ()
        added: dict[tuple[int, ...], np.ndarray] = {}
        for group, whole in zip(groups, together, strict=True):  # pairs come before triples
            pairs = [offset for pair, offset in added.items() if set(pair) < set(group)]
            added[group] = whole - full[list(group)].sum(0) - sum(pairs)
            fields.add(group, added[group])
    return fields.constants(m)


def prepare_rivets(
    neutral: Float[np.ndarray, "n 3"], teeth: list[Int[np.ndarray, " s"]], place: Int[np.ndarray, " n"]
) -> dict[str, np.ndarray]:
    """Return the constants of rigid teeth that follow their moved vertices; place: from `node_chain.place_of`."""
    support, owner, _, local = tooth_vertices(neutral, teeth)
    mean = np.zeros((len(support), len(teeth)))
    mean[np.arange(len(support)), owner] = 1 / np.bincount(owner)[owner] if teeth else 0
    spread_of = np.einsum("st,si,sj->tij", mean, local, local)
    fit = np.einsum("st,si,tij->sjt", mean, local, np.linalg.inv(spread_of)) if teeth else np.zeros((0, 3, 0))
    return {
        "support": support.astype(np.int32),
        "place": place,
        "owner": owner,
        "local": local.T.astype(np.float32),
        "mean": mean.astype(np.float32),
        "fit": fit.astype(np.float32),
    }


def hold_rigid(constants: Constants, x: Float[Values, "b 3 n"]) -> Float[Values, "b 3 n"]:
    """Return positions in which every tooth is a rigid image of itself at rest, the one nearest its moved vertices."""
    if constants["mean"].shape[1] == 0:
        return x
    moved = x[:, :, constants["support"]]  # (b, 3, s)
    centre = moved @ constants["mean"]  # (b, 3, teeth)
    affine = jnp.einsum("bis,sjt->btij", moved - centre[:, :, constants["owner"]], constants["fit"])
    rotation = polar_rotation(affine)[:, constants["owner"]]  # (b, s, 3, 3)
    rigid = jnp.einsum("bsij,js->bis", rotation, constants["local"]) + centre[:, :, constants["owner"]]
    inside = constants["place"] < len(constants["owner"])
    return jnp.where(inside, spread(rigid, constants["place"]), x)


def add_targets(constants: FaceConstants, state: State) -> State:
    """Move every vertex by the targets of the controls."""
    return state | {"x": constants["neutral"] + move(constants["targets"], state["u"])}


def rivet_teeth(constants: FaceConstants, state: State) -> State:
    """Hold the teeth rigid."""
    return state | {"x": hold_rigid(constants["rivets"], state["x"])}


SHORT_WAVES = 6  # the step with waves of half the length
CONTACT = ("skull_slide", "lip_contact", "teeth_contact", "flesh")


def _without(*names: str) -> tuple[Node, ...]:
    return tuple(node for node in NODES if node.name not in names)


_TARGETS = (
    NODES[0],
    Node("targets", add_targets, ("neutral", "targets")),
    Node("rivets", rivet_teeth, ("rivets",)),
)
FACE = Chain("face", NODES, pose)
TARGETS = Chain("face_targets", _TARGETS, pose)  # of steps 1 and 2, which differ by their targets
ROTATIONS = Chain("face_rotations", _without(*CONTACT, "wrinkles"), pose)
SMOOTH = Chain("face_smooth", _without("wrinkles"), pose)
LADDER = {1: TARGETS, 2: TARGETS, 3: ROTATIONS, 4: SMOOTH, 5: FACE, 6: FACE}
