"""The options of the command line, and the characters, seeds and methods that they name."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from data_recipes.recipe_paths import OUTSIDE, character_label, character_names, named, recipe_file
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.schema import either, shown
from replicate.base.user_files import whole_number, words
from replicate.capture.capture_config import default_section as capture_section
from replicate.config import LARGEST_SEED, PROFILES, Config, check_profile, resolve
from replicate.engine.cluster.config import is_elsewhere
from replicate.engine.device import choose_device
from replicate.engine.provenance import core_count
from replicate.inverse.control_points import default_section as inverse_section
from replicate.methods import method_registry as registry
from replicate.methods.method import Method
from replicate.methods.plan import Plan

MOST_JOBS = 1024
SPLITS = ("frames", "clips")
OF_A_RUN = ("profile", "characters", "seed", "device", "config", "split", "jobs", "cluster")
OPTIONS = {
    "profile": {"default": "laptop", "help": f"one of {', '.join(PROFILES)} (default: laptop)"},
    "characters": {
        "nargs": "+",
        "help": f"names, of {', '.join(character_names())}, or paths of .toml recipes, of .glb files or of "
        "folders; "
        + ", ".join(f"{name} needs {variable}=folder in the environment" for name, variable in OUTSIDE.items()),
    },
    "methods": {
        "nargs": "+",
        "default": ["standard"],
        "help": "the rows: names, all, lbs for all numbers of bones, printed for the recipe of the text (hours), "
        'or .py files with a method of your own, as "standard mine.py" (default: standard, the rows of README)',
    },
    "seed": {
        "default": ["0"],
        "nargs": "+",
        "help": "the seeds that all random streams come from; tables show the mean over them (default: 0)",
    },
    "device": {"default": "auto", "help": "auto, cpu or cuda (default: CUDA if there is one, else the CPU)"},
    "jobs": {"help": f"processes side by side (default: one a core, here {core_count()})"},
    "cluster": {
        "metavar": "WHERE",
        "help": "run the stages on Dask: local:4, tcp://host:8786, or a .toml file for Slurm (default: processes here)",
    },
    "numbers-only": {"action": "store_true", "help": "write the CSV and its manifest, no figures and no notebook"},
    "add-seeds": {
        "action": "store_true",
        "help": "the seeds of Table 2 join those committed of the same characters, instead of replacing them",
    },
    "config": {"metavar": "FILE", "help": "a TOML file whose keys override the profile's, as [coarse] map_size = 64"},
    "latex": {"action": "store_true", "help": "print LaTeX (packages: booktabs) instead of text"},
    "split": {"help": f"{' (as in the paper) or '.join(SPLITS)}: what is held out for the test"},
    "pose": {"help": "an expression, as joy; a wrong name lists them (default: neutral)"},
    "clip": {"help": "a clip's name, or its number from 0; a wrong one lists them"},
    "params": {
        "metavar": "FILE",
        "help": "a CSV file whose header names controls: one row is a pose, several are a clip of 24 frames a second; "
        "or a .json that the posing page saved",
    },
    "form": {
        "default": "vertices",
        "help": "what models give: vertices (default), or the weights of shapes, which are morph targets of a GLB",
    },
    "onto": {
        "nargs": "+",
        "default": [],
        "help": "other characters whose faces the networks move as well: names or recipes, as for --characters",
    },
    "landmarks": {
        "metavar": "FILE",
        "help": "a recording as Live Link Face, OpenFace 2 or MediaPipe writes it, or a CSV file of an actor's "
        "landmarks: frame,landmark,x_mm,y_mm with y up, or frame,landmark,x_px,y_px in pixels of the picture with y "
        "down; 54 lines a frame, 24 frames a second; the neutral expression first",
    },
    "to": {
        "metavar": "FILE",
        "help": "the .glb, .usd, .usda, .usdc or .abc (metres) or, for a pose, .obj (mm) to write (default: a .glb in "
        "results/runs/export); USD needs the extra `usd`, and Alembic bpy or Blender as well",
    },
    "tolerance": {
        "type": float,
        "default": 0.05,
        "metavar": "MM",
        "help": "how far a clip's vertices may be from the rig's: smaller makes larger files; 0 writes the points of "
        "every frame into a USD (default: 0.05 mm)",
    },
    "all": {
        "action": "store_true",
        "help": "leave nothing out: `clean` removes all that this suite has put there, `compare` prints the rows that "
        "your results lack too",
    },
    "details": {
        "action": "store_true",
        "help": "`status` prints a line for every artefact, with hash and state; `reproduce` says what it would do",
    },
}


def configurations(options: argparse.Namespace) -> list[Config]:
    """Return the configuration of every character and seed that the command line names."""
    check_profile(options.profile)  # before methods are asked for their settings
    device = choose_device(options.device, elsewhere=is_elsewhere(getattr(options, "cluster", None)))
    if options.split and options.split not in SPLITS:
        raise InputError(f"split: expected {either(SPLITS)}, got {shown(options.split)}")
    overrides = {"samples": {"split": options.split}} if options.split else None
    file = paths.with_home(options.config, "CONFIG") if options.config else None
    registry.choose(words(getattr(options, "methods", "")))  # also imports those from outside, which may have sections
    sections = registry.sections(options.profile)
    sections |= {"inverse": inverse_section(options.profile), "capture": capture_section(options.profile)}
    return [
        resolve(character, options.profile, overrides, file, sections, seed=seed, device=device)
        for character in characters(options)
        for seed in seeds(options)
    ]


def characters(options: argparse.Namespace) -> list[str]:
    """Return the characters that are named, each recipe once; raise InputError if two recipes have one label."""
    recipes: dict[str, tuple[Path, str]] = {}
    for character in map(named, words(options.characters)):
        file, label = recipe_file(character), character_label(character)
        first, _ = recipes.setdefault(label, (file, character))
        if first != file:
            both = f"{paths.display_path(first)} and {paths.display_path(file)}"
            raise InputError(f"{both} would both be {label!r} in the results: rename one of them")
    if not recipes:
        raise InputError(f"no character is named: expected {either(character_names())}")
    return [character for _, character in recipes.values()]


def seeds(options: argparse.Namespace) -> list[int]:
    """Return the seeds that are named, each once; 0 if there are none."""
    return list(dict.fromkeys(whole_number(seed, "seed", 0, LARGEST_SEED) for seed in words(options.seed))) or [0]


def methods(options: argparse.Namespace, config: Config) -> Sequence[Method]:
    """Return the methods that are named, for one configuration, in the order of the tables."""
    return registry.choose(words(options.methods), config)


def others(options: argparse.Namespace, plan: Plan) -> list[str]:
    """Return the characters that `onto` names, each once, except the plan's character."""
    by_label = {character_label(character): character for character in map(named, words(options.onto))}
    return [character for label, character in by_label.items() if label != plan.character]


def workers(options: argparse.Namespace) -> int:
    """Return how many processes work side by side on this machine."""
    if options.jobs is None:
        return core_count()
    count = whole_number(options.jobs, "jobs", 1, MOST_JOBS)
    if getattr(options, "cluster", None):
        jobs, cluster = f"JOBS={count}", f"CLUSTER={options.cluster}"
        raise InputError(f"{jobs} counts processes on this machine, and with {cluster} none works here: leave JOBS out")
    return count
