"""From finished artefacts to what a person reads: results/runs/<profile>/ with CSVs, manifest, figures and notebook."""

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from replicate.config import Config
from replicate.engine import paths
from replicate.engine.stage import Stage
from replicate.engine.store import artefact_folder
from replicate.report import manifest
from replicate.report.results import Row, over_seeds, read_results, write_results
from replicate.report.tables import as_text
from replicate.report.training_curves import read_curves, write_curves
from replicate.targets.table1.layout import size_claim, table1
from replicate.targets.table2.layout import table2

MANIFEST = manifest.NAME


def publish_table2(configs: Sequence[Config], tables: Sequence[Stage], draw: bool = True) -> None:
    """Write Table 2 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    tables: each configuration's last stage. Configurations of one character differ in their seeds: its numbers are the
    means over them, its curves and pictures those of the first. Results of characters that are not among them stay in
    the folder. draw: False writes the numbers alone, neither figures nor notebook. Where a number comes from is read
    from the artefacts, so publishing again changes nothing. While another process publishes to the same folder, this
    one waits, so that neither loses the other's results.
    """
    profile = configs[0].profile
    folder, seeded = _folder(profile), _by_character(configs, tables)
    with _alone(folder):
        rows = _merge(folder, seeded)
        if draw:
            _draw(folder, profile, configs[0].evaluation.heatmap_deg)
    paper = read_results(paths.PAPER / "table2.csv")
    for character, runs in seeded.items():
        split = runs[0][0].samples.split
        print(as_text(table2(rows, paper, character)))
        print(f"split by {split}" + (", as in the paper" if split == "frames" else ""))
    with_it = ", figures, and table2.ipynb to read them in" if draw else ""
    print(f"written to {paths.shown(folder)}: table2.csv, {MANIFEST}{with_it}")


def publish_table1(configs: Sequence[Config], tables: Sequence[Stage]) -> None:
    """Write Table 1 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Arguments, seeds and characters that are there already: as for `publish_table2`.
    """
    from replicate.report.notebooks import run_notebook

    profile = configs[0].profile
    folder, seeded = _folder(profile), _by_character(configs, tables)
    with _alone(folder):
        facts = manifest.entries(folder, "table1")
        rows = _readable(read_results, folder / "table1.csv") or []
        runs = {name: {row.run for row in rows if row.character == name} for name in facts}
        facts = {name: own for name, own in facts.items() if runs[name] == {own.get("run")} and name not in seeded}
        rows = [row for row in rows if row.character in facts]
        for character, made in seeded.items():
            rows += over_seeds([read_results(_artefact(stage) / "table1.csv") for _, stage in made])
            facts[character] = manifest.facts_of(*zip(*made, strict=True), rows[-1].run)
        write_results(folder / "table1.csv", rows)
        manifest.write_entries(folder, "table1", dict(sorted(facts.items())))
        run_notebook("table1", profile)
    paper = read_results(paths.PAPER / "table1.csv")
    print(as_text(table1(rows, paper)))
    print(size_claim(rows, paper))
    print(f"written to {paths.shown(folder)}: table1.csv, {MANIFEST}, and table1.ipynb to read it in")


def publish_figure(name: str, configs: Sequence[Config], drawings: Sequence[Stage]) -> None:
    """Copy a figure of some characters, with its words and numbers, to the profile's folder, and execute its notebook.

    name: "figure05", …; drawings: each configuration's last stage, whose files are named name_character….
    Of several seeds the first is shown. Figures of characters that are not among them stay.
    """
    from replicate.report.notebooks import run_notebook

    profile = configs[0].profile
    folder, seeded = _folder(profile), _by_character(configs, drawings)
    with _alone(folder):
        before = manifest.entries(folder, name)
        facts = {
            character: own
            for character, own in before.items()
            if character not in seeded and all((folder / file).is_file() for file in own.get("files", ["?"]))
        }
        for character, (first, *_) in seeded.items():
            made = sorted(file for file in _artefact(first[1]).glob(f"{name}_{character}*") if file.is_file())
            for file in before.get(character, {}).get("files", ()):
                if file not in {path.name for path in made}:
                    (folder / file).unlink(missing_ok=True)
            for file in made:
                _copy(file, folder / file.name)
            own = manifest.facts_of([first[0]], [first[1]], first[1].key)
            facts[character] = {**own, "files": [file.name for file in made]}
        manifest.write_entries(folder, name, dict(sorted(facts.items())))
        run_notebook(name, profile)
    for character in seeded:
        pictures = [file for file in facts[character]["files"] if file.endswith(".png")]
        print(f"written to {paths.shown(folder)}: {', '.join(pictures)}, with their words and numbers beside them")
    print(f"written to {paths.shown(folder)}: {name}.ipynb to read them in")


def _folder(profile: str) -> Path:
    folder = paths.run_folder(profile)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _by_character(configs: Sequence[Config], lasts: Sequence[Stage]) -> dict[str, list[tuple[Config, Stage]]]:
    """Return, by character, the configuration and the last stage of each of its seeds."""
    seeded: dict[str, list[tuple[Config, Stage]]] = {}
    for config, stage in zip(configs, lasts, strict=True):
        seeded.setdefault(paths.recipe_file(config.character).stem, []).append((config, stage))
    return seeded


def _artefact(stage: Stage) -> Path:
    return artefact_folder(stage.identifier)


def _copy(source: Path, target: Path) -> None:
    beside = target.with_name(f".{target.name}.{os.getpid()}")
    shutil.copyfile(source, beside)
    os.replace(beside, target)


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
    rows, curves, facts = _present(folder)
    for character, runs in seeded.items():
        made = [_artefact(stage) for _, stage in runs]
        rows = [row for row in rows if row.character != character]
        rows += over_seeds([read_results(folder / "table2.csv") for folder in made])
        curves = {key: curve for key, curve in curves.items() if key[0] != character}
        curves |= read_curves(made[0] / "table2_curves.csv")
        shutil.copyfile(made[0] / f"table2_{character}_pose.npz", folder / f"table2_{character}_pose.npz")
        facts[character] = manifest.facts_of(*zip(*runs, strict=True), rows[-1].run)
    write_results(folder / "table2.csv", rows)
    write_curves(folder / "table2_curves.csv", curves)
    manifest.write_entries(folder, "table2", {name: facts[name] for name in sorted({row.character for row in rows})})
    return rows


def _present(folder: Path) -> tuple[list[Row], dict, dict]:
    """Return the rows, curves and manifest entries of the characters that are there as a whole.

    Such a character has rows of the run that the manifest names, curves and a pose. What is missing, can't be read or
    was left by a process killed between two files counts as absent: it is written again from the artefacts.
    """
    from replicate.report.pose_record import load_pose

    rows = _readable(read_results, folder / "table2.csv") or []
    curves = _readable(read_curves, folder / "table2_curves.csv") or {}
    entries = manifest.entries(folder, "table2")
    whole = {
        name
        for name, facts in entries.items()
        if {row.run for row in rows if row.character == name} == {facts.get("run")}
        and any(name == character for character, _ in curves)
        and _readable(load_pose, folder / f"table2_{name}_pose.npz")
    }
    return (
        [row for row in rows if row.character in whole],
        {key: curve for key, curve in curves.items() if key[0] in whole},
        {name: facts for name, facts in entries.items() if name in whole},
    )


def _readable(read: Callable[[Path], object], file: Path):
    """Return what a file holds, or None if it isn't there or is damaged, in whatever way."""
    try:
        return read(file)
    except Exception:
        return None


def _draw(folder: Path, profile: str, limit_deg: float) -> None:
    """Draw the figures and execute the notebook, unless both show these results already.

    The notebook comes last: only when it stands, with its stamp, were the figures of these results drawn to the end.
    """
    from replicate.drawing.panels import save_figure
    from replicate.report.notebooks import is_current, run_notebook
    from replicate.targets.table2.pictures import open_table2, table2_figure_names, table2_figures

    results = open_table2(folder)
    names = [name for character in results.characters for name in table2_figure_names(character)]
    drawn = all((folder / f"{name}{ending}").is_file() for name in names for ending in (".png", ".json"))
    if drawn and is_current("table2", profile, HEATMAP_DEG=limit_deg):
        return
    for character in results.characters:
        for name, figure, words in table2_figures(results, character, limit_deg):
            save_figure(figure, folder / f"{name}.png", words)
    run_notebook("table2", profile, HEATMAP_DEG=limit_deg)
