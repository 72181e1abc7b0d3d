"""What the benchmarks share: their command line, the artefacts that they measure, and the folder that they write to."""

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from data_recipes import recipe_paths
from replicate.approximation.metrics import unique_poses
from replicate.base import paths
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.base.signals import without_foreign
from replicate.base.user_files import words
from replicate.config import PROFILES, Config, check_profile, resolve
from replicate.drawing.panels import Words, save_figure
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.method_registry import choose, sections
from replicate.methods.plan import Plan
from replicate.report import manifest
from replicate.report.publication import alone, check_results_folder, results_folder
from replicate.report.results import Row, read_results, write_results
from replicate.report.tables import Table, as_text

if TYPE_CHECKING:
    import matplotlib.figure

    from replicate.inference.fast_evaluation import Places

PROFILE = "bench"  # the folder's name, and what rows say that no profile made

# The command line.


def parse(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """Return a benchmark's options, and the words that state them.

    Options that make gives to every benchmark and that this one doesn't have are left out.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    known = without_foreign(given, parser._option_string_actions)
    return parser.parse_args(known), known


def make_parser(name: str, about: str, characters: str = "teen", profile: str = "") -> argparse.ArgumentParser:
    """Return the parser of a benchmark that takes characters and, where `profile` says what for, a profile."""
    parser = argparse.ArgumentParser(prog=f"python -m replicate.benchmarks.{name}", description=about)
    if profile:
        parser.add_argument("--profile", default="laptop", help=f"{profile} (default: laptop)")
    help = f"names or recipes, separated by commas (default: {characters})"
    parser.add_argument("--characters", default=characters, help=help)
    return parser


def add_count(
    parser: argparse.ArgumentParser, name: str, default: int | Sequence[int], about: str, least: int = 1
) -> None:
    """Add an option for a whole number, or for several where its default has several.

    parser: where it is added.
    name: of the option, without the dashes.
    default: what it counts where it is not given.
    about: what it counts, for the help.
    least: a smaller number ends in an InputError.
    """
    several = not isinstance(default, int)
    help = f"{about} (default: {' '.join(map(str, default)) if several else default})"
    nargs = "+" if several else None
    parser.add_argument(f"--{name}", action=_Count, type=int, nargs=nargs, default=default, const=least, help=help)


class _Count(argparse.Action):
    """Takes a whole number of at least `const`, or several."""

    def __call__(
        self, parser: object, namespace: argparse.Namespace, values: int | list[int], option_string: str = ""
    ) -> None:
        for value in values if isinstance(values, list) else [values]:
            if value < self.const:
                raise InputError(f"{self.dest}: expected a whole number of at least {self.const}, got {value}")
        setattr(namespace, self.dest, values)


def add_methods(parser: argparse.ArgumentParser, target: str) -> None:
    """Add the options for methods and for a file of settings, which take the same words as those of a target."""
    parser.add_argument("--methods", nargs="+", default=["standard"], help=f"as for {target} (default: standard)")
    parser.add_argument("--config", metavar="FILE", help=f"a TOML file that overrides the profile, as for {target}")


def add_only(parser: argparse.ArgumentParser) -> None:
    """Add an option that names some of a benchmark's trainings: the rows of the others stay."""
    parser.add_argument(
        "--only", default="", help="only trainings whose description has this, or one of several: 'a|b'; others stay"
    )


def selected(trainings: Sequence, only: str) -> list:
    """Return the trainings whose name has `only` in it, or one of the texts that `|` separates there.

    Raises InputError where there are none.
    """
    texts = only.split("|")
    selection = [training for training in trainings if any(text in str(training) for text in texts)]
    if not selection:
        names = "; ".join(map(str, trainings))
        raise InputError(f"only: no training's name has {only!r} in it; there are {names}")
    return selection


def split_names(characters: str, rig_use: str = "") -> list[str]:
    """Return the characters that a text names, separated by commas or spaces.

    rig_use: why the benchmark evaluates rigs at new poses, for the message to whoever names a character that is known
    by its samples alone. Raises InputError for one, and where none is named.
    """
    names = list(dict.fromkeys(map(recipe_paths.named, words(characters))))
    if not names:
        existing = ", ".join(recipe_paths.character_names())
        raise InputError(f"characters: expected at least one name, got none; there are {existing}")
    if rig_use:
        recipe_paths.check_function(names, "this benchmark", rig_use)
    return names


def answer(parser: argparse.ArgumentParser, body: Callable, arguments: Sequence[str] | None) -> int:
    """Run a benchmark, `body(options, words)`, as the command line says; return the exit code.

    Whether its results can be written is checked before it measures anything.
    """

    def checked() -> None:
        options, words = parse(parser, arguments)
        check_profile(getattr(options, "profile", next(iter(PROFILES))))
        _check_results(parser.prog.rpartition(".")[2])
        body(options, words)

    return guard(checked)


def _check_results(name: str) -> None:
    """Raise InputError where <name>.csv can't be written, or can't be read so that new rows could join the others."""
    check_results_folder(PROFILE)
    file = paths.run_folder(PROFILE) / f"{name}.csv"
    try:
        if file.exists():
            read_results(file)
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}; new rows would join that file: mend or remove it") from None


def bench_characters(
    name: str,
    measure: Callable[[Config], list[Row]],
    table: Callable[[Sequence[Row], str], Table],
    options: argparse.Namespace,
    command_line: Sequence[str],
    rig_use: str = "",
    draw: Callable[[Sequence[Row], str], None] = lambda rows, character: None,
) -> None:
    """Measure one character after the other; print and publish the rows of each before the next begins.

    name: the benchmark's module.
    measure: configuration → rows.
    table: (rows, character) → what is printed.
    options: `characters`, `profile` and, for a benchmark of methods, `config`.
    command_line: the words that state the options.
    rig_use: as for `split_names`.
    draw: (rows, character) → pictures, at the end.
    """
    config = getattr(options, "config", None)
    file = paths.with_home(config, "CONFIG") if config else None
    more = sections(options.profile)
    for character in split_names(options.characters, rig_use):
        rows = measure(resolve(character, options.profile, file=file, sections=more))
        publish(name, rows, [table(rows, rows[0].character)], command_line)
        draw(rows, rows[0].character)


def bench_methods(
    name: str,
    measure: Callable[[Config, list[str]], list[Row]],
    table: Callable[[Sequence[Row], str], Table],
    options: argparse.Namespace,
    command_line: Sequence[str],
    **more: object,
) -> None:
    """Measure methods on one character after the other, as `bench_characters` does.

    Raises InputError for an unknown method before anything is made.

    measure: (configuration, words that name methods) → rows.
    options: with `methods` and `config` too.
    name, table, command_line, more: as for `bench_characters`.
    """
    methods = split_names(" ".join(options.methods))
    choose(methods)
    bench_characters(name, lambda config: measure(config, methods), table, options, command_line, **more)


# What is measured: artefacts, made where they are missing.


def make_stages(name: str, profile: str, stages: Sequence[Stage], seed: int = 0) -> None:
    """Make what is missing of some stages and of all behind them. name: the benchmark's module."""
    run(list(stages), facts=provenance(["make", name.replace("_", "-")], profile, [seed], core_count()))


def folders_of(stages: Iterable[Stage]) -> dict[str, Path]:
    """Return the folders of some stages' artefacts by stage name."""
    return {stage.name: artefact_folder(stage.identifier) for stage in stages}


def artefacts_of(name: str, config: Config, stages: Sequence[Stage]) -> dict[str, Path]:
    """Make what is missing of some stages; return the folders of their artefacts and of all behind them, by name.

    name: the benchmark's module. config: the one that the stages are of.
    """
    make_stages(name, config.profile, stages, config.seed)
    return folders_of(in_order(list(stages)))


def trained_methods(
    name: str, config: Config, words: Sequence[str], *stages: Callable[[Plan], Stage]
) -> tuple[list[Method], dict[str, Path]]:
    """Return those of the named methods that have a model, and the folders of all artefacts, made where missing.

    name: the benchmark's module. words: names of methods, as `choose` takes them. stages: what else is needed.
    """
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    of_methods = [stage for method in methods for stage in method.stages(plan)]
    return methods, artefacts_of(name, config, [*(stage(plan) for stage in stages), *of_methods])


def distinct_test_poses(inputs: Mapping[str, Path]) -> Float32[np.ndarray, "t m"]:
    """Return the raw rig parameters of a character's test poses, each pose once."""
    params = artefacts.load_samples(inputs).test_params
    return np.asarray(params[unique_poses(params)], np.float32)


def without_rigid_step(placing: "Places", mesh: Mesh) -> Callable[[np.ndarray], np.ndarray]:
    """Return parameters (1, m) → vertices (n, 3) mm by the fast evaluation, rigid segments left at rest.

    Every pose is written to the same array.
    """
    out = np.array(mesh.neutral, np.float32)

    def evaluate(params: np.ndarray) -> np.ndarray:
        np.copyto(out, mesh.neutral)
        placing.place(params[0], out)
        return out

    return evaluate


# What is written: rows, tables and pictures.


def bench_row(
    table: str,
    character: str,
    method: str,
    metric: str,
    unit: str,
    value: float,
    poses: int | None,
    run: str = "",
) -> Row:
    """Return one measured value as a row of the profile "bench" and one seed.

    table, character, method, metric, unit, value: as in `Row`.
    poses: how many were measured.
    run: the character's name where nothing is given.
    """
    return Row(table, character, method, metric, unit, float(value), None, 1, poses, PROFILE, run or character)


def in_groups(lines: Iterable[tuple[object, Iterable[str]]]) -> tuple[tuple[str, ...] | None, ...]:
    """Return a table's body of (group, cells of a line) pairs, with None, which draws a rule, between two groups."""
    body, last = [], None
    for group, cells in lines:
        body += [None] if body and group != last else []
        body.append(tuple(cells))
        last = group
    return tuple(body)


def bench_folder() -> Path:
    """Return the folder that benchmarks write to, and make it. Raises InputError where it can't be written."""
    return results_folder(PROFILE)


def publish(
    name: str,
    rows: Sequence[Row],
    tables: Iterable[Table],
    arguments: Sequence[str],
    in_part: bool = False,
) -> None:
    """Print tables, write rows to <name>.csv in the benchmarks' folder and note in its manifest how they were made.

    name: the benchmark's module.
    rows: of one or more characters, whose earlier rows they replace.
    tables: what is printed of the rows.
    arguments: those of the command line.
    in_part: whether earlier rows about other things stay for these characters too.
    """
    for table in tables:
        print(as_text(table))
    characters, folder = {row.character for row in rows}, bench_folder()
    with alone(folder):
        merge(folder / f"{name}.csv", rows, lambda row: in_part or row.character not in characters)
        note(name, characters, arguments, in_part=in_part)


def merge(file: Path, rows: Sequence[Row], keep: Callable[[Row], bool]) -> None:
    """Write rows to a CSV file beside those earlier ones that `keep` says yes to and that no new row replaces.

    Where others may write there too, the caller holds the lock of its folder: see `publication.alone`.
    """
    new = {row.key for row in rows}
    others = [row for row in read_results(file) if keep(row) and row.key not in new] if file.is_file() else []
    write_results(file, [*others, *rows])


def note(
    name: str,
    characters: Iterable[str],
    arguments: Sequence[str],
    seeds: Sequence[int] = (0,),
    in_part: bool = False,
) -> None:
    """Note in the folder's manifest how <name>.csv's rows about some characters were made, and say so.

    in_part: whether rows of earlier commands are still there; they and their commits are noted as "earlier".
    """
    folder = bench_folder()
    command = ["python", "-m", f"replicate.benchmarks.{name}", *arguments]
    facts = provenance(command, PROFILE, list(seeds), core_count())
    with alone(folder):
        before = manifest.entries(folder, name)
        parts = before if in_part else {}
        now = {character: facts | _earlier(parts.get(character), facts["command"]) for character in characters}
        manifest.write_entries(folder, name, dict(sorted((before | now).items())))
    print(f"written to {paths.display_path(folder)}: {name}.csv, {manifest.NAME}")


def _earlier(entry: dict | None, command: str) -> dict[str, list]:
    """Return the commands of a manifest's entry, before the new one, for the entry that takes its place."""
    if entry is None:
        return {}
    last = {name: entry[name] for name in ("command", "git")}
    parts = {part["command"]: part for part in (*entry.get("earlier", []), last)}
    return {"earlier": [part for part in parts.values() if part["command"] != command]}


def save_picture(name: str, picture: "tuple[matplotlib.figure.Figure, Words]") -> None:
    """Write a figure and its words to <name>.png in the benchmarks' folder, and say so."""
    folder = bench_folder()
    save_figure(picture[0], folder / f"{name}.png", picture[1])
    print(f"written to {paths.display_path(folder)}: {name}.png")
