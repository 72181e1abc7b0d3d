"""Compressed skinning (Kavan et al. 2024): few bones, few weights and few numbers, moved by a network.

The shapes are the components of `pca`, as long as their standard deviations, and the mean: any rig has them, and their
squared error is that of the training poses. They are compressed as published, 40 bones with 8 weights a vertex and
6,000 numbers for all shapes, α = 10; a network like that of `pca` then gives the shapes' coefficients.
`baselines.skinning.compskin` has the equations.

What the paper leaves open: lengths are in cm; bones start as clusters of the vertices, denser where much moves, and
turn about their centres; first motions are those of least squares. For 12,510 vertices and 200 shapes, a step takes
0.15 s of one core, and 0.32 s with 80 bones. `laptop` has 4,000 steps with free weights and as many with normalised
ones, 20 minutes, in place of 10,000 each. `compskin_best` may store more: 80 bones and 24,000 numbers, with α = 1, one
choice and no search; `laptop` has 2,000 steps of each kind for it. Nothing makes the rest pose exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import number
from replicate.config import ConditioningConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import pca
from replicate.methods.method import Method, variant
from replicate.methods.pca import PcaConfig
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, write_training

if TYPE_CHECKING:
    import replicate.baselines.skinning.compskin

PUBLISHED, BEST = "compskin", "compskin_best"
COMPRESSION = {"quick": 150, "laptop": 4_000}  # steps, twice
LARGER = {"quick": 100, "laptop": 2_000}


@dataclass(frozen=True)
class CompskinConfig(PcaConfig):
    """The shapes and the network as `pca` has them, and what the shapes' compression may keep."""

    bones: int = number(40, 1, 1_024)
    weights: int = number(8, 1, 64)  # of a vertex, at most
    numbers: int = number(6_000, 1, 10_000_000)  # of all bones in all shapes, at most
    smoothness: float = number(10.0, 0.0, 1e6)  # α of the loss
    steps: int = number(10_000, 1, 1_000_000)  # with free weights, and as many with weights that sum to 1
    rate: float = number(1e-3, 1e-9, 1.0)


def default_section(profile: str) -> CompskinConfig:
    """Return the section of the numbers as published."""
    section = CompskinConfig(training=pca.default_section(profile).training)
    return replace(section, steps=COMPRESSION.get(profile, section.steps))


def own_best(profile: str) -> CompskinConfig:
    """Return the section of a larger skin."""
    section = default_section(profile)
    return replace(section, bones=80, numbers=24_000, smoothness=1.0, steps=LARGER.get(profile, section.steps))


def stage(plan: Plan) -> Stage:
    """Return the stage that compresses the shapes and trains the network."""
    return plan.stage(PUBLISHED, train, plan.training(METHODS[0].section(plan.config)), *inputs_of_networks(plan))


def best_stage(plan: Plan) -> Stage:
    """Return the stage of the larger skin."""
    return plan.stage(BEST, train, plan.training(METHODS[1].section(plan.config)), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Compress the shapes, and train the network of their coefficients on Eq. 1."""
    import torch

    from replicate.approximation.conditioning import initialise, parameter_scale
    from replicate.approximation.segments import faces_within
    from replicate.approximation.training import prepare
    from replicate.baselines.differential import umbrella
    from replicate.baselines.skinning import compskin

    settings, section, name = context.config, context.config.section, context.name
    prepare(settings.device)
    mesh, samples, segment = pca.whole_face(context.inputs)
    vertices, count = segment.vertices, len(segment.parameters)
    # the shapes, compressed
    basis, mean = pca.components(samples, segment.vertices, section, settings.seed)
    shapes = np.concatenate([basis, mean[None]]).reshape(len(basis) + 1, -1, 3)
    rest, faces = mesh.neutral[vertices], faces_within(mesh.faces, vertices, len(mesh.neutral))
    limits = compskin.Limits(section.weights, section.numbers, section.smoothness, section.steps, section.rate)
    with context.progress(2 * section.steps, f"{name}, shapes", 0) as bar:
        compressed = compskin.compress(
            rest, umbrella(faces, len(vertices)), shapes, section.bones, limits, settings.seed, bar.update
        )
    network = compskin.CompressedNetwork(
        count, section.hidden, section.leaky_slope, len(shapes), len(compressed.centres), len(vertices)
    )
    network.skin(compressed, rest)
    initialise(ConditioningConfig(), [network], section.leaky_slope, torch.Generator().manual_seed(settings.seed))
    scale = parameter_scale(samples.params)
    model = compskin.CompressedModel([network], [segment], scale, [1.0], len(mesh.neutral))
    log = pca.train_model(context, model, samples, mesh)
    compskin.save_compressed(model, context.out, section.hidden, section.leaky_slope)
    write_training(context, model, log)
    context.note(components=len(basis), bones=len(compressed.centres), numbers=network.numbers())


def load_trained(name: str, inputs: Mapping[str, Path]) -> "replicate.baselines.skinning.compskin.CompressedModel":
    """Return the network with the skin that the stage of a name has compressed."""
    from replicate.baselines.skinning.compskin import load_compressed

    return load_compressed(inputs[name])


_METHOD = Method(
    PUBLISHED,
    "Compressed skinning",
    lambda plan: (stage(plan),),
    model=partial(load_trained, PUBLISHED),
    place=74,
    note="Compressed skinning (Kavan et al. 2024) of PCA shapes, whose coefficients a network gives.",
    colour="#BCBD22",
    standard=False,
    default_section=default_section,
)
METHODS = (
    _METHOD,
    variant(
        _METHOD,
        BEST,
        "Compressed skinning, larger",
        74.5,
        stages=lambda plan: (best_stage(plan),),
        default_section=own_best,
        note="Compressed skinning with 80 bones and 24,000 numbers in place of 40 and 6,000, and less smoothing.",
        colour="#DBDB8D",
    ),
)
