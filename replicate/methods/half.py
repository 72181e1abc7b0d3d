"""The paper's networks with their weights rounded to 16 bits, so that sizes stand beside ours at one precision.

Nothing is trained: the weights of `coarse`, `refined` and `dense` are rounded to float16, computed with in float32 as
an engine does that reads such a file, and measured like any other model. Our method stores 8 and 16 bits.
"""

from dataclasses import dataclass

from replicate.base.exceptions import InputError
from replicate.engine.stage import Stage, StageContext
from replicate.engine.store import read_manifest
from replicate.methods import coarse, dense_network, refined
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan

NOTE = "Trained as the row without “16 bits”, then rounded to float16."
WEIGHTS, DESCRIPTION = "weights.safetensors", "model.json"
LARGEST = 65_504  # of float16
COARSE, REFINED, DENSE = "coarse_half", "refined_half", "dense_half"


@dataclass(frozen=True)
class RoundedModel:
    """The settings of a stage that rounds a model. of: the stage that trained it."""

    of: str


def stage(plan: Plan, name: str, trained: Stage) -> Stage:
    """Return the stage that rounds a trained model; it keeps the name of the row for the row's size."""
    return plan.stage(name, round_weights, RoundedModel(trained.name), trained)


def round_weights(context: StageContext) -> None:
    """Write a model whose weights are those of a trained one, each rounded to the nearest float16.

    Raises InputError for weights that float16 can't hold.
    """
    from safetensors.torch import load_file, save_file

    folder = context.inputs[context.config.of]
    arrays = load_file(folder / WEIGHTS)
    for name, values in arrays.items():
        if values.is_floating_point() and not name.startswith("segment."):
            if not values.abs().max() <= LARGEST:
                raise InputError(f"{context.config.of}: float16 holds numbers up to {LARGEST:,}, got larger weights")
            arrays[name] = values.half().float()
    save_file(arrays, context.out / WEIGHTS)
    (context.out / DESCRIPTION).write_bytes((folder / DESCRIPTION).read_bytes())
    context.note(size_mb=read_manifest(folder)["notes"]["size_mb"] / 2)


def coarse_stages(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages that train the coarse networks and round them."""
    trained = coarse.stage(plan)
    return trained, stage(plan, COARSE, trained)


def refined_stages(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages that train both levels of networks, on unrounded ones, and round both."""
    trained = refined.stage(plan)
    return *coarse_stages(plan), trained, stage(plan, REFINED, trained)


def dense_stages(plan: Plan) -> tuple[Stage, ...]:
    """Return the stages that train the dense networks and round them."""
    trained = dense_network.stage(plan)
    return trained, stage(plan, DENSE, trained)


def _row(method: Method, name: str, place: float, **functions: object) -> Method:
    return variant(method, name, f"{method.label}, 16 bits", place, note=NOTE, **functions)


METHODS = (
    _row(coarse.METHOD, COARSE, 67, stages=coarse_stages),
    _row(refined.METHOD, REFINED, 67.3, stages=refined_stages),
    _row(dense_network.METHOD, DENSE, 67.6, stages=dense_stages),
)
