"""The dense baseline: a multilayer perceptron for each segment (§5.1)."""

from collections.abc import Mapping
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


def load_model(inputs: Mapping[str, Path]) -> Model:
    """Return the dense networks."""
    from replicate.baselines.dense import load_dense

    return load_dense(inputs["dense"])


METHOD = Method(
    "dense",
    "Dense",
    lambda plan: (stage(plan),),
    model=load_model,
    place=30,
    in_paper=True,
    colour="#D55E00",
)
