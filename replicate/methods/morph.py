"""A neural morph model, as engines and animation packages ship it: learned shapes of the whole face, and their weights.

A small multilayer perceptron of all rig parameters gives the weights of as many morph targets as it has outputs. Unlike
those of `pca` the shapes are trained with it: Unreal's ML Deformer in its global mode; Houdini's and Maya's are alike.

`morph` is the recipe of Unreal's documentation: 128 shapes, two hidden layers of 128, the mean absolute error of
vertices, Adam at 1e-3 throughout, 5,000 batches of 128, offsets less their mean in units of their standard deviation.
`morph_best` has the training of our dense networks: Eq. 1, its schedule and as many steps. Two sizes were tried in
short trainings. On validation poses 256 shapes and layers of 256 are nearer than 128 and 128: 1.76 mm and 3.09° instead
of 1.95 mm and 3.15° on the toon (1,500 steps), 1.87 mm and 2.46° instead of 1.98 mm and 2.47° on the teen (600 steps).

What the documentation leaves open is as in our networks: leaky ReLUs, first weights, and controls divided by the
largest value of each. Rest is not exact, as in the model itself.
"""

from dataclasses import dataclass, replace
from functools import partial

from replicate.base.schema import Checked, number, read_table
from replicate.config import BEST, PROFILES, DenseConfig, TrainingConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import pca
from replicate.methods.dense_network import load_trained
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, write_training

STEPS = {"quick": 150}  # of the documented recipe, in place of 5,000
TRAINING = TrainingConfig("paper", 5_000, 128, "uniform", rates=(1e-3,), shares=(1.0,))


@dataclass(frozen=True)
class MorphConfig(Checked):
    """The shapes and the network that mixes them."""

    shapes: int = number(128, 1, 4_096)
    hidden: tuple[int, ...] = number((128, 128), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(0.0, 0.0, 1e6)  # α of Eq. 1; 0 leaves the error of vertices alone
    training: TrainingConfig = TRAINING


def default_section(profile: str) -> MorphConfig:
    """Return the documented recipe."""
    return MorphConfig(training=replace(TRAINING, steps=STEPS.get(profile, TRAINING.steps)))


def best_section(profile: str) -> MorphConfig:
    """Return the recipe of our dense networks, for as many steps."""
    dense = read_table(DenseConfig(), PROFILES[profile].get("dense", {}))
    training = TrainingConfig(**(BEST | {"steps": dense.training.steps}))
    return MorphConfig(256, (256, 256), normal_weight=dense.normal_weight, training=training)


def stage(plan: Plan) -> Stage:
    """Return the stage that trains shapes and network by the documented recipe."""
    return plan.stage("morph", train, plan.training(METHODS[0].section(plan.config)), *inputs_of_networks(plan))


def best_stage(plan: Plan) -> Stage:
    """Return the stage that trains them by our recipe."""
    return plan.stage("morph_best", train, plan.training(METHODS[1].section(plan.config)), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Train shapes and network together."""
    import numpy as np
    import torch

    from replicate.approximation.conditioning import initialise
    from replicate.approximation.losses import STATISTICS, spread
    from replicate.approximation.model import save_model
    from replicate.baselines.dense import Normalised, make_network
    from replicate.config import ConditioningConfig

    settings, section = context.config, context.config.section
    mesh, samples, segment = pca.whole_face(context.inputs)
    facts = {"hidden": list(section.hidden), "leaky_slope": section.leaky_slope, "shapes": section.shapes}
    network = make_network(segment, facts)
    generator = torch.Generator().manual_seed(settings.seed)
    initialise(ConditioningConfig(), [network], section.leaky_slope, generator)
    some = samples.vertices_subset(spread(len(samples), STATISTICS), segment.vertices)
    some = some.reshape(len(some), -1).astype(np.float64)
    mean, deviation = (torch.from_numpy(part.astype(np.float32)) for part in (some.mean(0), some.std(0)))
    training = Normalised(network, mean, deviation)
    log = pca.train_model(context, pca.model_of(training, segment, samples, mesh), samples, mesh)
    model = pca.model_of(training.cpu().folded(), segment, samples, mesh)
    save_model(model, context.out, facts)
    write_training(context, model, log)


MORPH = Method(
    "morph",
    "Neural morphs",
    lambda plan: (stage(plan),),
    model=partial(load_trained, "morph"),
    place=70.5,
    note="A small network to the weights of 128 learned shapes, as engines ship it, by their documented recipe.",
    colour="#8A5A00",
    in_figures=False,
    standard=False,
    default_section=default_section,
)
METHODS = (
    MORPH,
    variant(
        MORPH,
        "morph_best",
        "Neural morphs, our training",
        71,
        stages=lambda plan: (best_stage(plan),),
        default_section=best_section,
        note="The same with our loss, schedule and steps; widths chosen on validation poses.",
    ),
)
