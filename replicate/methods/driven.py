"""Linear blend skinning as a prediction: a network that sees rig parameters moves the bones of the largest skin."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, skinned
from replicate.methods.method import Method, Model
from replicate.methods.plan import Plan, TrainingSettings
from replicate.methods.training_stage import write_training


@dataclass(frozen=True)
class DrivenSettings(TrainingSettings):
    """What the network is trained with, and how many bones its skin has."""

    bones: int


def stage(plan: Plan) -> Stage:
    """Return the stage that trains the network; it needs the skin with the most bones."""
    config, bones = plan.config, max(plan.config.lbs.bones)
    settings = DrivenSettings(config.driven, config.seed, config.device, bones)
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan), skinned.stage(plan, bones))
    return plan.stage("driven", train, settings, *inputs)


def train(context: StageContext) -> None:
    """Train the network that moves a skin's bones by the rig parameters."""
    from replicate.baselines.skinning.bone_network import save, train_driven

    settings, skin = context.config, skinned.load_skin(context.inputs, context.config.bones)
    model, log = train_driven(
        artefacts.load_mesh(context.inputs),
        skin,
        artefacts.load_samples(context.inputs),
        settings.section,
        context.scratch,
        context.progress,
        settings.seed,
        settings.device,
    )
    save(model, skin, context.out, settings.section)
    write_training(context, model, log)


def load_model(inputs: Mapping[str, Path]) -> Model:
    """Return the skin with the network that poses it.

    The multiplications from rotation vectors to matrices are not counted.
    """
    from replicate.baselines.skinning.bone_network import load_driven

    return load_driven(inputs["driven"])


METHOD = Method(
    "driven",
    "LBS moved by a network",
    lambda plan: (stage(plan),),
    model=load_model,
    place=70,
    rigid_step=False,
    note="The skin with the most bones, moved by a small network that sees rig parameters: LBS as a prediction.",
    mark="◊",
    colour="#F0E442",
    in_figures=False,
    standard=False,
)
