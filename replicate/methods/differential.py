"""Differential subspace reconstruction (Song et al. 2020): networks to local shape and to anchors, then a solution.

One network of all controls gives the differential coordinates of the mesh in a PCA subspace, by the mean absolute error
and gradient descent with momentum; 2 % of the vertices, denser where much moves, have small networks of their own,
which see the controls that move them. `baselines.differential` has the equations. No loss sees normals, as published.

What the paper leaves open: differential coordinates are scaled to [0, 1] by one minimum and maximum for all, so that
the error keeps its proportions; the anchors' networks are trained by Adam. Offsets are those of the whole face,
since no skinning is known of a closed rig. Rigid segments follow by their attachments (§3.4). For 12,510 vertices, a
step of 128 poses takes 0.35 s of one core at a width of 2,048, 0.18 s at 512, and 0.08 s for the anchors. `laptop` has
4,000 such steps, and 8,000 at 512, so that both take less than 30 minutes a character: four and eight times as many
poses as the dense networks see in 16,000 steps. The narrow network's rate is a cycle up to 1: on the toon's training
batches it brought the error of δ, in shares of δ's range, to 0.0042 in 300 steps, and the published rate of 0.1, which
the wide network keeps, to 0.0061 in 450. No other rates were tried. Nothing makes the rest pose exact.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import Checked, number
from replicate.config import ConditioningConfig, TrainingConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, pca
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, write_training

if TYPE_CHECKING:
    import replicate.approximation.samples
    import replicate.baselines.differential

WIDE, SMALL = "differential", "differential_small"
STEPS = {WIDE: {"quick": 150, "laptop": 4_000}, SMALL: {"quick": 300, "laptop": 8_000}}
ANCHOR_STEPS = {"quick": 400, "laptop": 3_000}
DESCENT = TrainingConfig("paper", batch=128, draws="uniform", rates=(0.1,), shares=(1.0,))
CYCLE = TrainingConfig("one_cycle", batch=128, draws="uniform", peak_rate=1.0)
ANCHOR_TRAINING = TrainingConfig("one_cycle", batch=128, draws="uniform", peak_rate=2e-3)


@dataclass(frozen=True)
class DifferentialConfig(Checked):
    """The subspace, the anchors and the networks."""

    components: int = number(183, 1, 4_096)
    basis_samples: int = number(2_000, 2)  # training samples, spread over the set, for components, scale and anchors
    hidden: tuple[int, ...] = number((2_048,) * 6, 1, 65_536)
    momentum: float = number(0.9, 0.0, 0.999)
    training: TrainingConfig = DESCENT
    anchor_share: float = number(0.02, 1e-4, 1.0)  # of the vertices
    anchor_hidden: tuple[int, ...] = number((64,) * 4, 1, 65_536)
    anchor_training: TrainingConfig = ANCHOR_TRAINING


def default_section(profile: str) -> DifferentialConfig:
    """Return the section of the networks as published."""
    return _section(WIDE, DifferentialConfig(), profile)


def own_small(profile: str) -> DifferentialConfig:
    """Return the section of networks of 512."""
    return _section(SMALL, DifferentialConfig(hidden=(512,) * 6, training=CYCLE), profile)


def _section(name: str, section: DifferentialConfig, profile: str) -> DifferentialConfig:
    if profile not in ANCHOR_STEPS:
        return section
    training = replace(section.training, steps=STEPS[name][profile])
    anchors = replace(section.anchor_training, steps=ANCHOR_STEPS[profile])
    return replace(section, training=training, anchor_training=anchors)


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the networks as published."""
    return plan.stage(WIDE, train, plan.training(METHODS[0].section(plan.config)), *inputs_of_networks(plan))


def small_stage(plan: Plan) -> Stage:
    """Return the stage that trains networks of 512."""
    return plan.stage(SMALL, train, plan.training(METHODS[1].section(plan.config)), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Choose anchors, compute the subspace, and train the anchors' networks and the differential one."""
    import torch

    from replicate.approximation.conditioning import initialise, parameter_scale
    from replicate.approximation.losses import Supervision, spread
    from replicate.approximation.segments import faces_within
    from replicate.approximation.training import prepare
    from replicate.approximation.training import train as minimise
    from replicate.baselines import differential

    settings, section, name = context.config, context.config.section, context.name
    device = prepare(settings.device)
    mesh, samples, segment = pca.whole_face(context.inputs)
    vertices = segment.vertices
    # anchors and the subspace of local shape
    laplacian = differential.umbrella(faces_within(mesh.faces, vertices, len(mesh.neutral)), len(vertices))
    rows = spread(len(samples), section.basis_samples)
    offsets = samples.vertices_subset(rows, vertices)
    motion = np.linalg.norm(offsets, axis=-1).mean(0, dtype=np.float64)
    anchors = differential.choose_anchors(mesh.neutral[vertices], laplacian, motion, section.anchor_share)
    delta = differential.differences(laplacian, offsets).reshape(len(rows), -1)
    least, extent = float(delta.min()), max(float(np.ptp(delta)), 1e-9)
    delta -= least
    delta /= extent
    basis, mean = subspace(delta, section.components, settings.seed)
    # the untrained model
    sees = artefacts.load_influence(context.inputs)[vertices[anchors]]
    network = differential.DifferentialNetwork(sees, section.hidden, section.anchor_hidden, len(basis), len(vertices))
    length = float(np.sqrt(np.square(offsets[:, anchors], dtype=np.float64).mean())) or 1.0
    solver = differential.Reconstruction(laplacian, anchors)
    network.reconstruct_by(solver, basis * extent, mean * extent + least, length)
    generator = torch.Generator().manual_seed(settings.seed)
    initialise(ConditioningConfig(), [network], 0.0, generator)
    network.anchors.start(generator)
    scale = parameter_scale(samples.params)
    model = differential.DifferentialModel([network], [segment], scale, [1.0], len(mesh.neutral))
    model.nonzeros = solver.nonzeros
    del offsets, delta
    model = model.to(device)

    # the anchors' networks, then the differential one, whose log is kept
    def batch(step: int, training: TrainingConfig, stream: str) -> tuple[torch.Tensor, np.ndarray]:
        drawn = samples.draw_for_step(settings.seed, stream, step, training.batch, training.draws)
        return torch.from_numpy(np.asarray(samples.params[drawn], np.float32)).to(device) / model.scale, drawn

    def anchor_loss(step: int) -> torch.Tensor:
        params, drawn = batch(step, section.anchor_training, f"{name}, anchors")
        truth = torch.from_numpy(samples.vertices_subset(drawn, vertices[anchors]) / np.float32(length)).to(device)
        return (network.anchors(params) - truth).square().mean()

    def anchor_errors() -> tuple[float, float]:
        params = torch.tensor(np.asarray(samples.validation_params, np.float32)).to(device) / model.scale
        with torch.no_grad():
            found = network.anchors(params).cpu().numpy() * length
        apart = np.linalg.norm(found - samples.validation_offsets[:, vertices[anchors]], axis=-1)
        return float(apart.mean(dtype=np.float64)), math.nan  # single vertices have no normals

    components, centre = (torch.from_numpy(array).to(device) for array in (basis, mean))

    def loss(step: int) -> torch.Tensor:
        params, drawn = batch(step, section.training, name)
        delta = differential.differences(laplacian, samples.vertices_subset(drawn, vertices))
        truth = torch.from_numpy((delta.reshape(len(drawn), -1) - np.float32(least)) / np.float32(extent)).to(device)
        return (torch.addmm(centre, network.coefficients(params), components) - truth).abs().mean()

    scratch, validation = Path(context.scratch), Supervision(mesh, samples, vertices, 0.0, device).validation()
    anchor_log = minimise(
        network.anchors,
        anchor_loss,
        section.anchor_training,
        scratch / "anchors",
        context.progress,
        f"{name}, anchors",
        anchor_errors,
    )
    network.anchors.requires_grad_(False)
    log = differential.descend(
        network,
        loss,
        section.training,
        section.momentum,
        scratch / "network",
        context.progress,
        name,
        lambda: validation(model.offsets),
    )
    differential.save_differential(model, context.out, section.hidden, section.anchor_hidden)
    write_training(context, model, log)
    counts = {"anchors": len(anchors), "components": len(basis), "factor_nonzeros": model.nonzeros}
    context.note(**counts, anchor_error_mm=anchor_log[-1]["mm"])


def subspace(rows: np.ndarray, components: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return at most that many principal components of some rows (b, d), each of length 1, and the mean, as float32."""
    from sklearn.decomposition import PCA
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        pca = PCA(min(components, *rows.shape), svd_solver="randomized", random_state=seed).fit(rows)
    return np.ascontiguousarray(pca.components_, np.float32), np.asarray(pca.mean_, np.float32)


def load_trained(name: str, inputs: Mapping[str, Path]) -> "replicate.baselines.differential.DifferentialModel":
    """Return the networks that the stage of a name has trained."""
    from replicate.baselines.differential import load_differential

    return load_differential(inputs[name])


PUBLISHED = Method(
    WIDE,
    "Differential subspace",
    lambda plan: (stage(plan),),
    model=partial(load_trained, WIDE),
    place=72,
    note="Deep differential subspace reconstruction (Song, Shi and Reed 2020): local shape, held in place by anchors.",
    colour="#17BECF",
    standard=False,
    default_section=default_section,
)
METHODS = (
    PUBLISHED,
    variant(
        PUBLISHED,
        SMALL,
        "Differential subspace, 512",
        72.5,
        stages=lambda plan: (small_stage(plan),),
        default_section=own_small,
        note="The differential subspace with layers of 512 in place of 2,048, at a rate that rises and falls.",
        colour="#9EDAE5",
    ),
)
