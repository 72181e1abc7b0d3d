"""The artefact "samples": training, validation and test poses with the rig's vertices at them (§3.5, §5.1)."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.artefacts import built_rig
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

if TYPE_CHECKING:
    import replicate.approximation.samples


def stage(plan: Plan) -> Stage:
    """Return the stage that draws the poses and evaluates the rig at them."""
    return plan.stage("samples", make, plan.numbers(plan.config.samples), built_rig.stage(plan))


def make(context: StageContext) -> None:
    """Draw the poses and evaluate the rig at them (§3.5)."""
    from replicate.approximation.samples import write_samples

    section, rig = context.config.section, built_rig.load(context.inputs)
    facts = write_samples(rig, section, context.out, context.rng, context.scratch, context.progress)
    context.note(**facts)


def load(inputs: Mapping[str, Path]) -> "replicate.approximation.samples.SampleSet":
    """Return the samples, memory-mapped."""
    from replicate.approximation.samples import SampleSet

    return SampleSet.open(inputs["samples"])
