"""Characters with artefacts of made-up numbers, to be published."""

from dataclasses import replace

import numpy as np
from sample_rows import CURVE, table2_rows
from toy_stages import ToyConfig

from replicate.config import resolve
from replicate.engine import store
from replicate.engine.stage import Stage
from replicate.report.pose_record import CHOICES, PoseRecord, pose_file, save_pose
from replicate.report.publication import CharacterResult
from replicate.report.results import write_curves, write_results
from replicate.targets import table2

GIT = {"commit": "c0ffee", "clean": True}


def result(
    character: str,
    seed: int = 0,
    run: str = "r",
    git: dict | None = GIT,
    split: str = "frames",
    error: float | None = None,
    moved: float = 0.0,
    pose: int = 5,
) -> CharacterResult:
    """Return a character whose table's artefact holds made-up numbers.

    error: the coarse networks' mean one, mm. moved: how far the dense networks' vertices are off in the poses, mm.
    pose: the index of those.
    """

    def build(out, scratch):
        rows = [replace(row, run=run) for row in table2_rows((character,))]
        if error is not None:
            coarse = ("coarse", "vertex_error_mean")
            rows = [replace(row, value=error) if row.key[2:] == coarse else row for row in rows]
        write_results(out / "table2.csv", rows)
        write_curves(out / "table2_curves.csv", {(character, "dense"): CURVE})
        flat, faces = np.eye(3, dtype=np.float32), np.int32([[0, 1, 2]])
        for choice in CHOICES:
            vertices = {"truth": flat, "dense": flat + np.float32(moved)}
            record = PoseRecord(character, pose, flat, faces, vertices, (), choice, "dense")
            save_pose(pose_file(out, character, choice), record)
        return {"key": "k", "wall_s": 1.0, "run": {"git": git, "profile": "quick", "command": "make table2"}}

    stage = Stage("table2", "toy_stages:numbers", ToyConfig(seed), label=f"{character}-{run}")
    store.make(stage.identifier, build)
    return CharacterResult(resolve(character, "quick", {"samples": {"split": split}}, seed=seed), stage)


def publish_numbers(*runs: CharacterResult) -> None:
    table2.publish(runs, draw=False)
