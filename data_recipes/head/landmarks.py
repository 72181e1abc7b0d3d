"""Named curves and landmarks of a head, from its grids."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.topology import Layout
from data_recipes.recipe.reading import Recipe
from replicate.base.exceptions import InputError


def name_curves(recipe: Recipe, layout: Layout) -> dict[str, np.ndarray]:
    """Return ordered vertex indices: paired curves run from the middle outwards, others from the left to the right."""
    t, grids = recipe.template, layout.grids
    body, mouth = grids["body"], grids["mouth"]
    k = mouth.shape[1] // 2
    lower = np.concatenate([[0], np.arange(2 * k - 1, k - 1, -1)])
    brow_row = t.eye_rows[1] + max(1, round((t.hair_row - t.eye_rows[1]) * 0.06))
    columns = np.arange(t.face_columns, -t.face_columns - 1, -1)
    fold = np.arange(max(1, k // 4 + 1), -1, -1)
    fold_ring = min(t.lip_rings + (t.mouth_rings - t.lip_rings) // 2 + 1, t.mouth_rings - 1)
    start = body[t.nostril_rows[0] : t.nostril_rows[1] + 1, t.nostril_columns[1] + 1][::-1]
    left = {
        "brow": body[brow_row, t.eye_columns[0] : t.eye_columns[1] + 1],
        "nasolabial": np.array(list(dict.fromkeys(np.concatenate([start, mouth[fold_ring, fold]]).tolist()))),
    }
    chin = max(t.neck_rows, int(_anchor(recipe, 3)))
    curves = {
        "lip_upper": mouth[t.lip_rings, : k + 1],
        "lip_lower": mouth[t.lip_rings, lower],
        "seam_upper": mouth[0, : k + 1],
        "seam_lower": mouth[0, lower],
        "hairline": body[t.hair_row, columns],
        "jawline": body[chin, columns],
        "midline": np.concatenate([_column(body, 0), grids["crown"][1:-1, grids["crown"].shape[1] // 2]]),
    }
    for name, ids in left.items():
        curves[f"{name}_left"], curves[f"{name}_right"] = ids, layout.mirror[ids]
    return {name: np.asarray(ids, np.int32) for name, ids in curves.items()}


def _column(body: np.ndarray, column: int) -> np.ndarray:
    ids = body[:, column]
    return ids[ids >= 0]


def _anchor(recipe: Recipe, index: int) -> float:
    anchors = recipe.template.anchors
    return anchors[min(index, len(anchors) - 1)][0]


def name_landmarks(recipe: Recipe, layout: Layout, x: Float[np.ndarray, "n 3"]) -> dict[str, int]:
    """Return single vertices by name; `_left` is the character's left (+x)."""
    t, grids = recipe.template, layout.grids
    body, mouth, eye = grids["body"], grids["mouth"], grids["eye_left"]
    k, e = mouth.shape[1], eye.shape[1]
    front = _column(body, 0)
    front = front[(x[front, 2] > 0)]
    curves = name_curves(recipe, layout)

    def nearest(ids: np.ndarray, key) -> int:
        if not len(ids):
            raise InputError(
                f"{recipe.file}: mouth.y: the head is not a face: expected vertices of the middle line above and below"
            )
        return int(ids[np.argmax(key(x[ids]))])

    # where to look for them
    nose_rows = front[(x[front, 1] < 0) & (x[front, 1] > recipe.mouth.y)]
    below = front[x[front, 1] < recipe.mouth.y]
    side = body[t.nostril_rows[0] : t.nostril_rows[1] + 1, t.nostril_columns[1] + 1]
    face = np.flatnonzero((layout.part == 0) & (x[:, 0] > 0))
    jaw, cheek = np.array(recipe.skull.jaw_angle), np.array(recipe.skull.cheekbone)
    brow = curves["brow_left"]
    # those of the left, then those of the middle
    left = {
        "mouth_corner": int(mouth[0, 0]),
        "eye_outer": int(eye[0, 0]),
        "eye_inner": int(eye[0, e // 2]),
        "lid_upper": int(eye[0, e // 4]),
        "lid_lower": int(eye[0, 3 * e // 4]),
        "brow_inner": int(brow[0]),
        "brow_mid": int(brow[len(brow) // 2]),
        "brow_outer": int(brow[-1]),
        "nose_wing": nearest(side, lambda p: p[:, 0]),
        "cheek": nearest(face, lambda p: -np.linalg.norm(p - cheek - (4, -4, 14), axis=1)),
        "jaw_corner": nearest(face, lambda p: -np.linalg.norm(p - jaw - (12, -6, 0), axis=1)),
    }
    marks = {
        "lip_upper_mid": int(mouth[0, k // 4]),
        "lip_lower_mid": int(mouth[0, 3 * k // 4]),
        "lip_upper_top": int(mouth[t.lip_rings, k // 4]),
        "lip_lower_bottom": int(mouth[t.lip_rings, 3 * k // 4]),
        "nose_tip": nearest(nose_rows, lambda p: p[:, 2]),
        "chin": nearest(below, lambda p: p[:, 2] - 0.3 * p[:, 1]),
        "glabella": int(body[t.eye_rows[1], 0]),
        "forehead": int(body[(t.eye_rows[1] + t.hair_row) // 2, 0]),
    }
    for name, index in left.items():
        marks[f"{name}_left"], marks[f"{name}_right"] = index, int(layout.mirror[index])
    return marks
