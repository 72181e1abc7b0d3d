"""A character that landmarks drive: rig parameters from the IK networks, and the approximation's mesh (§5.3.2)."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from data_recipes.rig import BATCH, AlteredRig, Prop, Rig, has_function
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.inverse.ik_network import IkModel


def driven_params(ik: IkModel, targets: Float[np.ndarray, "t l 3"], rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return the rig parameters that bring landmarks to their targets, within the controls' limits (D26).

    targets: where the landmarks are wanted, mm, in the order of the networks' points.
    """
    return np.clip(ik.solve(targets), rig.lower, rig.upper).astype(np.float32)


class ApproximatedRig(AlteredRig):
    """A rig whose skin an approximation gives: what is drawn and exported of a captured performance.

    Props, as eyeballs and hair, are not part of the approximation: the rig poses them, and they go with the skin.
    """

    def __init__(self, rig: Rig, predict: Callable[[np.ndarray, np.ndarray], np.ndarray]):
        """rig: the character. predict: (params (b, m), the rig's vertices (b, n, 3)) → vertices (b, n, 3), mm.

        Of a rig without a function it gets the neutral vertices, which no method but an oracle looks at.
        """
        super().__init__(rig)
        self._predict = predict
        self._truth = (
            rig if has_function(rig) else lambda params: np.repeat(rig.mesh.neutral[None], len(params), axis=0)
        )

    def __call__(self, params: Float[np.ndarray, "*b m"]) -> Float32[np.ndarray, "*b n 3"]:
        """Return the vertices (n, 3) or (b, n, 3), mm, of one pose (m,) or a batch (b, m)."""
        every = np.asarray(params, np.float32).reshape(-1, len(self.default))
        parts = [every[first : first + BATCH] for first in range(0, len(every), BATCH)]
        vertices = np.concatenate([np.asarray(self._predict(part, self._truth(part)), np.float32) for part in parts])
        return vertices.reshape(*np.shape(params)[:-1], *vertices.shape[1:])

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes in the pose (m,), moved as the skin is."""
        props = self._rig.pose_props(params)
        return carry_props(props, self._rig(params), self(params)) if props else []


# Pictures of faces in a performance: in clay, with one camera for all frames.

MARGIN = 0.06  # of a picture's height around the head at rest, since it moves


def head_camera(rig: Rig, aspect: float) -> Camera:
    """Return the camera in front of a head that shows all of it. aspect: the picture's width over its height."""
    front = camera_for("front", rig.mesh.neutral)
    shown = [Surface(rig.mesh.neutral, rig.mesh.faces), *prop_surfaces(rig.pose_props(rig.default))]
    return frame_surfaces(front, shown, aspect, MARGIN)


def face_picture(
    face: Rig,
    params: Float[np.ndarray, " m"],
    camera: Camera,
    width: int,
    height: int,
    marks: Surface | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture of a face in a pose.

    face: the rig that is drawn
    params: raw rig parameters
    camera: as of `head_camera`
    width, height: of the picture, pixels
    marks: a surface that is drawn with the face
    """
    surfaces = [Surface(face(params), face.mesh.faces), *prop_surfaces(face.pose_props(params), camera)]
    return render([*surfaces, *([marks] if marks else [])], camera, width, height)
