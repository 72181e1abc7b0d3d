"""Draw committed pictures anew from committed numbers, after their layout has changed.

`python -m replicate.targets.reference.pictures teen woman` draws those of some characters, by default of all:
the figures of Table 2, Figure 1, and charts of benchmarks. It needs no cache, no network and no rig. The manifest
then names the commit at which pictures were drawn; its facts about the numbers stay. The numbers of Figures 1, 9 and 10
are written anew with their pictures.
"""

import re
import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from replicate.base import paths
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.benchmarks.bench_decoder import decoder_chart
from replicate.benchmarks.bench_ladder import ladder_figure
from replicate.benchmarks.bench_roofline import roofline_figure
from replicate.benchmarks.common import merge
from replicate.drawing.panels import WEBP, save_figure
from replicate.engine.provenance import git_state
from replicate.report import manifest
from replicate.report.pose_record import CHOICES, FOLDED, TRUTH, PoseRecord, best_peer, load_pose, pose_file, save_pose
from replicate.report.results import read_curves, read_results, write_curves
from replicate.targets.figure01 import figure01
from replicate.targets.figure10 import LIMIT_DEG, figure10, picture_name
from replicate.targets.pose_numbers import rows_of
from replicate.targets.reference.times import TARGET
from replicate.targets.table2.charts import open_table2, redraw_charts, table2_figures
from replicate.targets.table2.rows import CURVES

CHARTS = {  # of benchmarks, drawn from their rows
    "bench_decoder": decoder_chart,
    "bench_ladder": ladder_figure,
    "bench_roofline": roofline_figure,
}
OF_A_POSE = ("figure01", "figure09", "figure10")  # targets whose pictures are drawn from Table 2's poses


def redraw(characters: Collection[str]) -> list[Path]:
    """Draw the pictures of some characters anew from the committed results, and return their files.

    Raises InputError, before it draws anything, for a tree with changes: no commit would say how they were drawn.
    """
    state = git_state()
    if not (state and state["clean"]):
        raise InputError("the tree has changes: commit them, so that the manifest can say what drew the pictures")
    files = [*_of_table2(characters), *_charts(characters), *put_numbers(characters)]
    for target in (manifest.TOP, *OF_A_POSE, *CHARTS):
        entries = manifest.entries(paths.REFERENCE, target)
        for name in entries:
            if (_head_of(name) if target in CHARTS else name) in characters:
                has_poses = target not in CHARTS and pose_file(paths.REFERENCE, name, FOLDED).is_file()
                source = {"from": f"table2_{name}_pose*.npz"} if has_poses else {}
                entries[name][manifest.DRAWN] = state | source
        if entries:
            manifest.write_entries(paths.REFERENCE, target, entries)
    return files


def put_numbers(characters: Collection[str]) -> list[Path]:
    """Write the numbers of Figures 1, 9 and 10 anew from the committed poses of some characters; return the files.

    Characters without a committed picture of the figure, or without a pose, are skipped. The manifest's entries of the
    others then name Table 2's run, which made the poses.
    """
    folder, runs, files = paths.REFERENCE, manifest.entries(paths.REFERENCE, manifest.TOP), []
    for figure in OF_A_POSE:
        entries, rows = manifest.entries(folder, figure), []
        for name in characters:
            poses = {choice: file for choice in CHOICES if (file := pose_file(folder, name, choice)).is_file()}
            if name not in runs or not poses or not (folder / f"{figure}_{name}{WEBP}").is_file():
                continue
            facts, records = runs[name], {choice: load_pose(file) for choice, file in poses.items()}
            rows += rows_of(figure, records, LIMIT_DEG, facts["profile"], facts["run"])
            entries[name] = _entry_of_poses(figure, name, facts, entries.get(name, {}))
        if rows:
            files.append(folder / f"{figure}.csv")
            merge(files[-1], rows, lambda row, new=tuple(row.character for row in rows): row.character not in new)
            manifest.write_entries(folder, figure, dict(sorted(entries.items())))
    return files


def _entry_of_poses(figure: str, character: str, facts: dict, earlier: dict) -> dict:
    """Return the manifest's entry of a figure whose numbers come from Table 2's poses.

    facts: Table 2's entry. earlier: the figure's entry so far, of which the time of the figure's stage is kept.
    """
    pictures = paths.REFERENCE.glob(f"{figure}_{character}*")
    pattern = re.compile(rf"{re.escape(f'{figure}_{character}')}(_\w+)?({re.escape(WEBP)}|\.json)")
    last = f"{figure}-{character}"
    return {
        **{key: facts[key] for key in ("profile", "split", "run", manifest.DRAWN) if key in facts},
        "seeds": [min(facts["seeds"])],
        manifest.POSES: f"table2_{character}_pose*.npz",
        "files": sorted(file.name for file in pictures if pattern.fullmatch(file.name)),
        "stages": {title: stage for title, stage in earlier.get("stages", {}).items() if title == last},
    }


def _of_table2(characters: Collection[str]) -> list[Path]:
    results, files = open_table2(paths.REFERENCE), []
    for character in results.characters:
        if character not in characters:
            continue
        if character not in results.poses:  # a face from elsewhere: its meshes are not committed
            files += redraw_charts(paths.REFERENCE, [character])
            continue
        figures = list(table2_figures(results, character, LIMIT_DEG))
        record = results.poses[character][FOLDED]
        close = picture_name(record, "forehead")
        if (paths.REFERENCE / f"{close}{WEBP}").is_file():
            figures.append((close, *figure10(record, LIMIT_DEG, "forehead")))
        if (paths.REFERENCE / f"figure01_{character}{WEBP}").is_file():
            figures.append((f"figure01_{character}", *figure01(record)))
        for name, figure, words in figures:
            files.append(paths.REFERENCE / f"{name}{WEBP}")
            save_figure(figure, files[-1], words)
    return files


def _charts(characters: Collection[str]) -> list[Path]:
    files = []
    for target, chart in CHARTS.items():
        rows = read_results(paths.REFERENCE / f"{target}.csv")
        for head in dict.fromkeys(_head_of(row.character) for row in rows):
            if head in characters:
                figure, words = chart(rows, head)
                files.append(paths.REFERENCE / f"{target}_{head}{WEBP}")
                save_figure(figure, files[-1], words)
    return files


def _head_of(character: str) -> str:
    """Return the character whose head a variant has: a rung of the ladder, teen@1, has the teen's."""
    return character.partition("@")[0]


def main(arguments: Sequence[str]) -> None:
    """Draw the pictures of the characters that the command line names."""
    names = list(arguments) or list(manifest.entries(paths.REFERENCE, manifest.TOP))
    for file in redraw(names):
        print(f"written to {paths.display_path(file)}")


if __name__ == "__main__":
    sys.exit(guard(lambda: main(sys.argv[1:])))


# Poses and curves of a run's first seed, for characters whose other methods are committed already.

TOLERANCE_MM = 0.02  # rounded records of the same face differ by less


def put_first_seed(run: Path, shared: Collection[str]) -> list[Path]:
    """Put a run's methods into the committed poses and curves of the shared characters; return the files.

    Of what is used today only the nearest to the truth is kept (`best_peer`), which figures show.

    Poses are of a character's first seed, so that a run of other seeds changes nothing. A committed pose stays if
    another method chose the run's, as in a run without the method that ranks them. Pictures are not drawn: see
    `redraw`.
    """
    before, of_run = (manifest.entries(folder, TARGET) for folder in (paths.REFERENCE, run))
    names = [name for name in shared if min(of_run[name]["seeds"]) == min(before[name]["seeds"])]
    files = [file for name in names for choice in CHOICES for file in _put_pose(run, name, choice)]
    into = paths.REFERENCE / CURVES
    if names and (run / CURVES).is_file() and into.is_file():
        new = {key: curve for key, curve in read_curves(run / CURVES).items() if key[0] in names}
        write_curves(into, read_curves(into) | new)
        files.append(into)
    return files


def _put_pose(run: Path, character: str, choice: str) -> list[Path]:
    there, new = (pose_file(folder, character, choice) for folder in (paths.REFERENCE, run))
    if not (there.is_file() and new.is_file()):
        return []
    committed, record = load_pose(there), load_pose(new)
    if not _is_same(committed, record):
        return []
    labels = (committed.vertices.keys() & record.vertices.keys()) - {TRUTH}
    labels |= {best_peer(record)} - {None}
    save_pose(there, replace(committed, vertices=committed.vertices | {name: record.vertices[name] for name in labels}))
    return [there]


def _is_same(one: PoseRecord, other: PoseRecord) -> bool:
    """Return whether two records show the same pose of the same rig, chosen by the same rule."""
    rules = [(record.pose, record.choice, record.ranked_by, record.neutral.shape) for record in (one, other)]
    return rules[0] == rules[1] and np.allclose(one.vertices[TRUTH], other.vertices[TRUTH], atol=TOLERANCE_MM)
