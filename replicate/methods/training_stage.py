"""What methods with trained networks share: training on coarse segments, and what is written of it."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from replicate.artefacts import built_rig, control_influence, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

if TYPE_CHECKING:
    import replicate.approximation.model
    import replicate.approximation.refinement

LOG = "log.csv"


def inputs_of_networks(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages that a network for each coarse segment is trained on."""
    return tuple(module.stage(plan) for module in (built_rig, drawn_samples, control_influence, rigid_segments))


def train_on_segments(
    context: StageContext,
    make_network: Callable,
    facts: dict,
    save: Callable,
    lines: "replicate.approximation.model.SegmentedModel | None" = None,
) -> None:
    """Train one network a coarse segment and write model and log; the stage's name is the training's stream.

    lines: straight lines that the networks learn to add to, and that become part of the model; none by default.
    """
    from replicate.approximation.conditioning import input_scale
    from replicate.approximation.linear_skip import add_line
    from replicate.approximation.segment_training import train_segments

    numbers, mesh = context.config, built_rig.load_mesh(context.inputs)
    samples, segments = drawn_samples.load(context.inputs), rigid_segments.load_coarse_segments(context.inputs, mesh)
    networks = [make_network(segment, facts) for segment in segments]
    scale = input_scale(numbers.section.conditioning, samples.params, lambda: built_rig.load(context.inputs))
    model, log = train_segments(
        mesh,
        segments,
        networks,
        samples,
        numbers.section,
        context.scratch,
        context.progress,
        context.name,
        numbers.seed,
        scale,
        numbers.device,
        lines,
    )
    model = model if lines is None else add_line(model, lines)
    save(model, context.out, numbers.section)
    write_training(context, model, log)


def write_training(
    context: StageContext,
    model: "replicate.approximation.model.SegmentedModel | replicate.approximation.refinement.RefinedModel",
    log: list[dict],
) -> None:
    """Write a training's log beside its model, and note the model's size."""
    from replicate.approximation.training import write_log

    write_log(log, context.out / LOG)
    context.note(size_mb=model.size_mb())
