"""What the stages of `pipeline` do: each reads artefacts, calls the library and writes one artefact.

Nothing is computed here. Settings are the smallest part of the configuration that a stage's numbers depend on, so that
a change of one number remakes no more than it must.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from replicate.engine.stage import StageContext, stream_rng
from replicate.geometry.mesh import Mesh


@dataclass(frozen=True)
class Character:
    """Which rig to build: a character's name or the path of a recipe."""

    character: str


@dataclass(frozen=True)
class Section:
    """A section of the configuration, and what its stage needs besides: a seed to draw from, a device, bones."""

    section: object
    seed: int
    device: str | None = None
    bones: int | None = None


@dataclass(frozen=True)
class Selection:
    """What decides where a refinement is needed: of the refinement's section, and the coarse maps' size."""

    poses: int
    square: float
    clusters_max: int
    coarse_map_size: int


@dataclass(frozen=True)
class Measured:
    """Which method is measured, on how many test poses (0: all), and the numbers that its predictor needs."""

    method: str
    test_poses: int
    batch: int
    seed: int
    refit_sweeps: int = 0
    refit_settled: float = 0.0
    map_size: int = 0
    refined_map_size: int = 0


@dataclass(frozen=True)
class Reported:
    """What the rows of a table are labelled with."""

    character: str
    profile: str
    seed: int


@dataclass(frozen=True)
class Shape:
    """The shape of a map network, for its size: what `evaluation.model_size` needs of a network's section."""

    map_size: int
    channels: int
    hidden: tuple[int, ...]


@dataclass(frozen=True)
class Sized:
    """What the rows of Table 1 are labelled with, and the shapes of the networks whose sizes they hold."""

    character: str
    profile: str
    coarse: Shape
    refined: Shape


@dataclass(frozen=True)
class Drawn:
    """Whose figure is drawn, and the seed that examples are chosen with."""

    character: str
    seed: int


def make_rig(context: StageContext) -> None:
    """Build a character's rig and keep it; the mesh alone as well, for stages that need no rig."""
    from data_recipes.rig import build_rig, save_rig

    rig = build_rig(context.config.character)
    save_rig(rig, context.out / "rig")
    rig.mesh.save(context.out / "mesh.npz")
    context.note(vertices=len(rig.mesh.neutral), faces=len(rig.mesh.faces), parameters=len(rig.controls))


def make_samples(context: StageContext) -> None:
    """Draw the poses and evaluate the rig at them (§3.5)."""
    from replicate.approximation.samples import write_samples

    rig = load_rig(context)
    section = context.config.section
    facts = write_samples(rig, section, context.out, context.rng, context.scratch, context.progress)
    context.note(**facts)


def make_influence(context: StageContext) -> None:
    """Find which control can move which vertex (§3.1): a fact about the rig, so at poses of its own draw."""
    from replicate.approximation.influence import influence, influence_poses
    from replicate.approximation.samples import choose_poses

    rig = load_rig(context)
    training = choose_poses(rig, context.config.section, context.rng)["training"]
    poses = influence_poses(rig, training, context.rng("poses"))
    moves = influence(rig, poses, progress=context.progress)
    np.save(context.out / "influence.npy", moves)
    context.note(poses=len(poses), idle_controls=[rig.controls[k].name for k in np.flatnonzero(~moves.any(0))])


def make_rigid(context: StageContext) -> None:
    """Find the rigid segments and what they are attached to, from training poses (§3.4)."""
    from replicate.approximation.rigid import find_attachments

    mesh, samples, section = load_mesh(context), load_samples(context), context.config.section
    poses = samples.draw(context.rng("poses"), min(section.poses, len(samples)))
    found = find_attachments(mesh, mesh.neutral + samples.offsets(poses), section.tau_mm, section.attachments)
    found.save(context.out / "attachments.npz")
    context.note(rigid_segments=[mesh.segment_names[k] for k in found.segment])


def make_coarse(context: StageContext) -> None:
    """Train the coarse CNNs (§3.1)."""
    from replicate.approximation import cnn

    _train(context, cnn.make_network, cnn.shape_facts(context.config.section), cnn.save)


def make_selection(context: StageContext) -> None:
    """Find where a refinement is needed (§3.3)."""
    from replicate.approximation.refinement import map_error, select
    from replicate.approximation.segments import save_segments

    section, mesh, samples = context.config.section, load_mesh(context), load_samples(context)
    segments = load_coarse_segments(context.inputs, mesh)
    poses = samples.draw(context.rng("poses"), min(section.poses, len(samples)))
    errors = map_error(segments, samples.offsets(poses), section.coarse_map_size)
    influence = np.load(context.inputs["influence"] / "influence.npy")
    found, elbow = select(segments, errors, influence, section, context.config.seed)
    save_segments(found, context.out / "segments.npz")
    np.save(context.out / "map_error.npy", errors)
    sizes = {segment.name: len(segment.vertices) for segment in found}
    context.note(segments=sizes, clusters=elbow.clusters, inertia=list(elbow.inertia))


def make_refined(context: StageContext) -> None:
    """Train the refinement CNNs on what the coarse ones leave (§3.2)."""
    from replicate.approximation.cnn import load_coarse, save
    from replicate.approximation.refinement import train_refined
    from replicate.approximation.segments import load_segments

    settings = context.config
    mesh, samples, coarse = load_mesh(context), load_samples(context), load_coarse(context.inputs["coarse"])
    segments = load_segments(context.inputs["selection"] / "segments.npz")
    given, kept = (mesh, coarse, segments, samples, settings.section), (context.scratch, context.progress)
    model, log = train_refined(*given, *kept, settings.seed, settings.device)
    save(model.residual, context.out, settings.section)
    _keep_log(context, model, log)


def make_dense(context: StageContext) -> None:
    """Train the dense baseline (§5.1)."""
    from replicate.approximation import dense

    _train(context, dense.make_network, dense.shape_facts(context.config.section), dense.save)


def make_skin(context: StageContext) -> None:
    """Fit linear blend skinning to training poses, the same for every number of bones (§5.1)."""
    from replicate.approximation.skinning.ssdr import fit

    section = context.config.section
    mesh, samples = load_mesh(context), load_samples(context)
    poses = samples.draw(stream_rng(context.config.seed, "lbs", "poses"), min(section.samples, len(samples)))
    skin = fit(
        mesh.neutral,
        mesh.neutral + samples.offsets(poses),
        context.config.bones,
        context.rng("sketch"),
        section.influences,
        section.iterations,
        context.scratch,
        context.progress,
        mesh.faces,
        section.coherence,
        section.relaxed,
    )
    skin.save(context.out / "skin.npz")


def make_driven(context: StageContext) -> None:
    """Train the network that moves a skin's bones as the rig parameters say."""
    from replicate.approximation.skinning.bone_network import save, train_driven
    from replicate.approximation.skinning.ssdr import Skin

    settings = context.config
    skin = Skin.load(context.inputs[f"lbs{settings.bones}"] / "skin.npz")
    given, kept = (
        (load_mesh(context), skin, load_samples(context), settings.section),
        (context.scratch, context.progress),
    )
    model, log = train_driven(*given, *kept, settings.seed, settings.device)
    save(model, skin, context.out, settings.section)
    _keep_log(context, model, log)


def make_wrinkled(context: StageContext) -> None:
    """Choose the test pose that figures show: the one that folds the forehead most."""
    from replicate.drawing.scene import forehead_faces
    from replicate.report.pose_record import most_wrinkled

    mesh, samples = load_mesh(context), load_samples(context)
    shown = forehead_faces(mesh.neutral, mesh.faces)
    pose = most_wrinkled(mesh, samples.test_params, samples.test_offsets, shown)
    (context.out / "pose.json").write_text(json.dumps({"pose": pose}) + "\n")


def make_errors(context: StageContext) -> None:
    """Measure one method on the test poses, and keep the one that figures show as the method predicts it."""
    from replicate.approximation.evaluation import evaluate, unique_poses
    from replicate.methods.loading import load_predictor

    settings, mesh, samples = context.config, load_mesh(context), load_samples(context)
    attachments = load_attachments(context.inputs)
    predictor = load_predictor(settings, context.inputs, mesh, attachments)
    poses = unique_poses(samples.test_params)
    if settings.test_poses and settings.test_poses < len(poses):
        order = stream_rng(settings.seed, "errors", "poses").permutation(len(poses))
        poses = poses[np.sort(order[: settings.test_poses])]  # fewer poses are some of the more
    with context.progress(len(poses), f"errors, {settings.method}") as bar:
        errors = evaluate(
            mesh,
            samples.test_params[poses],
            samples.test_offsets[poses],
            {settings.method: predictor},
            attachments.segment,
            settings.batch,
            bar,
        )[settings.method]
    errors.save(context.out / "errors.npz")
    pose = load_wrinkled(context.inputs)
    truth = mesh.neutral + samples.test_offsets[pose : pose + 1]
    np.save(context.out / "pose.npy", predictor(samples.test_params[pose : pose + 1], truth)[0].astype(np.float32))


def make_table2(context: StageContext) -> None:
    """Gather one character's rows of Table 2, the curves of its trainings and the pose that figures show."""
    from replicate.report.pose_record import save_pose
    from replicate.report.results import write_results
    from replicate.report.training_curves import write_curves
    from replicate.targets.table2.gather import curves_of, pose_of, rows_of

    settings, inputs = context.config, context.inputs
    write_results(context.out / "table2.csv", rows_of(settings, inputs, load_mesh(context)))
    write_curves(context.out / "table2_curves.csv", curves_of(settings.character, inputs))
    samples, pose = load_samples(context), load_wrinkled(inputs)
    rig = load_rig(context)
    props = rig.pose_props(samples.test_params[pose])
    record = pose_of(settings.character, inputs, rig.mesh, pose, samples.test_offsets[pose], props)
    save_pose(context.out / f"table2_{settings.character}_pose.npz", record)


def make_table1(context: StageContext) -> None:
    """Count one character's segments and weigh its models (Table 1)."""
    from replicate.report.results import write_results
    from replicate.targets.table1.rows import rows_of

    write_results(context.out / "table1.csv", rows_of(context.config, context.inputs, load_mesh(context)))


def make_figure05(context: StageContext) -> None:
    """Draw some training poses, and a strip of each kind of clip (Fig. 5)."""
    from replicate.targets.figure05.picture import POSES, save_clips, save_poses

    rig, samples, name = load_rig(context), load_samples(context), f"figure05_{context.config.character}"
    shown = np.sort(context.rng("poses").choice(len(samples), min(POSES, len(samples)), replace=False))
    save_poses(rig, samples.params[shown], shown, context.out / name)
    if rig.clips:
        save_clips(rig, context.out / f"{name}_clips")


def make_lbs(context: StageContext) -> None:
    """Measure skins of several numbers of bones on test poses, and draw what they are."""
    from replicate.approximation.skinning.ssdr import Skin
    from replicate.targets.lbs.picture import TEST, TRAINING, save_all

    rig, samples, name = load_rig(context), load_samples(context), f"lbs_{context.config.character}"
    files = {folder.name: folder / "skin.npz" for folder in context.inputs.values() if (folder / "skin.npz").is_file()}
    skins = {skin.bones: skin for skin in map(Skin.load, files.values())}
    count = len(samples.test_params)
    drawn = np.sort(context.rng("poses").choice(count, min(TEST, count), replace=False))
    test = rig.mesh.neutral + np.asarray(samples.test_offsets[drawn], np.float32)
    training = samples.draw(context.rng("training"), min(TRAINING, len(samples)))
    wrinkled = rig.mesh.neutral + np.asarray(samples.test_offsets[load_wrinkled(context.inputs)], np.float32)
    posed = rig.mesh.neutral + samples.offsets(training)
    with context.progress(len(skins), "LBS", 0) as bar:
        save_all(rig, skins, posed, test, wrinkled, context.out / name, bar)


def make_figure07(context: StageContext) -> None:
    """Draw the mesh segments in colours (Fig. 7)."""
    from replicate.targets.figure07.picture import save_segments_figure

    rigid = load_attachments(context.inputs).segment.tolist()
    save_segments_figure(load_rig(context), rigid, context.out / f"figure07_{context.config.character}")


def make_figure08(context: StageContext) -> None:
    """Draw the refinement segments in colours, what is unused in grey (Fig. 8)."""
    from replicate.approximation.segments import load_segments
    from replicate.targets.figure08.picture import save_refinement_figure

    found = load_segments(context.inputs["selection"] / "segments.npz")
    errors = np.load(context.inputs["selection"] / "map_error.npy")
    save_refinement_figure(load_rig(context), found, errors, context.out / f"figure08_{context.config.character}")


def load_rig(context: StageContext):
    """Return the rig that the stage "rig" built."""
    from data_recipes import rig

    return rig.load_rig(context.inputs["rig"] / "rig")


def load_mesh(context: StageContext) -> Mesh:
    """Return the rig's mesh, without the rig."""
    return Mesh.load(context.inputs["rig"] / "mesh.npz")


def load_samples(context: StageContext):
    """Open the samples."""
    from replicate.approximation.samples import SampleSet

    return SampleSet.open(context.inputs["samples"])


def load_attachments(inputs: Mapping[str, Path]):
    """Return the rigid segments and what carries them."""
    from replicate.approximation.rigid import Attachments

    return Attachments.load(inputs["rigid"] / "attachments.npz")


def load_coarse_segments(inputs: Mapping[str, Path], mesh: Mesh):
    """Return the segments of the coarse model: the mesh's own, less the rigid ones."""
    from replicate.approximation.segments import coarse_segments

    moves = np.load(inputs["influence"] / "influence.npy")
    return coarse_segments(mesh, load_attachments(inputs).segment.tolist(), moves)


def load_wrinkled(inputs: Mapping[str, Path]) -> int:
    """Return the index of the test pose that figures show."""
    return json.loads((inputs["wrinkled"] / "pose.json").read_text())["pose"]


def _train(context: StageContext, make_network: Callable, facts: dict, save: Callable) -> None:
    """Train one network a coarse segment; the stage's name is the training's stream."""
    from replicate.approximation.segment_training import train_segments

    settings, mesh, samples = context.config, load_mesh(context), load_samples(context)
    segments = load_coarse_segments(context.inputs, mesh)
    networks = [make_network(segment, facts) for segment in segments]
    given, kept = (mesh, segments, networks, samples, settings.section), (context.scratch, context.progress)
    model, log = train_segments(*given, *kept, context.name, settings.seed, settings.device)
    save(model, context.out, settings.section)
    _keep_log(context, model, log)


def _keep_log(context: StageContext, model, log) -> None:
    from replicate.approximation.training import write_log

    write_log(log, context.out / "log.csv")
    context.note(size_mb=model.size_mb())
