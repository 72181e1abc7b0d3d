"""Test poses with every method's prediction, in files that are small enough to be committed.

Figures and notebooks read these files, so they need neither a cache nor a trained network.
"""

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.base.exceptions import InputError
from replicate.base.files import replacing
from replicate.drawing.prop_surfaces import carry_props, colour_in_bytes, prop_surfaces
from replicate.drawing.scene import CLAY, Camera, Surface, above_neck, camera_for, forehead_camera, frame_surfaces
from replicate.geometry.face_regions import NO_REGION
from replicate.methods import typical_poses
from replicate.methods.method_registry import in_order, method_named
from replicate.methods.typical_poses import MEDIAN, WORST

TRUTH = "truth"
FOLDED = "folded"
CHOICES = (FOLDED, *typical_poses.CHOICES)


@dataclass(frozen=True)
class PoseRecord:
    """A test pose of one character.

    character: its name in results
    pose: its index among the test poses
    neutral: the neutral mesh, (n, 3), mm
    faces: its triangles, (f, 3)
    vertices: "truth" and each method's name → (n, 3) float32, mm
    props: (name, vertices (k, 3), faces (g, 3), colour) for display only; the colour is (k, 3) uint8 for the vertices,
        as in `rig.pose_props`, or one RGB, which is converted to 0–255
    choice: the rule that chose the pose, one of `CHOICES`: the forehead folds most, or the mean normal error of the
        method `ranked_by` is the median or the largest
    ranked_by: that method, or ""
    region_names: the regions of the face, top to bottom, from `face_regions`
    region: each mesh face's index into them, (f,); by default no face has a region
    """

    character: str
    pose: int
    neutral: np.ndarray
    faces: np.ndarray
    vertices: dict[str, np.ndarray]
    props: tuple[tuple[str, np.ndarray, np.ndarray, np.ndarray | tuple[float, float, float]], ...] = ()
    choice: str = FOLDED
    ranked_by: str = ""
    region_names: tuple[str, ...] = ()
    region: np.ndarray | None = None

    def __post_init__(self) -> None:
        props = tuple(
            (name, vertices, faces, colour if np.ndim(colour) == 2 else colour_in_bytes(colour))
            for name, vertices, faces, colour in self.props
        )
        object.__setattr__(self, "props", props)
        if self.region is None:
            object.__setattr__(self, "region", np.full(len(self.faces), NO_REGION, np.int8))


def pose_file(folder: Path, character: str, choice: str = FOLDED) -> Path:
    """Return the file in a folder of results for the test pose that a rule of `CHOICES` chose."""
    return folder / f"table2_{character}_pose{'' if choice == FOLDED else f'_{choice}'}.npz"


def save_pose(path: Path, record: PoseRecord) -> None:
    """Write a record as npz. Offsets are int16 in steps of a 65,534th of their range, about a micrometre."""
    facts = {"character": record.character, "pose": record.pose, "labels": list(record.vertices), "props": []}
    facts |= {"choice": record.choice, "ranked_by": record.ranked_by, "regions": list(record.region_names)}
    arrays = {"neutral": record.neutral.astype(np.float32), "faces": record.faces.astype(np.int32)}
    arrays["region"] = record.region.astype(np.int8)
    offsets = np.stack([vertices - record.neutral for vertices in record.vertices.values()])
    step = float(max(np.abs(offsets).max(), 1e-6)) / 32767
    arrays["offsets"], facts["step_mm"] = np.rint(offsets / step).astype(np.int16), step
    for k, (name, vertices, faces, colour) in enumerate(record.props):
        arrays[f"prop_{k}_vertices"], arrays[f"prop_{k}_faces"] = np.float32(vertices), np.int32(faces)
        has_paint = np.ndim(colour) == 2
        if has_paint:
            arrays[f"prop_{k}_colours"] = np.asarray(colour, np.uint8)
        facts["props"].append([name, None if has_paint else list(colour)])
    arrays["facts"] = np.frombuffer(json.dumps(facts, sort_keys=True).encode(), np.uint8)
    with replacing(path) as new:
        np.savez_compressed(new, **arrays)


def load_pose(path: Path) -> PoseRecord:
    """Read a file of `save_pose`. Raises InputError, naming the file, for anything else."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            facts = json.loads(bytes(stored["facts"]))
            neutral, faces, region = stored["neutral"], stored["faces"], stored["region"]
            rule = facts["choice"], facts["ranked_by"], tuple(facts["regions"])
            offsets = stored["offsets"].astype(np.float32) * np.float32(facts["step_mm"])
            props = tuple(
                (
                    name,
                    stored[f"prop_{k}_vertices"],
                    stored[f"prop_{k}_faces"],
                    stored[f"prop_{k}_colours"] if colour is None else tuple(colour),
                )
                for k, (name, colour) in enumerate(facts["props"])
            )
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such pose; `make table2` makes it.") from None
    except (ValueError, KeyError, OSError, EOFError, BadZipFile) as error:
        raise InputError(f"{path}: expected a pose as `make table2` writes it ({error}).") from None
    vertices = dict(zip(facts["labels"], neutral + offsets, strict=True))
    return PoseRecord(facts["character"], facts["pose"], neutral, faces, vertices, props, *rule, region)


# A method's errors in one pose: over the whole mesh, and in each region of the face.

WHOLE = "whole mesh"  # the name of the mean over the whole mesh beside those of regions
FOREHEAD = "forehead"


def normal_means_deg(record: PoseRecord, method: str) -> dict[str, float]:
    """Return the mean normal error (Eq. 11) of a method in degrees, over the whole mesh and over each region.

    It is NaN for a region whose mesh faces have no normals.
    """
    errors = normal_error(record.vertices[method], record.vertices[TRUTH], record.faces)
    means = {WHOLE: float(np.nanmean(errors))}
    for k, name in enumerate(record.region_names):
        inside = errors[record.region == k]
        means[name] = float(np.nanmean(inside)) if np.isfinite(inside).any() else float("nan")
    return means


def close_up_region(record: PoseRecord) -> str:
    """Return whose mean error a close-up of the forehead shows: the whole mesh's where no region is the forehead."""
    return FOREHEAD if FOREHEAD in record.region_names else WHOLE


def vertex_mean_mm(record: PoseRecord, method: str) -> float:
    """Return the mean distance of a method's vertices from the true ones, in mm."""
    return float(vertex_error(record.vertices[method], record.vertices[TRUTH]).mean())


# Names in figures: a method's title, or the ground truth; and the rule that chose a pose.


def panel_title(method: str) -> str:
    """Return a method's title with the mark of its note, or the truth's title."""
    return "Ground truth" if method == TRUTH else method_named(method).title


def plain_name(method: str) -> str:
    """Return `panel_title` without the mark."""
    return "Ground truth" if method == TRUTH else method_named(method).label


def marks_in_words(methods: Iterable[str]) -> str:
    """Return the notes of the marks in some methods' titles, each once, as sentences."""
    notes = [method_named(name) for name in in_order(set(methods) - {TRUTH})]
    return " ".join(dict.fromkeys(f"{method.mark} {method.note}" for method in notes if method.mark))


def pose_in_words(record: PoseRecord) -> str:
    """Return a record's test pose, its character, and the rule that chose it, in words."""
    rules = {
        FOLDED: "the one whose forehead folds most",
        MEDIAN: f"the median of the mean normal errors of “{plain_name(record.ranked_by)}”",
        WORST: f"the one with the largest mean normal error of “{plain_name(record.ranked_by)}”",
    }
    return f"test pose {record.pose} of {record.character}, {rules[record.choice]}"


# A method's prediction as surfaces in clay, the skin with brows and eyeballs, and cameras to draw them with.


SKIN_FROM = 120  # brows and hair grow on patches of skin, whose green is at least so bright


def clay_surfaces(record: PoseRecord, method: str, hair: bool = True) -> list[Surface]:
    """Return the surfaces of a pose as one of the record's methods predicts it.

    hair: False leaves out hair and glasses, which hide wrinkles.
    """
    vertices = record.vertices[method]
    shown = [prop for prop in record.props if hair or not is_before_forehead(prop[0])]
    props = carry_props(shown, record.vertices[TRUTH], vertices)
    return [Surface(vertices, record.faces), *prop_surfaces(map(_on_clay, props))]


def is_before_forehead(name: str) -> bool:
    """Return whether a prop of this name, hair or glasses, may hide wrinkles."""
    return name.startswith(("hair", "glasses"))


def _on_clay(prop: tuple) -> tuple:
    """Return a prop whose skin is clay."""
    name, vertices, faces, colour = prop
    if np.ndim(colour) == 2 and name.startswith(("brow", "hair")):
        colour = np.where(colour[:, 1:2] >= SKIN_FROM, np.uint8(CLAY), colour)
    return name, vertices, faces, colour


def view_of(record: PoseRecord, camera: str, aspect: float) -> Camera:
    """Return a named camera for the panels of a pose. aspect: a panel's width over its height.

    From the front the head without its neck fills the panel, wherever the pose has moved it; the forehead's camera
    follows the forehead. Other views are fixed.
    """
    if camera == "forehead":
        return forehead_camera(record.neutral, record.faces, record.vertices[TRUTH])
    view = camera_for(camera, record.neutral)
    if camera != "front":
        return view
    mesh, *props = clay_surfaces(record, TRUTH)
    head = replace(mesh, vertices=mesh.vertices[above_neck(record.neutral)])
    return frame_surfaces(view, [head, *props], aspect)


def with_layout(character: str, segment_names: Sequence[str]) -> str:
    """Return a character's name with the number of charts that its face lies in: "teen (face in 4 charts)".

    segment_names: those of its mesh; charts of the face are called face, or face_1, face_2 … (D21). Without such charts
    the name stands alone.
    """
    charts = sum(bool(re.fullmatch(r"face(_\d+)?", name)) for name in segment_names)
    layout = {0: "", 1: " (face in one chart)"}.get(charts, f" (face in {charts} charts)")
    return character + layout


# The methods that figures show after the truth, in order. Where a record has what is used today, the nearest of these
# to the truth stands behind ours.

FIGURE01 = ("refined", "regional", "lbs32")
FIGURE09 = ("refined", "coarse", "dense", "regional", "linear", "lbs32", "floor_refined")
FIGURE10 = ("refined", "regional", "linear", "lbs32", "dense")  # and methods from outside before them
LINE = "linear"  # the simplest fit
PEERS = ("morph", "morph_best", "differential", "differential_small", "compskin", "compskin_best")


def best_peer(record: PoseRecord) -> str | None:
    """Return the one of `PEERS` that a record has and whose normal error over the whole mesh is the smallest."""
    there = [name for name in PEERS if name in record.vertices]
    return min(there, key=lambda name: normal_means_deg(record, name)[WHOLE], default=None)


def peer_in_words(record: PoseRecord) -> str:
    """Return the sentence of a caption on the best peer, with a space in front; "" without one."""
    peer = best_peer(record)
    return f" Of what is used today “{plain_name(peer)}” has the nearest normals in this pose." if peer else ""


def shown_in(record: PoseRecord, methods: Sequence[str]) -> list[str]:
    """Return those of a figure's methods that a record has, with the best peer behind our method or at the end.

    Beside a peer there is no place for the straight line: `line_in_words` has its number.
    """
    shown = [name for name in methods if name in record.vertices]
    if peer := best_peer(record):
        shown = [name for name in shown if name != LINE]
        shown.insert(shown.index("regional") + 1 if "regional" in shown else len(shown), peer)
    return shown


def line_in_words(record: PoseRecord, shown: Sequence[str], region: str = WHOLE) -> str:
    """Return a caption's sentence on the straight line's normal error, with a space in front; "" if it is shown."""
    if LINE not in record.vertices or LINE in shown:
        return ""
    return f" The straight line, which isn't shown, has {normal_means_deg(record, LINE)[region]:.2f}°."
