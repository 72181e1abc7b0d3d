"""From finished artefacts to what a person reads: results/runs/<profile>/ with CSVs, manifest, figures and notebook."""

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from replicate import paths
from replicate.config import Config
from replicate.evaluation.curves import read_curves, write_curves
from replicate.evaluation.results import Row, over_seeds, read_results, write_results
from replicate.evaluation.table2 import table2
from replicate.evaluation.tables import as_text
from replicate.provenance import graph_git, stage_facts
from replicate.stages import Stage
from replicate.store import artefact_folder, read_manifest

MANIFEST = "manifest.json"


def publish_table2(configs: Sequence[Config], tables: Sequence[Stage]) -> None:
    """Write Table 2 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    tables: each configuration's last stage. Configurations of one character differ in their seeds: its numbers are the
    means over them, its curves and pictures those of the first. Results of characters that are not among them stay in
    the folder. Where a number comes from is read from the artefacts, so publishing again changes nothing. While another
    process publishes to the same folder, this one waits, so that neither loses the other's results.
    """
    profile = configs[0].profile
    folder = paths.run_folder(profile)
    folder.mkdir(parents=True, exist_ok=True)
    seeded: dict[str, list[tuple[Config, Stage]]] = {}
    for config, stage in zip(configs, tables, strict=True):
        seeded.setdefault(paths.recipe_file(config.character).stem, []).append((config, stage))
    with _alone(folder):
        rows = _merge(folder, seeded)
        _draw(folder, profile, configs[0].evaluation.heatmap_deg)
    paper = read_results(paths.PAPER / "table2.csv")
    for character, runs in seeded.items():
        split = runs[0][0].samples.split
        print(as_text(table2(rows, paper, character)))
        print(f"split by {split}" + (", as in the paper" if split == "frames" else ""))
    print(f"written to {paths.shown(folder)}: table2.csv, {MANIFEST}, figures, and table2.ipynb to read them in")


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder of results, beside it; the system frees it should the process die."""
    held = FileLock(folder.with_name(f".{folder.name}.lock"))
    try:
        held.acquire(timeout=0)
    except Timeout:
        print(f"{paths.shown(folder)}: being written by another process; waiting for it", flush=True)
        held.acquire(poll_interval=0.2)
    try:
        yield
    finally:
        held.release()


def _merge(folder: Path, seeded: Mapping[str, Sequence[tuple[Config, Stage]]]) -> list[Row]:
    """Write the results of some characters beside those of the others that are there, and return all rows.

    seeded: by character, the configuration and the last stage of each of its seeds.
    """
    rows, curves, manifest = _present(folder)
    for character, runs in seeded.items():
        made = [artefact_folder(stage.identifier) for _, stage in runs]
        rows = [row for row in rows if row.character != character]
        rows += over_seeds([read_results(folder / "table2.csv") for folder in made])
        curves = {key: curve for key, curve in curves.items() if key[0] != character}
        curves |= read_curves(made[0] / "table2_curves.csv")
        shutil.copyfile(made[0] / f"table2_{character}_pose.npz", folder / f"table2_{character}_pose.npz")
        manifest[character] = _facts([config for config, _ in runs], [stage for _, stage in runs], rows[-1].run)
    write_results(folder / "table2.csv", rows)
    write_curves(folder / "table2_curves.csv", curves)
    _write_manifest(folder / MANIFEST, {name: manifest[name] for name in sorted({row.character for row in rows})})
    return rows


def _present(folder: Path) -> tuple[list[Row], dict, dict]:
    """Return the rows, curves and manifest entries of the characters that are there as a whole.

    Such a character has rows of the run that the manifest names, curves and a pose. What is missing, can't be read or
    was left by a process killed between two files counts as absent: it is written again from the artefacts.
    """
    from replicate.evaluation.pose import load_pose

    rows = _readable(read_results, folder / "table2.csv") or []
    curves = _readable(read_curves, folder / "table2_curves.csv") or {}
    manifest = _readable(_entries, folder / MANIFEST) or {}
    whole = {
        name
        for name, facts in manifest.items()
        if {row.run for row in rows if row.character == name} == {facts.get("run")}
        and any(name == character for character, _ in curves)
        and _readable(load_pose, folder / f"table2_{name}_pose.npz")
    }
    return (
        [row for row in rows if row.character in whole],
        {key: curve for key, curve in curves.items() if key[0] in whole},
        {name: facts for name, facts in manifest.items() if name in whole},
    )


def _readable(read: Callable[[Path], object], file: Path):
    """Return what a file holds, or None if it isn't there or is damaged, in whatever way."""
    try:
        return read(file)
    except Exception:
        return None


def _entries(file: Path) -> dict[str, dict]:
    """Return each character's own facts from a manifest that `_write_manifest` wrote."""
    characters = json.loads(file.read_text(encoding="utf-8"))["characters"]
    return {name: facts for name, facts in characters.items() if isinstance(facts, dict)}


def _facts(configs: list[Config], tables: list[Stage], run: str) -> dict:
    """Return where one character's numbers come from: the run that made its table, and every stage behind it.

    configs, tables: the configuration and the last stage of each seed; they differ in nothing else.
    """
    return {
        **read_manifest(artefact_folder(tables[0].identifier))["run"],
        "git": graph_git(tables),
        "seeds": [config.seed for config in configs],
        "split": configs[0].samples.split,
        "run": run,
        "stages": stage_facts(tables),
    }


def _write_manifest(file: Path, characters: dict[str, dict]) -> None:
    """Write what all characters share at the top, and each one's own facts below."""
    each = list(characters.values())
    shared = {
        key: value
        for key, value in each[0].items()
        if key not in ("stages", "run") and all(facts.get(key) == value for facts in each)
    }
    text = json.dumps({**shared, "characters": characters}, indent=1, ensure_ascii=False) + "\n"
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, file)


def _draw(folder: Path, profile: str, limit_deg: float) -> None:
    """Draw the figures and execute the notebook, unless both show these results already.

    The notebook comes last: only when it stands, with its stamp, were the figures of these results drawn to the end.
    """
    from replicate.figures.notebooks import is_current, run_notebook
    from replicate.figures.panels import save_figure
    from replicate.figures.table2_figures import open_table2, table2_figure_names, table2_figures

    results = open_table2(folder)
    names = [name for character in results.characters for name in table2_figure_names(character)]
    drawn = all((folder / f"{name}{ending}").is_file() for name in names for ending in (".png", ".json"))
    if drawn and is_current("table2", profile, HEATMAP_DEG=limit_deg):
        return
    for character in results.characters:
        for name, figure, words in table2_figures(results, character, limit_deg):
            save_figure(figure, folder / f"{name}.png", words)
    run_notebook("table2", profile, HEATMAP_DEG=limit_deg)
