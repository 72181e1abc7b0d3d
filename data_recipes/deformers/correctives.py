"""Combination correctives: offsets that correct the sum of two actions where both are on (layer 1)."""

from __future__ import annotations

import numpy as np

from data_recipes.controls import SIDES
from data_recipes.deformers.face_fields import tongue_reach
from data_recipes.deformers.lip_motions import Curve, Motion, arch
from data_recipes.deformers.mouth_fields import lip_change
from data_recipes.deformers.pose_curves import PoseFields
from data_recipes.deformers.sculpting import Sculptor, smoothstep

# (drivers, what both seam and border do in Δa, Δb, Δr as functions of u and side); "*" stands for one side.
# An open jaw stretches the lips' corners: a laugh is rounder than a smile plus an open mouth, an "oh" narrower than
# pucker plus jaw; and two actions that lift or push the same lip don't add up in full.


def _laugh(u: Curve, side: Curve) -> Motion:
    corner = np.abs(u) ** 2
    lift = (side > 0) * arch(u, 2.6)  # the upper lip goes up with the corners and bares the upper teeth
    return -2.5 * np.sign(u) * corner, 2.5 * corner + 6.0 * lift, -0.5 * corner - 1.0 * lift


def _oh(u: Curve, side: Curve) -> Motion:
    return -2.5 * np.sign(u) * np.abs(u), 0 * u, 2.0 * (1 - np.abs(u))


def _less_smile(u: Curve, side: Curve) -> Motion:
    corner = np.abs(u)
    return -1.0 * np.sign(u) * corner**1.4, -3.0 * corner**2, 0 * u


def _less_stretch(u: Curve, side: Curve) -> Motion:
    return -6.0 * np.sign(u) * np.abs(u) ** 1.4, 1.5 * np.abs(u) ** 2, 1.5 * np.abs(u)


def _less_protrusion(u: Curve, side: Curve) -> Motion:
    return 5.0 * np.sign(u) * np.abs(u) ** 0.9, 0 * u, -5.5 * (1 - u * u) - 1.0


def _less_lift(u: Curve, side: Curve) -> Motion:
    # The chin pushes the upper lip through the lower one; a lip that is up already it doesn't reach.
    return 0 * u, -3.4 * (side > 0) * arch(u, 1.8), 0 * u


def _less_frown(u: Curve, side: Curve) -> Motion:
    return 0 * u, -1.6 * arch(u, 1.8) + 1.0 * np.abs(u) ** 2, 0 * u


def _smug(u: Curve, side: Curve) -> Motion:
    # Puckered lips keep most of their way from a smile: it draws them out a little and hardly up.
    return 2.5 * np.sign(u) * np.abs(u), -6.5 * np.abs(u) ** 2.2 + 1.0 * arch(u), 0 * u


CORRECTIVES = (
    (("smile_*", "jaw_open"), _laugh),
    (("pucker_*", "jaw_open"), _oh),
    (("smile_*", "frown_*"), _less_smile),
    (("smile_*", "mouth_stretch_*"), _less_stretch),
    (("pucker_*", "funnel_*"), _less_protrusion),
    (("smile_*", "pucker_*"), _smug),
    (("upper_lip_raise_*", "chin_raise"), _less_lift),
    (("frown_*", "chin_raise"), _less_frown),
)


def corrective_drivers(columns: dict[str, int]) -> list[tuple[int, ...]]:
    """Return, for each corrective on each side, the columns of the controls that drive it, where the rig has them."""
    names = [[driver.replace("*", side) for driver in drivers] for drivers, _ in CORRECTIVES for side in SIDES]
    names.append(["tongue_out", "jaw_open"])
    return [tuple(columns[name] for name in group) for group in names if all(name in columns for name in group)]


def add_correctives(s: Sculptor, columns: dict[str, int], fields: PoseFields) -> None:
    """Add every corrective whose drivers the rig has."""
    u, side = s.head.ring_parameter["mouth_u"], s.head.ring_parameter["mouth_side"]
    window = smoothstep(u, -0.45, 0.45)
    for drivers, motion in CORRECTIVES:
        if drivers[0].replace("*", "left") not in columns:
            continue
        change = tuple(part * window for part in motion(u, side))
        offset = s.along_surface(lip_change(s, change, change))
        for name, vectors in (("left", offset), ("right", (offset * np.array([-1.0, 1, 1]))[s.head.mirror])):
            names = [driver.replace("*", name) for driver in drivers]
            if all(driver in columns for driver in names):
                fields.add(tuple(columns[driver] for driver in names), vectors)
    if "tongue_out" in columns and "jaw_open" in columns:
        fields.add((columns["tongue_out"], columns["jaw_open"]), tongue_reach(s))
