"""Where a face wrinkles, and how: forehead, brows, nose, crow's feet, cheeks, lips, chin, under the eyes.

Each region has a fibre direction (compression along it raises the folds), a wave length λ and a pattern p. Patterns are
round ridges with sharp valleys, (|cos πφ|^0.8 − 0.66)/0.5 with φ in wave lengths, made uneven (see `uneven`) and faded
out at the border of the region.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.sculpting import Sculptor
from data_recipes.deformers.surface_operators import smooth_values, submesh
from data_recipes.deformers.wrinkles import Region
from data_recipes.head.shape import smoothstep
from data_recipes.recipe.sections import Wrinkles

# Rows of folds as skin has them: uneven in spacing, depth and length, with branches and ends.

SPACING = 0.22  # standard deviation of the folds' density, at unevenness 1
DEPTH = 0.4  # standard deviation of their amplitude
SHALLOWEST, DEEPEST = 0.15, 1.35  # amplitudes
ALONG_MM = 36.0  # how far along a fold its place and depth stay similar
ACROSS_FOLDS = 1.1  # the same across folds, in units of φ
FOLDS_PER_BRANCH = 3.0
CORE = 0.45  # radius, in folds, in which the amplitude falls to 0 around the point of a branch
LATER = 0.06  # compression by which the shallowest folds appear after the deepest
WAVES = 24  # in a smooth random field


@dataclass(frozen=True)
class FoldRow:
    """Folds at s vertices: phase φ, amplitude (usually 1), wave length, and the compression that raises them."""

    phase: Float[np.ndarray, " s"]
    amplitude: Float[np.ndarray, " s"]
    wavelength_mm: Float[np.ndarray, " s"]
    threshold: Float[np.ndarray, " s"]

    def pattern(self, window: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
        """Return the row's dimensionless height inside a window."""
        return window * self.amplitude * ridges(self.phase)


def ridges(phase: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    """Return round ridges at whole phases and sharp valleys half-way between them."""
    return (np.abs(np.cos(np.pi * phase)) ** 0.8 - 0.66) / 0.5


def stream(seed: int, name: str) -> np.random.Generator:
    """Return a region's random generator, independent of other regions."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def random_field(
    generator: np.random.Generator, places: Float[np.ndarray, "s d"]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "s d"]]:
    """Return a smooth random field of variance 1 and its gradient; places in units of its correlation length."""
    wave = generator.normal(size=(WAVES, places.shape[1]))
    angle = places @ wave.T + generator.uniform(0, 2 * np.pi, WAVES)
    scale = np.sqrt(2 / WAVES)
    return scale * np.cos(angle).sum(axis=1), -scale * np.sin(angle) @ wave


def uneven(
    phase: Float[np.ndarray, " s"],
    along_mm: Float[np.ndarray, " s"],
    wavelength_mm: float,
    wrinkles: Wrinkles,
    generator: np.random.Generator,
) -> FoldRow:
    """Return a row of folds made uneven.

    phase: of each vertex, before
    along_mm: its place along its fold
    wavelength_mm: of the even row
    wrinkles: how uneven, and the compression that raises folds
    """
    # shift the folds, and make some deeper than others
    share = wrinkles.unevenness
    places = np.stack([phase / ACROSS_FOLDS, along_mm / ALONG_MM], axis=1)
    change, slope = random_field(generator, places)
    density = np.clip(1 + share * SPACING * slope[:, 0], 0.6, 1.6)
    moved = phase + share * SPACING * ACROSS_FOLDS * change
    depth, _ = random_field(generator, places)
    depth -= depth.mean() if len(depth) else 0.0  # a small region must not be flat as a whole
    amplitude = np.clip(1 + share * DEPTH * depth, SHALLOWEST, DEEPEST)
    # branches: around their points, the phase turns by a whole fold
    if share > 0 and len(phase):
        low, high = np.quantile(phase, (0.15, 0.85))
        first, last = np.quantile(along_mm, (0.15, 0.85))
        for branch in range(int((high - low) / FOLDS_PER_BRANCH + 0.3)):
            across = phase - generator.uniform(low, high)
            along = (along_mm - generator.uniform(first, last)) / wavelength_mm
            moved = moved + (-1) ** branch * np.arctan2(along, across) / (2 * np.pi)
            distance = across**2 + along**2
            amplitude = amplitude * distance / (distance + CORE**2)
    later = LATER * share * np.clip((DEEPEST - amplitude) / (DEEPEST - SHALLOWEST), 0, 1)
    return FoldRow(moved, amplitude, wavelength_mm / density, wrinkles.tension + later)


ROWS_PER_FOLD = 5.0
COLUMNS_PER_LIP_LINE = 4.0


@dataclass(frozen=True)
class Patch:
    """A region before vertices without a face are left out.

    vertices: (s,), mesh indices
    fibre: (n, 3), direction across the folds, over the whole mesh
    wavelength_mm, threshold: (s,), or one for all
    pattern: (s,)
    gains: (s,), the weight of each gain control by its name
    """

    name: str
    vertices: np.ndarray
    fibre: np.ndarray
    wavelength_mm: np.ndarray | float
    pattern: np.ndarray
    threshold: np.ndarray | float
    gains: dict[str, np.ndarray]


def build_regions(s: Sculptor, columns: dict[str, int], m: int, wave: float = 1.0) -> list[Region]:
    """Return the face's wrinkle regions; column m stands for a gain control that the rig lacks.

    wave: length of the waves in rows of folds over the usual one; single folds stay as they are.
    """
    patches = [_forehead(s, wave), _glabella(s), _chin(s, wave), _lip_lines(s, wave)]
    for side in ("left", "right"):
        patches += [_bridge(s, side, wave), _crow(s, side, wave), _nasolabial(s, side), _under_eye(s, side, wave)]
    regions = []
    for patch in patches:
        local, _ = submesh(s.head.faces, patch.vertices, s.n)
        used = np.unique(local)
        if len(used) < 6:
            continue  # the tiny template has no room for this region
        names = list(patch.gains)
        total = sum(patch.gains.values())
        each = np.ones(len(patch.vertices))
        regions.append(
            Region(
                name=patch.name,
                vertices=patch.vertices[used].astype(np.int32),
                fibre=s.tangent(patch.fibre)[patch.vertices[used]],
                wavelength_mm=(patch.wavelength_mm * each)[used],
                pattern=patch.pattern[used],
                threshold=(patch.threshold * each)[used],
                gain_columns=np.array([columns.get(control, m) for control in names], np.int32),
                gain_weights=np.stack([patch.gains[c][used] / total[used] for c in names]).astype(np.float32),
            )
        )
    return regions


def _row(s: Sculptor, name: str, phase: np.ndarray, along_mm: np.ndarray, wavelength_mm: float) -> FoldRow:
    """Return a region's row of folds, as uneven as the recipe says."""
    wrinkles = s.head.recipe.wrinkles
    return uneven(phase, along_mm, wavelength_mm, wrinkles, stream(wrinkles.seed, name))


def _depth(s: Sculptor, name: str, places: np.ndarray) -> np.ndarray:
    """Return how deep single folds are, 1 on average, at places (s, d) in units of the correlation length."""
    wrinkles = s.head.recipe.wrinkles
    return np.clip(1 + 0.3 * wrinkles.unevenness * random_field(stream(wrinkles.seed, name), places)[0], 0.4, 1.4)


def _inside(s: Sculptor, mask: np.ndarray) -> np.ndarray:
    return np.flatnonzero(mask & s.is_outer & s.in_parts("face", "cranium"))


def _sides(x: np.ndarray, softness: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    left = 1 / (1 + np.exp(-x / softness * 2))
    return left, 1 - left


def _forehead(s: Sculptor, wave: float) -> Patch:
    """Return ridges along the rows from the brows to the hair line."""
    head, t = s.head, s.head.recipe.template
    body = head.grids["body"]
    first, last = t.eye_rows[1], t.hair_row
    reach = t.eye_columns[1] + 2
    columns = list(range(-reach, reach + 1))
    grid = body[first : last + 1][:, columns]
    row, column = np.indices(grid.shape)
    keep = grid >= 0
    vertices = grid[keep]
    r, c = row[keep], np.abs(column[keep] - reach)
    rows = last - first
    window = smoothstep(r, 0.06 * rows, 0.2 * rows) * smoothstep(r, 0.97 * rows, 0.78 * rows)
    window = window * smoothstep(c, reach, 0.62 * reach)
    spacing = np.linalg.norm(np.diff(s.x[body[first : last + 1, 0]], axis=0), axis=1).mean()
    x = s.x[vertices, 0]
    wavelength = wave * ROWS_PER_FOLD * spacing
    folds = _row(s, "forehead", r / (wave * ROWS_PER_FOLD) + 0.5, x, wavelength)
    middle = np.exp(-((x / 16.0) ** 2))
    left, right = _sides(x)
    gain = {
        "wrinkle_forehead_left": left * (1 - middle),
        "wrinkle_forehead_right": right * (1 - middle),
        "wrinkle_forehead_middle": middle,
    }
    pattern = 0.7 * folds.pattern(window)
    return Patch("forehead", vertices, s.up, folds.wavelength_mm, pattern, folds.threshold, gain)


def _glabella(s: Sculptor) -> Patch:
    """Return two upright grooves between the brows."""
    y0, top = s.point("glabella")[1], s.point("brow_inner_left")[1]
    inner = s.point("brow_inner_left")[0]
    x, y = s.x[:, 0], s.x[:, 1]
    vertices = _inside(s, (np.abs(x) < 1.35 * inner) & (y > y0 - 16) & (y < top + 16) & (s.x[:, 2] > 0))
    x, y = x[vertices], y[vertices]
    groove = 0.34 * inner
    p = 0.5 - 2.0 * np.exp(-(((np.abs(x) - groove) / (0.36 * groove)) ** 2))
    window = (
        smoothstep(np.abs(x), 1.3 * inner, 0.7 * inner) * smoothstep(y, y0 - 14, y0 - 2) * smoothstep(y, top + 14, top)
    )
    p = p * _depth(s, "glabella", np.stack([x / groove, y / 30.0], axis=1))
    gains = {"wrinkle_glabella": np.ones(len(vertices))}
    return Patch("glabella", vertices, s.out, 9.0, window * p, s.head.recipe.wrinkles.tension, gains)


def _bridge(s: Sculptor, side: str, wave: float) -> Patch:
    """Return oblique folds on one flank of the nose's bridge."""
    sign = 1.0 if side == "left" else -1.0
    y1, y0 = s.point("glabella")[1] - 10, s.point("nose_wing_left")[1] + 12
    x, y = sign * s.x[:, 0], s.x[:, 1]
    wide = s.point("eye_inner_left")[0]
    vertices = _inside(
        s, (x > -0.5) & (x < 1.05 * wide) & (y > y0 - 4) & (y < y1 + 4) & (s.x[:, 2] > 0.6 * s.point("glabella")[2])
    )
    x, y = x[vertices], y[vertices]
    wavelength = wave * 5.4
    phase = (y - y0 + 0.55 * x) / (wavelength * np.hypot(1, 0.55))
    window = smoothstep(y, y0 - 3, y0 + 5) * smoothstep(y, y1 + 3, y1 - 5) * smoothstep(x, 1.0 * wide, 0.55 * wide)
    window = window * smoothstep(x, 0.0, 2.5)
    fibre = s.up + 0.55 * sign * s.out
    folds = _row(s, f"nose_{side}", phase, x - 0.55 * y, wavelength)
    gains = {f"wrinkle_nose_{side}": np.ones(len(vertices))}
    return Patch(f"nose_{side}", vertices, fibre, folds.wavelength_mm, folds.pattern(window), folds.threshold, gains)


def _crow(s: Sculptor, side: str, wave: float) -> Patch:
    """Return a fan of folds, 19° apart, from the outer corner of the eye."""
    sign = 1.0 if side == "left" else -1.0
    corner = s.point(f"eye_outer_{side}")
    away = s.x - corner
    # In the tangent plane at the corner: a outwards along the skin, b up.
    out = np.array([0.55 * sign, 0, -0.83])
    a, b = away @ out, away[:, 1]
    distance = np.linalg.norm(away, axis=1)
    vertices = _inside(s, (distance < 36) & (a > 2))
    a, b, distance = a[vertices], b[vertices], distance[vertices]
    angle = np.degrees(np.arctan2(b, a + 3.0))
    window = smoothstep(distance, 6, 12) * smoothstep(distance, 34, 20) * smoothstep(np.abs(angle + 4), 62, 38)
    wavelength = wave * 6.0
    radial = (a + 3.0)[:, None] * out + b[:, None] * np.array([0, 1.0, 0])
    fibre = np.zeros_like(s.x)
    fibre[vertices] = np.cross(s.normals[vertices], radial)
    folds = _row(s, f"crow_{side}", angle / (wave * 19) + 0.5, distance, wavelength)
    gains = {f"wrinkle_crow_{side}": np.ones(len(vertices))}
    return Patch(f"crow_{side}", vertices, fibre, folds.wavelength_mm, folds.pattern(window), folds.threshold, gains)


def _nasolabial(s: Sculptor, side: str) -> Patch:
    """Return a fold from the wing of the nose past the corner of the mouth, the roll of the cheek, and a second fold.

    The second one, further out, appears later, when a wide smile pushes the cheek against the first.
    """
    sign = 1.0 if side == "left" else -1.0
    wing, corner = s.point(f"nose_wing_{side}"), s.point(f"mouth_corner_{side}")
    start = wing + np.array([2.5 * sign, 4.0, -6.0])
    end = corner + np.array([11.0 * sign, -4.0, -6.0])
    middle = 0.5 * (start + end) + np.array([4.0 * sign, 2.0, 0.0])
    t = np.linspace(0, 1, 60)[:, None]
    curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * (2 * middle - 0.5 * (start + end)) + t**2 * end
    along = np.linalg.norm(s.x[:, None, :2] - curve[None, :, :2], axis=2)
    place = along.argmin(axis=1)
    direction = np.gradient(curve, axis=0)[place]
    across = np.cross(direction, s.normals) * sign
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    outward = np.sign(sign * across[:, 0])[:, None]
    across = across * np.where(outward == 0, 1, outward)
    distance = ((s.x - curve[place]) * across).sum(axis=1)
    mouth = s.head.grids["mouth"][: s.head.recipe.template.lip_rings + 1]
    off_lips = ~np.isin(np.arange(s.n), mouth)
    near = (along.min(axis=1) < 26) & (distance > -17) & (sign * s.x[:, 0] > 8) & (s.x[:, 2] > 20) & off_lips
    vertices = _inside(s, near)
    d, place = distance[vertices], place[vertices] / 59
    # The groove is two edges of this mesh wide; a narrower one would be drawn as stairs.
    p = -1.6 * np.exp(-((d / 3.8) ** 2)) + 1.2 * np.exp(-(((d - 7.5) / 5.0) ** 2))
    window = smoothstep(place, 0.0, 0.12) * smoothstep(place, 0.95, 0.6) * smoothstep(np.abs(d), 16, 11)
    p = p * window * _depth(s, f"nasolabial_{side}", np.stack([place / 0.4], axis=1))
    outside = 0.6 * np.exp(-(((d - 20.5) / 4.2) ** 2)) - 0.9 * np.exp(-(((d - 15.0) / 3.8) ** 2))
    p = p + outside * smoothstep(place, 0.3, 0.5) * smoothstep(place, 0.95, 0.8) * smoothstep(d, 25, 22)
    tension = s.head.recipe.wrinkles.tension
    threshold = tension + 0.06 * smoothstep(d, 9, 13)
    gains = {f"wrinkle_nasolabial_{side}": np.ones(len(vertices))}
    return Patch(f"nasolabial_{side}", vertices, across, 11.0, p, threshold, gains)


def _chin(s: Sculptor, wave: float) -> Patch:
    """Return irregular dimples, as on the peel of an orange."""
    chin = s.point("chin")
    away = s.x - chin
    vertices = _inside(
        s, (np.linalg.norm(away, axis=1) < 25) & (s.x[:, 2] > 20) & (s.x[:, 1] < s.point("lip_lower_bottom")[1] - 2)
    )
    x, y = away[vertices, 0], away[vertices, 1]
    wavelength = wave * 7.0
    seed = s.head.recipe.wrinkles.seed
    angle = np.pi * (np.arange(7) + stream(seed, "chin").uniform(-0.4, 0.4, 7)) / 7
    wave_number = np.pi / wavelength * np.stack([np.cos(angle), np.sin(angle)])
    phases = stream(seed, "chin's phases").uniform(0, 2 * np.pi, 7)
    p = 0.35 * np.cos(np.stack([x, y], axis=1) @ wave_number + phases).sum(axis=1)
    window = smoothstep(np.hypot(x, y - 4), 22, 12)
    left, right = _sides(x, 5.0)
    gains = {"wrinkle_chin_left": left, "wrinkle_chin_right": right}
    return Patch("chin", vertices, s.up, wavelength, window * p, s.head.recipe.wrinkles.tension, gains)


def _lip_lines(s: Sculptor, wave: float) -> Patch:
    """Return lines from the lips outwards, which a pucker raises in the skin around the mouth."""
    rings, t = s.head.grids["mouth"], s.head.recipe.template
    grid = rings[t.lip_rings + 1 : -1]
    column = np.indices(grid.shape)[1].ravel()
    u = np.abs(np.broadcast_to(s.head.ring_parameter["mouth_u"], grid.shape))
    vertices = grid.ravel()
    step = np.linalg.norm(s.x[grid] - s.x[np.roll(grid, 1, axis=1)], axis=2)
    wavelength = wave * COLUMNS_PER_LIP_LINE * float(step.mean())
    outwards = np.linalg.norm(s.x[grid] - s.x[rings[t.lip_rings]], axis=2).ravel()
    phase = column / (wave * COLUMNS_PER_LIP_LINE)
    folds = _row(s, "lips", phase, outwards, wavelength)
    side = np.broadcast_to(s.head.ring_parameter["mouth_side"], grid.shape).ravel()
    reach = np.where(side > 0, 13.0, 8.0)  # below the lower lip is the chin's own region
    window = smoothstep(outwards, 0.0, 3.0) * smoothstep(outwards / reach, 1.0, 0.45) * smoothstep(u.ravel(), 0.9, 0.6)
    fibre = np.zeros_like(s.x)
    fibre[vertices] = (s.x[np.roll(grid, -1, axis=1)] - s.x[np.roll(grid, 1, axis=1)]).reshape(-1, 3)
    fibre /= np.maximum(np.linalg.norm(fibre, axis=1, keepdims=True), 1e-9)
    pattern = 0.4 * folds.pattern(window)
    gains = {"wrinkle_lips": np.ones(len(vertices))}
    return Patch("lips", vertices, fibre, folds.wavelength_mm, pattern, folds.threshold, gains)


def _under_eye(s: Sculptor, side: str, wave: float) -> Patch:
    """Return two folds along the lower lid."""
    rings = s.head.grids[f"eye_{side}"]
    lid, u = s.head.ring_parameter["eye_side"], s.head.ring_parameter["eye_u"]
    grid = rings[1:][:, lid < 0]
    ring = np.broadcast_to(np.arange(1, len(rings))[:, None], grid.shape).ravel()
    place = np.broadcast_to(u[lid < 0], grid.shape).ravel()
    vertices = grid.ravel()
    count = len(rings) - 1
    wavelength = wave * 4.6
    window = smoothstep(ring, 0.15 * count, 0.35 * count) * smoothstep(ring, 1.0 * count, 0.75 * count)
    window = window * smoothstep(np.abs(place), 0.95, 0.55)
    fibre = smooth_values(s.up, s.graph, 2)
    folds = _row(s, f"under_eye_{side}", ring / (wave * 4.0) + 0.5, s.x[vertices, 0], wavelength)
    pattern = 1.2 * folds.pattern(window)
    gains = {f"wrinkle_under_eye_{side}": np.ones(len(vertices))}
    return Patch(f"under_eye_{side}", vertices, fibre, folds.wavelength_mm, pattern, folds.threshold, gains)
