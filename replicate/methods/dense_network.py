"""The dense baseline: a multilayer perceptron a segment (§5.1)."""

from collections.abc import Callable, Mapping
from pathlib import Path

from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.training_stage import inputs_of_networks, train_on_segments, vertices_of


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the dense networks."""
    return plan.stage("dense", train, plan.training(plan.config.dense), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Train the dense networks on Eq. 1."""
    from replicate.approximation import dense

    train_on_segments(context, dense.make_network, dense.shape_facts(context.config.section), dense.save)


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the dense networks."""
    from replicate.approximation.dense import load_dense

    return load_dense(inputs["dense"])


def load(inputs: Mapping[str, Path], numbers: None) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3) of the dense networks."""
    return vertices_of(inputs, load_model(inputs))


def multiplications(inputs: Mapping[str, Path], numbers: None) -> int:
    """Return how many multiplications one pose takes."""
    from replicate.approximation.multiplications import of_model

    return of_model(load_model(inputs))


METHOD = Method(
    "dense",
    "Dense",
    lambda plan: (stage(plan),),
    load,
    place=30,
    in_paper=True,
    colour="#D55E00",
    multiplications=multiplications,
)
