"""The full approximation: the coarse networks, and finer maps over a few squares for the rest (§3.2, §3.3)."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, coarse
from replicate.methods.method import Method, Metric
from replicate.methods.plan import Plan
from replicate.methods.training_stage import write_training

if TYPE_CHECKING:
    import replicate.approximation.model
    import replicate.approximation.refinement


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the refinement networks."""
    inputs = inputs_of_refinement(plan, coarse.stage(plan))
    return plan.stage("refined", train, plan.training(plan.config.refinement), *inputs)


def inputs_of_refinement(plan: Plan, coarse_stage: Stage) -> tuple[Stage, ...]:
    """Return the stages whose artefacts refinement networks are trained on."""
    return (artefacts.rig_stage(plan), artefacts.samples_stage(plan), coarse_stage, artefacts.squares_stage(plan))


def train(context: StageContext) -> None:
    """Train the refinement networks on what the coarse ones leave (§3.2); a variant's on those of its variant."""
    train_on(context, coarse.load_trained(_coarse_beside(context.name), context.inputs))


def train_on(context: StageContext, coarse_model: "replicate.approximation.model.SegmentedModel") -> None:
    """Train refinement networks on what a coarse model leaves."""
    from replicate.approximation.cnn import save
    from replicate.approximation.refinement import train_refined

    settings, inputs = context.config, context.inputs
    model, log = train_refined(
        artefacts.load_mesh(inputs),
        coarse_model,
        artefacts.load_squares(inputs),
        artefacts.load_samples(inputs),
        settings.section,
        context.scratch,
        context.progress,
        settings.seed,
        settings.device,
    )
    save(model.residual, context.out, settings.section)
    write_training(context, model, log)


def load_trained(name: str, inputs: Mapping[str, Path]) -> "replicate.approximation.refinement.RefinedModel":
    """Return the refinement networks of the stage of this name, and the coarse ones that they were trained on."""
    from replicate.approximation.refinement import load_refined

    return load_refined(inputs[name], coarse.load_trained(_coarse_beside(name), inputs))


def _coarse_beside(name: str) -> str:
    return name.replace("refined", "coarse", 1)


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.refinement.RefinedModel":
    """Return the coarse and the refinement networks."""
    return load_trained("refined", inputs)


def facts(inputs: Mapping[str, Path], mesh: Mesh) -> list[Metric]:
    """Return how many refinement segments there are, and how many texels each vertex has in all."""
    residual = load_model(inputs).residual
    squares = {
        segment.name: (network.map_size, len(segment.vertices))
        for segment, network in zip(residual.segments, residual.networks, strict=True)
    }
    return [("refinement_segments", "count", len(squares)), *coarse.texels(coarse.map_sizes(inputs) | squares)]


METHOD = Method(
    "refined",
    "Refined",
    lambda plan: (coarse.stage(plan), stage(plan)),
    model=partial(load_trained, "refined"),
    place=20,
    in_paper=True,
    colour="#0072B2",
    facts=facts,
)
