"""A view that stays open: meshes are handed to the graphics once, and a new pose only moves their points.

For the slider panel, where a picture must come well under a second after a control has moved. It goes without ambient
occlusion and without smoothed edges, unlike figures.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8

from replicate.drawing.render import plotter_of, working_renderer
from replicate.drawing.scene import PORTRAIT, WHITE, Camera, Lighting, Surface
from replicate.drawing.software_rasteriser import rasterise
from replicate.inference.vertex_normals import fast_vertex_normals


class LiveView:
    """Draw the same surfaces again and again, with other vertices and from other cameras."""

    def __init__(
        self,
        width: int,
        height: int,
        background: tuple[int, int, int] = WHITE,
        lighting: Lighting = PORTRAIT,
        renderer: str | None = None,
    ):
        self.look = width, height, background, lighting
        self.renderer = renderer or working_renderer()
        self._plotter, self._meshes, self._camera = None, [], None

    def draw(self, surfaces: Sequence[Surface], camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
        """Return the picture. The meshes are set up anew where their number, their sizes or the camera have changed."""
        if self.renderer == "software":
            return rasterise(surfaces, camera, *self.look)
        if self._plotter is None or camera != self._camera or not self._fits(surfaces):
            self.close()
            self._plotter, self._meshes = plotter_of(surfaces, camera, *self.look)
            self._plotter.render_window.SetMultiSamples(0)  # eight samples a pixel take three times as long
            self._camera = camera
        for mesh, surface in zip(self._meshes, surfaces, strict=True):
            mesh.points = np.asarray(surface.vertices, np.float32)
            if surface.smooth:
                mesh.point_data["Normals"] = fast_vertex_normals(np.asarray(mesh.points), surface.faces)
        self._plotter.renderer.ResetCameraClippingRange()
        self._plotter.render()  # a screenshot alone would show the points as they were
        return np.array(self._plotter.screenshot(return_img=True))[..., :3]

    def close(self) -> None:
        """Give the graphics' memory back."""
        if self._plotter is not None:
            self._plotter.close()
            self._plotter = None

    def _fits(self, surfaces: Sequence[Surface]) -> bool:
        counts = [(mesh.n_points, mesh.n_cells) for mesh in self._meshes]
        return counts == [(len(surface.vertices), len(surface.faces)) for surface in surfaces]
