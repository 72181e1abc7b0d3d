"""Light on surfaces by rays: soft shadows, what a hollow sees of the sky, light under the skin, glints. No OpenGL.

Rays are Embree's, by embreex. One ray a pixel finds what the camera sees; rays from the vertices seen find how much of
the sky and of each lamp reaches them; that light spreads a little under skin; and each pixel gets the light at its
face's corners, and glints of its own. Colours are linear in between and sRGB in the picture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from scipy.sparse import csr_matrix

from replicate.drawing.scene import SILKY, WET, Camera, Surface, axes
from replicate.geometry.mesh import vertex_normals

LIFT_MM = 0.35  # how far above a vertex its rays begin, so that its own faces don't stop them
CLOSE_MM = 4.0  # a surface that lies less far above another covers it
BEHIND = -0.2  # a normal that points so far from the eye belongs to a surface that is seen from behind
SPREADS = 24  # steps in which light spreads under skin
KNEE = 0.72  # up to here brightness is shown as it is; above, it nears white
STRAIGHT = 0.028  # share of light from straight ahead that skin mirrors
BRIGHTEST = 3.0  # a glint is no brighter
SMOOTHINGS = (1, 4)  # steps after which a surface is compared with itself, to find narrow hollows and wider ones
EDGE_MM = 3.5  # the edges of a mesh on which a hollow is as dark as it is deep
CREASED = (0.45, 1.35)  # what the light of hollows and ridges is multiplied with, at most
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
CHUNK = 1 << 16  # pixels at a time
SKIN_ROUGHNESS = 0.43
ROUGHNESS = {WET: 0.10, SILKY: 0.38}  # of what mirrors otherwise than skin does

Reach = Callable[[Float[np.ndarray, "k 3"]], Float[np.ndarray, "s k"]]


@dataclass(frozen=True)
class Lamp:
    """A lamp fixed to the camera.

    direction: where it is, in the camera's axes (right, up, to the eye)
    spread_deg: half the angle under which it is seen; a wide lamp's shadows are soft
    rays: how many find out what of it reaches a vertex
    strength: of its light
    colour: red, green and blue, about 1
    """

    direction: tuple[float, float, float]
    spread_deg: float
    rays: int
    strength: float
    colour: tuple[float, float, float]


@dataclass(frozen=True)
class Studio:
    """All light of a picture.

    lamps: the lamps
    below, above: the sky's colours straight down and straight up
    bounced: colour of the light that comes from where the sky is hidden
    sky: strength of the sky's light
    sky_rays: how many find out how much of it a vertex sees
    under_skin_mm: how far red, green and blue light spread under skin
    gloss: strength of glints
    exposure: what brightness is multiplied with
    saturation: what distances from grey are multiplied with
    vignette: how much darker than its middle a background's corner is
    crease: how much darker hollows are than ridges, as if dust lay in them; 0 for what rays alone find
    """

    lamps: tuple[Lamp, ...]
    below: tuple[float, float, float]
    above: tuple[float, float, float]
    bounced: tuple[float, float, float]
    sky: float
    sky_rays: int = 128
    under_skin_mm: tuple[float, float, float] = (3.4, 1.5, 0.7)
    gloss: float = 0.8
    exposure: float = 0.78
    saturation: float = 1.1
    vignette: float = 0.3
    crease: float = 0.0


# For characters: a warm key from the upper left, a wide warm fill, and two cool lamps from behind that part the head
# from the paper.
PORTRAIT = Studio(
    (
        Lamp((-0.52, 0.54, 0.72), 14, 24, 1.15, (1.0, 0.93, 0.83)),
        Lamp((0.75, 0.10, 0.75), 35, 16, 0.28, (1.0, 0.90, 0.82)),
        Lamp((0.85, 0.50, -0.55), 15, 8, 0.90, (0.90, 0.95, 1.0)),
        Lamp((-0.90, 0.40, -0.50), 15, 8, 0.50, (0.90, 0.95, 1.0)),
    ),
    below=(0.55, 0.50, 0.47),
    above=(1.0, 1.02, 1.06),
    bounced=(0.24, 0.085, 0.045),
    sky=0.42,
)
# For clay whose folds one counts: a narrow lamp that rakes over the forehead from the upper left, and a faint fill.
RAKING = Studio(
    (
        Lamp((-0.62, 0.78, 0.22), 10, 24, 1.0, (1.0, 0.97, 0.92)),
        Lamp((0.80, 0.10, 0.60), 30, 12, 0.16, (0.92, 0.95, 1.0)),
    ),
    below=(0.62, 0.64, 0.68),
    above=(0.95, 0.97, 1.0),
    bounced=(0.1, 0.1, 0.1),
    sky=0.36,
    under_skin_mm=(0.0, 0.0, 0.0),
    gloss=0.4,
    exposure=0.86,
    saturation=1.0,
    vignette=0.0,
    crease=0.9,
)
# For surfaces whose colours are looked up in a legend: mostly sky, so that colours stay what they are.
EVEN = replace(
    RAKING,
    lamps=tuple(replace(lamp, strength=0.3 * lamp.strength) for lamp in RAKING.lamps),
    sky=0.85,
    exposure=0.95,
    gloss=0.2,
    crease=0.0,
)


def quick(studio: Studio) -> Studio:
    """Return a studio with a sixth of the rays, for views that move."""
    lamps = tuple(replace(lamp, rays=max(2, lamp.rays // 6)) for lamp in studio.lamps)
    return replace(studio, lamps=lamps, sky_rays=studio.sky_rays // 6)


# What OpenGL's light has of a lamp's strength, and of the sky's from the eye and from everywhere.
OF_LAMP, OF_SKY_AHEAD, OF_SKY_AROUND = 0.52, 0.7, 0.6


def plain_lights(studio: Studio) -> tuple[list[Lamp], float]:
    """Return a studio for OpenGL, which knows no shadows: lamps, one of them at the eye for the sky, and ambient light.

    Strengths are for colours as they are, not linear ones.
    """
    lamps = [replace(lamp, strength=OF_LAMP * lamp.strength) for lamp in studio.lamps]
    ahead = Lamp((0.0, 0.0, 1.0), 0, 1, OF_SKY_AHEAD * studio.sky, (1.0, 1.0, 1.0))
    return [*lamps, ahead], OF_SKY_AROUND * studio.sky


class Scene(NamedTuple):
    """All surfaces as one mesh of n vertices and f faces.

    vertices: (n, 3), mm
    faces: (f, 3), rows of `vertices`
    normals: (n, 3), unit, on the side that is seen
    colours: (n, 3), linear
    face_colours: (f, 3), linear; NaN where the corners' colours count
    roughness: (n,)
    is_skin: (n,), whether light goes under the surface
    is_lit: (n,); what isn't shows its colours as they are
    surface: (n,), which one it is of
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    face_colours: np.ndarray
    roughness: np.ndarray
    is_skin: np.ndarray
    is_lit: np.ndarray
    surface: np.ndarray


def trace(
    surfaces: Sequence[Surface],
    camera: Camera,
    width: int,
    height: int,
    background: tuple[int, int, int],
    studio: Studio = PORTRAIT,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw surfaces as a camera sees them, one ray a pixel; both sides of a face are visible.

    Raises ImportError where embreex isn't installed.
    """
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    rows, eye = axes(camera)
    scene = scene_of(surfaces, eye)
    embree = EmbreeScene()
    TriangleMesh(embree, scene.vertices.astype(np.float32), scene.faces.astype(np.int32))

    # What the camera sees
    directions = _through_pixels(camera, width, height)
    origins = np.tile(np.float32(eye), (len(directions), 1))
    found = embree.run(origins, directions, query="INTERSECT", output=True)
    pixels = np.flatnonzero(found["primID"] >= 0)
    faces, u, v = (found[name][pixels] for name in ("primID", "u", "v"))
    shares = np.stack([1 - u - v, u, v], -1).astype(np.float32)

    # What light reaches that
    seen = np.unique(scene.faces[faces])
    normals = scene.normals[seen]
    starts = np.float32(scene.vertices[seen] + LIFT_MM * normals)

    def reach(towards: np.ndarray) -> np.ndarray:
        towards = np.float32(towards)
        ahead = normals @ towards.T > 0
        vertex, ray = np.nonzero(ahead)
        ahead[vertex, ray] = embree.run(starts[vertex], towards[ray], query="OCCLUDED") < 0
        return ahead

    light, open_shares = np.zeros((len(scene.vertices), 3)), np.zeros((len(scene.vertices), len(studio.lamps)))
    light[seen], open_shares[seen] = light_at(normals, rows, studio, reach)
    is_covered = np.zeros(len(seen), bool)
    for towards, far in ((_unit(eye - starts), np.inf), (normals, CLOSE_MM)):
        found = embree.run(starts, np.float32(towards), query="INTERSECT", output=True)
        hit = found["primID"]
        is_covered |= (hit >= 0) & (found["tfar"] < far) & (scene.surface[scene.faces[hit, 0]] != scene.surface[seen])
    light, open_shares = np.split(uncovered(np.hstack([light, open_shares]), scene, seen, is_covered), [3], axis=1)
    if any(studio.under_skin_mm):
        light = spread(light, scene, seen, studio.under_skin_mm)
    if studio.crease:
        light *= np.exp(-studio.crease * depth_mm(scene)).clip(*CREASED)[:, None]

    # Its colours
    image = backdrop(background, width, height, studio.vignette).reshape(-1, 3)
    for first in range(0, len(pixels), CHUNK):
        part = slice(first, first + CHUNK)
        to_eye = -directions[pixels[part]]
        image[pixels[part]] = _shade(scene, faces[part], shares[part], to_eye, light, open_shares, rows, studio)
    return np.rint(255 * to_srgb(image)).astype(np.uint8).reshape(height, width, 3)


def scene_of(surfaces: Sequence[Surface], eye: Float[np.ndarray, " 3"]) -> Scene:
    """Return surfaces as one mesh. eye: the camera's place, which decides what side of a surface is seen."""
    counts, starts = [len(one.vertices) for one in surfaces], [0]
    starts += np.cumsum(counts)[:-1].tolist()
    vertices = np.concatenate([np.asarray(one.vertices, np.float64) for one in surfaces])
    normals = np.concatenate([vertex_normals(np.float32(one.vertices), np.asarray(one.faces)) for one in surfaces])
    is_behind = (normals * _unit(eye - vertices)).sum(-1) < BEHIND
    colours, face_colours = zip(*map(_colours_of, surfaces), strict=True)
    return Scene(
        vertices,
        np.concatenate([np.asarray(one.faces) + start for one, start in zip(surfaces, starts, strict=True)]),
        np.where(is_behind[:, None], -normals, normals),
        np.concatenate(colours),
        np.concatenate(face_colours),
        np.repeat([ROUGHNESS.get(one.finish, SKIN_ROUGHNESS) for one in surfaces], counts),
        np.repeat([one.finish not in ROUGHNESS for one in surfaces], counts),
        np.repeat([one.lit for one in surfaces], counts),
        np.repeat(np.arange(len(surfaces)), counts),
    )


def _colours_of(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface's linear colours: of its vertices, and of its faces, NaN where the vertices' count."""
    corners, faces = np.zeros((len(surface.vertices), 3)), np.full((len(surface.faces), 3), np.nan)
    if surface.paint is not None:
        corners[:] = to_linear(surface.paint)
    elif isinstance(surface.colours, tuple):
        corners[:] = to_linear(surface.colours)
    else:
        faces[:] = to_linear(surface.colours)
    return corners, faces


def _through_pixels(camera: Camera, width: int, height: int) -> np.ndarray:
    """Return the unit directions (height · width, 3) of the rays through the pixels' middles, row by row."""
    rows, _ = axes(camera)
    scale = camera.height_mm / height
    across = (np.arange(width) + 0.5 - width / 2) * scale
    up = (height / 2 - np.arange(height) - 0.5) * scale
    flat = np.empty((height, width, 3))
    flat[..., 0], flat[..., 1], flat[..., 2] = across, up[:, None], -camera.distance_mm
    return _unit(flat.reshape(-1, 3) @ rows).astype(np.float32)


def light_at(
    normals: Float[np.ndarray, "s 3"], rows: Float[np.ndarray, "3 3"], studio: Studio, reach: Reach
) -> tuple[Float[np.ndarray, "s 3"], Float[np.ndarray, "s l"]]:
    """Return the light that falls on some points, and the share of each lamp that they see.

    normals: of the points, unit
    rows: the camera's axes
    reach: directions (k, 3) → (s, k), whether a ray from each point leaves the scene
    """
    towards = directions_around(studio.sky_rays)
    cosines, is_open = (normals @ towards.T).clip(0), reach(towards)
    height = (1 + (towards @ rows.T)[:, 1:2]) / 2
    sky = np.array(studio.below) * (1 - height) + np.array(studio.above) * height
    hidden = (cosines * ~is_open).sum(1, keepdims=True) * np.array(studio.bounced)
    light = studio.sky * ((cosines * is_open) @ sky + hidden) / cosines.sum(1, keepdims=True)
    shares = np.zeros((len(normals), len(studio.lamps)))
    for column, lamp in enumerate(studio.lamps):
        towards = cone(np.array(lamp.direction) @ rows, lamp.spread_deg, lamp.rays)
        cosines, is_open = (normals @ towards.T).clip(0), reach(towards)
        light += lamp.strength * np.array(lamp.colour) * (cosines * is_open).mean(1, keepdims=True)
        shares[:, column] = (cosines * is_open).sum(1) / cosines.sum(1).clip(1e-9)
    return light, shares


def uncovered(
    values: Float[np.ndarray, "n c"], scene: Scene, seen: np.ndarray, is_covered: np.ndarray
) -> Float[np.ndarray, "n c"]:
    """Return values where each covered vertex has the mean of those beside it that aren't covered, from there inwards.

    A vertex under another surface, as a neck's under its collar, is in the dark, but the part of its face that comes
    out isn't; blended over the face, its darkness would be a stain.

    seen: (s,), the vertices whose values are known
    is_covered: (s,), whether another surface hides them from the eye or lies close above
    """
    beside, values = _neighbours(scene), values.copy()
    is_known, waiting = np.zeros(len(values), bool), seen[is_covered]
    is_known[seen[~is_covered]] = True
    while len(waiting):
        count = beside[waiting] @ is_known.astype(float)
        ready = count > 0
        if not ready.any():
            break
        means = beside[waiting[ready]] @ (values * is_known[:, None]) / count[ready, None]
        values[waiting[ready]] = means
        is_known[waiting[ready]] = True
        waiting = waiting[~ready]
    return values


def _neighbours(scene: Scene) -> csr_matrix:
    """Return (n, n): how many edges of faces join two vertices."""
    pairs = scene.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(scene.vertices)
    return csr_matrix((np.ones(2 * len(pairs)), np.concatenate([pairs, pairs[:, ::-1]]).T), (count, count))


def spread(
    light: Float[np.ndarray, "n 3"], scene: Scene, seen: np.ndarray, radii_mm: Sequence[float]
) -> Float[np.ndarray, "n 3"]:
    """Return light that has spread under skin, each colour by its radius: implicit steps of diffusion on the mesh.

    seen: (s,), the vertices whose light is known; none comes from others.
    """
    is_known = np.zeros(len(scene.vertices), bool)
    is_known[seen] = scene.is_skin[seen]
    pairs = scene.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = pairs[is_known[pairs].all(1)]
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    near = 1 / np.square(scene.vertices[pairs[:, 0]] - scene.vertices[pairs[:, 1]]).sum(1).clip(0.01)
    between = csr_matrix((near, pairs.T), (len(light), len(light)))
    nearness, degree = (np.bincount(pairs[:, 0], values, len(light)) for values in (near, None))
    result = light.copy()
    for channel, radius in enumerate(radii_mm):
        pull = 2 * radius**2 / degree.clip(1)
        spreading = light[:, channel].copy()
        for _ in range(SPREADS):
            spreading = (light[:, channel] + pull * (between @ spreading)) / (1 + pull * nearness)
        result[is_known, channel] = spreading[is_known]
    return result


def depth_mm(scene: Scene) -> Float[np.ndarray, " n"]:
    """Return how far each vertex lies below the smoothed surface, mm; above, it is negative.

    It is what it would be with edges of `EDGE_MM`: smoothing moves a vertex by its curvature times the square of its
    edges' length, so that all of a coarse mesh would lie in hollows.
    """
    beside = _neighbours(scene)
    weight = np.asarray(beside.sum(1)).clip(1)
    depth, smooth = np.zeros(len(scene.vertices)), scene.vertices
    for step in range(1, max(SMOOTHINGS) + 1):
        smooth = beside @ smooth / weight
        if step in SMOOTHINGS:
            depth += ((smooth - scene.vertices) * scene.normals).sum(1)
    pairs = scene.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lengths = np.repeat(np.linalg.norm(scene.vertices[pairs[:, 0]] - scene.vertices[pairs[:, 1]], axis=1), 2)
    count = len(scene.vertices)
    edge_mm = np.bincount(pairs.ravel(), lengths, count) / np.bincount(pairs.ravel(), minlength=count).clip(1)
    return depth * (EDGE_MM / edge_mm.clip(1.0)) ** 2


def _shade(
    scene: Scene,
    faces: np.ndarray,
    shares: np.ndarray,
    to_eye: np.ndarray,
    light: np.ndarray,
    open_shares: np.ndarray,
    rows: np.ndarray,
    studio: Studio,
) -> Float[np.ndarray, "p 3"]:
    """Return the linear colours of pixels.

    faces: (p,), what each shows
    shares: (p, 3), of the face's corners
    to_eye: (p, 3), unit
    light: (n, 3), that falls on each vertex
    open_shares: (n, l), of each lamp that a vertex sees
    """
    corners = scene.faces[faces]

    def blend(values: np.ndarray) -> np.ndarray:
        return np.einsum("pc,pc...->p...", shares, np.float32(values)[corners])

    colour = np.where(np.isnan(scene.face_colours[faces]), blend(scene.colours), scene.face_colours[faces])
    shown = colour * blend(light)
    normals, rough = _unit(blend(scene.normals)), scene.roughness[corners[:, 0]]
    for lamp, share in zip(studio.lamps, blend(open_shares).T, strict=True):
        mirrored = glints(normals, to_eye, np.array(lamp.direction) @ rows, rough) * share
        shown += (studio.gloss * lamp.strength * mirrored.clip(0, BRIGHTEST))[:, None] * np.array(lamp.colour)
    grey = shown @ LUMINANCE[:, None]
    shown = studio.exposure * (grey + studio.saturation * (shown - grey)).clip(0)
    over = (shown - KNEE).clip(0) / (1 - KNEE)
    shown = np.where(over > 0, KNEE + (1 - KNEE) * (1 - np.exp(-over)), shown)
    is_lit = scene.is_lit[corners[:, 0]]
    if not is_lit.all():  # colours that are read off are mixed as they are seen, not as light
        mixed = np.einsum("pc,pc...->p...", shares[~is_lit], to_srgb(scene.colours)[corners[~is_lit]])
        plain = scene.face_colours[faces[~is_lit]]
        shown[~is_lit] = np.where(np.isnan(plain), to_linear(255 * mixed), plain)
    return shown


def glints(
    normals: Float[np.ndarray, "p 3"], to_eye: Float[np.ndarray, "p 3"], lamp: np.ndarray, rough: np.ndarray
) -> Float[np.ndarray, " p"]:
    """Return what surfaces mirror of a lamp of strength 1 (Cook and Torrance's model with GGX's facets).

    lamp: (3,), its direction. rough: (p,), from 0 to 1.
    """
    lamp = _unit(lamp)
    half = _unit(lamp + to_eye)
    of_half, of_lamp = (normals * half).sum(-1).clip(0, 1), (normals @ lamp).clip(0, 1)
    of_eye, squared = (normals * to_eye).sum(-1).clip(1e-3, 1), rough**4
    facets = squared / (np.pi * (of_half**2 * (squared - 1) + 1) ** 2)
    k = (rough + 1) ** 2 / 8
    masked = 4 * (of_lamp * (1 - k) + k) * (of_eye * (1 - k) + k)
    fresnel = STRAIGHT + (1 - STRAIGHT) * (1 - (to_eye * half).sum(-1).clip(0, 1)) ** 5
    return facets * fresnel * of_lamp / masked


def directions_around(count: int) -> Float[np.ndarray, "k 3"]:
    """Return directions that are spread evenly over a sphere, on Fibonacci's spiral."""
    return _spiral(1 - 2 * (np.arange(count) + 0.5) / count)


def cone(axis: Float[np.ndarray, " 3"], angle_deg: float, count: int) -> Float[np.ndarray, "k 3"]:
    """Return directions that are spread evenly within an angle of an axis."""
    axis = _unit(axis)
    beside = _unit(np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0]))
    depth = (1 - np.cos(np.radians(angle_deg))) * (np.arange(count) + 0.5) / count
    return _spiral(1 - depth) @ np.stack([beside, np.cross(axis, beside), axis])


def _spiral(heights: np.ndarray) -> np.ndarray:
    turns = np.pi * (1 + 5**0.5) * (np.arange(len(heights)) + 0.5)
    radius = np.sqrt(1 - heights**2)
    return np.stack([radius * np.cos(turns), radius * np.sin(turns), heights], -1)


def backdrop(colour: Sequence[int], width: int, height: int, vignette: float) -> Float[np.ndarray, "h w 3"]:
    """Return a background in linear colours, darker away from its middle. vignette: 0 for one colour."""
    y, x = (np.mgrid[:height, :width] + 0.5) / np.array([height, width])[:, None, None] - 0.5
    away = np.hypot(x, y)[..., None] / np.hypot(0.5, 0.5)
    return to_linear(colour) * (1 - vignette * away**1.5)


def to_linear(colours: object) -> Float[np.ndarray, "*s 3"]:
    """Return sRGB colours from 0 to 255 as light from 0 to 1."""
    shares = np.asarray(colours, float) / 255
    return np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)


def to_srgb(light: Float[np.ndarray, "*s 3"]) -> Float[np.ndarray, "*s 3"]:
    """Return light from 0 to 1 as sRGB colours from 0 to 1; more than white is white."""
    light = light.clip(0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True).clip(1e-12)
