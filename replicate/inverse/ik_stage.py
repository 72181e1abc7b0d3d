"""The artefacts "inverse_…": IK networks that are trained through an approximation, or through the rig itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from data_recipes.rig import Rig
from replicate.engine.stage import Stage, StageContext, stage_function
from replicate.inverse.control_points import InverseConfig, control_points, default_section
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan, TrainingSettings, reference

if TYPE_CHECKING:
    import replicate.inverse.ik_network

RIG = "rig"  # instead of an approximation's name
PREFIX = "inverse"
LOG = "log.csv"


@dataclass(frozen=True)
class ThroughModel(TrainingSettings):
    """The training's settings. model: "module:function" of the approximation's `model`; "" for the rig itself."""

    model: str


def section(plan: Plan) -> InverseConfig:
    """Return the settings of inverse kinematics in a plan's configuration."""
    return getattr(plan.config, PREFIX, None) or default_section(plan.config.profile)


def stage_name(approximation: str) -> str:
    """Return the name of the stage for a method's name, or for RIG."""
    return f"{PREFIX}_{approximation}"


def stage(plan: Plan, method: Method | None) -> Stage:
    """Return the stage that trains the IK networks through a method's model; through the rig where it is None."""
    model, stages = (reference(method.model), method.stages(plan)) if method else ("", ())
    settings = ThroughModel(section(plan), plan.config.seed, plan.config.device, model)
    common = tuple(stage(plan) for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.influence_stage))
    names = {known.name for known in common}
    inputs = (*common, *(needed for needed in stages if needed.name not in names))
    functions = ",".join([reference(train), *([model] if model else [])])  # the model's sources count too
    return plan.stage(stage_name(method.name if method else RIG), functions, settings, *inputs)


def train(context: StageContext, rig: Rig | None = None) -> None:
    """Train the IK networks (§4.2) and write model and log.

    rig: one with other control points than the artefact's, some of whose regions may stand still.
    """
    from replicate.approximation.training import write_log
    from replicate.inverse.ik_network import read_truth, save_ik, train_ik

    settings, samples = context.config, artefacts.load_samples(context.inputs)
    influence, with_others = artefacts.load_influence(context.inputs), rig is not None
    rig = rig or artefacts.load_rig(context.inputs)
    points = control_points(rig, influence, may_stand_still=with_others)
    model, log = train_ik(
        positions(context.inputs, settings.model, points.vertices),
        rig,
        points,
        read_truth(samples, rig.mesh.neutral, points),
        samples,
        settings.section,
        settings.seed,
        context.scratch,
        context.progress,
        context.name,
    )
    save_ik(model, context.out)
    write_log(log, context.out / LOG)
    context.note(size_mb=sum(weight.numel() for weight in model.parameters()) * 4 / 1e6)


def positions(inputs: Mapping[str, Path], model: str, vertices: Int[np.ndarray, " c"]) -> Callable:
    """Return raw rig parameters (b, m) → positions (b, c, 3) of some vertices in mm, by a model or by the rig."""
    import torch

    from replicate.inverse.at_vertices import at_vertices
    from replicate.inverse.posing import RigPoints

    if not model:
        return RigPoints(artefacts.load_rig(inputs), vertices)
    offsets = at_vertices(stage_function(model)(inputs), vertices)
    neutral = torch.from_numpy(artefacts.load_mesh(inputs).neutral[vertices])
    return lambda params: neutral + offsets(params)


def load(inputs: Mapping[str, Path], approximation: str) -> "replicate.inverse.ik_network.IkModel":
    """Return the IK networks that were trained through a method of that name, or through RIG."""
    from replicate.inverse.ik_network import load_ik

    return load_ik(inputs[stage_name(approximation)])
