"""Ours: gated networks with a linear skip to the coefficients of regional bases, stored in few bits.

The mesh is cut into compact regions. Each has a PCA basis, principal in the metric of the loss, so that a few dozen
components hold wrinkles too. For each region a network of products, beside a straight line, gives the coefficients from
the controls that move the region. Where regions meet, one fades into the other.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from data_recipes.rig import BATCH, has_function
from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, number
from replicate.config import TrainingConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.linear import CHUNK, ridge, with_constant
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, write_training

if TYPE_CHECKING:
    import torch

    import replicate.approximation.losses
    import replicate.approximation.samples
    import replicate.regional.basis
    import replicate.regional.model
    import replicate.regional.networks


STEPS = {"quick": 1_200, "laptop": 16_000, "paper": 100_000}
TRAINING = TrainingConfig("one_cycle", STEPS["paper"], 64, "uniform", peak_rate=1.6e-2, largest_gradient=1.0)
STRENGTH = 1e-5  # of the penalty on the line that the network starts from


@dataclass(frozen=True)
class RegionalConfig(Checked):
    """The regions, their bases and the network."""

    regions: int = number(16, 1, 1_024)
    components: int = number(96, 1, 4_096)  # in each region
    fine: int = number(16, 0, 4_096)  # of them in 16 bits; the others are stored in 8
    basis_samples: int = number(2_500, 2)  # training samples, spread over the set, for the components
    blend_rings: int = number(1, 0, 64)  # of edges on either side of a border, over which one region fades into another
    by_region: bool = True  # a network for each region; False: one for all
    by_influence: bool = True  # a network sees the controls that move its vertices; False: all of them
    hidden: tuple[int, ...] = number((128, 128), 1, 65_536)
    gated: bool = True  # layers are products; False: leaky ReLUs
    line: bool = True  # straight lines beside the layers
    squares: bool = False  # the loss is of squared errors, not of their lengths
    normal_weight: float = number(5.0, 0.0, 1e6)
    derivatives: float = number(0.0, 0.0, 1e6)  # weight of the rig's derivatives in the loss; 0: they are not needed
    reach: float = number(0.3, 1e-6, 1.0)  # how far a derivative reaches: this share of the way to another pose
    training: TrainingConfig = TRAINING


def default_section(profile: str) -> RegionalConfig:
    """Return the method's section of the configuration."""
    return RegionalConfig(training=replace(TRAINING, steps=STEPS[profile]))


def stage(plan: Plan) -> Stage:
    """Return the stage that computes the bases and trains the networks."""
    return plan.stage("regional", train, plan.training(METHOD.section(plan.config)), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Compute the bases, project all training samples onto them, and train the networks on the coefficients."""
    import torch

    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.losses import Supervision
    from replicate.approximation.segments import segment_vertices
    from replicate.approximation.training import prepare
    from replicate.approximation.training import train as minimise
    from replicate.regional import model as regional_model

    settings, section = context.config, context.config.section
    device = prepare(settings.device)
    # the regions' bases, and the coefficients of all samples
    mesh, samples = artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    movable = np.sort(segment_vertices(artefacts.load_coarse_segments(context.inputs, mesh)))
    supervision = Supervision(mesh, samples, movable, section.normal_weight, device)
    bases, projections, coefficients = stored_bases(supervision, section, context.progress)
    scale = parameter_scale(samples.params)
    params = np.asarray(samples.params / scale, np.float32)
    slopes = rig_slopes(context, samples.params, bases, projections) if section.derivatives else None
    length = float(np.sqrt(np.mean(np.square(coefficients), dtype=np.float64))) or 1.0
    # the untrained networks, which start as straight lines
    influence = artefacts.load_influence(context.inputs)
    network = untrained_networks(bases, influence, section)
    start(network, params, coefficients / np.float32(length), torch.Generator().manual_seed(settings.seed))
    rest = np.asarray(samples.default / scale, np.float32)
    for part, seen in zip(network.networks, network.seen, strict=True):
        part.rest = torch.from_numpy(rest[seen.numpy()])
    network = network.to(device)
    overlapping = blended_bases(supervision, bases, coefficients, section)
    # the loss of a step
    regions = np.repeat(np.arange(len(bases)), [len(basis.steps) for basis in bases])
    membership = torch.from_numpy(np.eye(len(bases), dtype=np.float32)[regions]).to(device)

    def on_device(array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.asarray(array, np.float32)).to(device)

    def length_of(error: torch.Tensor) -> torch.Tensor:
        return error.square().sum(dim=1).mean() if section.squares else regional_model.regional_loss(error, membership)

    inputs, targets = on_device(params), on_device(coefficients / np.float32(length))
    along = None if slopes is None else (on_device(slopes[0] / scale), on_device(slopes[1] / np.float32(length)))

    def loss_of_step(step: int) -> torch.Tensor:
        training = section.training
        rows = samples.draw_for_step(settings.seed, "regional", step, training.batch, training.draws)
        rows = torch.from_numpy(rows).to(device)
        if along is None:
            return length_of(network(inputs[rows]) - targets[rows])
        directions, changes = along
        found, slope = torch.func.jvp(network, (inputs[rows],), (directions[rows],))[:2]
        return length_of(found - targets[rows]) + section.derivatives * length_of(slope - changes[rows])

    def model() -> regional_model.RegionalModel:
        return regional_model.RegionalModel(network.to("cpu"), overlapping, scale, length, len(mesh.neutral), rest)

    # the training, and the networks in the bits that they are stored in
    validation = supervision.validation()

    def measure() -> tuple[float, float]:
        errors = validation(model().offsets)
        network.to(device)
        return errors

    log = minimise(network, loss_of_step, section.training, context.scratch, context.progress, "regional", measure)
    network = network.to("cpu")
    regional_model.halve(network)
    for part, seen in zip(network.networks, network.seen, strict=True):
        part.limit(params[:, seen.numpy()])
        part.settle()
    regional_model.save(model(), context.out)
    write_training(context, model(), log)
    context.note(multiplications=model().multiplications())


def untrained_networks(
    bases: "Sequence[replicate.regional.model.StoredBasis]",
    influence: Bool[np.ndarray, "n m"],
    section: RegionalConfig,
) -> "replicate.regional.networks.RegionalNetworks":
    """Return networks for the coefficients of some bases; influence: which control moves which vertex."""
    from replicate.regional.networks import fresh_networks

    members = [basis.vertices.numpy() for basis in bases]
    members = members if section.by_region else [np.concatenate(members)]
    if section.by_influence:
        seen = [parameters_of(influence[vertices]) for vertices in members]
    else:
        seen = [np.arange(influence.shape[1]) for _ in members]
    outputs = [len(basis.steps) for basis in bases]
    return fresh_networks(seen, section.hidden, outputs, section.gated, section.line)


def parameters_of(influence: Bool[np.ndarray, "k m"]) -> Int[np.ndarray, " j"]:
    """Return the parameters that move any of some vertices, all parameters if none does."""
    moving = influence.any(axis=0)
    return np.flatnonzero(moving if moving.any() else ~moving)


def start(
    network: "replicate.regional.networks.RegionalNetworks",
    params: Float[np.ndarray, "s m"],
    coefficients: Float[np.ndarray, "s d"],
    generator: "torch.Generator",
) -> None:
    """Draw a network's weights; set its straight lines by ridge regression on samples, its bounds by their range."""
    first = 0
    for part, seen in zip(network.networks, network.seen, strict=True):
        last = first + part.output.out_features
        inputs = params[:, seen.numpy()]
        (line,) = ridge(with_constant(inputs), chunks_of(coefficients[:, first:last]), (STRENGTH,))
        part.start(line, generator)
        part.bound(inputs)
        first = last


def stored_bases(
    supervision: "replicate.approximation.losses.Supervision", section: RegionalConfig, progress: Callable
) -> "tuple[list[replicate.regional.model.StoredBasis], list[np.ndarray], np.ndarray]":
    """Return the regions' bases in few bits, their projections and the coefficients of all training samples.

    A projection is the (3k, c) matrix that gives a region's coefficients. The coefficients are (N, Σ c) float32.
    """
    from threadpoolctl import threadpool_limits

    from replicate.approximation.losses import spread
    from replicate.approximation.segments import faces_within
    from replicate.regional.basis import RegionalBasis, loss_metric, principal_basis, projection, split_regions
    from replicate.regional.model import store

    mesh, samples, movable = supervision.mesh, supervision.samples, supervision.movable
    few = spread(len(samples), section.basis_samples)
    bases, projections, columns = [], [], []
    regions = split_regions(mesh.neutral[movable], section.regions)
    with progress(len(regions), "regional bases") as bar, threadpool_limits(1):
        for region in regions:
            vertices = movable[region]
            faces = faces_within(mesh.faces, vertices, len(mesh.neutral))
            counts = (len(movable), len(supervision.faces))
            metric = loss_metric(mesh.neutral[vertices], faces, *counts, section.normal_weight)
            offsets = samples.vertices_subset(few, vertices)
            exact = principal_basis(vertices, offsets, metric, section.components, through_rest=True)
            stored = store(exact, section.fine)
            mean = stored.mean.float().numpy()
            shapes = stored.components().numpy().reshape(len(stored.steps), -1, 3)
            onto = projection(RegionalBasis(vertices, mean, shapes), metric).astype(np.float32)
            rows = (np.arange(i, min(i + CHUNK, len(samples))) for i in range(0, len(samples), CHUNK))
            offsets = (samples.vertices_subset(chunk, vertices) - mean for chunk in rows)
            bases.append(stored)
            projections.append(onto)
            columns.append(np.concatenate([chunk.reshape(-1, len(onto)) @ onto for chunk in offsets]))
            bar.update(1)
    return bases, projections, np.concatenate(columns, axis=1)


def blended_bases(
    supervision: "replicate.approximation.losses.Supervision",
    bases: "Sequence[replicate.regional.model.StoredBasis]",
    coefficients: Float32[np.ndarray, "s d"],
    section: RegionalConfig,
) -> "list[replicate.regional.model.StoredBasis]":
    """Return bases that overlap, made from bases that don't; coefficients: those of all training samples."""
    from threadpoolctl import threadpool_limits

    from replicate.approximation.losses import spread
    from replicate.regional.basis import blend_weights
    from replicate.regional.model import blended

    mesh, samples = supervision.mesh, supervision.samples
    few = spread(len(samples), section.basis_samples)
    regions = [basis.vertices.numpy() for basis in bases]
    reaches = blend_weights(regions, mesh.faces, len(mesh.neutral), section.blend_rings)
    columns = np.split(coefficients[few], np.cumsum([len(basis.steps) for basis in bases])[:-1], axis=1)
    overlapping = []
    with threadpool_limits(1):
        for basis, known, (vertices, weights) in zip(bases, columns, reaches, strict=True):
            beyond = samples.vertices_subset(few, vertices[len(basis.vertices) :])
            overlapping.append(blended(basis, vertices, weights, known, beyond, through_rest=True))
    return overlapping


def rig_slopes(
    context: StageContext,
    params: Float[np.ndarray, "s m"],
    bases: "Sequence[replicate.regional.model.StoredBasis]",
    projections: Sequence[np.ndarray],
) -> tuple[Float32[np.ndarray, "s m"], Float32[np.ndarray, "s d"]]:
    """Return, for each training sample, a direction and the exact change of its coefficients along it (Sobolev).

    A direction leads a part of the way to another training sample, so that poses do differ in that way. Raises
    InputError for a rig that can't be differentiated.
    """
    section, rig = context.config.section, artefacts.load_rig(context.inputs)
    function = getattr(rig, "function", None)
    if function is None or not has_function(rig):
        raise InputError(
            f"{context.name}.derivatives: expected 0, since {rig.name} is known by its samples alone, which have no "
            f"derivatives, got {section.derivatives}"
        )
    others = context.rng("slopes").permutation(len(params))
    directions = np.asarray(section.reach * (params[others] - params), np.float32)
    slopes = []
    with context.progress(len(params), "derivatives of the rig") as bar:
        for moved in derivative_batches(function, np.asarray(params), directions):
            parts = [
                moved[:, basis.vertices.numpy()].reshape(len(moved), -1) @ onto
                for basis, onto in zip(bases, projections, strict=True)
            ]
            slopes.append(np.concatenate(parts, axis=1))
            bar.update(len(moved))
    return directions, np.concatenate(slopes)


def chunks_of(array: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the rows of an array as float64, some at a time."""
    for start in range(0, len(array), CHUNK):
        yield array[start : start + CHUNK].astype(np.float64)


def load_model(inputs: Mapping[str, Path]) -> "replicate.regional.model.RegionalModel":
    """Return the networks and their bases."""
    from replicate.regional.model import load

    return load(inputs["regional"])


METHOD = Method(
    "regional",
    "Regional (ours)",
    lambda plan: (stage(plan),),
    model=load_model,
    place=40,
    mark="★",
    note="Our method: small networks, each beside a straight line, mix stored shapes, region by region.",
    colour="#332288",
    default_section=default_section,
)


# The rig's exact derivatives at many poses, each along another direction, which Sobolev training fits as well as the
# rig's values (Czarnecki et al., Sobolev Training for Neural Networks, 2017).


def derivative_batches(
    rig: Callable, params: Float[np.ndarray, "s m"], directions: Float[np.ndarray, "s m"]
) -> Iterator[Float32[np.ndarray, "b n 3"]]:
    """Yield ∂V/∂p · d in mm of each pose and its direction d, exactly, in batches.

    rig: parameters (b, m) → vertices (b, n, 3) in mm, which JAX can trace, as the function of a FunctionRig.
    """
    import jax

    push = jax.jit(lambda poses, along: jax.jvp(rig, (poses,), (along,))[1])
    for start in range(0, len(params), BATCH):
        both = np.asarray([array[start : start + BATCH] for array in (params, directions)], np.float32)
        count = both.shape[1]
        padded = np.concatenate([both, np.repeat(both[:, -1:], BATCH - count, axis=1)], axis=1)
        yield np.asarray(push(*padded), np.float32)[:count]
