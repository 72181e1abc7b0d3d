"""Publish a run of yours as the committed results: for maintainers of this repository."""

import argparse
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from data_recipes.recipe_paths import OUTSIDE
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.files import copy_file, write_bytes, write_text
from replicate.benchmarks.bench_deploy import forms_card
from replicate.benchmarks.bench_poses import health_card
from replicate.benchmarks.bench_rig import speed_card
from replicate.benchmarks.bench_train import steps_table
from replicate.benchmarks.common import PROFILE as BENCH
from replicate.benchmarks.common import merge
from replicate.cli.target_list import target_table
from replicate.config import check_profile
from replicate.drawing.panels import WEBP, webp
from replicate.methods.method_registry import in_order, method_named
from replicate.report import manifest, notebooks
from replicate.report.pose_record import PEERS
from replicate.report.results import COLUMNS, Row, characters_of, find, read_curves, read_results, write_curves
from replicate.report.tables import Table, as_markdown, round_off
from replicate.targets.claims import claims_in_brief, overview, write_claims
from replicate.targets.claims.rules import gather
from replicate.targets.claims.verdicts import FILE as CLAIMS
from replicate.targets.reference import times as reference_times
from replicate.targets.reference.pictures import put_first_seed, put_numbers
from replicate.targets.reference.times import TIMED_TARGET as GPU_TIMES
from replicate.targets.reference.times import is_of_gpu, put_gpu_times, times_card
from replicate.targets.rig_report.shown import report_card
from replicate.targets.table2.charts import redraw_charts
from replicate.targets.table2.rows import (
    CURVES,
    about_rows,
    other_rigs,
    standard_rows,
    table2_overview,
    table2_questions,
    table_notes,
)
from replicate.targets.table3.rows import ALL, best_row, cell
from replicate.targets.table3.shown import speed_table, timing_table


def run(options: argparse.Namespace) -> None:
    """Publish a profile's results as the reference."""
    check_profile(options.profile)
    for file in publish_reference(options.profile, options.add_seeds):
        print(f"written to {paths.display_path(file)}")


KINDS = (".csv", ".json", ".npz", ".png")
README, RESULTS, DATA_CARD, REPRODUCING, ENGINES = (
    paths.ROOT / name for name in ("README.md", "RESULTS.md", "data_recipes/README.md", "REPRODUCING.md", "ENGINES.md")
)
TABLE2 = reference_times.TARGET
TRAINED = "teen"  # the character whose training steps REPRODUCING shows
APART = "paper"  # the profile whose results have a separate folder
PART = "--only"  # the option that runs a benchmark in part
ALWAYS = ("claims", "rig_tour")  # notebooks that belong to no single target


def publish_reference(profile: str, add_seeds: bool = False) -> list[Path]:
    """Replace the committed results by a profile's and the benchmarks'; return the new files.

    Table 2 with the profile `paper` or with whole clips as test poses goes into a separate folder, beside the one that
    texts quote (see `publish_apart`); so does a Table 3 with times on a GPU.

    In a table each character of the run is replaced as a whole and others stay, so that characters may be run one at a
    time. In a benchmark that was run in part (`--only`) its other rows stay too. Files without a new result stay.

    add_seeds: let seeds of Table 2 join the committed ones of the same characters, and methods of the first seed its
    poses and curves; other committed results of such a character stay.

    Raises InputError, before it writes anything, if there are no results, or some come from a tree with changes.
    """
    # what goes into a separate folder
    run, bench, rigs = (paths.run_folder(name) for name in (profile, BENCH, "rigs"))
    of_clips = _is_of_clips(run)
    if of_clips and profile == APART:
        raise InputError(
            f"{paths.display_path(run)}: results on whole clips can't be published with the profile {APART}: "
            "there is no folder for both"
        )
    if apart := paths.PAPER_PROFILE if profile == APART else paths.WHOLE_CLIPS if of_clips else None:
        return publish_apart(run, paths.committed_folders()[apart], add_seeds)
    # checks before anything is written
    of_run, of_bench = manifest.targets(run), manifest.targets(bench)
    if not (of_run or of_bench):
        raise InputError(f"{run}: there are no results; `make table2 PROFILE={profile}` writes them.")
    for folder, names in ((run, of_run), (bench, of_bench)):
        _check_clean(folder, names)
    on_gpu = GPU_TIMES in of_run and is_of_gpu(run)
    shared = reference_times.shared_characters(run) if add_seeds else []
    # the files of results
    paths.REFERENCE.mkdir(parents=True, exist_ok=True)
    files = put_first_seed(run, shared)
    files += reference_times.put_table2(run, shared) if TABLE2 in of_run else []
    if on_gpu:
        files += put_gpu_times(run, paths.committed_folders()[paths.GPU_MACHINE])
        of_run.remove(GPU_TIMES)
    done = [file.name for file in files]
    for file in sorted(run.iterdir()) if of_run else ():
        stay = _committed(_target_of(file, of_run), shared)
        if _is_result(file) and file.name not in done and not _is_of(file, stay) and not _is_mesh_left_out(file):
            files.append(_put(file, stay))
    for file in sorted(bench.iterdir()) if of_bench else ():
        if _is_result(file) and (file.suffix != ".csv" or file.stem in of_bench):
            files.append(_put(file, joining=_in_part(bench, file.stem)))
    # their entries in the manifest
    for folder, names, of_both in ((run, of_run, shared), (bench, of_bench, ())):
        for target in names:
            if target != TABLE2:
                stay = _committed(target, of_both)
                entries = manifest.entries(folder, target).items()
                new = {name: _with_results_alone(facts) for name, facts in entries if name not in stay}
                there = manifest.entries(paths.REFERENCE, target)
                for name in there.keys() & _in_part(folder, target):
                    new[name] = manifest.joined(new[name], there[name])
                both = there | new
                if both:
                    manifest.write_entries(paths.REFERENCE, target, dict(sorted(both.items())))
    # what follows from them: charts, numbers of figures, verdicts, texts
    files += redraw_charts(paths.REFERENCE, shared)
    files += put_numbers(manifest.entries(run, TABLE2))
    write_claims(paths.REFERENCE, gather([paths.REFERENCE]))
    files.append(paths.REFERENCE / CLAIMS)
    drawn = [(rigs / name).with_suffix(".png") for name in shown_pictures()]
    files += [_put(file) for file in drawn if file.is_file()]
    return files + _texts(manifest.targets(paths.REFERENCE))


def publish_apart(run: Path, into: Path, add_seeds: bool = False) -> list[Path]:
    """Put the numbers of a run's Table 2 into a separate folder, execute its notebook anew, return the new files.

    Characters that the run lacks stay. add_seeds: as for `publish_reference`. Raises InputError, before it writes
    anything, for a run without Table 2, or one from a tree with changes.
    """
    if TABLE2 not in manifest.targets(run):
        raise InputError(f"{run}: there is no Table 2; `make table2 PROFILE={run.name}` writes it.")
    _check_clean(run, [TABLE2])
    shared = reference_times.shared_characters(run, into) if add_seeds else []
    into.mkdir(parents=True, exist_ok=True)
    return [*reference_times.put_table2(run, shared, into), *_texts([TABLE2])]


def _is_of_clips(run: Path) -> bool:
    """Return whether the test poses of a run's Table 2 are whole clips. Raises InputError if only some are."""
    splits = {name: facts.get("split", "frames") for name, facts in manifest.entries(run, TABLE2).items()}
    if len(set(splits.values())) > 1:
        both = ", ".join(f"{name} {split}" for name, split in splits.items())
        raise InputError(f"{paths.display_path(run)}: Table 2 has several splits ({both}): publish one at a time")
    return "clips" in splits.values()


def _check_clean(folder: Path, targets: Collection[str]) -> None:
    """Raise InputError unless all results of the targets in a folder come from trees without changes."""
    for target in targets:
        for character, facts in manifest.entries(folder, target).items():
            if not (facts.get("git") or {}).get("clean"):
                raise InputError(
                    f"{target} of {character} in {paths.display_path(folder)} was made from a tree with changes: "
                    "commit them and make it again"
                )


def _committed(target: str, characters: Collection[str]) -> list[str]:
    """Return the characters that have committed results of a target; for Table 2 all that are given."""
    there = manifest.entries(paths.REFERENCE, target)
    return [character for character in characters if target == TABLE2 or character in there]


def _in_part(folder: Path, target: str) -> set[str]:
    """Return the characters of which a benchmark was run in part, so that its other committed rows stay."""
    return {
        name for name, facts in manifest.entries(folder, target).items() if PART in facts.get("command", "").split()
    }


def _target_of(file: Path, targets: Sequence[str]) -> str:
    """Return the target of a file of results: the longest one that its name begins with, or Table 2."""
    owners = [name for name in targets if file.stem == name or file.stem.startswith(f"{name}_")]
    return max(owners, key=len, default=TABLE2)


def shown_pictures() -> list[str]:
    """Return the names of the committed pictures that texts show."""
    texts = [file.read_text("utf-8") for file in (README, RESULTS, DATA_CARD)]
    return sorted({name for text in texts for name in re.findall(rf"reference/(\w+{re.escape(WEBP)})", text)})


def rewrite_target_table() -> None:
    """Write the list of targets into REPRODUCING, as the registry has them."""
    text = REPRODUCING.read_text(encoding="utf-8")
    write_text(REPRODUCING, with_table(text, "targets", target_table()))


def tables_in_texts() -> dict[str, tuple[Path, str, Callable[[Path], Table]]]:
    """Return, by the name in a table's marks, the text that has it, the committed file behind it, and what makes it."""
    paper = read_results(paths.PAPER / "table2.csv")
    times = read_results(paths.PAPER / "table3.csv")
    return {
        "claims_in_brief": (README, "claims.csv", claims_in_brief),
        "claims": (RESULTS, "claims.csv", overview),
        "table2_ratios": (RESULTS, "table2.csv", lambda file: table2_questions(read_results(file), paper)),
        "table2_today": (
            RESULTS,
            "table2.csv",
            lambda file: beside_today(read_results(file), notebooks.rows_if_there("reference", "table3.csv")),
        ),
        "table2_others": (RESULTS, "table2.csv", lambda file: other_rigs(read_results(file))),
        "table2": (RESULTS, "table2.csv", lambda file: table2_overview(standard_rows(read_results(file)), paper)),
        "table3_speed": (RESULTS, "table3.csv", lambda file: speed_table(read_results(file))),
        "table3": (RESULTS, "table3.csv", lambda file: timing_table(read_results(file), times)),
        "bench_poses": (DATA_CARD, "bench_poses.csv", lambda file: health_card(read_results(file))),
        "table2_times": (REPRODUCING, manifest.NAME, lambda file: times_card(file.parent)),
        "bench_deploy": (ENGINES, "bench_deploy.csv", lambda file: forms_card(read_results(file))),
        "bench_train": (REPRODUCING, "bench_train.csv", lambda file: steps_table(read_results(file), TRAINED)),
        "bench_rig": (REPRODUCING, "bench_rig.csv", lambda file: speed_card(read_results(file))),
        "rig_report": (DATA_CARD, "rig_report.csv", lambda file: report_card(read_results(file))),
    }


TODAY = (*PEERS, "ridge_products")
HALVES = ("coarse_half", "refined_half", "dense_half")
BESIDE = ("coarse", "refined", "dense", "dense_compact", *HALVES, "regional", "neutral")


def beside_today(ours: Sequence[Row], times: Sequence[Row] = ()) -> Table:
    """Return mean errors, sizes, work and times of what is used today, of the characters that have such rows.

    times: rows of Table 3; without any, and for what it hasn't timed, there is no time.
    """
    rows = [row for row in ours if row.table == "table2"]
    characters = characters_of(row for row in rows if row.method in TODAY and row.method != "ridge_products")
    rows = [row for row in rows if row.character in characters and row.method in TODAY + BESIDE]
    metrics = (("vertex_error_mean", "mm", 1.0), ("normal_error_mean", "deg", 1.0))
    metrics = (*metrics, ("model_size", "MB", 1.0), ("multiplications", "ratio", 1e-6))
    body = []
    for character in characters:
        for method in in_order({row.method for row in rows if row.character == character}):
            cells = [character, method_named(method).title]
            for metric, unit, scale in metrics:
                row = find(rows, "table2", character, method, metric)
                cells.append(round_off(row.value * scale, unit, row.sd if scale == 1.0 else None) if row else "–")
            body.append((*cells, cell(times, best_row(times, character, method, ALL), ALL)))
    present = in_order({row.method for row in rows})
    header = ("", "", "mm", "degrees", "MB", "million products a pose", "ms a pose")
    heading = "What is used today, beside the paper's networks and ours: mean errors, size, work and time"
    timed = "ms: the best evaluation with the rigid step, on all cores (Table 3); –: not timed."
    notes = (
        (about_rows(rows, None), timed, *table_notes(rows, present))
        if body
        else ("There are no results of such methods.",)
    )
    return Table(heading, (header,), tuple(body), notes, text_columns=2)


def with_table(text: str, name: str, table: Table) -> str:
    """Return a text with a table put between the marks of a name. Raises InputError if it lacks them."""
    marks = f"<!-- {name}, by make reference -->\n", f"<!-- end of {name} -->\n"
    before, begin, rest = text.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not (begin and end):
        lines = " and ".join(repr(mark.strip()) for mark in marks)
        raise InputError(f"expected the lines {lines}, between which the table is written; one is missing.")
    return before + begin + as_markdown(table).strip() + "\n" + end + after


def _is_result(file: Path) -> bool:
    return file.suffix in KINDS and file.name != manifest.NAME and not file.name.startswith(".")


def _with_results_alone(facts: dict) -> dict:
    """Return a manifest's entry with the committed files: without others, such as the posing page, pictures as WebP."""
    if "files" not in facts:
        return facts
    files = [Path(name) for name in facts["files"] if Path(name).suffix in KINDS]
    return facts | {"files": [file.with_suffix(WEBP).name if file.suffix == ".png" else file.name for file in files]}


def _is_of(file: Path, characters: Collection[str]) -> bool:
    """Return whether a file belongs to one of the characters alone, as figure07_teen_rigidity.png does."""
    return any(re.match(rf"[a-z0-9]+_{re.escape(name)}[_.]", file.name) for name in characters)


def _is_mesh_left_out(file: Path) -> bool:
    """Return whether a file holds meshes that are not committed (see `has_committed_meshes`)."""
    return file.suffix == ".npz" and ("@" in file.name or _is_of(file, OUTSIDE))


def _put(file: Path, stay: Collection[str] = (), joining: Collection[str] = ()) -> Path:
    """Put a new result among the committed ones, a picture as WebP; rows and curves of characters that it lacks stay.

    stay: characters whose committed rows and curves stay, too. joining: characters whose other rows stay beside the new
    ones.
    """
    into = paths.REFERENCE / file.name
    if file.suffix == ".csv" and into.is_file():
        with file.open(encoding="utf-8") as lines:
            columns = lines.readline().rstrip("\n").split(",")
        if columns == list(COLUMNS):
            rows = [row for row in read_results(file) if row.character not in stay]
            characters = {row.character for row in rows}
            merge(into, rows, lambda row: row.character not in characters or row.character in joining)
            return into
        if file.name == CURVES:
            curves = {key: curve for key, curve in read_curves(file).items() if key[0] not in stay}
            characters = {character for character, _ in curves}
            others = {key: curve for key, curve in read_curves(into).items() if key[0] not in characters}
            write_curves(into, others | curves)
            return into
    if file.suffix == ".png":
        into = into.with_suffix(WEBP)
        write_bytes(into, webp(file.read_bytes()))
    else:
        copy_file(file, into)
    return into


def _texts(targets: list[str]) -> list[Path]:
    """Execute the notebooks of some targets on the committed results, and write the tables that texts show."""
    stems = [file.stem for file in sorted(notebooks.NOTEBOOKS.glob("*.ipynb"))]
    studies = tuple(f"{target}_" for target in targets)  # such as table2_line
    names = [stem for stem in stems if stem in (*targets, *ALWAYS) or stem.startswith(studies)]
    files = [notebooks.run_notebook(name, "reference") for name in names]
    for name, (text, csv, make_table) in tables_in_texts().items():
        if (file := paths.REFERENCE / csv).is_file():
            write_text(text, with_table(text.read_text("utf-8"), name, make_table(file)))
            files.append(text)
    rewrite_target_table()
    return [*files, REPRODUCING]
