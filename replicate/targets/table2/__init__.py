"""Make Table 2, the errors of every method on held-out poses beside the paper's, with Figures 9 and 10."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from replicate.base.files import copy_file
from replicate.base.paths import PAPER, display_path
from replicate.cli.running import make_rows
from replicate.config import Config
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report import manifest
from replicate.report.notebooks import is_current, run_notebook
from replicate.report.pose_record import CHOICES, load_pose, pose_file
from replicate.report.publication import CharacterResult, alone, by_character, facts_of, readable, results_folder
from replicate.report.results import (
    Row,
    joined,
    of_character,
    over_seeds,
    read_curves,
    read_results,
    read_seeds,
    where,
    write_curves,
    write_results,
    write_seeds,
)
from replicate.report.tables import as_text
from replicate.targets.shown_records import record_stages
from replicate.targets.table2.rows import CURVES, ROWS, SEEDS, TableSettings, table2, work_table, write_all


def stages(plan: Plan, methods: Sequence[Method]) -> list[Stage]:
    """Return the stages of one character's table, those of the methods, the slow ones, first and the table last."""
    settings = TableSettings(plan.character, plan.config.profile, plan.config.seed)
    return record_stages(plan, methods, "table2", write_table, settings)


def write_table(context: StageContext) -> None:
    """Gather one character's rows, the curves of its trainings and the poses that figures show."""
    write_all(context.config, context.inputs, context.out)


def run(options: argparse.Namespace) -> None:
    """Measure the errors of every method on every character, publish and print them.

    Raises RunError for methods that failed, after it has published the other rows.
    """
    make_rows(
        options,
        lambda rigs: [stages(plan, chosen) for plan, chosen in rigs],
        lambda results: publish(results, not options.numbers_only),
    )


# Table 2 as a person reads it: its files in results/runs/<profile>/, printed, with figures and notebook.


def publish(results: Sequence[CharacterResult], draw: bool = True) -> None:
    """Write Table 2 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Several seeds are averaged, with each seed's numbers in a second file; curves and pictures are of the first seed.
    Results of other characters stay. draw: False writes numbers alone, without figures and notebook. Publishing again
    changes nothing, since the provenance is read from the artefacts. While another process publishes to the same
    folder, this one waits, so that neither loses the other's results.
    """
    config = results[0].config
    folder, groups = results_folder(config.profile), by_character(results)
    with alone(folder):
        rows = _merge(folder, groups)
        if draw:
            _draw(folder, config.profile, config.evaluation.heatmap_deg)
    paper = read_results(PAPER / ROWS)
    for character, each in groups.items():
        split = each[0].config.samples.split
        print(as_text(table2(rows, paper, character)))
        print(f"split by {split}" + (", as in the paper" if split == "frames" else "") + "\n")
        if costs := work_table(rows, character):
            print(as_text(costs))
    with_it = ", figures, and table2.ipynb to read them in" if draw else ""
    print(f"written to {display_path(folder)}: {ROWS}, {manifest.NAME}{with_it}")


def _merge(folder: Path, groups: Mapping[str, Sequence[CharacterResult]]) -> list[Row]:
    """Write the results of some characters next to those that are there, and return all rows."""
    rows, seeds, curves, facts = _present(folder)
    for character, each in groups.items():
        by_seed = {result.config.seed: read_results(result.folder / ROWS) for result in each}
        seeds = joined(where(seeds, character.__ne__), by_seed)
        rows = [row for row in rows if row.character != character]
        rows += over_seeds(list(by_seed.values()))
        curves = {key: curve for key, curve in curves.items() if key[0] != character}
        curves |= read_curves(each[0].folder / CURVES)
        for choice in CHOICES:
            copy_file(pose_file(each[0].folder, character, choice), pose_file(folder, character, choice))
        facts[character] = {**facts_of(each, rows[-1].run), "configuration": _as_table(each[0].config)}
    write_results(folder / ROWS, rows)
    write_seeds(folder / SEEDS, seeds)
    write_curves(folder / CURVES, curves)
    manifest.write_entries(folder, "table2", {name: facts[name] for name in sorted({row.character for row in rows})})
    return rows


def _as_table(config: Config) -> dict:
    """Return the configuration that all seeds share as nested tables, for the manifest."""
    return {name: value for name, value in asdict(config).items() if name not in ("character", "seed", "device")}


def _present(folder: Path) -> tuple[list[Row], dict[int, list[Row]], dict, dict]:
    """Return the rows, each seed's rows, curves and manifest entries of the characters that are complete.

    A complete character has rows of the run that the manifest names, those of its seeds, and its poses. If something is
    missing, damaged or left half-done by a killed process, the character is written again from its artefacts.
    """
    rows = readable(read_results, folder / ROWS) or []
    curves = readable(read_curves, folder / CURVES)
    entries = manifest.entries(folder, "table2") if curves is not None else {}
    seeds = readable(read_seeds, folder / SEEDS) or {}
    whole = {
        name
        for name, facts in entries.items()
        if {row.run for row in rows if row.character == name} == {facts.get("run")}
        and sorted(of_character(seeds, name)) == sorted(facts.get("seeds", ()))
        and all(readable(load_pose, pose_file(folder, name, choice)) for choice in CHOICES)
    }
    return (
        [row for row in rows if row.character in whole],
        where(seeds, whole.__contains__),
        {key: curve for key, curve in (curves or {}).items() if key[0] in whole},
        {name: facts for name, facts in entries.items() if name in whole},
    )


def _draw(folder: Path, profile: str, limit_deg: float) -> None:
    """Draw the figures and execute the notebook, unless both show these results already.

    The notebook comes last: its stamp says that the figures of these results are complete.
    """
    from replicate.drawing.panels import has_figure, save_figure
    from replicate.drawing.render import shared_pictures
    from replicate.targets.table2.charts import open_table2, table2_figure_names, table2_figures

    results = open_table2(folder)
    names = [name for character in results.characters for name in table2_figure_names(results, character)]
    complete = all(has_figure(folder / f"{name}.png") for name in names)
    if complete and is_current("table2", profile, HEATMAP_DEG=limit_deg):
        return
    with shared_pictures():  # the notebook shows the same renderings
        for character in results.characters:
            for name, figure, words in table2_figures(results, character, limit_deg):
                save_figure(figure, folder / f"{name}.png", words)
        run_notebook("table2", profile, HEATMAP_DEG=limit_deg)
