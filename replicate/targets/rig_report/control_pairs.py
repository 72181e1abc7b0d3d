"""The stage "rig_pairs": how much pairs of controls change what each other does, and the pairs that do it most."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.rig import Rig, has_function
from replicate.artefacts import built_rig, control_influence, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.engine.tidy_files import Column, read_csv, write_csv

if TYPE_CHECKING:
    import pandas

    import replicate.approximation.interaction

FILE = "interaction.npz"
STRONGEST = 10
LENGTHS = ("mixed_mm", "first_mm", "second_mm")
PAIR_COLUMNS = (
    *map(Column, ("first", "second", "segment", "pose")),
    *(Column(name, "finite number") for name in LENGTHS),
)


def stage(plan: Plan) -> Stage:
    """Return the stage that tries pairs of controls."""
    modules = (built_rig, drawn_samples, control_influence, rigid_segments)
    inputs = (module.stage(plan) for module in modules)
    return plan.stage("rig_pairs", make, plan.numbers(plan.config.rig_report.pairs), *inputs)


def make(context: StageContext) -> None:
    """Measure how pairs of controls that move one segment interact, from the default pose and from some test poses.

    A rig that is known by its samples alone can't be tried.
    """
    from replicate.approximation.evaluation import unique_poses
    from replicate.approximation.interaction import acting_steps, draw_pairs, interaction, no_interaction

    section, inputs = context.config.section, context.inputs
    rig, samples, influence = built_rig.load(inputs), drawn_samples.load(inputs), control_influence.load(inputs)
    frames = samples.test_params[unique_poses(samples.test_params)]
    some = context.rng("poses").choice(len(frames), min(section.poses, len(frames)), replace=False)
    if not has_function(rig):
        differences = no_interaction(len(rig.mesh.neutral), len(rig.controls))
        np.savez(context.out / FILE, **{entry.name: getattr(differences, entry.name) for entry in fields(differences)})
        context.note(pairs=0, poses=0)
        return
    segments = rigid_segments.load_coarse_segments(inputs, rig.mesh)
    pairs = draw_pairs([segment.parameters for segment in segments], section.count, context.rng("pairs"))
    poses = np.concatenate([rig.default[None], frames[np.sort(some)]])
    differences = interaction(rig, poses, acting_steps(rig, frames), pairs, influence, context.progress)
    np.savez(context.out / FILE, **{entry.name: getattr(differences, entry.name) for entry in fields(differences)})
    context.note(pairs=len(pairs), poses=len(poses), ratio=differences.ratio())


def load(inputs: Mapping[str, Path]) -> "replicate.approximation.interaction.Interaction":
    """Return the differences of all pairs; the default pose is the first."""
    from replicate.approximation.interaction import Interaction

    with np.load(inputs["rig_pairs"] / FILE, allow_pickle=False) as stored:
        return Interaction(**{entry.name: stored[entry.name] for entry in fields(Interaction)})


def strongest_pairs(rig: Rig, pairs: "replicate.approximation.interaction.Interaction") -> list[tuple]:
    """Return the strongest pairs, a line of `PAIR_COLUMNS` each: controls, where, from which pose, and how far in mm.

    The lengths are the largest of any vertex: of the mixed difference, and of either control alone from that pose.
    """
    if not len(pairs.mixed_mm):
        return []
    row = pairs.mixed_mm.argmax(0)  # (q,), the pose
    largest = pairs.mixed_mm.max(0)
    lines = []
    for k in np.argsort(-largest, kind="stable")[:STRONGEST]:
        pose, (i, j) = row[k], pairs.pairs[k]
        segment = rig.mesh.segment_names[rig.mesh.segment[pairs.place[pose, k]]]
        lengths = (largest[k], pairs.single_mm[pose, i], pairs.single_mm[pose, j])
        names = (rig.controls[i].name, rig.controls[j].name, segment, "animation" if pose else "default")
        lines.append((*names, *map(float, lengths)))
    return lines


def write_pairs(file: Path, lines: list[tuple]) -> None:
    """Write the strongest pairs as CSV."""
    write_csv(file, PAIR_COLUMNS, lines)


def read_pairs(file: Path) -> "pandas.DataFrame":
    """Read what `write_pairs` wrote. Raises InputError, naming the file, for anything else."""
    return read_csv(file, PAIR_COLUMNS, (), "there is no such file; `make rig-report` writes it.")
