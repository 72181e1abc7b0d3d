"""Pictures of meshes: pyvista off-screen where OpenGL works, the software rasteriser where it doesn't."""

import functools
import hashlib
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8

from replicate.base.files import replacing, short_temporary_folder
from replicate.drawing.light import trace
from replicate.drawing.scene import MATT, PORTRAIT, STUDIO, WHITE, Camera, Finish, Lighting, Surface, axes, project
from replicate.geometry.mesh import face_normals, vertex_normals

SUPERSAMPLING = 2  # each pixel is the mean of 2 × 2
SHADE_MM = 12.0  # how far from a surface another one shades it (ambient occlusion)
_PROBE = (
    "import pyvista; plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64)); "
    "plotter.add_mesh(pyvista.Sphere()); assert plotter.screenshot(return_img=True).std() > 1"
)


def render(
    surfaces: Sequence[Surface],
    camera: Camera,
    width: int,
    height: int,
    background: tuple[int, int, int] = WHITE,
    renderer: str | None = None,
    lighting: Lighting = STUDIO,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw surfaces as a camera sees them, smoothed at the edges.

    surfaces: what is drawn.
    camera: who sees it.
    width, height: of the picture, pixels.
    background: RGB.
    renderer: "pyvista" or "software"; None for pyvista where it works (probed once a process), else the latter.
    lighting: of the surfaces that are lit.
    """
    renderer = renderer or working_renderer()
    draw = {"pyvista": _pyvista, "software": rasterise}[renderer]

    def picture() -> UInt8[np.ndarray, "h w 3"]:
        return _reduced(draw(surfaces, camera, SUPERSAMPLING * width, SUPERSAMPLING * height, background, lighting))

    return drawn_once(picture, surfaces, camera, width, height, background, renderer, lighting)


def portrait(
    surfaces: Sequence[Surface],
    camera: Camera,
    width: int,
    height: int,
    background: tuple[int, int, int],
    renderer: str | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw a character in colour, by rays where embreex is installed, else as `render` does under `PORTRAIT`.

    renderer: one of `render`'s, in place of rays.
    """
    if renderer or not find_spec("embreex"):
        return render(surfaces, camera, width, height, background, renderer, PORTRAIT)

    def picture() -> UInt8[np.ndarray, "h w 3"]:
        return _reduced(trace(surfaces, camera, SUPERSAMPLING * width, SUPERSAMPLING * height, background))

    return drawn_once(picture, surfaces, camera, width, height, background, "rays")


def _reduced(large: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture whose pixels are means of `SUPERSAMPLING` × `SUPERSAMPLING` of another's."""
    blocks = large.reshape(len(large) // SUPERSAMPLING, SUPERSAMPLING, -1, SUPERSAMPLING, 3)
    return np.rint(blocks.mean((1, 3))).astype(np.uint8)


@functools.cache
def working_renderer() -> Literal["pyvista", "software"]:
    """Return "pyvista" if a subprocess can draw with it, else "software", with a warning that says what to install.

    It takes a subprocess, because VTK ends the process (exit 139) or a notebook's kernel where OpenGL doesn't work.
    """
    _choose_window()
    try:
        process = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=120)
        status = process.returncode
    except subprocess.TimeoutExpired:
        status = "none within 120 s"
    if status == 0:
        return "pyvista"
    warnings.warn(
        f"pyvista can't draw here (exit status {status}), so the software rasteriser draws the figures; "
        "for pyvista install the system packages libegl1 and libgl1-mesa-dri.",
        stacklevel=2,
    )
    return "software"


def _choose_window() -> None:
    """Have VTK use EGL where there is no display; with an empty variable it would find no window at all."""
    if not os.environ.get("VTK_DEFAULT_OPENGL_WINDOW"):
        os.environ.pop("VTK_DEFAULT_OPENGL_WINDOW", None)
        if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
            os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"


def plotter_of(
    surfaces: Sequence[Surface],
    camera: Camera,
    width: int,
    height: int,
    background: Sequence[int] = WHITE,
    lighting: Lighting = STUDIO,
) -> tuple:
    """Return an off-screen pyvista plotter, which the caller closes, and its mesh of each surface.

    The arguments are those of `render`.
    """
    _choose_window()
    import pyvista

    rows, eye = axes(camera)
    plotter = pyvista.Plotter(off_screen=True, window_size=(width, height), lighting="none")
    plotter.set_background([channel / 255 for channel in background])
    meshes = [_add(plotter, pyvista, surface, lighting) for surface in surfaces]
    for light in lighting.lights:
        towards = np.asarray(light.direction) @ rows
        place = np.asarray(camera.focus) + camera.distance_mm * towards / np.linalg.norm(towards)
        plotter.add_light(
            pyvista.Light(
                position=place,
                focal_point=camera.focus,
                color=light.colour,
                intensity=light.strength,
                light_type="scene light",
            )
        )
    view = plotter.camera
    view.position, view.focal_point, view.up = eye, camera.focus, rows[1]
    view.view_angle = 2 * np.degrees(np.arctan2(camera.height_mm / 2, camera.distance_mm))
    plotter.renderer.ResetCameraClippingRange()
    return plotter, meshes


def shade_bias_mm(camera: Camera, lighting: Lighting) -> float:
    """Return how deep a hollow must be for pyvista to shade it: what the lighting says, or a step of VTK's depths.

    VTK keeps depths in 16 bits: from 1,024 mm on they are rounded to 1 mm, and skin would shade itself in ripples along
    the lines where the rounded depth changes.
    """
    return max(lighting.shade_from_mm, float(np.spacing(np.float16(camera.distance_mm))))


def _pyvista(surfaces, camera: Camera, width: int, height: int, background, lighting: Lighting) -> np.ndarray:
    plotter, _ = plotter_of(surfaces, camera, width, height, background, lighting)
    try:
        if all(surface.lit for surface in surfaces):  # shades would falsify a heatmap's colours
            plotter.enable_ssao(radius=SHADE_MM, bias=shade_bias_mm(camera, lighting), kernel_size=64, blur=True)
        return np.asarray(plotter.screenshot(return_img=True))[..., :3]
    finally:
        plotter.close()


def _add(plotter, pyvista, surface: Surface, lighting: Lighting):
    mesh = pyvista.PolyData.from_regular_faces(np.asarray(surface.vertices, np.float32), np.asarray(surface.faces))
    if surface.smooth:
        mesh.point_data["Normals"] = vertex_normals(np.asarray(surface.vertices, np.float32), surface.faces)
        mesh.point_data.active_normals_name = "Normals"
    style = {"interpolation": "phong" if surface.smooth else "flat", "show_scalar_bar": False}
    if surface.lit:
        shine = surface.finish
        style |= {"ambient": lighting.ambient, "diffuse": 1.0}
        style |= {"specular": shine.specular, "specular_power": shine.shininess}
    else:  # VTK adds ambient and diffuse colour even without light
        style |= {"lighting": False, "ambient": 0.0, "diffuse": 1.0, "specular": 0.0}
    if surface.paint is not None:
        mesh.point_data["colours"] = np.asarray(surface.paint, np.uint8)
        actor = plotter.add_mesh(mesh, scalars="colours", rgb=True, **style)
    elif isinstance(surface.colours, tuple):
        actor = plotter.add_mesh(mesh, color=[channel / 255 for channel in surface.colours], **style)
    else:
        mesh.cell_data["colours"] = np.asarray(surface.colours, np.uint8)
        actor = plotter.add_mesh(mesh, scalars="colours", rgb=True, **style)
    actor.prop.specular_color = "white"  # a dark surface glints as brightly as a light one
    return mesh


# A small rasteriser in numpy: draws every figure where there is no OpenGL, only more slowly.

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
    """Draw surfaces as `render` does, without smoothing; both sides of a face are visible.

    The arguments are those of `render`.
    """
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
    """Lower `depth` at each pixel where a face is nearer, and return that face, −1 where none is."""
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

    colour: (k, 3), unlit.
    normal, to_eye: (k, 3) in the camera's axes, of any length.
    lighting: the lights.
    finish: how the surface shines.
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


# Pictures that several processes of one command need, drawn once: those of a run's figures and of its notebook.

PLACE = "REPLICATE_PICTURES"  # the variable by which processes that are started meanwhile know the folder

Picture = UInt8[np.ndarray, "h w 3"]


@contextmanager
def shared_pictures() -> Iterator[None]:
    """Have this process and those that it starts draw each picture once while the context lasts."""
    before = os.environ.get(PLACE)
    with short_temporary_folder() as folder:
        os.environ[PLACE] = str(folder)
        try:
            yield
        finally:
            os.environ.pop(PLACE)
            if before is not None:
                os.environ[PLACE] = before


def drawn_once(draw: Callable[[], Picture], *contents: Any) -> Picture:
    """Return the picture of some contents, drawn if it is new; outside of `shared_pictures` it always is.

    contents: all that the picture depends on: numbers, texts, arrays, dataclasses and sequences of them.
    """
    place = os.environ.get(PLACE)
    if place is None or not Path(place).is_dir():
        return draw()
    digest = hashlib.sha256()
    _digest_value(digest, contents)
    file = Path(place) / f"{digest.hexdigest()}.npy"
    if file.is_file():
        return np.load(file, allow_pickle=False)
    picture = draw()
    with suppress(OSError), replacing(file) as new:  # on a full disk, pictures are drawn again
        np.save(new, picture)
    return picture


def _digest_value(digest: Any, value: Any) -> None:
    """Add a value to a digest, its type and size first, so that no two values have the same bytes."""
    if is_dataclass(value):
        value = [type(value).__name__, *(getattr(value, field.name) for field in fields(value))]
    if hasattr(value, "__array__"):
        value = np.asarray(value)
        digest.update(f"array {value.dtype} {value.shape} ".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        digest.update(f"sequence {len(value)} ".encode())
        for part in value:
            _digest_value(digest, part)
    else:
        digest.update(f"{value!r} ".encode())
