"""The artefacts that all methods share: rig, samples, influence, rigid segments, squares for refinement, shown pose."""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from data_recipes.recipe_paths import sample_folder
from data_recipes.rig import Rig, rigid_names
from replicate.base.files import write_text
from replicate.config import resolve
from replicate.engine.provenance import as_lines, core_count, package_versions, provenance
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.approximation.rigid
    import replicate.approximation.samples
    import replicate.approximation.segments


RIGID_NAMES = "rigid.json"


@dataclass(frozen=True)
class Character:
    """Which rig to build: a recipe, or the settings of a folder of samples, without its path."""

    recipe: object


def rig_stage(plan: Plan) -> Stage:
    """Return the stage that builds the plan's character. Raises InputError for a bad recipe."""
    from data_recipes.catalogue import character_parts, sampled_parts  # slow; posing a face needs none of it

    if "rig" in plan:
        return plan["rig"]
    if folder := sample_folder(plan.config.character):
        settings, files = sampled_parts(folder)
        return plan.stage("rig", make_sampled_rig, Character(settings), files=files, per_seed=False)
    recipe, files = character_parts(plan.config.character)
    return plan.stage("rig", make_rig, Character(recipe), files=files, per_seed=False)


def make_rig(context: StageContext) -> None:
    """Build a character's rig, and write it with its mesh."""
    from data_recipes.catalogue import build_from_parts, save_rig

    rig = build_from_parts(context.config.recipe, context.files)
    save_rig(rig, context.out / "rig")
    _save_parts(rig, context.out)
    context.note(vertices=len(rig.mesh.neutral), faces=len(rig.mesh.faces), parameters=len(rig.controls))


def make_sampled_rig(context: StageContext) -> None:
    """Read a rig that is known only by its samples, and write it with its mesh."""
    from data_recipes.catalogue import import_sampled

    rig = import_sampled(context.config.recipe, context.files, context.out / "rig", context.progress)
    _save_parts(rig, context.out)
    sizes = {"vertices": len(rig.mesh.neutral), "faces": len(rig.mesh.faces), "parameters": len(rig.controls)}
    context.note(**sizes, poses=len(rig.known_poses), source=rig.source, licence=rig.licence)


def _save_parts(rig: Rig, folder: Path) -> None:
    """Write what stages need without the rig: its mesh, and which segments it names as rigid."""
    rig.mesh.save(folder / "mesh.npz")
    write_text(folder / RIGID_NAMES, json.dumps(rigid_names(rig)) + "\n")


def load_rig(inputs: Mapping[str, Path]) -> Rig:
    """Return the rig, from the artefact "rig" among the inputs."""
    from data_recipes.catalogue import load_rig

    return load_rig(inputs["rig"] / "rig")


def load_mesh(inputs: Mapping[str, Path]) -> Mesh:
    """Return the rig's mesh, without the rig."""
    return Mesh.load(inputs["rig"] / "mesh.npz")


def rig_of(character: str) -> Rig:
    """Return a character's rig outside of any graph; it is built unless the cache has it.

    Raises InputError for an unknown character or a bad recipe.
    """
    from replicate.engine import scheduler, store

    stage = rig_stage(Plan(resolve(character)))
    folder = store.load(stage.identifier)
    if folder is None:  # a notebook whose rig is there shall not begin with "nothing to do"
        facts = provenance(["python", *sys.orig_argv[1:]], "any", [], core_count())
        folder = scheduler.run([stage], facts=facts)[stage.title]
    return load_rig({"rig": folder})


def rig_identifier(character: str) -> str:
    """Return the name of a rig's artefact, which ends with a hash of its recipe and of all sources behind it."""
    return rig_stage(Plan(resolve(character))).identifier


def rig_provenance_text(character: str) -> str:
    """Return a rig's name, artefact and packages, in a few lines."""
    packages = package_versions()
    return as_lines(
        {
            "rig": character,
            "artefact": rig_identifier(character),
            "packages": ", ".join(f"{name} {packages[name]}" for name in ("jax", "jaxlib", "numpy", "scipy")),
        }
    )


# The artefact "samples": training, validation and test poses with the rig's vertices at them (§3.5, §5.1).


def samples_stage(plan: Plan) -> Stage:
    """Return the stage that draws the poses and evaluates the rig at them."""
    return plan.stage("samples", make_samples, plan.settings(plan.config.samples), rig_stage(plan))


def make_samples(context: StageContext) -> None:
    """Draw the poses and evaluate the rig at them (§3.5)."""
    from replicate.approximation.samples import write_samples

    section, rig = context.config.section, load_rig(context.inputs)
    facts = write_samples(rig, section, context.out, context.rng, context.scratch, context.progress)
    context.note(**facts)


def load_samples(inputs: Mapping[str, Path]) -> "replicate.approximation.samples.SampleSet":
    """Return the samples, memory-mapped."""
    from replicate.approximation.samples import SampleSet

    return SampleSet.open(inputs["samples"])


# The artefact "influence": which control can move which vertex, which decides what each network sees (§3.1).

INFLUENCE = "influence.npy"


def influence_stage(plan: Plan) -> Stage:
    """Return the stage that tries every control, at poses that it draws.

    If the rig is known only by its samples, their folder states the influence, or it is estimated from them.
    """
    if sample_folder(plan.config.character):
        inputs = (rig_stage(plan), samples_stage(plan))
        return plan.stage("influence", estimate, plan.settings(None), *inputs)
    return plan.stage("influence", make_influence, plan.settings(plan.config.samples), rig_stage(plan))


def make_influence(context: StageContext) -> None:
    """Try every control at several poses (§3.1)."""
    from replicate.approximation.influence import influence, influence_poses
    from replicate.approximation.samples import choose_poses

    rig = load_rig(context.inputs)
    training = choose_poses(rig, context.config.section, context.rng)["training"]
    poses = influence_poses(rig, training, context.rng("poses"))
    moves = influence(rig, poses, progress=context.progress)
    np.save(context.out / INFLUENCE, moves)
    context.note(poses=len(poses), idle_controls=[rig.controls[k].name for k in np.flatnonzero(~moves.any(0))])


def estimate(context: StageContext) -> None:
    """Take the influence that the samples' folder states, or estimate it from the training poses (DEVIATIONS D7)."""
    from replicate.approximation.influence import estimate_influence

    rig, samples = load_rig(context.inputs), load_samples(context.inputs)
    stated = getattr(rig, "moves", None)
    moves = stated
    if moves is None:
        moves = estimate_influence(samples, rig.default, context.rng("shadows"), context.progress)
    np.save(context.out / INFLUENCE, moves)
    context.note(stated=stated is not None, idle_controls=[rig.controls[k].name for k in np.flatnonzero(~moves.any(0))])


def load_influence(inputs: Mapping[str, Path]) -> Bool[np.ndarray, "n m"]:
    """Return which control (m) moves which vertex (n)."""
    return np.load(inputs["influence"] / INFLUENCE, allow_pickle=False)


# The artefact "rigid": the segments that move rigidly, and the vertices that carry them (§3.4).

ATTACHMENTS = "attachments.npz"


def rigid_stage(plan: Plan) -> Stage:
    """Return the stage that finds rigid segments and the vertices that carry them."""
    inputs = (rig_stage(plan), samples_stage(plan))
    return plan.stage("rigid", find_rigid, plan.settings(plan.config.rigid), *inputs)


def find_rigid(context: StageContext) -> None:
    """Find rigid segments, and the vertices that carry them, from all training poses (Eq. 3 and 4).

    A segment that its vertices would misplace, in training or validation poses, is left to the networks, unless the rig
    names it as rigid. The notes say which, and by how much; so does `make check`, and a line before training.
    """
    from replicate.approximation.rigid import find_attachments, placement_errors, without
    from replicate.approximation.samples import PosedSamples

    mesh, samples, section = load_mesh(context.inputs), load_samples(context.inputs), context.config.section
    names = context.inputs["rig"] / RIGID_NAMES
    named = json.loads(names.read_text(encoding="utf-8")) if names.is_file() else ()
    known = [mesh.segment_names.index(name) for name in named]
    training, validation = PosedSamples(mesh.neutral, samples), mesh.neutral + samples.validation_offsets
    found = find_attachments(mesh, training, section.tau_mm, section.attachments, known)
    errors = np.max([placement_errors(mesh, found, poses) for poses in (training, validation)], axis=0)
    misplaced = {int(k): float(error) for k, error in zip(found.segment, errors, strict=True) if error > section.tau_mm}
    kept = without(found, misplaced.keys() - set(known))
    kept.save(context.out / ATTACHMENTS)
    by_name = {mesh.segment_names[k]: round(error, 4) for k, error in misplaced.items()}
    context.note(rigid_segments=[mesh.segment_names[k] for k in kept.segment], misplaced_mm=by_name)


def waves_stage(plan: Plan) -> Stage:
    """Return the stage that finds the slowest waves of the parts that deform, by which errors are taken apart."""
    return plan.stage("waves", find_waves, None, rig_stage(plan), rigid_stage(plan))


def find_waves(context: StageContext) -> None:
    """Find the slowest waves of the mesh without its rigid segments."""
    from replicate.approximation.spectrum import FILE, slow_waves

    mesh = load_mesh(context.inputs)
    deforming = ~np.isin(mesh.segment, load_attachments(context.inputs).segment)
    waves = slow_waves(mesh, deforming)
    waves.save(context.out / FILE)
    context.note(waves=len(waves.frequencies), shortest_mm=float(2 * np.pi / np.sqrt(waves.frequencies[-1])))


def mean_rigid_errors(inputs: Mapping[str, Path]) -> Float[np.ndarray, " s"]:
    """Return each segment's mean residual of Eq. 3 in mm, over all training poses."""
    from replicate.approximation.rigid import mean_segment_errors
    from replicate.approximation.samples import PosedSamples

    mesh = load_mesh(inputs)
    return mean_segment_errors(mesh, PosedSamples(mesh.neutral, load_samples(inputs)))


def load_attachments(inputs: Mapping[str, Path]) -> "replicate.approximation.rigid.Attachments":
    """Return the rigid segments and their attachments."""
    from replicate.approximation.rigid import Attachments

    return Attachments.load(inputs["rigid"] / ATTACHMENTS)


def load_coarse_segments(
    inputs: Mapping[str, Path], mesh: Mesh
) -> "tuple[replicate.approximation.segments.Segment, ...]":
    """Return the segments of the coarse networks: those of the mesh, without the rigid ones."""
    from replicate.approximation.segments import coarse_segments

    return coarse_segments(mesh, load_attachments(inputs).segment.tolist(), load_influence(inputs))


def whole_mesh(inputs: Mapping[str, Path]) -> "tuple[replicate.approximation.segments.Segment, ...]":
    """Return all vertices as one segment that sees all rig parameters."""
    from replicate.approximation.segments import whole_mesh

    return (whole_mesh(load_mesh(inputs), load_samples(inputs).params.shape[1]),)


# The artefact "selection": the squares of the charts that a refinement is for (§3.3).

SQUARES, MAP_ERROR = "segments.npz", "map_error.npy"


@dataclass(frozen=True)
class SquareSettings:
    """What decides where a refinement is needed: a part of its section, and the size of the coarse maps."""

    poses: int
    square: float
    clusters_max: int
    coarse_map_size: int


def squares_stage(plan: Plan) -> Stage:
    """Return the stage that chooses the squares."""
    section = plan.config.refinement
    settings = SquareSettings(section.poses, section.square, section.clusters_max, plan.config.coarse.map_size)
    inputs = (stage(plan) for stage in (rig_stage, samples_stage, influence_stage, rigid_stage))
    return plan.stage("selection", choose_squares, plan.settings(settings), *inputs)


def choose_squares(context: StageContext) -> None:
    """Choose the squares where coarse maps lose most (Eq. 2), as many as the elbow says (§3.3)."""
    from replicate.approximation.refinement import map_error, select
    from replicate.approximation.segments import save_segments

    settings, mesh = context.config.section, load_mesh(context.inputs)
    samples, segments = load_samples(context.inputs), load_coarse_segments(context.inputs, mesh)
    poses = samples.draw(context.rng("poses"), min(settings.poses, len(samples)))
    errors = map_error(segments, samples.offsets(poses), settings.coarse_map_size)
    influence, seed = load_influence(context.inputs), context.config.seed
    squares, elbow = select(segments, errors, influence, settings.square, settings.clusters_max, seed)
    save_segments(squares, context.out / SQUARES)
    np.save(context.out / MAP_ERROR, errors)
    sizes = {square.name: len(square.vertices) for square in squares}
    context.note(segments=sizes, clusters=elbow.clusters, inertia=list(elbow.inertia), even=list(elbow.even))


def load_squares(inputs: Mapping[str, Path]) -> "tuple[replicate.approximation.segments.Segment, ...]":
    """Return the refinement segments."""
    from replicate.approximation.segments import load_segments

    return load_segments(inputs["selection"] / SQUARES)


def load_map_error(inputs: Mapping[str, Path]) -> Float[np.ndarray, " n"]:
    """Return e_i of Eq. 2 in mm²."""
    return np.load(inputs["selection"] / MAP_ERROR, allow_pickle=False)


# The artefact "wrinkled": the test pose that figures show, the one that folds the forehead most.

SHOWN_POSE = "pose.json"


def shown_pose_stage(plan: Plan) -> Stage:
    """Return the stage that chooses the pose."""
    return plan.stage("wrinkled", choose_pose, None, rig_stage(plan), samples_stage(plan))


def choose_pose(context: StageContext) -> None:
    """Choose the test pose whose forehead folds most, whatever any method predicts."""
    from replicate.approximation.metrics import unique_poses
    from replicate.drawing.scene import forehead_faces
    from replicate.geometry.mesh import most_folded

    mesh, samples = load_mesh(context.inputs), load_samples(context.inputs)
    forehead = forehead_faces(mesh.neutral, mesh.faces)
    pose = most_folded(mesh, unique_poses(samples.test_params), samples.test_offsets, forehead)
    (context.out / SHOWN_POSE).write_text(json.dumps({"pose": pose}) + "\n", encoding="utf-8")


def load_shown_pose(inputs: Mapping[str, Path]) -> int:
    """Return the pose's index among the test poses."""
    return json.loads((inputs["wrinkled"] / SHOWN_POSE).read_text(encoding="utf-8"))["pose"]
