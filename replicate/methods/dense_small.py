"""The dense baseline at the CNN's size: narrow networks, trained as `dense` is.

The rule is the same for all characters: the hidden layers of `dense`, but the last one is as wide as it can be with the
whole model no larger than the refined model of this configuration, counted from the architecture.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from replicate.approximation.model_size import MapShape, cnn_size_mb, dense_width, shape_of
from replicate.base.exceptions import InputError
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, dense_network
from replicate.methods.method import variant
from replicate.methods.plan import Plan, TrainingSettings
from replicate.methods.training_stage import inputs_of_networks, train_on_segments

# How large the refined model is under a configuration, for methods that may not be larger.


@dataclass(frozen=True)
class RefinedShapes:
    """The shapes of the map networks of both levels."""

    coarse: MapShape
    refined: MapShape


def shapes(plan: Plan) -> RefinedShapes:
    """Return the shapes that a configuration gives to the map networks."""
    return RefinedShapes(shape_of(plan.config.coarse), shape_of(plan.config.refinement))


def inputs_of_size(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages that `refined_size_mb` reads; none of them trains a network."""
    return (*inputs_of_networks(plan), artefacts.squares_stage(plan))


def refined_size_mb(inputs: Mapping[str, Path], shapes: RefinedShapes) -> float:
    """Return the size of coarse and refinement networks in MB of 10⁶ bytes, from their segments and shapes alone."""
    coarse = artefacts.load_coarse_segments(inputs, artefacts.load_mesh(inputs))
    seen, seen_refined = (
        [len(segment.parameters) for segment in part] for part in (coarse, artefacts.load_squares(inputs))
    )
    return cnn_size_mb(seen, seen_refined, shapes.coarse, shapes.refined)


@dataclass(frozen=True)
class SmallSettings(TrainingSettings):
    """What the dense networks are trained with, and the shapes of the networks that limit their size."""

    shapes: RefinedShapes


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the narrow networks."""
    config = plan.config
    settings = SmallSettings(config.dense, config.seed, config.device, shapes(plan))
    return plan.stage("dense_small", train, settings, *inputs_of_size(plan))


def train(context: StageContext) -> None:
    """Choose the width, and train the networks on Eq. 1."""
    from replicate.baselines import dense

    settings = context.config
    hidden = narrow_widths(context.inputs, settings.section.hidden, settings.shapes)
    narrow = replace(settings, section=replace(settings.section, hidden=hidden))
    context.note(hidden=list(hidden))
    facts = dense.shape_facts(narrow.section)
    train_on_segments(replace(context, config=narrow), dense.make_network, facts, dense.save)


def narrow_widths(inputs: Mapping[str, Path], hidden: tuple[int, ...], shapes: RefinedShapes) -> tuple[int, ...]:
    """Return the widths of the hidden layers: those of `dense`, the last cut so that the model is no larger.

    Raises InputError if the other layers alone are as large.
    """
    size_mb = refined_size_mb(inputs, shapes)
    segments = artefacts.load_coarse_segments(inputs, artefacts.load_mesh(inputs))
    seen, moved = (
        [len(part) for part in parts] for parts in zip(*((s.parameters, s.vertices) for s in segments), strict=True)
    )
    width = dense_width(seen, moved, hidden[:-1], size_mb)
    if width < 1:
        raise InputError(
            f"dense.hidden is {list(hidden)}: its layers before the last are as large as the refined model, "
            f"{size_mb:.2f} MB; choose narrower ones"
        )
    return (*hidden[:-1], min(width, hidden[-1]))


METHOD = variant(
    dense_network.METHOD,
    "dense_small",
    "Dense, narrow",
    64.5,
    stages=lambda plan: (stage(plan),),
    note="Dense networks whose last hidden layer is so narrow that the model is no larger than the refined one.",
)
