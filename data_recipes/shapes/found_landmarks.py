"""The 54 landmarks of performance capture on somebody else's face, found by what its shapes move (§5.3.2).

Lids that close show where the eyes are open, a jaw that opens shows where the lips part, and the profile has the nose's
tip and base. Everything else lies at shares of these distances, as on faces whose landmarks are known. On human faces
the landmarks found are 2 to 4 mm off, on average; on a snout they are far off. All is seen from the front, as a tracker
sees a face.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from data_recipes.acting.arkit_names import play_weights
from data_recipes.landmark_set import FACE_LANDMARKS, TELLING_SHAPES
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import edges

BROWS = ("browDownLeft", "browDownRight")  # these only make the brows' height better
SIDES = {"left": 1.0, "right": -1.0}
SHARP = 128  # pixels from eye to eye
OPENING, DEEP = 0.25, 0.2  # lids cover an opening where they are at least so much nearer, of what is at most so deep
SEAM, ACROSS = 0.2, 3  # the lips part where the jaw's motion jumps by such a share of its largest jump; pixels
DEPTH = 0.25  # how much depth counts when the nearest vertex is looked for
# Shares of the mouth's half width; heights above the seam, in heights of the eyes above it.
LIPS = {
    "mouth_corner_{}": (1.02, 0.0),
    "lip_upper_{}_2": (0.74, 0.07),
    "lip_upper_{}_1": (0.37, 0.108),
    "lip_upper": (0.0, 0.105),
    "lip_lower_{}_2": (0.75, -0.08),
    "lip_lower_{}_1": (0.39, -0.13),
    "lip_lower": (0.0, -0.143),
    "seam_corner_{}": (0.95, 0.0),
    "seam_upper_{}": (0.45, 0.0),
    "seam_upper": (0.0, 0.0),
    "seam_lower_{}": (0.45, 0.0),
    "seam_lower": (0.0, 0.0),
    "chin": (0.0, -0.575),
    "chin_{}": (0.8, -0.56),
}
# Shares of half the distance between the eyes' outer corners; heights above the eyes, in their heights above the seam.
BROW = {1: (0.33, 0.45), 2: (0.58, 0.45), 3: (0.83, 0.45), 4: (1.05, 0.44), 5: (1.25, 0.39)}
BROW_SHIFT = 0.12  # that a brow may be higher or lower
WING = 0.31, 0.6  # of that half distance; of the way from the nose's tip down to its base
NOSTRIL = 0.45  # of the wing's place across
BRIDGE = 0.02  # height of the uppermost point above the eyes


@dataclass(frozen=True)
class _View:
    """What is seen of the skin from the front.

    x, y: of the pixels' columns and rows, mm, upwards. depth: nearness of each pixel, mm.
    jaw, brow: how far the vertices there move, as shares of the farthest.
    """

    x: Float[np.ndarray, " w"]
    y: Float[np.ndarray, " h"]
    depth: Float[np.ndarray, "h w"]
    jaw: Float[np.ndarray, "h w"]
    brow: Float[np.ndarray, "h w"]

    def column(self, x: float) -> int:
        return int(np.argmin(np.abs(self.x - x)))

    def row(self, y: float) -> int:
        return int(np.argmin(np.abs(self.y - y)))


def found_landmarks(rig: Rig, known: Mapping[str, int]) -> dict[str, int]:
    """Return the vertex of each landmark of `FACE_LANDMARKS`; no two that are found are the same.

    known: those that needn't be found. Raises InputError for a face without `TELLING_SHAPES` by a name that is known,
    or whose lids or lips don't part.
    """
    blink, jaw, brow = _motions(rig)
    rest = rig.mesh.neutral.astype(float)
    skin = _skin(rest, rig.mesh.faces, blink + jaw)
    faces = rig.mesh.faces[skin[rig.mesh.faces].all(axis=1)]

    # where the lids move, and a picture around it
    weight = (blink**2).sum(axis=1) * skin
    middle = float((rest[:, 0] * weight).sum() / weight.sum())
    centres = {side: np.average(rest, axis=0, weights=weight * (sign * (rest[:, 0] - middle) > 0) + 1e-12)
               for side, sign in SIDES.items()}  # fmt: skip
    apart = float(centres["left"][0] - centres["right"][0])
    pixel, height = apart / SHARP, (centres["left"][1] + centres["right"][1]) / 2
    x = np.arange(middle - 1.3 * apart, middle + 1.3 * apart, pixel)
    y = np.arange(height - 2.4 * apart, height + 0.9 * apart, pixel)
    amounts = [np.abs(motion[:, 1]) / max(np.abs(motion[:, 1]).max(), 1e-9) for motion in (jaw, brow)]
    view = _View(x, y, *np.moveaxis(_foremost(rest, faces, np.stack(amounts, axis=1), x, y), -1, 0))
    closed = _foremost(rest + blink, faces, np.zeros((len(rest), 0)), x, y)[..., 0]

    places: dict[str, np.ndarray] = {}
    for side, centre in centres.items():
        near = np.hypot(x - centre[0], y[:, None] - centre[1]) < apart / 2
        places |= _eye(view, np.where(near, closed - view.depth, 0.0), apart, side)
    places |= _others(view, places, bool(brow.any()))
    return _nearest(rest, amounts[0], np.flatnonzero(skin), view, places, known)


def _motions(rig: Rig) -> list[Float[np.ndarray, "n 3"]]:
    """Return how both lids, the jaw and both brows move the vertices, mm; nothing moves for brows without a shape."""
    names = [*TELLING_SHAPES, *BROWS]
    params, lacking = play_weights(names, np.eye(len(names)), rig.controls)
    if missing := [name for name in TELLING_SHAPES if name in lacking]:
        raise InputError(f"no shape is called {' or '.join(missing)}")
    amounts = params - rig.default
    poses: Float32[np.ndarray, "3 m"] = rig.default + np.stack([amounts[:2].sum(0), amounts[2], amounts[3:].sum(0)])
    return [np.asarray(rig(pose[None].astype(np.float32)))[0] - rig.mesh.neutral for pose in poses]


def _skin(
    rest: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], motion: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Return the vertices of the connected part that moves most."""
    pairs = edges(faces)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(rest), len(rest)))
    part = connected_components(graph, directed=False)[1]
    return part == np.bincount(part, np.linalg.norm(motion, axis=1)).argmax()


def _foremost(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    values: Float[np.ndarray, "n k"],
    x: Float[np.ndarray, " w"],
    y: Float[np.ndarray, " h"],
) -> Float[np.ndarray, "h w k+1"]:
    """Return z and the values of what is foremost in each pixel; far back and 0 where nothing is."""
    pixel, columns = x[1] - x[0], np.concatenate([vertices[:, 2:], values], axis=1)
    flat = (vertices[:, :2] - (x[0], y[0])) / pixel  # in pixels
    longest = np.linalg.norm(flat[faces] - flat[faces[:, [1, 2, 0]]], axis=2).max(axis=1)
    inside = (flat[faces].max(axis=1) > -1).all(axis=1) & (flat[faces].min(axis=1) < (len(x), len(y))).all(axis=1)
    pixels, seen = [], []
    cuts = np.ceil(1.3 * longest).astype(int) + 1
    for cut in np.unique(cuts[inside]):
        a, b = np.indices((cut + 1, cut + 1)).reshape(2, -1) / cut
        shares = np.stack([1 - a - b, a, b], axis=1)[a + b <= 1 + 1e-9]
        corners = faces[inside & (cuts == cut)]
        points = np.rint(shares @ flat[corners]).reshape(-1, 2).astype(int)
        kept = ((points >= 0) & (points < (len(x), len(y)))).all(axis=1)
        pixels.append(points[kept, 1] * len(x) + points[kept, 0])
        seen.append((shares @ columns[corners]).reshape(-1, columns.shape[1])[kept])
    every, found = np.concatenate(pixels), np.concatenate(seen)
    picture = np.zeros((len(y) * len(x), columns.shape[1]))
    picture[:, 0] = vertices[:, 2].min() - 1_000 * pixel
    order = np.argsort(found[:, 0], kind="stable")
    picture[every[order]] = found[order]  # the last, nearest one stays
    return picture.reshape(len(y), len(x), -1)


def _eye(view: _View, nearer: Float[np.ndarray, "h w"], apart: float, side: str) -> dict[str, np.ndarray]:
    """Return the landmarks of an eye: corners and lids of the opening that closed lids cover.

    nearer: how much nearer they are than what is seen when they are open, mm; 0 far from the eye.
    """
    depth = min(float(nearer.max()), DEEP * apart)
    open_ = ndimage.binary_fill_holes(ndimage.binary_closing(nearer > OPENING * depth, iterations=2))
    parts, count = ndimage.label(open_)
    if depth < 0.01 * apart or not count:
        raise InputError(f"lids that close cover no opening of the {side} eye")
    sizes = ndimage.sum_labels(np.clip(nearer, 0, depth), parts, np.arange(1, count + 1))
    rows, columns = np.nonzero(parts == 1 + np.argmax(sizes))
    x, y = view.x[columns], view.y[rows]
    inner, outer = (x.min(), x.max())[:: int(SIDES[side])]
    places = {}
    for name, corner in (("inner", inner), ("outer", outer)):
        places[f"eye_{side}_{name}"] = np.array([corner, np.median(y[np.abs(x - corner) < apart / 64])])
    for k in (1, 2):
        place = inner + k / 3 * (outer - inner)
        column = y[np.abs(x - place) <= apart / 64]
        places[f"eye_{side}_upper_{k}"] = np.array([place, column.max()])
        places[f"eye_{side}_lower_{k}"] = np.array([place, column.min()])
    return places


def _seam(view: _View, middle: float, top: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of the line along which the lips part, from the right corner to the left one.

    middle: its x. top: above the seam, y. half: of the widest mouth.
    """
    jump = np.zeros_like(view.jaw)
    jump[ACROSS:-ACROSS] = view.jaw[: -2 * ACROSS] - view.jaw[2 * ACROSS :]
    jump[view.y > top] = 0
    jump[:, np.abs(view.x - middle) > half] = 0
    start = view.column(middle)
    around = jump[:, start - 2 * ACROSS : start + 2 * ACROSS + 1].max(axis=1)
    first = int(around.argmax())
    least, rows = SEAM * around[first], {start: first}
    if not around[first] > 0.05:
        raise InputError("a jaw that opens doesn't part the lips")
    for way in (1, -1):
        row, column = first, start + way
        while 0 <= column < len(view.x):
            near = np.arange(max(row - ACROSS, 0), min(row + ACROSS + 1, len(view.y)))
            here = jump[near, column]
            if here.max() <= least:
                break
            row = round(float(near[here >= 0.8 * here.max()].mean()))
            rows[column], column = row, column + way
    columns = sorted(rows)
    return view.x[columns], ndimage.gaussian_filter1d(view.y[[rows[column] for column in columns]], 4)


def _others(view: _View, eyes: dict[str, np.ndarray], by_brows: bool) -> dict[str, np.ndarray]:
    """Return the places of mouth, nose, brows and chin. eyes: those of the eyes. by_brows: a shape moves brows."""
    corners = np.array([place for name, place in eyes.items() if name.endswith(("inner", "outer"))])
    middle, level = corners.mean(axis=0)
    half = float(np.ptp(corners[:, 0])) / 2
    x, y = _seam(view, middle, level - half / 2, 0.84 * half)
    seam = float(np.interp(middle, x, y))
    unit = level - seam
    places = {}
    for side, sign in SIDES.items():
        width = abs((x[-1] if sign > 0 else x[0]) - middle)
        for name, (share, above) in LIPS.items():
            across = middle + sign * share * width
            places[name.format(side)] = np.array([across, np.interp(across, x, y) + above * unit])

    # the profile: the tip is foremost, the base the hollow below the chord from there to the upper lip
    profile = view.depth[:, np.abs(view.x - middle) <= half / 32].max(axis=1)
    rows = np.flatnonzero((view.y < level) & (view.y > seam + 0.2 * unit))
    tip = rows[profile[rows].argmax()]
    rows = np.flatnonzero((view.y > seam + half / 50) & (view.y < view.y[tip]))
    lip = rows[np.where(view.y[rows] < seam + 0.4 * (view.y[tip] - seam), profile[rows], -np.inf).argmax()]
    rows = np.arange(lip, tip)
    base = view.y[rows[(profile[rows] - np.interp(rows, [lip, tip], profile[[lip, tip]])).argmin()]]
    above, tip = level + BRIDGE * unit, view.y[tip]
    for k in range(3):
        places[f"nose_bridge_{k + 1}"] = np.array([middle, above + k / 3 * (tip - above)])
    places |= {"nose_tip": np.array([middle, tip]), "nose_base": np.array([middle, base])}
    wing = tip + WING[1] * (base - tip)
    for side, sign in SIDES.items():
        places[f"nose_wing_{side}"] = np.array([middle + sign * WING[0] * half, wing])
        places[f"nostril_{side}"] = np.array([middle + sign * NOSTRIL * WING[0] * half, (wing + base) / 2])

    # brows: where a shape that lowers them moves most, on average, but not far from where they usually are
    at = {n: (share * half, level + height * unit) for n, (share, height) in BROW.items()}
    rows = np.flatnonzero(np.abs(view.y - (level + unit / 2)) < unit / 4)
    for side, sign in SIDES.items():
        shift = 0.0
        if by_brows:
            columns = [view.column(middle + sign * at[n][0]) for n in (1, 2, 3, 4)]
            most = [view.y[rows[view.brow[rows, c - 2 : c + 3].sum(axis=1).argmax()]] for c in columns]
            shift = float(np.median(most) - np.median([at[n][1] for n in (1, 2, 3, 4)]))
            shift = float(np.clip(shift, -BROW_SHIFT * unit, BROW_SHIFT * unit))
        places |= {f"brow_{side}_{n}": np.array([middle + sign * a, b + shift]) for n, (a, b) in at.items()}
    return places


def _nearest(
    rest: Float[np.ndarray, "n 3"],
    jaw: Float[np.ndarray, " n"],
    skin: Int[np.ndarray, " s"],
    view: _View,
    places: dict[str, np.ndarray],
    known: Mapping[str, int],
) -> dict[str, int]:
    """Return the nearest vertex to each place on what is seen, each once; of lips those that move with their side.

    rest: the vertices, mm
    jaw: how far a jaw that opens moves each vertex, as a share of the farthest
    skin: the vertices that may be taken
    view: what is seen
    places: x and y of all landmarks, mm
    known: vertices of landmarks that needn't be found
    """
    front = ndimage.maximum_filter(view.depth, size=7)  # so rims count, and not what lies behind them
    scale = np.array([1, 1, np.sqrt(DEPTH)])
    seam = np.array([places[f"seam_{part}"] for part in ("corner_right", "upper_right", "upper", "upper_left")]
                    + [places["seam_corner_left"]]).T  # fmt: skip
    whole, found = cKDTree(rest[skin] * scale), dict(known)
    for name in FACE_LANDMARKS:
        if name in known:
            continue
        row, column = view.row(places[name][1]), view.column(places[name][0])
        members, tree = skin, whole
        if name.startswith(("lip_", "seam_upper", "seam_lower")):
            row_between = view.row(np.interp(places[name][0], *seam))
            between = view.jaw[[row_between - 5, row_between + 5], column].mean()
            members = skin[(jaw[skin] < between) == ("upper" in name)]
            tree = cKDTree(rest[members] * scale)
        near = tree.query(np.array([*places[name], front[row, column]]) * scale, k=min(64, len(members)))[1]
        free = [int(vertex) for vertex in members[np.atleast_1d(near)] if vertex not in found.values()]
        if not free:
            raise InputError(f"too few vertices lie around {name}")
        found[name] = free[0]
    return found
