"""One test pose as every method predicts it: by a rule, and stored so small that it can be committed.

Figures and notebooks read this file, so they need neither a cache nor a trained network.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from replicate.drawing.colours import colour_in_bytes
from replicate.engine.atomic_files import replacing
from replicate.engine.exceptions import InputError

TRUTH = "truth"


@dataclass(frozen=True)
class PoseRecord:
    """A test pose of one character.

    pose: its index among the test poses. neutral: (n, 3) mm; faces: (f, 3). vertices: "truth" and each method's label →
    (n, 3) float32 mm. props: (name, vertices (k, 3), faces (g, 3), colour), for display only; the colour is (k, 3)
    uint8, one for each vertex, as `rig.pose_props` gives it, or one RGB, which is brought to 0–255.
    """

    character: str
    pose: int
    neutral: np.ndarray
    faces: np.ndarray
    vertices: dict[str, np.ndarray]
    props: tuple[tuple[str, np.ndarray, np.ndarray, np.ndarray | tuple[float, float, float]], ...] = ()

    def __post_init__(self) -> None:
        props = tuple(
            (name, vertices, faces, colour if np.ndim(colour) == 2 else colour_in_bytes(colour))
            for name, vertices, faces, colour in self.props
        )
        object.__setattr__(self, "props", props)


def save_pose(path: Path, record: PoseRecord) -> None:
    """Write a record as npz: offsets as int16 with a step of a 65,534th of their range (about a micrometre)."""
    facts = {"character": record.character, "pose": record.pose, "labels": list(record.vertices), "props": []}
    arrays = {"neutral": record.neutral.astype(np.float32), "faces": record.faces.astype(np.int32)}
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
            neutral, faces = stored["neutral"], stored["faces"]
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
    return PoseRecord(facts["character"], facts["pose"], neutral, faces, vertices, props)
