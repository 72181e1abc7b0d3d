"""The dense baseline: a multilayer perceptron for each segment (§5.1)."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method, Model
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, train_on_segments


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the dense networks."""
    return plan.stage("dense", train, plan.training(plan.config.dense), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Train the dense networks on Eq. 1."""
    from replicate.baselines import dense

    train_on_segments(context, dense.make_network, dense.shape_facts(context.config.section), dense.save)


def load_trained(name: str, inputs: Mapping[str, Path]) -> Model:
    """Return the dense networks of the stage of this name."""
    from replicate.baselines.dense import load_dense

    return load_dense(inputs[name])


METHOD = Method(
    "dense",
    "Dense",
    lambda plan: (stage(plan),),
    model=partial(load_trained, "dense"),
    place=30,
    in_paper=True,
    colour="#D55E00",
)
