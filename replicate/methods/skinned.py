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
from replicate.methods.method import Method, Metric
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.baselines.skinning.ssdr

FILE = "skin.npz"
GREYS = {16: "#BBBBBB", 24: "#888888", 32: "#555555"}
NOTE = "An oracle: its bones are refitted to the true mesh of each test pose; it is no function of rig parameters."


@dataclass(frozen=True)
class SkinSettings:
    """What a skin depends on: a part of the configuration's section "lbs", and the seed."""

    bones: int
    influences: int
    samples: int
    relaxed: int
    iterations: int
    coherence: float
    seed: int


@dataclass(frozen=True)
class RefitSettings:
    """Which skin is posed, and when the sweeps over its bones end (see `baselines.skinning.ssdr.refit`)."""

    bones: int
    sweeps: int
    settled: float


def stage(plan: Plan, bones: int) -> Stage:
    """Return the stage that fits a skin with that many bones."""
    lbs = plan.config.lbs
    settings = SkinSettings(
        bones, lbs.influences, lbs.samples, lbs.relaxed, lbs.iterations, lbs.coherence, plan.config.seed
    )
    return plan.stage(f"lbs{bones}", fit_skin, settings, artefacts.rig_stage(plan), artefacts.samples_stage(plan))


def fit_skin(context: StageContext) -> None:
    """Fit bones and weights to training poses, the same poses for every number of bones."""
    from replicate.baselines.skinning.ssdr import fit

    settings = context.config
    mesh, samples = artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    poses = samples.draw(stream_rng(settings.seed, "lbs", "poses"), min(settings.samples, len(samples)))
    skin = fit(
        mesh.neutral,
        mesh.neutral + samples.offsets(poses),
        settings.bones,
        context.rng("sketch"),
        settings.influences,
        settings.iterations,
        context.scratch,
        context.progress,
        mesh.faces,
        settings.coherence,
        settings.relaxed,
    )
    skin.save(context.out / FILE)


def load_skin(inputs: Mapping[str, Path], bones: int) -> "replicate.baselines.skinning.ssdr.Skin":
    """Return the skin with that many bones."""
    from replicate.baselines.skinning.ssdr import Skin

    return Skin.load(inputs[f"lbs{bones}"] / FILE)


def load(inputs: Mapping[str, Path], settings: RefitSettings) -> Callable:
    """Return (parameters, truth (b, n, 3)) → the vertices of the skin, posed as near to the truth as possible."""
    from replicate.baselines.skinning.ssdr import refit

    skin = load_skin(inputs, settings.bones)
    return lambda params, truth: skin.deform(*refit(skin, truth, settings.sweeps, settings.settled))


def facts(inputs: Mapping[str, Path], mesh: Mesh) -> list[Metric]:
    """Return the skin's size: a weight and a bone's index, 32 bits each, for every influence of every vertex."""
    (bones,) = {int(name.removeprefix("lbs")) for name in inputs if re.fullmatch(r"lbs\d+", name)}
    return [("model_size", "MB", 8 * load_skin(inputs, bones).weights.size / 1e6)]


def multiplications(inputs: Mapping[str, Path], settings: RefitSettings) -> int:
    """Return how many multiplications the blend of one pose needs, without finding its bones from the truth."""
    from replicate.baselines.multiplications import of_blend

    return of_blend(load_skin(inputs, settings.bones).weights)


def _stages(plan: Plan, bones: int) -> tuple[Stage, ...]:
    return (stage(plan, bones),)


def _refit_settings(config: Config, bones: int) -> RefitSettings:
    return RefitSettings(bones, config.lbs.refit_sweeps, config.lbs.refit_settled)


def method(bones: int) -> Method:
    """Return the row of a skin with that many bones."""
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
        settings=partial(_refit_settings, bones=bones),
        facts=facts,
        multiplications=multiplications,
    )


def methods_of(config: Config | None) -> tuple[Method, ...]:
    """Return the rows of a configuration's numbers of bones, of the paper's for None."""
    return tuple(method(bones) for bones in (config.lbs if config else LbsConfig()).bones)


def method_named(name: str) -> Method | None:
    """Return the row "lbs64" of any number of bones, None for another name."""
    bones = re.fullmatch(r"lbs([1-9]\d{0,3})", name)
    return method(int(bones[1])) if bones else None
