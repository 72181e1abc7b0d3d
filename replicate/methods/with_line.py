"""The paper's networks beside a straight line: how much of their error comes from having to learn that line?

Each network adds to a ridge regression of its segment, on the parameters that it sees itself, and is trained on Eq. 1
as it is without. The line's weights stay fixed, and count in the model's size.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.config import CoarseConfig, DenseConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import coarse, dense_network, linear, refined
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, train_on_segments

if TYPE_CHECKING:
    import replicate.approximation.model
    import replicate.approximation.refinement

COARSE, REFINED, DENSE = "coarse_line", "refined_line", "dense_line"


def coarse_stage(plan: Plan) -> Stage:
    """Return the stage that trains coarse networks beside the line."""
    return _stage(plan, COARSE, train_coarse, plan.config.coarse)


def dense_stage(plan: Plan) -> Stage:
    """Return the stage that trains dense networks beside the line."""
    return _stage(plan, DENSE, train_dense, plan.config.dense)


def _stage(plan: Plan, name: str, function: Callable, section: CoarseConfig | DenseConfig) -> Stage:
    return plan.stage(name, function, plan.training(section), *inputs_of_networks(plan), linear.lines_stage(plan))


def refined_stage(plan: Plan) -> Stage:
    """Return the stage that trains refinement networks on what the coarse networks and the line leave."""
    return plan.stage(
        REFINED,
        train_refined,
        plan.training(plan.config.refinement),
        *refined.inputs_of_refinement(plan, coarse_stage(plan)),
    )


def train_coarse(context: StageContext) -> None:
    """Train coarse networks on what the line leaves."""
    from replicate.approximation import cnn

    facts = cnn.shape_facts(context.config.section)
    train_on_segments(context, cnn.make_network, facts, cnn.save, linear.load_lines(context.inputs))


def train_dense(context: StageContext) -> None:
    """Train dense networks on what the line leaves."""
    from replicate.baselines import dense

    facts = dense.shape_facts(context.config.section)
    train_on_segments(context, dense.make_network, facts, dense.save, linear.load_lines(context.inputs))


def train_refined(context: StageContext) -> None:
    """Train refinement networks on what the coarse networks and the line leave (§3.2)."""
    refined.train_on(context, load_coarse_model(context.inputs))


def load_coarse_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the coarse networks with their line."""
    from replicate.approximation import cnn
    from replicate.approximation.model import load_model
    from replicate.baselines.line import maker

    return load_model(inputs[COARSE], maker(cnn.make_network))


def load_refined_model(inputs: Mapping[str, Path]) -> "replicate.approximation.refinement.RefinedModel":
    """Return both levels of networks with their line."""
    from replicate.approximation.refinement import load_refined

    return load_refined(inputs[REFINED], load_coarse_model(inputs))


def load_dense_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the dense networks with their line."""
    from replicate.approximation.model import load_model
    from replicate.baselines import dense
    from replicate.baselines.line import maker

    return load_model(inputs[DENSE], maker(dense.make_network))


NOTE = "The network adds to the straight line of ridge regression and learns what that leaves."


def _beside_line(method: Method, name: str, place: float, model: Callable, *stages: Callable[[Plan], Stage]) -> Method:
    return variant(
        method,
        name,
        f"{method.label} + linear",
        place,
        stages=lambda plan: tuple(stage(plan) for stage in stages),
        model=model,
        note=NOTE,
        mark="‖",
    )


METHODS = (
    _beside_line(coarse.METHOD, COARSE, 52, load_coarse_model, coarse_stage),
    _beside_line(refined.METHOD, REFINED, 53, load_refined_model, coarse_stage, refined_stage),
    _beside_line(dense_network.METHOD, DENSE, 54, load_dense_model, dense_stage),
)
