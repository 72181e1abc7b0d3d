"""The paper's networks, trained in full as its text prints: what it leaves open is read in four ways.

Printed: Eq. 1 with α = 5 and positions in millimetres, batches of 8, balanced draws, and the learning rates 1e-3, 1e-4
and 1e-5 one after the other. Nothing that the text doesn't name is added: offsets are in one unit, and gradients not
bounded. The text has no number of steps, its released code 70,000; so many are made at every profile but `quick`.

Left open: the units of controls and offsets, and the first weights. Four readings:

- `…_printed`: controls as the rig has them, most of them from 0 to 1, weights of He et al. (2015);
- `…_printed_ranges`: controls in ranges like those of Ray's, degrees beside lengths;
- `…_printed_code`: these ranges, and the first weights of the released code;
- `…_printed_unit`: these ranges, and offsets in the unit of length of Ray's rig, as networks of its rig give them.

Errors are weighed in millimetres by all of them. What the text and the code say differently, α and batch, is the text's
here and the code's in `replicate.methods.released`.
"""

from dataclasses import replace
from functools import partial
from itertools import product

from replicate.config import PROFILES, CoarseConfig, ConditioningConfig, DenseConfig, RefinementConfig
from replicate.engine.stage import Stage
from replicate.methods import coarse, dense_network, refined, released
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

UNIT_MM = 1.0  # of the networks' outputs: millimetres, as they are
READINGS = {  # of what the text leaves open, by the end of the methods' names
    "": ConditioningConfig("raw", UNIT_MM, "he"),
    "_ranges": ConditioningConfig("released", UNIT_MM, "he"),
    "_code": ConditioningConfig("released", UNIT_MM, "released"),
    "_unit": ConditioningConfig("released", released.UNIT_MM, "he"),
}
WORDS = {
    "": ("as printed", "controls as the rig has them, first weights of He et al."),
    "_ranges": ("as printed, Ray's ranges", "controls in ranges like Ray's, first weights of He et al."),
    "_code": ("as printed, code's start", "controls in ranges like Ray's, first weights as in the released code."),
    "_unit": (
        "as printed, Ray's units",
        "controls in ranges like Ray's, offsets in its unit, first weights of He et al.",
    ),
}
SECTIONS = {"coarse": CoarseConfig(), "refinement": RefinementConfig(), "dense": DenseConfig()}  # the paper's values
KINDS = {"coarse": coarse.METHOD, "refinement": refined.METHOD, "dense": dense_network.METHOD}


def section_of(kind: str, reading: str, profile: str) -> CoarseConfig | RefinementConfig | DenseConfig:
    """Return the section of some networks as the text prints it.

    kind: a key of `SECTIONS`.
    reading: a key of `READINGS`.
    profile: "quick" has its own number of steps.
    """
    section = SECTIONS[kind]
    steps = PROFILES[profile][kind]["training"]["steps"] if profile == "quick" else section.training.steps
    return replace(section, training=replace(section.training, steps=steps), conditioning=READINGS[reading])


def stage(plan: Plan, kind: str, reading: str) -> Stage:
    """Return the stage that trains some networks by one reading. kind, reading: as for `section_of`."""
    method = next(method for method in METHODS if method.name == _name(kind, reading))
    training = plan.training(method.section(plan.config))
    if kind == "refinement":
        inputs = refined.inputs_of_refinement(plan, stage(plan, "coarse", reading))
        return plan.stage(method.name, refined.train, training, *inputs)
    train = coarse.train if kind == "coarse" else dense_network.train
    return plan.stage(method.name, train, training, *inputs_of_networks(plan))


def _name(kind: str, reading: str) -> str:
    return f"{KINDS[kind].name}_printed{reading}"


def _row(kind: str, reading: str, place: float) -> Method:
    kinds = ("coarse", kind) if kind == "refinement" else (kind,)
    label, words = WORDS[reading]
    return variant(
        KINDS[kind],
        _name(kind, reading),
        f"{KINDS[kind].label}, {label}",
        place,
        stages=lambda plan: tuple(stage(plan, each, reading) for each in kinds),
        default_section=partial(section_of, kind, reading),
        note=f"Trained in full as the paper's text prints: {words}",
    )


METHODS = tuple(
    _row(kind, reading, 65 + 0.05 * place) for place, (reading, kind) in enumerate(product(READINGS, SECTIONS))
)
