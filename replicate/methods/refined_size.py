"""How large the refined model is under a configuration, for methods that are to be no larger."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.approximation.model_size import MapShape, cnn_size_mb, shape_of
from replicate.artefacts import built_rig, refinement_squares, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage
from replicate.methods.training_stage import inputs_of_networks


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
    return (*inputs_of_networks(plan), refinement_squares.stage(plan))


def refined_size_mb(inputs: Mapping[str, Path], shapes: RefinedShapes) -> float:
    """Return the size of coarse and refinement networks in MB of 10⁶ bytes, from their segments and shapes alone."""
    coarse = rigid_segments.load_coarse_segments(inputs, built_rig.load_mesh(inputs))
    seen = ([len(segment.parameters) for segment in part] for part in (coarse, refinement_squares.load(inputs)))
    return cnn_size_mb(*seen, shapes.coarse, shapes.refined)
