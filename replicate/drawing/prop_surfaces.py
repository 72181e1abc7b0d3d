"""Display-only meshes as surfaces: each kind of part shines in its way, and eyes catch the light."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from replicate.drawing.scene import MATT, SILKY, WET, WHITE, Camera, Finish, Surface, axes

# By the beginning of a prop's name; all others are matt.
FINISHES = {"eye": WET, "hair": SILKY, "horn": SILKY}
# Where an eyeball would mirror a window, in the camera's axes (right, up, to the eye); the catchlight's size and its
# distance from the eyeball, as shares of the radius.
CATCHLIGHT = np.array([-0.20, 0.14, 0.97])
CATCHLIGHT_SIZE, CATCHLIGHT_LIFT = 0.085, 0.012
BUST = "bust"  # the prop that a head stands on; the picture's lower edge cuts it off
NEAREST = 4  # vertices of the skin that move a vertex of a prop


def finish_of(name: str) -> Finish:
    """Return how a part of a character shines, by its name."""
    return next((finish for start, finish in FINISHES.items() if name.startswith(start)), MATT)


def prop_surfaces(props: Iterable[Sequence], camera: Camera | None = None) -> list[Surface]:
    """Return surfaces of (name, vertices (k, 3), faces, colour) as `rig.pose_props` and pose records give them.

    colour: one RGB, or (k, 3), one for each vertex. camera: gives each eyeball a small white catchlight on the camera's
    side, wherever the eye looks; lids cover it as they cover the eye.
    """
    surfaces, eyes = [], {}
    for name, vertices, faces, colour in props:
        paint = (
            {"paint": np.asarray(colour, np.uint8)} if np.ndim(colour) == 2 else {"colours": colour_in_bytes(colour)}
        )
        surfaces.append(Surface(vertices, faces, finish=finish_of(name), framed=name != BUST, **paint))
        if name.startswith("eye_"):
            eyes.setdefault(name.rsplit("_", 1)[-1], []).append(vertices)
    if camera is not None:
        surfaces += [_catchlight(np.concatenate(parts), camera) for parts in eyes.values()]
    return surfaces


def carry_props(
    props: Iterable[Sequence], truth: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "n 3"]
) -> list[tuple]:
    """Return props moved with the skin from the truth to a method's vertices; eyeballs stay.

    So brows lie on every method's skin as they do on the true one, and no error of the skin hides them. props: as
    `prop_surfaces` takes them, on the true skin.
    """
    from scipy.spatial import cKDTree  # each command would wait for it, which few of them need

    tree, step = cKDTree(truth), np.asarray(vertices, np.float64) - truth
    moved = []
    for name, places, faces, colour in props:
        if not name.startswith("eye"):
            distance, index = tree.query(places, k=NEAREST)
            weight = 1 / (distance + 0.5) ** 2
            weight /= weight.sum(1, keepdims=True)
            places = np.float32(places + (weight[..., None] * step[index]).sum(1))
        moved.append((name, places, faces, colour))
    return moved


def _catchlight(eyeball: Float[np.ndarray, "k 3"], camera: Camera) -> Surface:
    """Return a disc on an eyeball: on the sphere that fits it, but as far out as a squashed eyeball is there."""
    p = eyeball.astype(float)
    system = np.concatenate([2 * p, np.ones((len(p), 1))], 1)
    centre = np.linalg.lstsq(system, (p * p).sum(1), rcond=None)[0][:3]
    rows, _ = axes(camera)
    right, up, towards = _frame(CATCHLIGHT @ rows)
    distance = np.linalg.norm(p - centre, axis=1)
    radius = distance[np.argsort(-(p - centre) @ towards / distance)[:4]].max()
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    ring = towards + CATCHLIGHT_SIZE * (np.cos(turn) * right + np.sin(turn) * up)
    ring = np.concatenate([towards[None], ring / np.linalg.norm(ring, axis=1, keepdims=True)])
    around = 1 + np.arange(24)
    faces = np.stack([np.zeros(24, int), around, np.roll(around, -1)], 1)
    return Surface(np.float32(centre + (1 + CATCHLIGHT_LIFT) * radius * ring), np.int32(faces), WHITE)


def _frame(towards: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return right, up and a direction as unit rows."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])


# Colours of pictures, red, green and blue from 0 to 255, and how different they look.

# Rows: red, green and blue of sRGB in the CIE's X, Y and Z, those of white being 1.
_TO_XYZ = np.array([[0.4339, 0.2126, 0.0177], [0.3762, 0.7152, 0.1095], [0.1899, 0.0722, 0.8728]])


def colour_in_bytes(colour: Sequence[float]) -> tuple[int, int, int]:
    """Return a colour in 0 to 255; one whose channels are at most 1 is in 0 to 1."""
    scale = 255 if max(colour) <= 1 else 1
    return tuple(round(scale * float(channel)) for channel in colour)


def perceived(colours: Sequence) -> Float[np.ndarray, "*s 3"]:
    """Return colours (..., 3) from 0 to 255 in the CIE's L*a*b*, where distances are those that the eye sees.

    A distance of about 2 is just noticeable; at less than about 30, shading can make two colours look alike.
    """
    part = np.asarray(colours, float) / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    root = linear @ _TO_XYZ
    root = np.where(root > 0.008856, np.cbrt(root), 7.787 * root + 16 / 116)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
