"""A test pose as every method predicts it: chosen by a rule, and stored so small that it can be committed.

Figures and notebooks read these files, so they need neither a cache nor a trained network.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from replicate.drawing.colours import colour_in_bytes
from replicate.engine.atomic_files import replacing
from replicate.engine.exceptions import InputError
from replicate.geometry.face_regions import NO_REGION
from replicate.methods import typical_poses

TRUTH = "truth"
FOLDED = "folded"
CHOICES = (FOLDED, *typical_poses.CHOICES)


@dataclass(frozen=True)
class PoseRecord:
    """A test pose of one character.

    pose: its index among the test poses. neutral: (n, 3) mm; faces: (f, 3). vertices: "truth" and each method's label →
    (n, 3) float32 mm. props: (name, vertices (k, 3), faces (g, 3), colour), for display only; the colour is (k, 3)
    uint8, one for each vertex, as `rig.pose_props` gives it, or one RGB, which is brought to 0–255.
    choice: the rule that chose the pose, one of `CHOICES`: the forehead folds most, the median or the largest of the
    mean normal errors of one method, `ranked_by`. region_names, region: the regions of the face, top to bottom, and the
    index of each mesh face's (f,), as `face_regions` gives them; without them no mesh face has a region.
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
    """Return where a folder of results keeps the test pose that one of the rules, `CHOICES`, chose."""
    return folder / f"table2_{character}_pose{'' if choice == FOLDED else f'_{choice}'}.npz"


def save_pose(path: Path, record: PoseRecord) -> None:
    """Write a record as npz: offsets as int16 with a step of a 65,534th of their range (about a micrometre)."""
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
    """Read what `save_pose` wrote. Raises InputError, naming the file, for anything else."""
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
        raise InputError(f"{path}: found no pose as `make table2` writes it ({error}).") from None
    vertices = dict(zip(facts["labels"], neutral + offsets, strict=True))
    return PoseRecord(facts["character"], facts["pose"], neutral, faces, vertices, props, *rule, region)
