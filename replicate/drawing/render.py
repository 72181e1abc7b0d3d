"""Pictures of meshes: by rays, without OpenGL; pyvista off-screen for views that move, and where rays can't be had."""

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
from typing import Any

import numpy as np
from jaxtyping import UInt8

from replicate.base.exceptions import RunError
from replicate.base.files import replacing, short_temporary_folder
from replicate.drawing.light import PORTRAIT, RAKING, Studio, plain_lights, trace
from replicate.drawing.scene import WHITE, Camera, Surface, axes
from replicate.geometry.mesh import vertex_normals

SUPERSAMPLING = 2  # each pixel is the mean of 2 × 2
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
    studio: Studio = RAKING,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw surfaces as a camera sees them, smoothed at the edges: by rays, or by OpenGL where embreex isn't installed.

    surfaces: what is drawn
    camera: who sees it
    width, height: of the picture, pixels
    background: RGB
    studio: the light on surfaces that are lit

    Raises RunError where there is neither embreex nor OpenGL.
    """
    draw = trace if find_spec("embreex") else _by_opengl

    def picture() -> UInt8[np.ndarray, "h w 3"]:
        return _reduced(draw(surfaces, camera, SUPERSAMPLING * width, SUPERSAMPLING * height, background, studio))

    return drawn_once(picture, surfaces, camera, width, height, background, draw.__name__, studio)


def _reduced(large: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture whose pixels are means of `SUPERSAMPLING` × `SUPERSAMPLING` of another's."""
    blocks = large.reshape(len(large) // SUPERSAMPLING, SUPERSAMPLING, -1, SUPERSAMPLING, 3)
    return np.rint(blocks.mean((1, 3))).astype(np.uint8)


@functools.cache
def opengl_works() -> bool:
    """Return whether a subprocess can draw with pyvista, which says how to make it work if it can't.

    It takes a subprocess, because VTK ends the process (exit 139) or a notebook's kernel where OpenGL doesn't work.
    """
    _choose_window()
    try:
        process = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=120)
        status = process.returncode
    except subprocess.TimeoutExpired:
        status = "none within 120 s"
    if status:
        warnings.warn(
            f"pyvista can't draw here (exit status {status}); for OpenGL install the system packages libegl1 and "
            "libgl1-mesa-dri.",
            stacklevel=2,
        )
    return not status


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
    studio: Studio = PORTRAIT,
) -> tuple:
    """Return an off-screen pyvista plotter, which the caller closes, and its mesh of each surface.

    The arguments are those of `render`; the light is `plain_lights`.
    """
    _choose_window()
    import pyvista

    rows, eye = axes(camera)
    plotter = pyvista.Plotter(off_screen=True, window_size=(width, height), lighting="none")
    plotter.set_background([channel / 255 for channel in background])
    lamps, ambient = plain_lights(studio)
    meshes = [_add(plotter, pyvista, surface, ambient) for surface in surfaces]
    for lamp in lamps:
        towards = np.asarray(lamp.direction) @ rows
        place = np.asarray(camera.focus) + camera.distance_mm * towards / np.linalg.norm(towards)
        plotter.add_light(
            pyvista.Light(
                position=place,
                focal_point=camera.focus,
                color=lamp.colour,
                intensity=lamp.strength,
                light_type="scene light",
            )
        )
    view = plotter.camera
    view.position, view.focal_point, view.up = eye, camera.focus, rows[1]
    view.view_angle = 2 * np.degrees(np.arctan2(camera.height_mm / 2, camera.distance_mm))
    plotter.renderer.ResetCameraClippingRange()
    return plotter, meshes


def _by_opengl(surfaces, camera: Camera, width: int, height: int, background, studio: Studio) -> np.ndarray:
    if not opengl_works():
        raise RunError("expected embreex or OpenGL to draw with: `pip install embreex`, or install libegl1")
    plotter, _ = plotter_of(surfaces, camera, width, height, background, studio)
    try:
        return np.asarray(plotter.screenshot(return_img=True))[..., :3]
    finally:
        plotter.close()


def _add(plotter, pyvista, surface: Surface, ambient: float):
    mesh = pyvista.PolyData.from_regular_faces(np.asarray(surface.vertices, np.float32), np.asarray(surface.faces))
    if surface.lit:
        mesh.point_data["Normals"] = vertex_normals(np.asarray(surface.vertices, np.float32), surface.faces)
        mesh.point_data.active_normals_name = "Normals"
    style = {"interpolation": "phong", "show_scalar_bar": False}
    if surface.lit:
        shine = surface.finish
        style |= {"ambient": ambient, "diffuse": 1.0}
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


# Pictures that several processes of one command need, drawn once: those of a run's figures and of its notebook.

PLACE = "REPLICATE_PICTURES"  # the variable by which processes that are started meanwhile know the folder

Picture = UInt8[np.ndarray, "h w 3"]


@contextmanager
def shared_pictures() -> Iterator[None]:
    """Have this process and those that it starts draw each picture once while the outermost context lasts."""
    if _shared() is not None:
        yield
        return
    before = os.environ.get(PLACE)
    with short_temporary_folder() as folder:
        os.environ[PLACE] = str(folder)
        try:
            yield
        finally:
            os.environ.pop(PLACE)
            if before is not None:
                os.environ[PLACE] = before


def _shared() -> Path | None:
    place = os.environ.get(PLACE)
    return Path(place) if place and Path(place).is_dir() else None


def drawn_once(draw: Callable[[], Picture], *contents: Any) -> Picture:
    """Return the picture of some contents, drawn if it is new; outside of `shared_pictures` it always is.

    contents: all that the picture depends on: numbers, texts, arrays, dataclasses and sequences of them.
    """
    folder = _shared()
    if folder is None:
        return draw()
    digest = hashlib.sha256()
    _digest_value(digest, contents)
    file = folder / f"{digest.hexdigest()}.npy"
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
