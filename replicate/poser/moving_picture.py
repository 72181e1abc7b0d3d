"""A moving picture for the front page: a face is dragged into wrinkled expressions, as the rig and two methods have it.

`python -m replicate.poser.moving_picture` writes results/reference/moving_teen.webp and its words, by the models that
come with the repository, or by your own of the same profile.
"""

import json
import sys
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float32, UInt8

from replicate.approximation.metrics import normal_error
from replicate.base import paths
from replicate.base.command_line import guard
from replicate.config import resolve
from replicate.drawing.characters import BACKGROUND, character_surfaces
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import middle_line, normal_heat, split_face
from replicate.drawing.light import PORTRAIT
from replicate.drawing.marks import balls_in_front
from replicate.drawing.panels import as_picture
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.engine.device import choose_device
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.inverse import ik_stage
from replicate.methods import coarse, regional
from replicate.methods.method import Method
from replicate.methods.trained import plan_for
from replicate.poser.contents import PosedFace
from replicate.poser.face_page import posed_vertices
from replicate.poser.notebook import THROUGH, read_face, stages_of_face

CHARACTER, PROFILE, METHODS = "teen", "laptop", (coarse.METHOD, regional.METHOD)
RATE, WIDTH, TALL = 12, 900, 1.2  # frames a second, pixels, a picture's height over its width
LIMIT_DEG = 20.0  # upper end of the errors' colours
QUALITY = 72  # of WebP
# When which control points are where: seconds, and mm from their places at rest, outwards and up.
SCRIPT: tuple[tuple[float, Mapping[str, tuple[float, float]]], ...] = (
    (0.4, {}),
    (1.3, {"brow_*_01": (0, 21), "brow_*_03": (0, 13)}),
    (2.3, {"brow_*_01": (0, 21), "brow_*_03": (0, 13)}),
    (3.2, {"brow_*_01": (-6, -9), "brow_*_03": (0, -4), "mouth_corner_*": (3, -6)}),
    (4.2, {"brow_*_01": (-6, -9), "brow_*_03": (0, -4), "mouth_corner_*": (3, -6)}),
    (5.1, {"mouth_corner_*": (9, 9), "brow_*_03": (0, 5)}),
    (6.2, {"mouth_corner_*": (9, 9), "brow_*_03": (0, 5)}),
    (7.0, {}),
)


def drags(names: tuple[str, ...], rest: Float32[np.ndarray, "c 3"]) -> Iterator[Float32[np.ndarray, "c 3"]]:
    """Yield where the control points are wanted in each frame. rest: their places in the neutral pose, mm."""
    times = [0.0, *(time for time, _ in SCRIPT)]
    places = [rest, *(_moved(names, rest, moves) for _, moves in SCRIPT)]
    for time in np.arange(round(times[-1] * RATE)) / RATE:
        k = np.searchsorted(times, time, side="right") - 1
        share = (time - times[k]) / (times[k + 1] - times[k])
        yield places[k] + np.float32(share * share * (3 - 2 * share)) * (places[k + 1] - places[k])


def _moved(names: tuple[str, ...], rest: np.ndarray, moves: Mapping[str, tuple[float, float]]) -> np.ndarray:
    places = np.array(rest, np.float32)
    for pattern, (outwards, up) in moves.items():
        for side in ("left", "right"):
            k = names.index(pattern.replace("*", side))
            places[k, :2] += np.float32([outwards * np.sign(rest[k, 0]), up])
    return places


def frame(
    faces: Mapping[Method, PosedFace], targets: Float32[np.ndarray, "c 3"], camera: Camera
) -> UInt8[np.ndarray, "h w 3"]:
    """Return one frame: the rig's face, then each method's, half of it its surface, half its normal errors.

    targets: where the control points are wanted, mm
    """
    face = next(iter(faces.values()))
    rig, mesh = face.rig, face.rig.mesh
    params = np.clip(face.ik.solve(targets[None])[0], rig.lower, rig.upper).astype(np.float32)
    truth, props = rig(params), tuple(rig.pose_props(params))
    width = cell_width(1 + len(faces), width=WIDTH)
    height = round(TALL * width)
    dragged = np.abs(targets - mesh.neutral[rig.control_points]).max(1) > 0.1
    points = [balls_in_front(targets[dragged], truth)] if dragged.any() else []

    def draw(vertices: np.ndarray) -> np.ndarray:
        surface = Surface(vertices, mesh.faces, paint=rig.paint)
        others = prop_surfaces(carry_props(props, truth, vertices), camera)
        return render([surface, *others, *points], camera, width, height, BACKGROUND, PORTRAIT)

    cells = [Cell("the rig", (draw(truth),), ("",))]
    for method, posed in faces.items():
        vertices = posed_vertices(posed, params[None])[0]
        heat = [normal_heat(vertices, truth, mesh.faces, LIMIT_DEG)]
        half = render(heat, camera, width, height, BACKGROUND)
        line = middle_line(mesh.neutral, vertices, mesh.faces, camera, width, height)
        error = f"{np.nanmean(normal_error(vertices, truth, mesh.faces)):.2f}°"
        cells.append(Cell(method.label, (split_face(draw(vertices), half, line),), (error,)))
    return as_picture(face_sheet(cells, len(cells), width=WIDTH, first_bold=True))


def faces_of(character: str) -> dict[Method, PosedFace]:
    """Return the CNN and our method on a character, posed by the IK networks that are trained through our method."""
    config = resolve(character, PROFILE, device=choose_device("auto"))
    networks = [*(method.name for method in METHODS), ik_stage.stage_name(THROUGH.name)]
    plan = plan_for(config, METHODS, [*networks, "rigid", "influence"])
    stages = stages_of_face(plan, METHODS)
    folders = run(stages, facts=provenance(["python", *sys.orig_argv[1:]], PROFILE, [0], core_count()))
    inputs = {stage.name: folders[stage.title] for stage in stages}
    return {method: read_face(inputs, method.model(inputs), THROUGH.name) for method in METHODS}


def main() -> None:
    """Write the moving picture and its words."""
    from PIL import Image

    faces = faces_of(CHARACTER)
    rig = next(iter(faces.values())).rig
    rest = np.float32(rig.mesh.neutral[rig.control_points])
    view = camera_for("front", rig.mesh.neutral)
    camera = frame_surfaces(view, character_surfaces(rig, rig.default), 1 / TALL, margin=0.09)
    targets = list(drags(tuple(rig.control_point_names), rest))
    first, *others = (Image.fromarray(frame(faces, each, camera)) for each in targets)
    file = paths.REFERENCE / f"moving_{CHARACTER}.webp"
    times = {"duration": round(1000 / RATE), "loop": 0}
    first.save(file, save_all=True, append_images=others, quality=QUALITY, method=6, **times)
    seconds = len(targets) / RATE
    words = {
        "alt": f"{seconds:.0f} seconds of the {CHARACTER}: brows and mouth are dragged into expressions with wrinkles; "
        "the rig, the paper's CNN and our method, half of each a heatmap of its errors.",
        "caption": f"The {CHARACTER}, posed by dragging the red points (inverse kinematics, §4): the rig, the paper's "
        f"coarse CNN and our method. Left halves: surfaces. Right halves: normal errors from 0° (dark) to "
        f"{LIMIT_DEG:g}° (yellow), their mean below.",
    }
    file.with_suffix(".json").write_text(json.dumps(words, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"written to {paths.display_path(file)} ({file.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    sys.exit(guard(main))
