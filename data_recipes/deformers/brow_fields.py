"""Brow and scalp actions: the brow's curve moves, the forehead takes it up evenly as far as the hair line (layer 1).

The raise is a harmonic field that is 1 along the brow and 0 at the hair line and at the lids, so it falls linearly
between them: strain, and with it wrinkles, spread evenly over the forehead.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.sculpting import Path, Sculptor, smoothstep

RAISE_MM = 12.5
LOWER_MM = 11.0


def brow_row_field(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return the field that is 1 along both brows and 0 at hair line, lids, temples and the bridge of the nose."""
    head = s.head
    body, rings = head.grids["body"], head.grids["eye_left"]
    crown = head.grids["crown"].ravel()
    hair = head.curves["hairline"]
    t = head.recipe.template
    above = body[t.hair_row :]
    neck = body[: t.neck_rows]
    lids = np.concatenate([head.grids[f"eye_{side}"][: max(len(rings) // 4, 1)].ravel() for side in ("left", "right")])
    half = body.shape[1] // 2
    back = body[:, t.ear_columns[0] : 2 * half - t.ear_columns[0] + 1]
    low = body[: t.eye_rows[0] + (t.eye_rows[1] - t.eye_rows[0]) // 2]
    still = np.concatenate([hair, crown, above[above >= 0], lids, back[back >= 0], low[low >= 0], neck[neck >= 0]])
    for grid in ("lid_inner_left", "lid_inner_right", "mouth_bag", "mouth", "ear_left", "ear_right"):
        still = np.concatenate([still, head.grids[grid].ravel()])
    brows = np.concatenate([head.curves["brow_left"], head.curves["brow_right"]])
    row = _row_of(head, brows)
    between = body[row, list(range(-t.eye_columns[0], t.eye_columns[0] + 1))]
    brow_line = np.concatenate([brows, between[between >= 0]])
    # Up the forehead's columns the field is 1 − s, s the arc length from brow to hair line: an even strain.
    reach = t.eye_columns[1] - 1
    columns = body[row : t.hair_row + 1][:, list(range(-reach, reach + 1))]
    steps = np.linalg.norm(np.diff(s.x[columns], axis=0), axis=2)
    arc = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(steps, axis=0)])
    ramp = 1 - arc / arc[-1]
    whole = (columns >= 0).all()
    even = (columns.ravel(), ramp.ravel()) if whole else (brow_line, 1.0)
    return s.blend((brow_line, 1.0), even, (still, 0.0), passes=4)


def _row_of(head, brow: np.ndarray) -> int:
    return int(np.argwhere(head.grids["body"] == brow[0])[0, 0])


def across(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return how far out along the left brow a vertex lies: 0 at its inner end, 1 at its outer one, unclipped."""
    inner, outer = s.point("brow_inner_left"), s.point("brow_outer_left")
    angle = np.arctan2(s.x[:, 0], s.x[:, 2] - s.head.mouth_axis[0])
    low, high = (np.arctan2(p[0], p[2] - s.head.mouth_axis[0]) for p in (inner, outer))
    return (angle - low) / (high - low)


def sculpt(s: Sculptor) -> dict[str, Path]:
    """Return the brow actions by name; "*" stands for the left side."""
    row = brow_row_field(s)
    h = across(s)
    left = smoothstep(h, -0.75, 0.15)  # with its mirror image about 1 across the glabella
    inner = left * smoothstep(h, 0.85, 0.15)
    outer = left * smoothstep(h, 0.15, 0.75) * smoothstep(h, 1.75, 1.1)
    paths = {
        "brow_inner_up_*": s.slide(RAISE_MM * (row * inner)[:, None] * s.up),
        "brow_outer_up_*": s.slide(RAISE_MM * (row * outer)[:, None] * s.up),
    }
    # Frowning: the whole brow sinks and moves inwards; skin piles up over the nose and above the eyes.
    sink = s.bump("brow_inner_left", 46.0) * 0.75 + s.bump("brow_mid_left", 42.0) * 0.45 + 0.15 * row * left
    sink = sink * smoothstep(h, -0.65, 0.0) * _off_lids(s)
    offset = sink[:, None] * (-LOWER_MM * s.up - 2.2 * s.out)
    ridge = 1.6 * s.bump("brow_inner_left", 22.0) * smoothstep(h, -0.4, 0.0)
    paths["brow_down_*"] = s.slide(offset, ridge)
    squeeze = s.bump("brow_inner_left", 36.0) * smoothstep(h, -0.6, -0.05) * _off_lids(s)
    offset = squeeze[:, None] * (-5.5 * s.out + 0.6 * s.up)
    paths["brow_squeeze_*"] = s.slide(offset, 0.8 * s.bump("brow_inner_left", 16.0) * smoothstep(h, -0.4, 0.0))
    paths["scalp_raise"] = s.slide(4.5 * _scalp(s)[:, None] * s.up)
    return paths


def _off_lids(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return 0 on the lids' inner rings, rising to 1 at the outermost ring and beyond."""
    weight = np.ones(s.n)
    for side in ("left", "right"):
        rings = s.head.grids[f"eye_{side}"]
        for j, ring in enumerate(rings[:-1]):
            weight[ring] = smoothstep(np.array(j / (len(rings) - 1)), 0.15, 0.95)
        weight[s.head.grids[f"lid_inner_{side}"]] = 0
    return weight


def _scalp(s: Sculptor) -> Float[np.ndarray, " n"]:
    t = s.head.recipe.template
    body, crown = s.head.grids["body"], s.head.grids["crown"]
    low = body[: t.eye_rows[1] + 1]
    back = body[:, t.coarse_from : body.shape[1] - t.coarse_from + 1]
    ears = [s.head.grids[f"ear_{side}"].ravel() for side in ("left", "right")]
    eyes = [s.head.grids[f"eye_{side}"].ravel() for side in ("left", "right")]
    still = np.concatenate([low[low >= 0], back[back >= 0], *ears, *eyes, s.head.grids["mouth_bag"].ravel()])
    still = np.setdiff1d(still, s.head.curves["hairline"])
    front = np.setdiff1d(crown[: max(len(crown) // 5, 1)].ravel(), still)
    return s.blend(
        (s.head.curves["hairline"], 1.0), (front, 0.8), (crown[len(crown) // 2 :].ravel(), 0.0), (still, 0.0)
    )
