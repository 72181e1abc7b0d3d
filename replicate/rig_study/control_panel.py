"""A panel of sliders for a rig's controls, for notebooks: every change draws the face again.

`control_panel(rig)` builds it; its `widget` is what a notebook shows. The panel also works without a browser: set a
slider's `value` and look at `picture`.
"""

import io
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from data_recipes.catalogue import expression_poses
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.drawing.characters import BACKGROUND, character_surfaces
from replicate.drawing.light import PORTRAIT, quick, trace
from replicate.drawing.panels import DPI, Words
from replicate.drawing.render import opengl_works, plotter_of
from replicate.drawing.scene import WHITE, Camera, Surface, camera_for
from replicate.inference.vertex_normals import fast_vertex_normals

if TYPE_CHECKING:
    import matplotlib.figure


VIEWS = ("front", "three_quarter", "side", "forehead", "mouth")
SHOWN_BARS = 26  # how many sliders the still picture has room for
BARS = 420  # pixels beside the picture, for their names and values


class ControlPanel:
    """Sliders for the controls of one region at a time, presets, a switch for the wrinkles, and the picture.

    params: (m,) the pose shown; picture: (height, width, 3) uint8; times_ms: how long the last picture took, by part.
    """

    def __init__(self, rig: Rig, width: int = 400, height: int = 440, opengl: bool | None = None):
        import ipywidgets as widgets

        self.rig, self.params = rig, rig.default.copy()
        self.times_ms: dict[str, float] = {}
        self.picture: UInt8[np.ndarray, "h w 3"] = np.zeros((height, width, 3), np.uint8)
        self._view = LiveView(width, height, BACKGROUND, opengl)
        self._held = False  # while several sliders change for one picture
        self._presets = expression_poses(rig)
        self.sliders = {c.name: self._slider(widgets, k, c) for k, c in enumerate(rig.controls)}
        regions = list(dict.fromkeys(c.region for c in rig.controls))
        narrow = widgets.Layout(width="300px")
        self.region = widgets.Dropdown(options=regions, description="region", layout=narrow)
        self.expression = widgets.Dropdown(options=list(self._presets), description="expression", layout=narrow)
        self.camera = widgets.Dropdown(options=VIEWS, description="camera", layout=narrow)
        self.wrinkles = widgets.Checkbox(value=True, description="wrinkles", disabled=not rig.nodes)
        self.reset = widgets.Button(description="reset")
        self._image = widgets.Image(format="png", width=width, height=height)
        self._words = widgets.Label()
        self._box = widgets.VBox(
            layout=widgets.Layout(max_height=f"{height - 150}px", overflow="auto", display="block")
        )
        self.region.observe(lambda change: self._list(), "value")
        self.expression.observe(lambda change: None if self._held else self.show(change["new"]), "value")
        self.camera.observe(lambda change: self.draw(), "value")
        self.wrinkles.observe(lambda change: self.draw(), "value")
        self.reset.on_click(lambda button: self.show("neutral"))
        choices = [self.expression, self.region, self.camera, widgets.HBox([self.wrinkles, self.reset])]
        self.widget = widgets.HBox([widgets.VBox([self._image, self._words]), widgets.VBox([*choices, self._box])])
        self._list()
        self.draw()

    def _slider(self, widgets, column: int, control):
        slider = widgets.FloatSlider(
            value=control.default,
            min=control.lower,
            max=control.upper,
            step=(control.upper - control.lower) / 100,
            description=control.name,
            style={"description_width": "170px"},
            layout=widgets.Layout(width="400px"),
        )
        slider.observe(lambda change: self._move(column, change["new"]), "value")
        return slider

    def _move(self, column: int, value: float) -> None:
        self.params[column] = value
        if not self._held:
            self.draw()

    def _list(self) -> None:
        self._box.children = [self.sliders[c.name] for c in self.rig.controls if c.region == self.region.value]

    def show(self, expression: str) -> None:
        """Set all sliders to an expression, "neutral" for none, and list those of the region that it moves most.

        Raises InputError for an unknown expression.
        """
        if expression not in self._presets:
            choices = ", ".join(self._presets)
            raise InputError(f"rig '{self.rig.name}': there is no expression '{expression}'; there are {choices}.")
        self._held = True
        try:
            self.expression.value = expression
            for slider, value in zip(self.sliders.values(), self._presets[expression], strict=True):
                slider.value = float(value)
            self.params[:] = self._presets[expression]
            self.region.value = self._most_moved_region()
        finally:
            self._held = False
        self.draw()

    def _most_moved_region(self) -> str:
        """Return the region whose controls leave their defaults most, relative to their ranges; at rest the current."""
        controls = self.rig.controls
        moved = dict.fromkeys([self.region.value, *(control.region for control in controls)], 0.0)
        for control, value in zip(controls, self.params, strict=True):
            moved[control.region] += abs(float(value) - control.default) / (control.upper - control.lower)
        return max(moved, key=moved.__getitem__)

    def draw(self) -> None:
        """Draw the pose as it is now."""
        if self._held:
            return
        camera = camera_for(self.camera.value, self.rig.mesh.neutral)
        start = time.perf_counter()
        surfaces = character_surfaces(self.rig, self.params, camera)
        if not self.wrinkles.value:
            smooth = self.rig.run_nodes(self.params[None], skip=("wrinkles",))[0]
            surfaces[0] = replace(surfaces[0], vertices=smooth)
        rig_end = time.perf_counter()
        self.picture = self._view.draw(surfaces, camera)
        drawing_end = time.perf_counter()
        self._image.value = _png(self.picture)
        end = time.perf_counter()
        parts = {"rig": rig_end - start, "drawing": drawing_end - rig_end, "PNG": end - drawing_end, "all": end - start}
        self.times_ms = {name: 1e3 * seconds for name, seconds in parts.items()}
        self._words.value = "  ".join(f"{name} {ms:.0f} ms" for name, ms in self.times_ms.items())


def control_panel(rig: Rig, width: int = 400, height: int = 440, opengl: bool | None = None) -> ControlPanel:
    """Return a panel for any rig; wrinkles can be switched off on those built from recipes."""
    return ControlPanel(rig, width, height, opengl)


def still(panel: ControlPanel) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a panel's picture, and its region's sliders as bars; if many, those that moved most."""
    from matplotlib.figure import Figure

    height, width = panel.picture.shape[:2]
    figure = Figure(((width + BARS) / DPI, height / DPI), dpi=DPI, facecolor="white")
    share = width / (width + BARS)
    picture = figure.add_axes((0, 0, share, 1))
    picture.imshow(panel.picture, interpolation="none", aspect="auto")
    picture.set_axis_off()
    columns = [k for k, c in enumerate(panel.rig.controls) if c.region == panel.region.value]
    moved = abs(panel.params - panel.rig.default)
    bars = sorted(sorted(columns, key=lambda k: -moved[k])[:SHOWN_BARS])  # those that moved most, in the rig's order
    axes = figure.add_axes((share + 150 / (width + BARS), 0.06, 250 / (width + BARS), 0.84))
    names = [panel.rig.controls[k].name for k in bars]
    axes.barh(names, panel.params[bars], color="#0072B2", height=0.55)
    axes.set_xlim(-1, 1)
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.tick_params(labelsize=7, length=2)
    axes.axvline(0, color="black", linewidth=0.6)
    axes.spines[["top", "right", "left"]].set_visible(False)
    fold = "on" if panel.wrinkles.value else "off"
    region, expression = panel.region.value, panel.expression.value
    axes.set_title(f"expression: {expression}   region: {region}   wrinkles: {fold}", fontsize=8, x=0.2)
    controls = f"{len(columns)} controls" if len(bars) == len(columns) else f"{len(bars)} of {len(columns)} controls"
    return figure, Words(
        f"The character {panel.rig.name}, {expression}, beside {controls} of the region {region} as bars.",
        f"The panel as it opens, without a kernel: {panel.rig.name}, {expression}; {controls} of the region {region}.",
    )


def _png(picture: UInt8[np.ndarray, "h w 3"]) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


# A view that stays open: the graphics gets the meshes once, and a new pose only moves their points.


class LiveView:
    """Draws the same surfaces many times, with other vertices and from other cameras."""

    def __init__(
        self,
        width: int,
        height: int,
        background: tuple[int, int, int] = WHITE,
        opengl: bool | None = None,
    ):
        self.look = width, height, background
        self.opengl = opengl_works() if opengl is None else opengl
        self._plotter, self._meshes, self._camera = None, [], None

    def draw(self, surfaces: Sequence[Surface], camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
        """Return the picture. The meshes are set up again where their count, their sizes or the camera have changed."""
        if not self.opengl:
            return trace(surfaces, camera, *self.look, quick(PORTRAIT))
        if self._plotter is None or camera != self._camera or not self._fits(surfaces):
            self.close()
            self._plotter, self._meshes = plotter_of(surfaces, camera, *self.look)
            self._plotter.render_window.SetMultiSamples(0)  # eight samples a pixel take three times as long
            self._camera = camera
        for mesh, surface in zip(self._meshes, surfaces, strict=True):
            mesh.points = np.asarray(surface.vertices, np.float32)
            if surface.lit:
                mesh.point_data["Normals"] = fast_vertex_normals(np.asarray(mesh.points), surface.faces)
        self._plotter.renderer.ResetCameraClippingRange()
        self._plotter.render()  # a screenshot alone would show the points as they were
        return np.array(self._plotter.screenshot(return_img=True))[..., :3]

    def close(self) -> None:
        """Free the graphics' memory."""
        if self._plotter is not None:
            self._plotter.close()
            self._plotter = None

    def _fits(self, surfaces: Sequence[Surface]) -> bool:
        counts = [(mesh.n_points, mesh.n_cells) for mesh in self._meshes]
        return counts == [(len(surface.vertices), len(surface.faces)) for surface in surfaces]
