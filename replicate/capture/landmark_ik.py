"""The artefacts "capture_ik_…": the IK networks of §4 with landmarks as their control points (§5.3.2)."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.artefacts.plan import Plan, reference
from replicate.capture import landmark_rig
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods.method import Method

if TYPE_CHECKING:
    import replicate.inverse.ik_network

PREFIX = "capture_ik"


def stage_name(approximation: str) -> str:
    """Return the name of the stage for a method's name."""
    return f"{PREFIX}_{approximation}"


def stage(plan: Plan, method: Method) -> Stage:
    """Return the stage that trains the networks through a method's model, as `ik_stage` does."""
    other = ik_stage.stage(plan, method)
    functions = ",".join([reference(train), reference(method.model)])
    return plan.stage(stage_name(method.name), functions, other.config, *other.inputs, landmark_rig.stage(plan))


def train(context: StageContext) -> None:
    """Train the IK networks (§4.2) on the landmarks of the samples."""
    ik_stage.train(replace(context, inputs=landmark_rig.as_rig(context.inputs)))


def load(inputs: Mapping[str, Path], approximation: str) -> "replicate.inverse.ik_network.IkModel":
    """Return the networks that were trained through a method of that name."""
    from replicate.inverse.ik_network import load_ik

    return load_ik(inputs[stage_name(approximation)])
