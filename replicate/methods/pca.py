"""A network to PCA coefficients, as studios ship it: all vertices move in the span of a few hundred fixed shapes.

V = V⁰ + mean + c(p) B, where the rows of B are principal components of training offsets, each of the length of its
standard deviation, and c is a multilayer perceptron of all rig parameters, trained on Eq. 1. One basis for the whole
deformable mesh; rigid segments follow by their attachments (§3.4).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import Checked, number
from replicate.config import ConditioningConfig, TrainingConfig
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, write_training

if TYPE_CHECKING:
    import torch

    import replicate.approximation.model
    import replicate.approximation.samples
    import replicate.approximation.segments

STEPS = {"quick": 600, "laptop": 16_000}  # those of the dense network
PEAK_RATE = 2e-3
TRAINING = TrainingConfig()  # the schedule of the paper


@dataclass(frozen=True)
class PcaConfig(Checked):
    """The basis and the network of the PCA model."""

    components: int = number(200, 1, 4_096)
    basis_samples: int = number(2_000, 2)  # training samples, spread over the set, for the components
    hidden: tuple[int, ...] = number((256, 256), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(5.0, 0.0, 1e6)
    training: TrainingConfig = TRAINING


def default_section(profile: str) -> PcaConfig:
    """Return the method's section of the configuration."""
    if profile not in STEPS:
        return PcaConfig()
    return PcaConfig(training=TrainingConfig("one_cycle", STEPS[profile], peak_rate=PEAK_RATE))


def stage(plan: Plan) -> Stage:
    """Return the stage that computes the basis and trains the network."""
    return plan.stage("pca", train, plan.training(METHOD.section(plan.config)), *inputs_of_networks(plan))


def make_network(
    inputs: int, basis: "torch.Tensor", mean: "torch.Tensor", hidden: Sequence[int], slope: float
) -> "torch.nn.Module":
    """Return the network: (b, m) scaled parameters → (b, k, 3) offsets in mm.

    inputs: m.
    basis: (c, 3k) components, float32; not trained, nor is mean (3k,).
    hidden: the widths of its layers.
    slope: that of its leaky ReLUs.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    class CoefficientNetwork(nn.Module):
        basis: torch.Tensor
        mean: torch.Tensor

        def __init__(self):
            super().__init__()
            self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
            self.output = nn.Linear(hidden[-1], len(basis))
            self.register_buffer("basis", basis)
            self.register_buffer("mean", mean)

        def forward(self, params: torch.Tensor) -> torch.Tensor:
            x = params
            for layer in self.hidden:
                x = functional.leaky_relu(layer(x), slope)
            return torch.addmm(self.mean, self.output(x), self.basis).unflatten(1, (-1, 3))

    return CoefficientNetwork()


def train(context: StageContext) -> None:
    """Compute the basis, and train the network on Eq. 1 as the dense one is trained."""
    train_on_basis(context, make_network, _start)


def _start(
    model: "replicate.approximation.model.SegmentedModel",
    samples: "replicate.approximation.samples.SampleSet",
    section: PcaConfig,
    generator: "torch.Generator",
) -> dict:
    from replicate.approximation.conditioning import initialise

    initialise(ConditioningConfig(), list(model.networks), section.leaky_slope, generator)
    return {}


def train_on_basis(context: StageContext, make: Callable, start: Callable) -> None:
    """Compute the basis, and train a network to its coefficients on Eq. 1; the stage's name is the stream of draws.

    make: makes the network, as `make_network` does.
    start: (model, samples, section, generator) → facts to note. It sets the first weights of the model's only network,
        which holds the basis as `basis` and `mean`.
    """
    import torch

    from replicate.approximation.model import save_model

    settings, section = context.config, context.config.section
    mesh, samples, segment = whole_face(context.inputs)
    basis, mean = components(samples, segment.vertices, section, settings.seed)
    shapes = (torch.from_numpy(basis), torch.from_numpy(mean))
    network = make(len(segment.parameters), *shapes, section.hidden, section.leaky_slope)
    model = model_of(network, segment, samples, mesh)
    notes = start(model, samples, section, torch.Generator().manual_seed(settings.seed))
    log = train_model(context, model, samples, mesh)
    facts = {"hidden": list(section.hidden), "leaky_slope": section.leaky_slope, "components": len(basis)}
    save_model(model, context.out, facts)
    write_training(context, model, log)
    context.note(size_mb=model.size_mb() + (basis.size + mean.size) * 4 / 1e6, components=len(basis), **notes)


# One network for the whole face, whatever it consists of.


def whole_face(
    inputs: Mapping[str, Path],
) -> "tuple[Mesh, replicate.approximation.samples.SampleSet, replicate.approximation.segments.Segment]":
    """Return mesh and samples, and all deformable vertices as one segment that sees every control."""
    from replicate.approximation.segments import Segment, segment_vertices

    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    vertices = np.sort(segment_vertices(artefacts.load_coarse_segments(inputs, mesh)))
    count, places = samples.params.shape[1], np.zeros((len(vertices), 2), np.float32)
    return mesh, samples, Segment("deformable", vertices.astype(np.int32), places, np.arange(count, dtype=np.int32))


def model_of(
    network: "torch.nn.Module",
    segment: "replicate.approximation.segments.Segment",
    samples: "replicate.approximation.samples.SampleSet",
    mesh: Mesh,
) -> "replicate.approximation.model.SegmentedModel":
    """Return a network for the whole face, which predicts mm, as a model."""
    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.model import SegmentedModel

    return SegmentedModel([network], [segment], parameter_scale(samples.params), [1.0], len(mesh.neutral))


def train_model(
    context: StageContext,
    model: "replicate.approximation.model.SegmentedModel",
    samples: "replicate.approximation.samples.SampleSet",
    mesh: Mesh,
) -> list[dict]:
    """Train a model on Eq. 1, in place; return its log. The stage's name is the stream of draws."""
    import torch

    from replicate.approximation.losses import Supervision
    from replicate.approximation.training import prepare
    from replicate.approximation.training import train as minimise

    settings, section, name = context.config, context.config.section, context.name
    device = prepare(settings.device)
    model.to(device)
    supervision = Supervision(mesh, samples, model.vertices, section.normal_weight, device)

    def loss_of_step(step: int) -> torch.Tensor:
        params, target = supervision.batch(settings.seed, name, step, section.training)
        return supervision.loss(model(params), target)

    validation = supervision.validation()
    return minimise(
        model,
        loss_of_step,
        section.training,
        context.scratch,
        context.progress,
        name,
        lambda: validation(model.offsets),
    )


def components(
    samples: "replicate.approximation.samples.SampleSet", vertices: np.ndarray, section: PcaConfig, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the principal components of some vertices' offsets, (c, 3k) mm, and their mean, (3k,), as float32.

    Each component has the length of its standard deviation over the samples, so that coefficients are about 1.
    """
    from sklearn.decomposition import PCA
    from threadpoolctl import threadpool_limits

    from replicate.approximation.losses import spread

    rows = spread(len(samples), section.basis_samples)
    offsets = samples.vertices_subset(rows, vertices).reshape(len(rows), -1)
    with threadpool_limits(1):
        count = min(section.components, *offsets.shape)
        pca = PCA(count, svd_solver="randomized", random_state=seed).fit(offsets)
    scaled = pca.components_ * np.sqrt(pca.explained_variance_)[:, None]
    return np.ascontiguousarray(scaled, np.float32), np.asarray(pca.mean_, np.float32)


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the network with its basis."""
    return load_on_basis(inputs["pca"], make_network)


def load_on_basis(folder: Path, make: Callable) -> "replicate.approximation.model.SegmentedModel":
    """Return the model that `train_on_basis` wrote; make is the same as there."""
    import torch

    from replicate.approximation.model import load_model

    def network(segment: "replicate.approximation.segments.Segment", facts: dict) -> "torch.nn.Module":
        mean = torch.zeros(3 * len(segment.vertices))
        basis = torch.zeros(facts["components"], len(mean))
        return make(len(segment.parameters), basis, mean, facts["hidden"], facts["leaky_slope"])

    return load_model(folder, network)


METHOD = Method(
    "pca",
    "PCA network",
    lambda plan: (stage(plan),),
    model=load_model,
    place=60,
    note="A dense network to the coefficients of a PCA basis of the training offsets, as studios ship it.",
    colour="#8C564B",
    standard=False,
    default_section=default_section,
)
