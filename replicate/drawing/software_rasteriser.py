"""A small rasteriser in numpy: draws every figure where there is no OpenGL, only more slowly.

A z-buffer finds the face at each pixel; colours, normals and lights are then evaluated once a pixel.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8

from replicate.drawing.scene import MATT, STUDIO, WHITE, Camera, Finish, Lighting, Surface, axes, project
from replicate.geometry.normals import face_normals, vertex_normals

# How many (face, pixel) pairs are tried at once.
_CHUNK = 1_000_000


def rasterise(
    surfaces: Sequence[Surface],
    camera: Camera,
    width: int,
    height: int,
    background: tuple[int, int, int] = WHITE,
    lighting: Lighting = STUDIO,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw the surfaces; hidden parts are hidden, and both sides of a face are visible."""
    depth = np.full(width * height, np.inf)
    image = np.empty((width * height, 3))
    image[:] = background
    for surface in surfaces:
        vertices = np.asarray(surface.vertices, np.float64)
        pixels, distance = project(vertices, camera, width, height)
        face = _nearest(pixels, distance, surface.faces, depth, width, height)
        hit = np.flatnonzero(face >= 0)
        if len(hit):
            image[hit] = _colours(surface, vertices, pixels, distance, face[hit], hit, width, camera, lighting)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8).reshape(height, width, 3)


def _nearest(pixels, distance, faces, depth, width, height) -> np.ndarray:
    """Lower `depth` wherever a face is nearer, and return the face that did it for each pixel, else −1."""
    nearest = np.full(width * height, -1)
    corners = pixels[faces]  # (f, 3, 2)
    size = np.array([width, height])
    low = np.clip(np.ceil(corners.min(1) - 0.5), 0, size).astype(int)
    high = np.clip(np.floor(corners.max(1) - 0.5) + 1, 0, size).astype(int)
    area = (high - low).clip(0).prod(-1)
    visible = np.flatnonzero((area > 0) & (distance[faces] > 0).all(-1))
    for chunk in np.split(
        visible, np.searchsorted(np.cumsum(area[visible]), np.arange(_CHUNK, area[visible].sum(), _CHUNK))
    ):
        which = np.repeat(chunk, area[chunk])
        k = np.arange(len(which)) - np.repeat(np.cumsum(area[chunk]) - area[chunk], area[chunk])
        across = (high - low)[which, 0]
        x, y = low[which, 0] + k % across, low[which, 1] + k // across
        weight = _barycentric(corners[which], np.stack([x, y], -1) + 0.5)
        inside = (weight >= 0).all(-1)
        which, pixel, weight = which[inside], (y * width + x)[inside], weight[inside]
        z = 1 / (weight / distance[faces[which]]).sum(-1)
        nearer = z < depth[pixel]
        which, pixel, z = which[nearer], pixel[nearer], z[nearer]
        order = np.argsort(-z, kind="stable")  # of several faces at a pixel the nearest is written last
        depth[pixel[order]], nearest[pixel[order]] = z[order], which[order]
    return nearest


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the weights (k, 3) of the corners (k, 3, 2) at the points (k, 2); negative ones for flat triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    double_area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        wb, wc = _cross(points - a, c - a) / double_area, _cross(b - a, points - a) / double_area
        weights = np.stack([1 - wb - wc, wb, wc], -1)
    return np.where(double_area[:, None] == 0, -1.0, weights)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _colours(surface, vertices, pixels, distance, face, hit, width, camera, lighting) -> np.ndarray:
    corner = surface.faces[face]
    weight = _barycentric(pixels[corner], np.stack([hit % width, hit // width], -1) + 0.5) / distance[corner]
    weight /= weight.sum(-1, keepdims=True)  # straight lines in space, not in the picture
    if surface.paint is not None:
        colour = (np.asarray(surface.paint, float)[corner] * weight[..., None]).sum(1)
    else:
        colour = np.asarray(surface.colours, float)
        colour = np.broadcast_to(colour, (len(face), 3)) if colour.ndim == 1 else colour[face]
    if not surface.lit:
        return colour
    place = (vertices[corner] * weight[..., None]).sum(1)
    if surface.smooth:
        normal = (vertex_normals(vertices, surface.faces)[corner] * weight[..., None]).sum(1)
    else:
        normal = face_normals(vertices, surface.faces)[face]
    rows, eye = axes(camera)
    return shade(colour, normal @ rows.T, (eye - place) @ rows.T, lighting, surface.finish)


def shade(
    colour: np.ndarray, normal: np.ndarray, to_eye: np.ndarray, lighting: Lighting = STUDIO, finish: Finish = MATT
) -> np.ndarray:
    """Return lit colours (k, 3): ambient, diffuse and specular light, on whichever side faces the eye.

    normal, to_eye: (k, 3) in the camera's axes, of any length.
    """
    normal, to_eye = (v / np.linalg.norm(v, axis=-1, keepdims=True).clip(1e-12) for v in (normal, to_eye))
    normal = np.where((normal * to_eye).sum(-1, keepdims=True) < 0, -normal, normal)
    diffuse, glint = np.full((len(normal), 3), lighting.ambient), np.zeros((len(normal), 3))
    for light in lighting.lights:
        towards = np.asarray(light.direction) / np.linalg.norm(light.direction)
        tint = light.strength * np.asarray(light.colour)
        lit = (normal @ towards).clip(0)
        mirrored = 2 * (normal @ towards)[:, None] * normal - towards  # Phong's glint, as VTK draws it
        shine = (mirrored * to_eye).sum(-1).clip(0) ** finish.shininess
        diffuse += lit[:, None] * tint
        glint += (shine * (lit > 0))[:, None] * tint
    return colour * diffuse + 255 * finish.specular * glint
