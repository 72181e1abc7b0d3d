"""What methods with trained networks share: training on coarse segments, and what they write."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.approximation.model

LOG = "log.csv"


def inputs_of_networks(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages whose artefacts the networks of coarse segments are trained on."""
    return tuple(
        stage(plan)
        for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.influence_stage, artefacts.rigid_stage)
    )


def train_on_segments(
    context: StageContext,
    make_network: Callable,
    facts: dict,
    save: Callable,
    lines: "replicate.approximation.model.SegmentedModel | None" = None,
) -> None:
    """Train a network for each coarse segment, and write model and log; the stage's name is the stream of draws.

    make_network: (segment, facts) → the network.
    facts: the networks' shape.
    save: (model, folder, section) → None; writes the model.
    lines: straight lines that the networks add to, which become part of the model; none by default.
    """
    from replicate.approximation.conditioning import input_scale
    from replicate.approximation.training import train_segments
    from replicate.baselines.line import add_line

    settings, mesh = context.config, artefacts.load_mesh(context.inputs)
    samples, segments = artefacts.load_samples(context.inputs), artefacts.load_coarse_segments(context.inputs, mesh)
    networks = [make_network(segment, facts) for segment in segments]
    scale = input_scale(settings.section.conditioning, samples.params, lambda: artefacts.load_rig(context.inputs))
    model, log = train_segments(
        mesh,
        segments,
        networks,
        samples,
        settings.section,
        context.scratch,
        context.progress,
        context.name,
        settings.seed,
        scale,
        settings.device,
        lines,
    )
    model = model if lines is None else add_line(model, lines)
    save(model, context.out, settings.section)
    write_training(context, model, log)


@runtime_checkable
class WithSize(Protocol):
    """A model that knows its size."""

    def size_mb(self) -> float:
        """Return the size of what is stored, in MB of 10⁶ bytes."""
        ...


def write_training(context: StageContext, model: WithSize, log: list[dict]) -> None:
    """Write a training's log beside its model, and note the model's size."""
    from replicate.approximation.training import write_log

    write_log(log, context.out / LOG)
    context.note(size_mb=model.size_mb())
