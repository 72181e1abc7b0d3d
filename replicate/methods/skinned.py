"""Linear blend skinning by SSDR, with bones refitted to each test pose: an oracle, as in the paper (§5.1)."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.config import Config, LbsConfig
from replicate.engine.stage import Stage, StageContext, stream_rng
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method, Number
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.baselines.skinning.ssdr

FILE = "skin.npz"
GREYS = {16: "#BBBBBB", 24: "#888888", 32: "#555555"}
NOTE = "An oracle: its bones are refitted to the true mesh of each test pose; it is no function of rig parameters."


@dataclass(frozen=True)
class SkinNumbers:
    """What a skin depends on: of the configuration's section "lbs" what the fit needs, and no more."""

    bones: int
    influences: int
    samples: int
    relaxed: int
    iterations: int
    coherence: float
    seed: int


@dataclass(frozen=True)
class RefitNumbers:
    """Which skin is posed, and when the sweeps over its bones end (see `skinning.ssdr.refit`)."""

    bones: int
    sweeps: int
    settled: float


def stage(plan: Plan, bones: int) -> Stage:
    """Return the stage that fits a skin with some number of bones."""
    lbs = plan.config.lbs
    numbers = SkinNumbers(
        bones, lbs.influences, lbs.samples, lbs.relaxed, lbs.iterations, lbs.coherence, plan.config.seed
    )
    return plan.stage(f"lbs{bones}", fit_skin, numbers, artefacts.rig_stage(plan), artefacts.samples_stage(plan))


def fit_skin(context: StageContext) -> None:
    """Fit bones and weights to training poses, the same poses for every number of bones."""
    from replicate.baselines.skinning.ssdr import fit

    numbers, mesh, samples = context.config, artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    poses = samples.draw(stream_rng(numbers.seed, "lbs", "poses"), min(numbers.samples, len(samples)))
    skin = fit(
        mesh.neutral,
        mesh.neutral + samples.offsets(poses),
        numbers.bones,
        context.rng("sketch"),
        numbers.influences,
        numbers.iterations,
        context.scratch,
        context.progress,
        mesh.faces,
        numbers.coherence,
        numbers.relaxed,
    )
    skin.save(context.out / FILE)


def load_skin(inputs: Mapping[str, Path], bones: int) -> "replicate.baselines.skinning.ssdr.Skin":
    """Return the skin with some number of bones."""
    from replicate.baselines.skinning.ssdr import Skin

    return Skin.load(inputs[f"lbs{bones}"] / FILE)


def load(inputs: Mapping[str, Path], numbers: RefitNumbers) -> Callable:
    """Return (parameters, truth (b, n, 3)) → vertices of the skin in the poses that come nearest to the truth."""
    from replicate.baselines.skinning.ssdr import refit

    skin = load_skin(inputs, numbers.bones)
    return lambda params, truth: skin.deform(*refit(skin, truth, numbers.sweeps, numbers.settled))


def facts(inputs: Mapping[str, Path], mesh: Mesh) -> list[Number]:
    """Return the skin's size: a weight and a bone's index, 32 bits each, for every influence of every vertex."""
    (bones,) = {int(name.removeprefix("lbs")) for name in inputs if re.fullmatch(r"lbs\d+", name)}
    return [("model_size", "MB", 8 * load_skin(inputs, bones).weights.size / 1e6)]


def multiplications(inputs: Mapping[str, Path], numbers: RefitNumbers) -> int:
    """Return how many multiplications the blend of one pose takes; finding its bones from the truth is left out."""
    from replicate.baselines.multiplications import of_blend

    return of_blend(load_skin(inputs, numbers.bones).weights)


def _stages(plan: Plan, bones: int) -> tuple[Stage, ...]:
    return (stage(plan, bones),)


def _refit_numbers(config: Config, bones: int) -> RefitNumbers:
    return RefitNumbers(bones, config.lbs.refit_sweeps, config.lbs.refit_settled)


def method(bones: int) -> Method:
    """Return the row of a skin with some number of bones."""
    return Method(
        f"lbs{bones}",
        f"LBS: {bones} bones",
        partial(_stages, bones=bones),
        load,
        place=40 + bones / 1000,
        oracle=True,
        rigid_step=False,
        in_paper=True,
        note=NOTE,
        mark="†",
        colour=GREYS.get(bones, GREYS[24]),
        numbers=partial(_refit_numbers, bones=bones),
        facts=facts,
        multiplications=multiplications,
    )


def methods_of(config: Config | None) -> tuple[Method, ...]:
    """Return the rows of a configuration's numbers of bones, the paper's where there is none."""
    return tuple(method(bones) for bones in (config.lbs if config else LbsConfig()).bones)


def method_named(name: str) -> Method | None:
    """Return the row "lbs64" of any number of bones, None for another name."""
    bones = re.fullmatch(r"lbs([1-9]\d{0,3})", name)
    return method(int(bones[1])) if bones else None
