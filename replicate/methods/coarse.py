"""The coarse approximation: for each segment a CNN that makes a map of offsets, which the vertices read (§3.1)."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods.method import Method, Metric
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks, train_on_segments

if TYPE_CHECKING:
    import replicate.approximation.model


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the coarse networks."""
    return plan.stage("coarse", train, plan.training(plan.config.coarse), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Train the coarse networks on Eq. 1."""
    from replicate.approximation import cnn

    train_on_segments(context, cnn.make_network, cnn.shape_facts(context.config.section), cnn.save)


def load_trained(name: str, inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the coarse networks of the stage of this name."""
    from replicate.approximation.cnn import load_coarse

    return load_coarse(inputs[name])


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the coarse networks."""
    return load_trained("coarse", inputs)


def map_sizes(inputs: Mapping[str, Path]) -> dict[str, tuple[int, int]]:
    """Return each map's width in pixels, and how many vertices read it, by its segment's name."""
    model = load_model(inputs)
    return {s.name: (net.map_size, len(s.vertices)) for s, net in zip(model.segments, model.networks, strict=True)}


def texels(maps: Mapping[str, tuple[int, int]]) -> list[Metric]:
    """Return how many texels each vertex has: in every map, and in all maps together."""
    ratios = {f"[{name}]": width**2 / vertices for name, (width, vertices) in maps.items()}
    ratios[""] = sum(width**2 for width, _ in maps.values()) / sum(vertices for _, vertices in maps.values())
    return [(f"texels_per_vertex{which}", "ratio", ratio) for which, ratio in ratios.items()]


def facts(inputs: Mapping[str, Path], mesh: Mesh) -> list[Metric]:
    """Return how many texels each vertex has."""
    return texels(map_sizes(inputs))


METHOD = Method(
    "coarse",
    "Coarse",
    lambda plan: (stage(plan),),
    model=partial(load_trained, "coarse"),
    place=10,
    in_paper=True,
    colour="#E69F00",
    facts=facts,
)
