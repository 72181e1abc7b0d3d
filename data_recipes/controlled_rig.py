"""What every rig has whose deformers are not known: limits from its controls, and neither nodes, paint nor props."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, UInt8

from data_recipes.controls import Control
from data_recipes.rig import Prop


class ControlledRig:
    """The part of the Rig contract that follows from the controls (m of them), and empty parts that only we fill."""

    controls: tuple[Control, ...]

    @property
    def lower(self) -> Float32[np.ndarray, " m"]:
        """The controls' lower limits."""
        return np.array([c.lower for c in self.controls], np.float32)

    @property
    def default(self) -> Float32[np.ndarray, " m"]:
        """The controls' defaults: the neutral pose."""
        return np.array([c.default for c in self.controls], np.float32)

    @property
    def upper(self) -> Float32[np.ndarray, " m"]:
        """The controls' upper limits."""
        return np.array([c.upper for c in self.controls], np.float32)

    @property
    def nodes(self) -> tuple:
        """The deformers that can be run one by one: none, unless a rig says so."""
        return ()

    @property
    def paint(self) -> UInt8[np.ndarray, "n 3"] | None:
        """A colour for each vertex: None."""
        return None

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes in the pose (m,): none."""
        return []
