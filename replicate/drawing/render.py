"""Pictures of meshes: pyvista off-screen where OpenGL works, the software rasteriser where it doesn't."""

import functools
import os
import subprocess
import sys
import warnings
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import UInt8

from replicate.drawing.scene import STUDIO, WHITE, Camera, Lighting, Surface, axes
from replicate.drawing.shared_pictures import drawn_once
from replicate.drawing.software_rasteriser import rasterise
from replicate.geometry.normals import vertex_normals

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
    renderer: Literal["pyvista", "software"] | None = None,
    lighting: Lighting = STUDIO,
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw surfaces as a camera sees them, smoothed at the edges.

    lighting: of the surfaces that are lit.
    renderer: None takes pyvista where it works (probed once a process), else the software rasteriser.
    """
    renderer = renderer or working_renderer()
    draw = {"pyvista": _pyvista, "software": rasterise}[renderer]

    def picture() -> UInt8[np.ndarray, "h w 3"]:
        large = draw(surfaces, camera, SUPERSAMPLING * width, SUPERSAMPLING * height, background, lighting)
        blocks = large.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 3)
        return np.rint(blocks.mean((1, 3))).astype(np.uint8)

    return drawn_once(picture, surfaces, camera, width, height, background, renderer, lighting)


@functools.cache
def working_renderer() -> Literal["pyvista", "software"]:
    """Return "pyvista" if a subprocess draws a picture with it, else "software", with a warning that says what to do.

    A subprocess, because VTK ends the process (exit 139) or a notebook's kernel when it finds no working OpenGL.
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
    """Have VTK use EGL where there is no display. An empty variable would make it find no window at all."""
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
    """Return an off-screen pyvista plotter, which the caller closes, and the mesh that it holds of each surface."""
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
    """Return how deep a hollow must be for pyvista to shade it: as the lighting says, or a step of VTK's depths.

    VTK holds depths in 16 bits: from 1,024 mm on they are rounded to 1 mm, and skin would shade itself along the lines
    where the rounded depth changes, in ripples.
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
