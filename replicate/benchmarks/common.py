"""What the benchmarks share: their command line, the artefacts that they measure, and the folder that they write to."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from data_recipes import recipe_paths
from replicate.approximation.rigid import Attachments
from replicate.base import paths
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.base.signals import without_foreign
from replicate.base.user_files import words
from replicate.config import PROFILES, Config, check_profile, resolve
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.methods.method import Method
from replicate.methods.method_registry import choose, sections
from replicate.report import manifest
from replicate.report.publication import alone, check_results_folder, results_folder
from replicate.report.results import Row, read_results, write_results
from replicate.report.tables import Table, as_text

PROFILE = "bench"  # the folder's name, and what rows say that no profile made


def parse(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """Return a benchmark's options, and the words that state them.

    What make hands to all benchmarks and this one lacks is left out.
    """
    every = list(sys.argv[1:] if arguments is None else arguments)
    own = without_foreign(every, parser._option_string_actions)
    return parser.parse_args(own), own


def make_parser(name: str, about: str, characters: str = "teen", profile: str = "") -> argparse.ArgumentParser:
    """Return the parser of a benchmark that takes characters and, where `profile` says what for, a profile."""
    parser = argparse.ArgumentParser(prog=f"python -m replicate.benchmarks.{name}", description=about)
    if profile:
        parser.add_argument("--profile", default="laptop", help=f"{profile} (default: laptop)")
    help = f"names or recipes, separated by commas (default: {characters})"
    parser.add_argument("--characters", default=characters, help=help)
    return parser


def add_count(parser: argparse.ArgumentParser, name: str, usual: int, about: str, least: int = 1) -> None:
    """Add an option for a whole number, --<name>; one below the least that is allowed ends in an InputError.

    usual: the number where none is named. about: what it counts, for the help.
    """
    words = f"{about} (default: {usual})"
    parser.add_argument(f"--{name}", action=_Count, type=int, default=usual, const=least, help=words)


def add_counts(parser: argparse.ArgumentParser, name: str, usual: Sequence[int], about: str, least: int = 1) -> None:
    """Add an option for one whole number or more, as `add_count` does for one."""
    words = f"{about} (default: {' '.join(map(str, usual))})"
    parser.add_argument(f"--{name}", action=_Count, type=int, nargs="+", default=usual, const=least, help=words)


class _Count(argparse.Action):
    """Takes a whole number of at least `const`, or several."""

    def __call__(
        self, parser: object, namespace: argparse.Namespace, values: int | list[int], option_string: str = ""
    ) -> None:
        for value in values if isinstance(values, list) else [values]:
            if value < self.const:
                raise InputError(f"{self.dest} is {value}: allowed is a whole number of at least {self.const}")
        setattr(namespace, self.dest, values)


def add_methods(parser: argparse.ArgumentParser, like: str) -> None:
    """Add the options that name methods, and a file of their numbers. like: the target that takes the same words."""
    parser.add_argument("--methods", nargs="+", default=["standard"], help=f"as for {like} (default: standard)")
    parser.add_argument("--config", metavar="FILE", help=f"a TOML file that overrides the profile, as for {like}")


def answer(parser: argparse.ArgumentParser, body: Callable, arguments: Sequence[str] | None) -> int:
    """Run a benchmark, `body(options, words)`, as the command line says; return the exit code.

    An error about where its results go comes before it measures anything.
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


def add_only(parser: argparse.ArgumentParser) -> None:
    """Add an option that names some of a benchmark's trainings: the rows of the others stay."""
    parser.add_argument(
        "--only", default="", help="only trainings whose description has this, or one of several: 'a|b'; others stay"
    )


def selected(trainings: Sequence, only: str) -> list:
    """Return the trainings whose name, "method, change", has one of the texts that `|` parts in `only`.

    Raises InputError where there are none.
    """
    wanted = only.split("|")
    selection = [variant for variant in trainings if any(words in str(variant) for words in wanted)]
    if not selection:
        names = "; ".join(map(str, trainings))
        raise InputError(f"only is {only!r}: no training is called so; there are {names}")
    return selection


def split_names(characters: str, asks_the_rig: str = "") -> list[str]:
    """Return the characters that a text names, separated by commas or spaces.

    asks_the_rig: what for the benchmark evaluates rigs at poses of its own. Raises InputError if there are none, and
    for one that is known by its samples alone where the rig is asked.
    """
    names = list(dict.fromkeys(map(recipe_paths.named, words(characters))))
    if not names:
        raise InputError(f"no character is named: allowed are {', '.join(recipe_paths.character_names())}")
    if asks_the_rig:
        recipe_paths.check_function(names, "this benchmark", asks_the_rig)
    return names


def bench_methods(
    name: str,
    measure: Callable[[Config, list[str]], list[Row]],
    table: Callable[[Sequence[Row], str], Table],
    options: argparse.Namespace,
    command_line: Sequence[str],
    asks_the_rig: str = "",
    draw: Callable[[Sequence[Row], str], None] = lambda rows, character: None,
) -> None:
    """Measure methods on one character after the other; print and publish each one's rows before the next begins.

    name: of the benchmark's module. measure: (configuration, words that name methods) → rows. table: (rows, character)
    → what is printed. options: with `characters`, `profile`, `methods` and `config`. command_line: the words that state
    them. asks_the_rig: as for `split_names`. draw: (rows, character), called at last. Raises InputError for names that
    are none, and for a wrong file, before anything is made.
    """
    words = split_names(" ".join(options.methods))
    choose(words)
    own = sections(options.profile)
    file = paths.with_home(options.config, "CONFIG") if options.config else None
    for character in split_names(options.characters, asks_the_rig):
        rows = measure(resolve(character, options.profile, file=file, sections=own), words)
        publish(name, rows, [table(rows, rows[0].character)], command_line)
        draw(rows, rows[0].character)


def artefacts_of(name: str, config: Config, stages: Sequence[Stage]) -> dict[str, Path]:
    """Return the folders of some stages' artefacts and of all behind them, by stage name; make what is missing.

    name: of the benchmark's module. config: that the stages are of.
    """
    command = ["make", name.replace("_", "-")]
    run(list(stages), facts=provenance(command, config.profile, [config.seed], core_count()))
    return {stage.name: artefact_folder(stage.identifier) for stage in in_order(list(stages))}


def bench_folder() -> Path:
    """Return the folder that benchmarks write to; it is there then. Raises InputError where it can't be written."""
    return results_folder(PROFILE)


def publish(
    name: str,
    rows: Sequence[Row],
    tables: Iterable[Table],
    arguments: Sequence[str],
    in_part: bool = False,
) -> None:
    """Print tables, write rows to <name>.csv in the benchmarks' folder and note in its manifest how they were made.

    tables: what is printed of the rows. arguments: the command line's. in_part: whether the other rows of these
    characters in an earlier file stay too, as those of other characters do.
    """
    for table in tables:
        print(as_text(table))
    characters, into = {row.character for row in rows}, bench_folder()
    with alone(into):
        merge(into / f"{name}.csv", rows, lambda row: in_part or row.character not in characters)
        note(name, characters, arguments)


def merge(file: Path, rows: Sequence[Row], keep: Callable[[Row], bool]) -> None:
    """Write rows to a CSV file beside those that it has already and that shall stay; never two about the same thing.

    Where others may write there too, the caller holds the lock of its folder: see `publication.alone`.
    """
    new = {row.key for row in rows}
    others = [row for row in read_results(file) if keep(row) and row.key not in new] if file.is_file() else []
    write_results(file, [*others, *rows])


def note(name: str, characters: Iterable[str], arguments: Sequence[str], seeds: Sequence[int] = (0,)) -> None:
    """Note in the folder's manifest how <name>.csv's rows about some characters were made, and say so."""
    into = bench_folder()
    command = ["python", "-m", f"replicate.benchmarks.{name}", *arguments]
    facts = provenance(command, PROFILE, list(seeds), core_count())
    with alone(into):
        before = manifest.entries(into, name)
        manifest.write_entries(into, name, dict(sorted((before | dict.fromkeys(characters, facts)).items())))
    print(f"written to {paths.display_path(into)}: {name}.csv, {manifest.NAME}")


# What places the rigid segments of a method that is timed: its attachments, or nothing.


def placing_attachments(method: Method, attachments: Attachments) -> Attachments:
    """Return the attachments by which a method places rigid segments (§3.4); of one without that step, no segment's."""
    if method.rigid_step:
        return attachments
    return Attachments(**{name: array[:0] for name, array in vars(attachments).items()})
