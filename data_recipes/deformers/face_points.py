"""Single vertices that a rig names: free-form handles, control points of inverse kinematics (§4), a face's marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from data_recipes.deformers.sculpting import Sculptor
from replicate.base.exceptions import InputError


def _left_points(s: Sculptor) -> dict[str, int]:
    """Return named vertices of the left side and the middle, besides the head's landmarks."""
    cheek, corner, jaw = s.point("cheek_left"), s.point("mouth_corner_left"), s.point("jaw_corner_left")
    wing, chin, brow = s.point("nose_wing_left"), s.point("chin"), s.point("brow_outer_left")
    glabella, tip = s.point("glabella"), s.point("nose_tip")
    marks = s.head.landmarks
    ear = s.head.grids["ear_left"]
    return {
        "brow_left_01": marks["brow_inner_left"],
        "brow_left_02": marks["brow_mid_left"],
        "brow_left_03": marks["brow_outer_left"],
        "cheek_left_01": s.nearest(0.6 * cheek + 0.4 * wing + np.array([0, 8.0, 0])),
        "cheek_left_02": marks["cheek_left"],
        "cheek_left_03": s.nearest(0.5 * corner + 0.25 * cheek + 0.25 * jaw + np.array([8.0, 0, 0])),
        "jaw_left_01": marks["jaw_corner_left"],
        "jaw_left_02": s.nearest(0.5 * (jaw + chin) + np.array([6.0, -4, 4])),
        "nose_wing_left": marks["nose_wing_left"],
        "nasolabial_left": s.nearest(0.5 * (wing + corner) + np.array([8.0, 0, -4])),
        "forehead_left": s.nearest(s.point("forehead") * np.array([0, 1.0, 0.9]) + np.array([0.55 * brow[0], 0, 0])),
        "temple_left": s.nearest(brow + np.array([12.0, 14, -26])),
        "ear_left": int(ear[len(ear) // 2, ear.shape[1] // 4]),
        "chin": marks["chin"],
        "nose_tip": marks["nose_tip"],
        "forehead": marks["forehead"],
        "glabella": marks["glabella"],
        "nose_bridge": s.nearest(np.array([0, 0.55 * glabella[1] + 0.45 * tip[1], glabella[2]])),
        "throat": s.nearest(np.array([0, chin[1] - 26, 40.0])),
    }


def named_points(s: Sculptor) -> dict[str, int]:
    """Return the named vertices of both sides."""
    left = _left_points(s)
    right = {name.replace("left", "right"): int(s.head.mirror[v]) for name, v in left.items() if "left" in name}
    return left | right


def handle_vertices(s: Sculptor, names: list[str]) -> Int[np.ndarray, " h"]:
    """Return the handles' vertices.

    Raises InputError where two handles of a coarse head share one, since then they can't be interpolated.
    """
    points = named_points(s)
    vertices = np.array([points[name] for name in names], int)
    first: dict[int, str] = {}
    for name, vertex in zip(names, vertices.tolist(), strict=True):
        if vertex in first:
            raise InputError(
                f"{s.head.recipe.file}: controls.handles: '{name}' and '{first[vertex]}' are at the same vertex "
                f"{vertex}; ask for fewer handles on a head this coarse"
            )
        first[vertex] = name
    return vertices


LIP_PLACES = (0.15, 0.3, 0.5, 0.7, 0.85)  # of the points of a lip, from the left corner of the mouth to the right one


def _lip_points(s: Sculptor) -> dict[str, int]:
    """Return the numbered points of both lips."""
    curves = {name: s.head.curves[name] for name in ("lip_upper", "lip_lower")}
    return {
        f"{name}_{i:02d}": int(curve[round(share * (len(curve) - 1))])
        for name, curve in curves.items()
        for i, share in enumerate(LIP_PLACES, 1)
    }


def control_points(
    s: Sculptor, names: Mapping[str, Sequence[str]]
) -> tuple[tuple[str, ...], Int[np.ndarray, " c"], tuple[str, ...]]:
    """Return names, vertices and regions of the control points that a recipe lists by region.

    Raises InputError for a name that the head doesn't have, and for two names at the same vertex.
    """
    known = s.head.landmarks | named_points(s) | _lip_points(s)
    points: dict[int, tuple[str, str]] = {}
    for region, points_of_region in names.items():
        for name in points_of_region:
            where = f"{s.head.recipe.file}: control_points.{region}"
            if name not in known:
                raise InputError(f"{where}: there is no point {name!r}; there are {', '.join(sorted(known))}")
            if (vertex := known[name]) in points:
                raise InputError(f"{where}: {name!r} and {points[vertex][0]!r} are the same vertex {vertex}; drop one")
            points[vertex] = name, region
    labels, regions = zip(*points.values(), strict=True) if points else ((), ())
    return labels, np.array(list(points), np.int32), regions


def face_marks(s: Sculptor) -> tuple[Int[np.ndarray, " k"], tuple[str, ...]]:
    """Return vertices all over the face, and the region that each one marks."""
    points, marks = named_points(s), s.head.landmarks
    pairs: list[tuple[int, str]] = []
    for side in ("left", "right"):
        pairs += [(points[f"brow_{side}_0{i}"], "brows") for i in (1, 2, 3)] + [(points[f"forehead_{side}"], "brows")]
        lids = ("lid_upper", "lid_lower", "eye_inner", "eye_outer")
        pairs += [(marks[f"{name}_{side}"], f"eye_{side}") for name in lids]
        pairs += [(points[f"cheek_{side}_0{i}"], "cheeks") for i in (1, 2, 3)]
        pairs += [(points[f"nose_wing_{side}"], "nose"), (points[f"nasolabial_{side}"], "mouth")]
        pairs += [
            (marks[f"mouth_corner_{side}"], "mouth"),
            (points[f"jaw_{side}_01"], "jaw"),
            (points[f"jaw_{side}_02"], "jaw"),
        ]
    pairs += [(points["nose_tip"], "nose"), (points["nose_bridge"], "nose"), (points["forehead"], "brows")]
    pairs += [(points["glabella"], "brows"), (points["chin"], "jaw")]
    pairs += [(vertex, "mouth") for vertex in _lip_points(s).values()]
    unique = dict(pairs[::-1])
    return np.array(list(unique)[::-1], np.int32), tuple(list(unique.values())[::-1])
