"""The artefacts "performance": a character's own rig performs, and where its landmarks are is known exactly (Fig. 12).

The performance is of the same acting as the characters' animation, from a seed that no animation has.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from replicate.artefacts.plan import Plan
from replicate.capture import landmark_rig
from replicate.engine.stage import Stage, StageContext

NAME, ARRAYS = "performance", "performance.npz"
FRAMES, TALL = 5, 1.2  # frames that are drawn; a picture's height over its width
MARK = 0.007  # the radius of a landmark's mark, as a share of the picture's height


@dataclass(frozen=True)
class Performance:
    """A rig's performance. params: (t, m). landmarks: (t, l, 3) mm. shown: the frames that are drawn, and pictures:
    (f, h, w, 3) uint8 of the rig in them, with its landmarks.
    """

    params: np.ndarray
    landmarks: np.ndarray
    shown: np.ndarray
    pictures: np.ndarray


def stage(plan: Plan) -> Stage:
    """Return the stage in which the plan's character performs."""
    return plan.stage(NAME, make, None, landmark_rig.stage(plan), per_seed=False)


def make(context: StageContext) -> None:
    """Let the character perform, and draw some frames."""
    from data_recipes.catalogue import performance
    from replicate.capture.face_pictures import face_picture, head_camera
    from replicate.capture.landmark_motion import telling_frames
    from replicate.drawing.marker_balls import balls

    rig = landmark_rig.load(context.inputs)
    params = performance(rig)
    landmarks = rig(params)[:, rig.control_points]
    shown = telling_frames(landmarks, FRAMES)
    (height, width), pictures = picture_size(), []
    camera = head_camera(rig, width / height)
    with context.progress(len(shown), "actor") as bar:
        for k in shown:
            marks = balls(landmarks[k], MARK * camera.height_mm)
            pictures.append(face_picture(rig, params[k], camera, width, height, marks=marks))
            bar.update(1)
    arrays = {"params": params, "landmarks": landmarks, "shown": np.array(shown), "pictures": np.stack(pictures)}
    np.savez_compressed(context.out / ARRAYS, **arrays)
    context.note(frames=len(params))


def picture_size() -> tuple[int, int]:
    """Return how high and how wide the pictures are, pixels."""
    from replicate.drawing.face_sheet import cell_width

    width = cell_width(FRAMES)
    return round(TALL * width), width


def load(inputs: Mapping[str, Path], character: str) -> Performance:
    """Return a character's performance, one of several perhaps."""
    with np.load(inputs[f"{NAME}-{character}"] / ARRAYS, allow_pickle=False) as stored:
        return Performance(*(stored[name] for name in ("params", "landmarks", "shown", "pictures")))
