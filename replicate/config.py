"""The configuration of a run, as frozen dataclasses whose defaults are the paper's values.

A profile overrides some of them, and a TOML file (`CONFIG=file.toml`) may override more; an unknown key or a value
out of range is an InputError. The resolved configuration is stored with every artefact and is part of its key.
"""

import dataclasses
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from data_recipes.recipe_paths import (
    LABEL,
    SHAPE_ENDINGS,
    character_label,
    named,
    no_character,
    recipe_file,
    sample_folder,
    shape_file,
    split_character,
)
from replicate.base.exceptions import InputError
from replicate.base.schema import LONGEST, Checked, naming, number, read_table, shown
from replicate.base.spelling import meant, nothing_named
from replicate.base.user_files import is_file, read_toml, shown_path

LARGEST_SEED = 2**32 - 1
START = 8  # pixels a side of the maps that the dense layers make


@dataclass(frozen=True)
class SamplesConfig(Checked):
    """How the training and test poses are made (§3.5, §5.1)."""

    count: int = number(50_000, 1, 10_000_000)
    low: float = number(0.25, 0.0, 100.0)  # the factors of Eq. 5
    high: float = number(3.0, 0.01, 100.0)
    bins: int = number(16, 1, 10_000)
    split: Literal["frames", "clips"] = "frames"
    held_out: float = number(0.1, 0.001, 0.9)  # share of the animation that makes the test poses
    validation: int = number(64, 1, 100_000)  # training poses held out, to watch the training (D6)
    uniform_test: int = number(5_000, 1, 1_000_000)  # test poses of a rig without clips

    def __post_init__(self):
        super().__post_init__()
        if self.high < self.low:
            raise InputError(f"high: expected a number of at least low, {self.low}, got {self.high!r}")


@dataclass(frozen=True)
class TrainingConfig(Checked):
    """The schedule of one network's training (§3.5; DEVIATIONS D6)."""

    schedule: Literal["paper", "one_cycle", "two_cycles"] = "paper"
    steps: int = number(70_000, 1, 2_000_000)
    batch: int = number(8, 1, 4096)
    draws: Literal["balanced", "uniform"] = "balanced"  # of training samples: as in §3.5, or all equally often
    rates: tuple[float, ...] = number((1e-3, 1e-4, 1e-5), 1e-9, 1.0)  # "paper": one after the other
    shares: tuple[float, ...] = number((5.0, 1.0, 1.0), 0.0, 1e6)  # of the steps that each rate gets
    peak_rate: float = number(2e-3, 1e-9, 1.0)  # of a cycle: linear warm-up to it, cosine decay from it
    warm_up: float = number(0.05, 0.0, 0.9)  # share of the steps
    largest_gradient: float = number(0.0, 0.0, 1e6)  # longer ones are shortened to it; 0: no limit

    def __post_init__(self):
        super().__post_init__()
        if len(self.shares) != len(self.rates) or sum(self.shares) <= 0:
            expected = f"{len(self.rates)} numbers, as many as rates, not all of them 0"
            raise InputError(f"shares: expected {expected}, got {shown(self.shares)}")


@dataclass(frozen=True)
class ConditioningConfig(Checked):
    """How large a network's inputs, outputs and first weights are (DEVIATIONS D8)."""

    # rig parameters by the largest value of each, as the rig has them, or in ranges like those of Ray's controls
    inputs: Literal["largest", "raw", "released"] = "largest"
    unit_mm: float = number(0.0, 0.0, 1e6)  # the length that outputs are in; 0: the RMS of the segment's targets
    weights: Literal["he", "released"] = "he"  # the first: He et al. (2015), or as in the released code


def _check_maps(size: int, hidden: tuple[int, ...]) -> None:
    if size & (size - 1):
        raise InputError(f"map_size: expected a power of two, since each level doubles the 8×8 maps, got {size}")
    if hidden[-1] % START**2:
        raise InputError(
            f"hidden: expected a multiple of {START**2} as its last width, for maps of 8×8 pixels, got {shown(hidden)}"
        )


@dataclass(frozen=True)
class CoarseConfig(Checked):
    """The coarse approximation: a CNN per segment (§3.1–3.2, Fig. 3)."""

    map_size: int = number(32, 16, 1024)
    channels: int = number(16, 1, 1024)
    hidden: tuple[int, ...] = number((256, 512), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(5.0, 0.0, 1e6)  # α of Eq. 1, with positions in mm
    conditioning: ConditioningConfig = ConditioningConfig()
    training: TrainingConfig = TrainingConfig()

    def __post_init__(self):
        super().__post_init__()
        _check_maps(self.map_size, self.hidden)


@dataclass(frozen=True)
class RefinementConfig(Checked):
    """The refinement: where it is needed, and its CNNs (§3.3)."""

    map_size: int = number(64, 16, 1024)
    channels: int = number(16, 1, 1024)
    hidden: tuple[int, ...] = number((256, 512), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(5.0, 0.0, 1e6)
    square: float = number(0.25, 0.01, 1.0)  # side of a segment, in widths of a chart
    clusters_max: int = number(10, 2, 64)  # the most clusters that are tried
    poses: int = number(1_000, 1, 1_000_000)  # training poses that Eq. 2 is averaged over
    conditioning: ConditioningConfig = ConditioningConfig()
    training: TrainingConfig = TrainingConfig()

    def __post_init__(self):
        super().__post_init__()
        _check_maps(self.map_size, self.hidden)


@dataclass(frozen=True)
class DenseConfig(Checked):
    """The dense baseline: an MLP per segment (§5.1)."""

    hidden: tuple[int, ...] = number((256, 256), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(5.0, 0.0, 1e6)
    conditioning: ConditioningConfig = ConditioningConfig()
    training: TrainingConfig = TrainingConfig()


@dataclass(frozen=True)
class RigidConfig(Checked):
    """The rigid segments and what they are attached to (§3.4)."""

    tau_mm: float = number(0.3, 0.0, 1000.0)  # on the mean of Eq. 3
    attachments: int = number(10, 3, 10_000)  # c of Eq. 4


@dataclass(frozen=True)
class LbsConfig(Checked):
    """Linear blend skinning fitted by SSDR (§5.1; Le and Deng 2012)."""

    bones: tuple[int, ...] = number((16, 24, 32), 1, 1024)
    influences: int = number(8, 1, 64)
    samples: int = number(1_000, 2, 1_000_000)
    relaxed: int = number(60, 0, 100_000)  # iterations in which all bones may act on every vertex, before the others
    iterations: int = number(100, 1, 100_000)
    coherence: float = number(0.2, 0.0, 1e6)  # weight of the error's differences along edges, which normals see
    refit_sweeps: int = number(500, 1, 100_000)  # the most sweeps over the bones of a test pose
    refit_settled: float = number(1e-7, 0.0, 1.0)  # they stop when no bone moves by more, in radians and rest radii


@dataclass(frozen=True)
class DrivenConfig(Checked):
    """LBS that sees rig parameters: a network that moves the bones of the largest skin (not in the paper)."""

    hidden: tuple[int, ...] = number((256, 256), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    normal_weight: float = number(5.0, 0.0, 1e6)
    training: TrainingConfig = TrainingConfig()


@dataclass(frozen=True)
class EvaluationConfig(Checked):
    """What is measured and shown (§5.1)."""

    test_poses: int = number(0, 0, 10_000_000)  # size of a random subset of the unique test poses; 0: all, as the paper
    batch: int = number(32, 1, 4096)  # test poses predicted at a time
    floor_poses: int = number(0, 0, 10_000_000)  # test poses that the projection floor is measured on; 0: all
    heatmap_deg: float = number(30.0, 0.1, 180.0)  # upper end of the colours, shared by all panels


@dataclass(frozen=True)
class ReportFitsConfig(Checked):
    """The regressions of `make rig-report`, and the basis whose coefficients they predict (not in the paper)."""

    samples: int = number(
        10_000, 2, 30_000
    )  # training samples at most; their products fill 0.8 GB, their factorisation as much
    basis_samples: int = number(2_000, 2, 20_000)  # training samples that the components are of
    components: int = number(512, 1, 20_000)  # at most; those of a face beyond these are of micrometres
    strengths: tuple[float, ...] = number((1e-7, 1e-6, 1e-5), 1e-15, 1e6)  # λ of the penalty
    poses: int = number(100, 1, 1_000_000)  # test poses that components are counted on


@dataclass(frozen=True)
class ReportPairsConfig(Checked):
    """The pairs of controls that `make rig-report` tries (not in the paper)."""

    count: int = number(2_000, 1, 1_000_000)
    poses: int = number(3, 0, 1_000)  # test poses that they are tried from, beside the default one


@dataclass(frozen=True)
class ReportMapsConfig(Checked):
    """The deformation maps that `make rig-report` projects poses onto (not in the paper)."""

    sizes: tuple[int, ...] = number((8, 16, 32, 64, 128), 2, 1024)  # widths in pixels
    poses: int = number(100, 1, 1_000_000)  # test poses


@dataclass(frozen=True)
class RigReportConfig(Checked):
    """How `make rig-report` measures how hard a rig is to approximate (not in the paper)."""

    fits: ReportFitsConfig = ReportFitsConfig()
    pairs: ReportPairsConfig = ReportPairsConfig()
    maps: ReportMapsConfig = ReportMapsConfig()


@dataclass(frozen=True)
class Config(Checked):
    """A run for one character."""

    character: str
    profile: str = "paper"
    seed: int = number(0, 0, LARGEST_SEED)
    device: Literal["cpu", "cuda"] = "cpu"
    samples: SamplesConfig = SamplesConfig()
    coarse: CoarseConfig = CoarseConfig()
    refinement: RefinementConfig = RefinementConfig()
    dense: DenseConfig = DenseConfig()
    rigid: RigidConfig = RigidConfig()
    lbs: LbsConfig = LbsConfig()
    driven: DrivenConfig = DrivenConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    rig_report: RigReportConfig = RigReportConfig()

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "character", named(self.character))
        recipe, folder = recipe_file(self.character), sample_folder(self.character)
        shapes = shape_file(self.character)
        name = split_character(self.character)[0]
        stem = character_label(self.character) if folder or shapes else recipe.stem
        if not is_file(recipe) and not folder and not shapes and not name.endswith(".toml"):
            raise InputError(no_character(name))
        if not re.fullmatch(LABEL, stem) or len(os.fsencode(stem)) > LONGEST:
            raise InputError(
                f"{'folder' if folder else 'recipe'} {shown_path(folder or recipe)}: folders can't be "
                f"called {shown(stem)}: expected at most {LONGEST} letters, digits, _, . and -"
            )
        if not is_file(recipe) and not (shapes and shapes.is_dir()):
            raise InputError(f"{shown_path(recipe)}: there is no such {_kind_and_remedy(recipe, folder, shapes)}")


def _kind_and_remedy(recipe: Path, folder: Path | None, shapes: Path | None) -> str:
    """Return what a character's missing file would be, and what to do: "file; did you mean head.glb?"."""
    if folder:
        faces = _files_beside(folder, SHAPE_ENDINGS)
        by_itself = f"; {faces[0]} in this folder is a character by itself: name that file" if faces else ""
        return f"file, which a folder of samples has{by_itself or ' (REPRODUCING.md says what goes into it)'}"
    near = meant(recipe.name, _files_beside(recipe.parent, SHAPE_ENDINGS if shapes else (".toml",)))
    return ("file" if shapes else "recipe file") + (f"; did you mean {near}?" if near else "")


def _files_beside(folder: Path, endings: tuple[str, ...]) -> list[str]:
    try:
        return sorted(name for name in os.listdir(folder) if name.lower().endswith(endings))
    except OSError:
        return []


def with_sections(sections: Mapping[str, Checked]) -> type[Config]:
    """Return the class of configurations with more sections: those of methods that have settings.

    The same sections give the same class, so that configurations with equal values are equal.
    """
    return _with_fields(tuple(sections.items())) if sections else Config


@cache
def _with_fields(sections: tuple[tuple[str, Checked], ...]) -> type[Config]:
    fields = [(name, type(section), section) for name, section in sections]
    return dataclasses.make_dataclass("Config", fields, bases=(Config,), frozen=True)


def resolve(
    character: str,
    profile: str = "paper",
    overrides: dict | None = None,
    file: Path | None = None,
    sections: Mapping[str, Checked] | None = None,
    **values: object,
) -> Config:
    """Return the configuration of one character: the paper's values, overridden by the profile, a file and arguments.

    character: a name from `recipe_paths.character_names()`, or the path of a recipe or a folder of samples.
    profile: a key of `PROFILES`.
    overrides: a nested dict, as a TOML file would give.
    file: a TOML file of overrides.
    sections: more sections by name, with the profile's values.
    values: top-level fields, such as `seed=3`; None leaves a field as it is.

    Raises InputError for an unknown profile or key and for a value out of range.
    """
    check_profile(profile)
    config = read_table(with_sections(sections or {})(character=character, profile=profile), PROFILES[profile])
    if file is not None:
        config = _overridden(config, read_toml(file), shown_path(file))
    if overrides:
        config = _overridden(config, overrides, "overrides")
    return read_table(config, {name: value for name, value in values.items() if value is not None})


def _overridden(config: Config, overrides: dict, source: str) -> Config:
    for name in ("character", "profile", "seed", "device"):  # the command line's; a file may serve several runs
        if name in overrides:
            raise InputError(f"{source}: {name} can't be set here: use {name.upper()}{'S' * (name == 'character')}=")
    with naming(source):
        return read_table(config, overrides)


# The profiles: numbers of samples and steps, as overrides of the paper's values.

BEST = {"schedule": "one_cycle", "peak_rate": 5e-3, "draws": "uniform", "largest_gradient": 1.0}  # DEVIATIONS D6


def _one_cycle(steps: int) -> dict:
    return {"training": BEST | {"steps": steps}}


PROFILES: dict[str, dict] = {
    "quick": {
        "samples": {"count": 1_500, "uniform_test": 200},
        "coarse": _one_cycle(800),
        "refinement": {"poses": 200, **_one_cycle(500)},
        "dense": _one_cycle(600),
        "lbs": {"samples": 200, "relaxed": 10, "iterations": 15, "refit_sweeps": 40},
        "driven": _one_cycle(400),
        "evaluation": {"test_poses": 200, "floor_poses": 50},
        "rig_report": {"pairs": {"count": 500}, "maps": {"poses": 50}},
    },
    "laptop": {
        "samples": {"count": 10_000, "uniform_test": 1_000},
        "coarse": _one_cycle(22_000),
        "refinement": _one_cycle(10_000),
        "dense": _one_cycle(16_000),
        "driven": _one_cycle(8_000),
    },
    "paper": {},
}


def check_profile(profile: str) -> None:
    """Raise InputError for an unknown profile."""
    if profile not in PROFILES:
        others = f": there are {', '.join(PROFILES)}"
        raise InputError(nothing_named("profile", profile, PROFILES, others))
