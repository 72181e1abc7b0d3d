"""The command line, which `make` calls: `python -m replicate <command>`."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from replicate.config import PROFILES, Config, resolve
from replicate.engine import paths, store
from replicate.engine.device import choose_device
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.provenance import core_count, provenance
from replicate.targets.table2.layout import STANDS_FOR

_EPILOG = """\
Artefacts are kept in .cache, or in $REPLICATE_CACHE, and reused for as long as their configuration, inputs and
sources stay the same. Exit codes: 0 done, 1 a stage failed or the disk is full, 2 bad input, 130 interrupted.
"""


@dataclass(frozen=True)
class Command:
    """A command of the command line: what it does, in words and as a function, and which options it takes."""

    about: str
    function: Callable[[argparse.Namespace], None]
    options: tuple[str, ...] = ()
    characters: tuple[str, ...] = ("teen",)  # those that it takes if none is named


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        raise InputError(f"{message}; `{self.prog} --help` lists what is allowed")


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; whoever made a mistake is told in one sentence."""
    try:
        options = _parser().parse_args(arguments)
        options.typed = ["python", "-m", "replicate", *(sys.argv[1:] if arguments is None else arguments)]
        COMMANDS[options.command].function(options)
    except (InputError, RunError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        print("interrupted: what is finished is kept, and the same command goes on from there", file=sys.stderr)
        return 130
    except OSError as error:
        if not store.is_disk_full(error):
            raise
        print(f"the disk is full ({error.filename or paths.ROOT}): make room and run the same command", file=sys.stderr)
        return 1
    return 0


def configurations(options: argparse.Namespace) -> list[Config]:
    """Return the configuration of every character that the command line names."""
    device = choose_device(options.device)
    overrides = {"samples": {"split": options.split}} if options.split else None
    file = Path(options.config) if options.config else None
    return [
        resolve(character, options.profile, overrides, file, seed=seed, device=device)
        for character in _characters(options)
        for seed in _seeds(options)
    ]


def _characters(options: argparse.Namespace) -> list[str]:
    """Return the characters that are named, each recipe once; results are kept by the stem of its file."""
    recipes: dict[str, tuple[Path, str]] = {}
    for character in " ".join(options.characters).replace(",", " ").split():
        file = paths.recipe_file(character)
        known, _ = recipes.setdefault(file.stem, (file, character))
        if known != file:
            both = f"{paths.shown(known)} and {paths.shown(file)}"
            raise InputError(f"{both} would both be {file.stem!r} in the results: rename one of them")
    if not recipes:
        raise InputError(f"no character is named: allowed are {', '.join(paths.character_names())}")
    return [character for _, character in recipes.values()]


def _seeds(options: argparse.Namespace) -> list[int]:
    seeds = " ".join(options.seed).replace(",", " ").split()
    for seed in seeds:
        if not seed.isdecimal():
            raise InputError(f"seed is {seed!r}: allowed are whole numbers of at least 0")
    return list(dict.fromkeys(map(int, seeds))) or [0]


def _table2(options: argparse.Namespace) -> None:
    from replicate.pipeline import table2_graph
    from replicate.report.publish import publish_table2

    configs = configurations(options)
    made = _made(options, configs, [table2_graph(config) for config in configs])
    publish_table2(configs, made, not options.numbers_only)


def _table1(options: argparse.Namespace) -> None:
    from replicate.pipeline import table1_graph
    from replicate.report.publish import publish_table1

    configs = configurations(options)
    publish_table1(configs, _made(options, configs, [table1_graph(config) for config in configs]))


def _figure(options: argparse.Namespace) -> None:
    from replicate.pipeline import figure_graph
    from replicate.report.publish import publish_figure

    configs = configurations(options)
    made = _made(options, configs, [figure_graph(config, options.command) for config in configs])
    publish_figure(options.command, configs, made)


def _made(options: argparse.Namespace, configs: list[Config], graphs: list[list]) -> list:
    """Run some graphs and return the last stage of each."""
    from replicate.engine.scheduler import run

    workers = _workers(options)
    facts = provenance(options.typed, options.profile, sorted({config.seed for config in configs}), workers)
    run([stage for graph in graphs for stage in graph], workers, facts)
    return [graph[-1] for graph in graphs]


def _compare(options: argparse.Namespace) -> None:
    from replicate.report.compare import compare_folders
    from replicate.report.tables import as_latex, as_text

    _check_profile(options.profile)
    for table in compare_folders(paths.PAPER, paths.REFERENCE, paths.run_folder(options.profile)):
        print(as_latex(table) if options.latex else as_text(table))


def _reference(options: argparse.Namespace) -> None:
    from replicate.report.reference import publish_reference

    _check_profile(options.profile)
    for file in publish_reference(options.profile):
        print(f"written to {paths.shown(file)}")


def _rigs(options: argparse.Namespace) -> None:
    from replicate.made import made_rig
    from replicate.targets.rigs.drawing import draw_line_up, draw_sheets

    folder = paths.run_folder("rigs")
    folder.mkdir(parents=True, exist_ok=True)
    rigs = [made_rig(character) for character in _characters(options)]
    for rig in rigs:
        for file in draw_sheets(rig, folder):
            print(f"written to {paths.shown(file)}")
    print(f"written to {paths.shown(draw_line_up(rigs, folder))}")


def _export(options: argparse.Namespace) -> None:
    from replicate.export.command import Request, export
    from replicate.made import made_rig

    request = Request(options.pose, options.clip, options.params, options.to, options.tolerance)
    characters = _characters(options)
    if request.to is not None and len(characters) > 1:
        raise InputError(
            f"{len(characters)} characters can't all be written to {request.to}: name one, or leave out to"
        )
    for character in characters:
        files, words = export(made_rig(character), request)
        print(f"written to {', '.join(paths.shown(file.absolute()) for file in files)}: {words}")


def _tour(options: argparse.Namespace) -> None:
    from replicate.made import made_rig
    from replicate.report.notebooks import NOTEBOOKS, execute

    folder = paths.run_folder("tour")
    folder.mkdir(parents=True, exist_ok=True)
    for character in _characters(options):
        made_rig(character)  # here its making is seen, and a bad recipe gets one sentence
        recipe = paths.recipe_file(character)
        file = folder / f"rig_tour_{recipe.stem}.ipynb"
        named = str(recipe) if character.endswith(".toml") else character  # the notebook runs in another folder
        execute(NOTEBOOKS / "rig_tour.ipynb", file, {"CHARACTER": named})
        print(f"written to {paths.shown(file)}")


def _status(options: argparse.Namespace) -> None:
    from replicate import pipeline
    from replicate.engine.cache_report import inventory, states

    for config in configurations(options):
        for stage, state in states(pipeline.all_graphs(config)):
            print(f"{stage.title:28} {stage.key}  {state}")
    entries = inventory()
    print(f"\n{paths.cache_folder()}")
    for state in ("current", "stale", "damaged", "unfinished"):
        sizes = [entry.size_bytes for entry in entries if entry.state == state]
        print(f"{state:28} {len(sizes):4} folders {sum(sizes) / 1e6:10,.1f} MB")


def _clean_cache(options: argparse.Namespace) -> None:
    from replicate.engine.cache_report import clean

    count, size_bytes = clean(options.all)
    print(f"removed {count} folders, {size_bytes / 1e6:,.1f} MB, from {paths.cache_folder()}")


# The characters that stand for the paper's four, in its order: those that have a recipe.
CAST = tuple(name for name in STANDS_FOR if paths.recipe_file(name).is_file())
_RUN_OPTIONS = ("profile", "characters", "seed", "device", "config", "split")
COMMANDS = {
    "table2": Command(
        "make Table 2: approximation errors on held-out poses, beside the paper's",
        _table2,
        (*_RUN_OPTIONS, "jobs", "numbers-only"),
    ),
    "table1": Command(
        "make Table 1: counts of segments and sizes of models, beside the paper's",
        _table1,
        (*_RUN_OPTIONS, "jobs"),
        CAST,
    ),
    "figure05": Command(
        "draw Figure 5: poses of the training data, and the clips behind them", _figure, (*_RUN_OPTIONS, "jobs"), CAST
    ),
    "figure07": Command("draw Figure 7: the mesh segments in colours", _figure, (*_RUN_OPTIONS, "jobs"), CAST),
    "figure08": Command("draw Figure 8: the refinement segments in colours", _figure, (*_RUN_OPTIONS, "jobs"), CAST),
    "lbs": Command(
        "draw what linear blend skinning makes of a face, and how that is found", _figure, (*_RUN_OPTIONS, "jobs")
    ),
    "compare": Command("print the paper's numbers, the reference results and yours", _compare, ("profile", "latex")),
    "reference": Command(
        "put a run's results and the benchmarks' in the place of the committed ones", _reference, ("profile",)
    ),
    "rigs": Command("draw the characters: what each is, and what it can express", _rigs, ("characters",), CAST),
    "export": Command(
        "write a pose as OBJ or GLB, or a clip as an animated GLB",
        _export,
        ("characters", "pose", "clip", "params", "to", "tolerance"),
    ),
    "tour": Command("execute the notebook that takes a rig apart", _tour, ("characters",)),
    "status": Command("list the artefacts of tables and figures, and what the cache holds", _status, _RUN_OPTIONS),
    "clean-cache": Command("remove what is stale, damaged or unfinished from the cache", _clean_cache, ("all",)),
}
_OPTIONS = {
    "profile": {"default": "laptop", "help": f"one of {', '.join(PROFILES)} (default: laptop)"},
    "characters": {
        "nargs": "+",
        "help": f"names, of {', '.join(paths.character_names())}, or paths of .toml recipes; "
        + ", ".join(f"{name} needs {variable}=folder in the environment" for name, variable in paths.OUTSIDE.items()),
    },
    "seed": {
        "default": ["0"],
        "nargs": "+",
        "help": "the seeds that all random streams come from; tables show the mean over them (default: 0)",
    },
    "device": {"default": "auto", "help": "auto, cpu or cuda (default: CUDA if there is one, else the CPU)"},
    "jobs": {"type": int, "help": f"processes side by side (default: one a core, here {core_count()})"},
    "numbers-only": {"action": "store_true", "help": "write the CSV and its manifest, no figures and no notebook"},
    "config": {"metavar": "FILE", "help": "a TOML file whose keys override the profile's, as [coarse] map_size = 64"},
    "latex": {"action": "store_true", "help": "print LaTeX (packages: booktabs) instead of text"},
    "split": {"help": "frames (as in the paper) or clips: what is held out for the test"},
    "pose": {"help": "an expression, as joy; a wrong name lists them (default: neutral)"},
    "clip": {"help": "a clip's name, or its number from 0; a wrong one lists them"},
    "params": {
        "metavar": "FILE",
        "help": "a CSV file whose header names controls: one row is a pose, several are a clip of 24 frames a second",
    },
    "to": {
        "metavar": "FILE",
        "help": "the .glb (metres) or, for a pose, .obj (mm) to write (default: a .glb in results/runs/export)",
    },
    "tolerance": {
        "type": float,
        "default": 0.05,
        "metavar": "MM",
        "help": "how far a clip's vertices may be from the rig's: smaller makes larger files (default: 0.05 mm)",
    },
    "all": {"action": "store_true", "help": "remove everything that this suite has put there"},
}


def _parser() -> argparse.ArgumentParser:
    plain = argparse.RawDescriptionHelpFormatter
    parser = _Parser("python -m replicate", description=__doc__, epilog=_EPILOG, formatter_class=plain)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="command")
    for name, command in COMMANDS.items():
        about = command.about[0].upper() + command.about[1:] + "."
        subparser = subparsers.add_parser(
            name, help=command.about, description=about, epilog=_EPILOG, formatter_class=plain
        )
        for option in command.options:
            settings = dict(_OPTIONS[option])
            if option == "characters":
                settings["default"] = list(command.characters)
                settings["help"] += f" (default: {' '.join(command.characters)})"
            subparser.add_argument(f"--{option}", **settings)
    return parser


def _workers(options: argparse.Namespace) -> int:
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"jobs is {options.jobs}: allowed is a whole number of at least 1")
    return options.jobs or core_count()


def _check_profile(profile: str) -> None:
    if profile not in PROFILES:
        raise InputError(f"profile {profile!r} is unknown: allowed are {', '.join(PROFILES)}")


if __name__ == "__main__":
    sys.exit(main())
