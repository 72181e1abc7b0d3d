"""Combination correctives: offsets that correct the sum of two or three actions when all of them are on (layer 1).

Actions of a face don't add up, since muscles share the same skin: Tian, Kanade and Cohn 2001, "Recognizing Action Units
for Facial Expression Analysis", call such combinations nonadditive, brow raiser and brow lowerer for one. A production
face has a shape for each such combination (Lewis et al. 2014, "Practice and Theory of Blendshape Facial Models", §3).
"""

from __future__ import annotations

import numpy as np

from data_recipes.controls import SIDES
from data_recipes.deformers.face_fields import fade, tongue_reach
from data_recipes.deformers.mouth_fields import Curve, Motion, arch, lip_change
from data_recipes.deformers.pose_curves import PoseFields
from data_recipes.deformers.sculpting import Path, Sculptor
from data_recipes.head.shape import FLIP, smoothstep

# Motions of seam and border in Δa, Δb, Δr, as functions of u and side. An open jaw stretches the lips' corners: a laugh
# is rounder than a smile plus an open mouth, an "oh" narrower than pucker plus jaw. And two actions that lift or push
# the same lip don't add up in full.


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
    # The chin pushes the upper lip through the lower one, and doesn't reach a lip that is already up.
    return 0 * u, -3.4 * (side > 0) * arch(u, 1.8), 0 * u


def _less_frown(u: Curve, side: Curve) -> Motion:
    return 0 * u, -1.6 * arch(u, 1.8) + 1.0 * np.abs(u) ** 2, 0 * u


def _smug(u: Curve, side: Curve) -> Motion:
    # Puckered lips keep most of their way from a smile: it draws them out a little and hardly up.
    return 2.5 * np.sign(u) * np.abs(u), -6.5 * np.abs(u) ** 2.2 + 1.0 * arch(u), 0 * u


def _half_raise(u: Curve, side: Curve) -> Motion:
    # Wrinkling the nose lifts the upper lip too, by the same muscle.
    return 0 * u, -2.6 * (side > 0) * arch(u, 2.6), 0.6 * (side > 0) * arch(u, 2.6)


def _tight(u: Curve, side: Curve) -> Motion:
    # An open mouth drawn wide: the lips are taut, thin and close to the teeth.
    return -3.0 * np.sign(u) * np.abs(u) ** 1.4, -1.5 * side * arch(u), -1.8 * arch(u)


def _unpress(u: Curve, side: Curve) -> Motion:
    # Lips that are apart have nothing to press against.
    return 0 * u, 1.7 * side * arch(u, 4), 0.8 * arch(u, 4)


def _deep_frown(u: Curve, side: Curve) -> Motion:
    # With the jaw open the corners are drawn down less far, and out.
    return 1.5 * np.sign(u) * np.abs(u) ** 2, 2.5 * np.abs(u) ** 2, 0 * u


CORRECTIVES = (  # drivers, "*" standing for one side, and the motion
    (("smile_*", "jaw_open"), _laugh),
    (("pucker_*", "jaw_open"), _oh),
    (("smile_*", "frown_*"), _less_smile),
    (("smile_*", "mouth_stretch_*"), _less_stretch),
    (("pucker_*", "funnel_*"), _less_protrusion),
    (("smile_*", "pucker_*"), _smug),
    (("upper_lip_raise_*", "chin_raise"), _less_lift),
    (("frown_*", "chin_raise"), _less_frown),
    (("nose_wrinkle_*", "upper_lip_raise_*"), _half_raise),
    (("mouth_stretch_*", "jaw_open"), _tight),
    (("lip_press_*", "jaw_open"), _unpress),
    (("frown_*", "jaw_open"), _deep_frown),
    (("smile_*", "upper_lip_raise_*", "jaw_open"), _half_raise),
)


SKIN_DRIVERS = (
    ("brow_inner_up_*", "brow_down_*"),
    ("brow_outer_up_*", "brow_down_*"),
    ("nose_wrinkle_*", "brow_down_*"),
    ("smile_*", "cheek_raise_*"),
    ("cheek_puff_*", "jaw_open"),
)


def _skin_correctives(s: Sculptor) -> tuple[Path, ...]:
    """Return the correctives of brows, nose and cheeks on the left, in the order of their drivers."""
    inner, middle, outer = (s.bump(f"brow_{part}_left", 30.0) for part in ("inner", "mid", "outer"))
    lids, left = fade(s, "eye"), smoothstep(s.x[:, 0], -6.0, 8.0)
    cheek = s.bump("cheek_left", 34.0) * fade(s, "mouth") * lids
    puff = s.bump("cheek_left", 40.0) * fade(s, "mouth") * left
    root = s.bump("glabella", 24.0) * left
    return (
        # Raised and lowered at once, the brow's inner end goes up and inwards and its middle sinks: grief.
        s.slide(
            (inner * lids * left)[:, None] * (-2.4 * s.out + 3.0 * s.up) - 2.0 * (middle * lids)[:, None] * s.up,
            1.2 * inner * left,
        ),
        # The outer half goes up against the frown: a kinked brow.
        s.slide((2.6 * outer - 2.0 * inner * left)[:, None] * lids[:, None] * s.up),
        # Both push the same skin over the root of the nose.
        s.slide(2.0 * (root * lids)[:, None] * s.up, 1.3 * root),
        # Both lift the same cheek: it goes up less far than the sum, and out.
        s.slide(-2.0 * cheek[:, None] * s.up, 1.8 * cheek),
        # An open mouth holds no air.
        s.straight(np.zeros_like(s.x), -4.0 * puff),
    )


def corrective_drivers(columns: dict[str, int]) -> list[tuple[int, ...]]:
    """Return the columns of the controls that drive each corrective on each side, if the rig has all of them.

    Those with fewer drivers come first.
    """
    groups = [drivers for drivers, _ in CORRECTIVES] + list(SKIN_DRIVERS)
    names = [[driver.replace("*", side) for driver in drivers] for drivers in groups for side in SIDES]
    names.append(["tongue_out", "jaw_open"])
    found = [tuple(columns[name] for name in group) for group in names if all(name in columns for name in group)]
    return sorted(found, key=len)


def add_correctives(s: Sculptor, columns: dict[str, int], offsets: PoseFields, bulges: PoseFields) -> None:
    """Add each corrective whose drivers the rig has, on both sides, to the offsets and to the bulges along normals."""

    def add(fields: PoseFields, drivers: tuple[str, ...], vectors: np.ndarray) -> None:
        mirrored = (vectors * FLIP)[s.head.mirror]
        for side, displacement in zip(SIDES, (vectors, mirrored), strict=True):
            names = [driver.replace("*", side) for driver in drivers]
            if all(name in columns for name in names):
                fields.add(tuple(columns[name] for name in names), displacement)

    u, side = s.head.ring_parameter["mouth_u"], s.head.ring_parameter["mouth_side"]
    window = smoothstep(u, -0.45, 0.45)
    for drivers, motion in CORRECTIVES:
        change = tuple(part * window for part in motion(u, side))
        add(offsets, drivers, s.along_surface(lip_change(s, change, change)))
    for drivers, path in zip(SKIN_DRIVERS, _skin_correctives(s), strict=True):
        add(offsets, drivers, path.full)
        add(bulges, drivers, path.full_bulge[:, None] * s.normals)
    if "tongue_out" in columns and "jaw_open" in columns:
        offsets.add((columns["tongue_out"], columns["jaw_open"]), tongue_reach(s))
