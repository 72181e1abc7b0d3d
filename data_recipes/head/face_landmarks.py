"""The 54 landmarks of performance capture on one of our heads (§5.3.2), from its grids and its middle line.

The paper's authors identify them by hand on each character. Here a rule does so for every recipe.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from data_recipes.head.neutral_head import Head
from data_recipes.landmark_set import FACE_LANDMARKS

OUTER = ("face", "cranium", "neck")  # parts of the head that a landmark may lie on
BESIDE_CHIN = 0.3  # the way from the chin to the jaw's corner on which the points beside it lie


def landmark_vertices(head: Head) -> Int[np.ndarray, " l"]:
    """Return the vertex of each landmark of `FACE_LANDMARKS`, in its order; no two are the same."""
    found = _on_rings(head)
    for name, place in _places(head).items():
        middle = "left" not in name
        free = _outer(head) & ((head.mirror == np.arange(len(head.vertices))) == middle)
        free[[vertex for taken in found.values() for vertex in (taken, head.mirror[taken])]] = False
        found[name] = _nearest(head, free, place)
    right = {name.replace("left", "right"): int(head.mirror[v]) for name, v in found.items() if "left" in name}
    every = found | right
    return np.array([every[name] for name in FACE_LANDMARKS], np.int32)


def _on_rings(head: Head) -> dict[str, int]:
    """Return the landmarks of the left side and the middle that are vertices of the rings around mouth and eye."""
    found = {
        "mouth_corner_left": int(head.curves["lip_upper"][0]),
        "seam_corner_left": head.landmarks["mouth_corner_left"],
    }
    for side in ("upper", "lower"):
        outer, seam = head.curves[f"lip_{side}"], head.curves[f"seam_{side}"]
        for name, curve, share in (
            (f"lip_{side}_left_2", outer, 1 / 6),
            (f"lip_{side}_left_1", outer, 2 / 6),
            (f"lip_{side}", outer, 1 / 2),
            (f"seam_{side}_left", seam, 1 / 4),
            (f"seam_{side}", seam, 1 / 2),
        ):
            found[name] = int(curve[round(share * (len(curve) - 1))])
    rim = head.grids["eye_left"][0]  # from the outer corner over the upper lid to the inner corner, and back below
    shares = {"outer": 0, "upper_2": 1 / 6, "upper_1": 2 / 6, "inner": 1 / 2, "lower_1": 4 / 6, "lower_2": 5 / 6}
    return found | {f"eye_left_{name}": int(rim[round(share * len(rim))]) for name, share in shares.items()}


def _places(head: Head) -> dict[str, Float[np.ndarray, " 3"]]:
    """Return the places (mm) near which the other landmarks of the left side and the middle are looked for."""
    x, marks = head.vertices, head.landmarks
    places = {
        f"brow_left_{i}": place for i, place in enumerate(_along(x[head.curves["brow_left"]], np.linspace(0, 1, 5)), 1)
    }
    tip, wing, lip = x[marks["nose_tip"]], x[marks["nose_wing_left"]], x[head.curves["lip_upper"]][_middle(head)]
    line = x[np.array([v for v in head.curves["midline"].tolist() if _outer(head)[v] and x[v, 2] > 0])]
    eyes = x[head.grids["eye_left"][0]].mean(0)[1]
    top = line[np.argmin(np.abs(line[:, 1] - eyes))]
    bridge = _along(np.stack([top, tip]), np.array([0, 1 / 3, 2 / 3]))
    places |= {f"nose_bridge_{i}": place for i, place in enumerate(bridge, 1)}
    between = line[(line[:, 1] < tip[1]) & (line[:, 1] > lip[1])]
    chord = lip + (tip - lip) * ((between[:, 1:2] - lip[1]) / (tip[1] - lip[1]))
    base = between[np.argmin(between[:, 2] - chord[:, 2])]  # the hollow between the nose and the lip
    chin, jaw = x[marks["chin"]], x[marks["jaw_corner_left"]]
    return places | {
        "nose_tip": tip,
        "nose_base": base,
        "nose_wing_left": wing,
        "nostril_left": (base + wing) / 2,
        "chin": chin,
        "chin_left": (1 - BESIDE_CHIN) * chin + BESIDE_CHIN * jaw,
    }


def _middle(head: Head) -> int:
    return len(head.curves["lip_upper"]) // 2


def _along(points: Float[np.ndarray, "k 3"], shares: Float[np.ndarray, " s"]) -> Float[np.ndarray, "s 3"]:
    """Return places along a line through some points, at shares of its length."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.stack([np.interp(shares * length[-1], length, column) for column in points.T], axis=1)


def _outer(head: Head) -> np.ndarray:
    return np.isin(head.part, [i for i, name in enumerate(head.part_names) if name in OUTER])


def _nearest(head: Head, free: np.ndarray, place: np.ndarray) -> int:
    return int(np.flatnonzero(free)[np.argmin(np.linalg.norm(head.vertices[free] - place, axis=1))])
