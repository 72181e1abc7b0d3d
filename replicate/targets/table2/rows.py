"""Table 2 in numbers: a character's rows from the methods' errors, and the printed tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from replicate.base import paths
from replicate.drawing.panels import MEASURES
from replicate.engine.store import artefact_folder, read_manifest
from replicate.methods import measurement
from replicate.methods.method_registry import in_order, method_named
from replicate.report.notebooks import rows_if_there
from replicate.report.pose_record import pose_file, save_pose
from replicate.report.results import (
    STANDS_FOR,
    Curve,
    Row,
    characters_of,
    error_rows,
    find,
    most_seeds,
    read_log,
    run_name,
    seeds_note,
    write_curves,
    write_results,
)
from replicate.report.tables import Table, our_value, paper_value, round_off
from replicate.targets.shown_records import load_records


@dataclass(frozen=True)
class TableSettings:
    """The settings of Table 2's stage: the labels of its rows."""

    character: str
    profile: str
    seed: int


ROWS, SEEDS, CURVES = "table2.csv", "table2_seeds.csv", "table2_curves.csv"


def write_all(settings: TableSettings, inputs: Mapping[str, Path], out: Path) -> None:
    """Write a character's rows, curves and poses to a folder.

    inputs: the folders of rig, samples, "wrinkled", "ranked", and of every method's errors and typical poses.
    """
    write_results(out / ROWS, rows_of(settings, inputs))
    write_curves(out / CURVES, curves_of(settings.character, inputs))
    for choice, record in load_records(settings.character, inputs).items():
        save_pose(pose_file(out, settings.character, choice), record)


def rows_of(settings: TableSettings, inputs: Mapping[str, Path]) -> list[Row]:
    """Return a character's rows: each method's errors, its size, the time of its training, and its other metrics."""
    run = run_name(inputs)
    rows = []
    for method, folder in measurement.error_folders(inputs).items():
        rows += error_rows(settings.character, {method: measurement.load_errors(folder)}, settings.profile, run)
        seconds = training_s(folder)
        training = [("training", "s", seconds)] if seconds is not None else []
        for metric, unit, value in (*measurement.load_metrics(folder), *training):
            table = "table2_segments" if "[" in metric else "table2"
            seeds = None if metric.startswith("texels") else 1  # texels depend on charts, not on a training
            facts = (method, metric, unit, value, None, seeds, None, settings.profile, run)
            rows.append(Row(table, settings.character, *facts))
    return rows


def curves_of(character: str, inputs: Mapping[str, Path]) -> dict[tuple[str, str], Curve]:
    """Return the validation errors of a character's trainings, step by step."""
    files = {method: measurement.load_curve(folder) for method, folder in measurement.error_folders(inputs).items()}
    return {(character, method): read_log(file) for method, file in files.items() if file}


# The time that it takes to train a method: that of the stages behind its errors, from their artefacts' manifests.

SHARED = "replicate.methods.artefacts:"  # the stages that all methods share: rig, samples, segments


def training_s(errors: Path) -> float | None:
    """Return the wall time of all stages behind a method, in seconds of one core, or None where it is unknown.

    errors: the folder of the method's errors. Stages that the method's stages build on count once (the coarse model
    below its refinement, say), but not those that all methods share. The time is unknown without such stages, where an
    artefact is gone from the cache, and where a stage went on from a checkpoint, since its manifest has the time of the
    last part alone. A busy machine makes times longer.
    """
    try:
        manifests = _behind(errors, {})
    except FileNotFoundError:
        return None
    if not manifests or any(manifest.get("resumed") for manifest in manifests.values()):
        return None
    return float(sum(manifest["wall_s"] * max(1, manifest["threads"]) for manifest in manifests.values()))


def _behind(folder: Path, found: dict[str, dict]) -> dict[str, dict]:
    """Collect in `found`, by identifier, the manifests of the method's stages behind an artefact, and return them."""
    for identifier in read_manifest(folder)["inputs"].values():
        source = artefact_folder(identifier)
        manifest = read_manifest(source)
        if identifier not in found and not manifest["function"].startswith(SHARED):
            found[identifier] = manifest
            _behind(source, found)
    return found


# Table 2, printed: ours beside the paper's, with the rows that the paper lacks and notes on them.

STATISTICS = ("mean", "p95", "max")


def table2(ours: Iterable[Row], paper: Sequence[Row], character: str) -> Table:
    """Return all errors of one character, with the paper's means for the film character that it stands for."""
    rows = [row for row in ours if row.table == "table2" and row.character == character]
    theirs = STANDS_FOR.get(character)
    present = in_order({row.method for row in rows})
    body = [_line(rows, paper, character, theirs, method) for method in present if method_named(method).in_paper]
    extra = [_line(rows, paper, character, theirs, method) for method in present if not method_named(method).in_paper]
    name = theirs or "paper"
    headers = (
        ("", "distance error, mm", "", "", "", "normal angle error, degrees", "", "", "", "texels"),
        ("", *STATISTICS, name, *STATISTICS, name, "per vertex"),
    )
    rule = [None] if body and extra else []
    heading = f"Table 2: {character}" + (f" beside the paper's {theirs}" if theirs else "")
    return Table(heading, headers, (*body, *rule, *extra), (about_rows(rows, theirs), *table_notes(rows, present)))


def standard_rows(rows: Iterable[Row]) -> list[Row]:
    """Return the rows of the methods that tables have without METHODS."""
    return [row for row in rows if method_named(row.method).standard]


def table2_overview(ours: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return the paper's Table 2: the means of every character beside those of its film character."""
    rows = [row for row in ours if row.table == "table2"]
    characters = [c for c in STANDS_FOR if any(row.character == c for row in rows)]
    present = in_order({row.method for row in rows if row.character in characters})
    body: list[tuple[str, ...] | None] = []
    for kind, words in (("vertex", "Distance error, mm"), ("normal", "Normal angle error, degrees")):
        body += [None] if body else []
        body.append((words, *[""] * (2 * len(characters))))
        for method in present:
            cells = [method_named(method).title]
            for character in characters:
                mine = find(rows, "table2", character, method, f"{kind}_error_mean")
                cells.append(our_value(mine))
                cells.append(paper_value(find(paper, "table2", STANDS_FOR[character], method, f"{kind}_error_mean")))
            body.append(tuple(cells))
    header = ("", *(name for c in characters for name in (c, STANDS_FOR[c])))
    heading = "Table 2: mean errors of our characters beside the paper's"
    shown = [row for row in rows if row.character in characters]
    about = about_rows(shown, "each of the paper's characters")
    return Table(heading, (header,), tuple(body), (about, *table_notes(shown, present)))


def other_rigs(ours: Sequence[Row]) -> Table:
    """Return the mean errors on rigs that stand for no character of the paper's, without variants of ours."""
    rows = [row for row in ours if row.table == "table2" and row.character not in STANDS_FOR]
    rows = [row for row in rows if "@" not in row.character]
    characters, present = characters_of(rows), in_order({row.method for row in rows})
    body = []
    for method in present:
        cells = [method_named(method).title]
        for character in characters:
            for kind in ("vertex", "normal"):
                mine = find(rows, "table2", character, method, f"{kind}_error_mean")
                cells.append(our_value(mine))
        body.append(tuple(cells))
    header = ("", *(f"{character}, {unit}" for character in characters for unit in ("mm", "degrees")))
    heading = "Mean errors on rigs that others wrote: distance (mm) and normal angle (degrees)"
    about = (about_rows(rows, None), *table_notes(rows, present)) if rows else ("There are no results of such a rig.",)
    return Table(heading, (header,), tuple(body), about)


def _line(rows, paper, character: str, theirs: str | None, method: str) -> tuple[str, ...]:
    cells = [method_named(method).title]
    for kind in ("vertex", "normal"):
        for statistic in STATISTICS:
            row = find(rows, "table2", character, method, f"{kind}_error_{statistic}")
            cells.append(our_value(row))
        cells.append(paper_value(find(paper, "table2", theirs or "", method, f"{kind}_error_mean")))
    texels = find(rows, "table2", character, method, "texels_per_vertex")
    return (*cells, round_off(texels.value, "ratio") if texels else "")


def about_rows(rows: Sequence[Row], theirs: str | None) -> str:
    """Return what a table's numbers are of: poses, seeds and profile; and whose column `theirs` is, if there is one."""
    about = []
    seeds = most_seeds(rows)
    if poses := _poses_in_words(rows):
        about.append(f"{poses} unique test poses" + (" or more a seed" if seeds > 1 else ""))
    if seeds:
        about.append(seeds_note(rows))
    about += [f"profile {name}" for name in sorted({row.profile for row in rows})]
    if theirs:
        about.append(f"{theirs} is another rig: compare orderings and ratios, not millimetres")
    return "; ".join(about) + "."


def _poses_in_words(rows: Sequence[Row]) -> str:
    """Return how many poses the errors are means over, for each character where they differ; "" for none.

    Rows with fewer seeds than others of the character are skipped, since the fewest poses of fewer seeds may be more.
    """
    counts = {}
    for character in characters_of(rows):
        its_rows = [row for row in rows if row.character == character]
        counts[character] = max(row.poses or 0 for row in its_rows if (row.seeds or 0) == most_seeds(its_rows))
    counts = {character: count for character, count in counts.items() if count}
    if len(set(counts.values())) < 2:
        return "".join(f"{count:,}" for count in set(counts.values()))
    *most, last = (f"{count:,} ({character})" for character, count in counts.items())
    return f"{', '.join(most)} and {last}"


def method_notes(present: Sequence[str]) -> list[str]:
    """Return the footnotes of some methods, each once, with the marks or else the labels of its methods in front."""
    marks, labels = {}, {}  # of each note
    for method in map(method_named, present):
        if method.note and method.mark:
            marks.setdefault(f"{method.mark} {method.note}", None)
        elif method.note:
            labels.setdefault(method.note, []).append(method.label)
    return [*marks, *(f"{'; '.join(names)}: {note}" for note, names in labels.items())]


def table_notes(rows: Sequence[Row], present: Sequence[str]) -> tuple[str, ...]:
    """Return the notes below a table of Table 2's rows: of its methods, and of poses and seeds that differ."""
    notes = method_notes(present)
    left_out = [row for row in rows if row.metric == "normal_faces_left_out" and row.value]
    if left_out:
        worst = max(left_out, key=lambda row: row.value)
        notes.append(
            f"Eq. 11 leaves out faces that have no area in the true or the predicted mesh: {worst.value:,.0f} (face, "
            f"pose) pairs at most ({method_named(worst.method).title})."
        )
    single = False  # whether some rows of one seed stand beside others of several
    for character in sorted({row.character for row in rows}):
        most = most_seeds(row for row in rows if row.character == character)
        by_method = {row.method: row for row in rows if row.character == character and row.poses}
        for method in filter(by_method.__contains__, present):
            largest = max(row.poses for row in by_method.values() if row.seeds == by_method[method].seeds)
            if by_method[method].poses < largest:
                notes.append(
                    f"{method_named(method).title}: on {by_method[method].poses:,} of {character}'s poses only."
                )
        fewer = [method_named(m).title for m in present if m in by_method and 1 < (by_method[m].seeds or 0) < most]
        if fewer:
            notes.append(f"Of fewer seeds than the others of {character}: {', '.join(fewer)}.")
        single |= most > 1 and any((row.seeds or 0) == 1 for row in by_method.values())
    return (*notes, *(["Means without ± are of one seed."] if single else []))


# Table 2 apart from millimetres: ratios between methods, and where on the face the errors are.

# (method, over another method, error): what a replication on another rig can compare, and measures of our success.
RATIOS = (
    ("refined", "coarse", "vertex"),
    ("refined", "coarse", "normal"),
    ("refined", "dense", "vertex"),
    ("refined", "dense", "normal"),
    ("refined", "lbs32", "vertex"),
    ("refined", "lbs32", "normal"),
    ("coarse", "floor", "normal"),
    ("refined", "floor_refined", "normal"),
    ("refined", "neutral", "vertex"),
)
ERRORS = {"vertex": "distance", "normal": "normal angle"}
# (question, method, over another method, error): the questions that README answers for all characters together.
QUESTIONS = (
    ("Does refinement help?", "refined", "coarse", "normal"),
    ("Are the normals of dense networks worse?", "dense", "refined", "normal"),
    ("Does LBS lose the wrinkles?", "lbs32", "refined", "normal"),
    ("Is LBS as close in distance?", "lbs32", "refined", "vertex"),
    ("How far does a straight line get in normals?", "linear", "refined", "normal"),
    ("And in distance?", "linear", "refined", "vertex"),
    ("Could the maps hold more than the networks learn?", "floor", "coarse", "normal"),
    ("Does our own method do better?", "regional", "refined", "normal"),
)
READING = (
    "Below 1 the first method has the smaller error. A column of the paper's has the ratios of its own numbers; it has "
    "no straight line, no floors and not our method."
)


def table2_ratios(ours: Sequence[Row], paper: Sequence[Row], character: str) -> Table:
    """Return ratios of mean errors beside the same ratios in the paper's numbers."""
    columns = [(ours, character), *([(paper, STANDS_FOR[character])] if character in STANDS_FOR else [])]
    body = []
    for method, other, kind in RATIOS:
        ratios = [_ratio(rows, name, method, other, kind) for rows, name in columns]
        if ratios[0] is not None:
            label = f"{method_named(method).title} / {method_named(other).title}, {ERRORS[kind]}"
            body.append((label, *(round_off(ratio, "ratio") for ratio in ratios)))
    names = [name for _, name in columns]
    header = ("mean error of one method over another's", *names)
    return Table(f"Table 2 as ratios: {' beside '.join(names)}", (header,), tuple(body))


def table2_questions(ours: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return ratios of mean errors, each answering a question, for all stand-ins for the paper's characters."""
    characters = [character for character in characters_of(ours) if character in STANDS_FOR]
    columns = [
        (rows, name) for character in characters for rows, name in ((ours, character), (paper, STANDS_FOR[character]))
    ]
    body = []
    for question, method, other, kind in QUESTIONS:
        ratios = [_ratio(rows, name, method, other, kind) for rows, name in columns]
        if any(ratio is not None for ratio in ratios[::2]):
            label = f"{method_named(method).title} / {method_named(other).title}, {ERRORS[kind]}"
            body.append((question, label, *(round_off(ratio, "ratio") for ratio in ratios)))
    header = ("question", "ratio of mean errors", *(name for _, name in columns))
    return Table("Table 2 as ratios", (header,), tuple(body), (READING,), text_columns=2)


def _ratio(rows: Iterable[Row], character: str, method: str, other: str, kind: str) -> float | None:
    rows = list(rows)
    above, below = (find(rows, "table2", character, m, f"{kind}_error_mean") for m in (method, other))
    return above.value / below.value if above and below and below.value else None


def table2_segments(ours: Iterable[Row], character: str) -> Table:
    """Return each segment's mean vertex and normal error for every method, segments in the order of their names.

    Spreads would make it wider than a page; a note says where they are.
    """
    rows = [row for row in ours if row.table == "table2_segments" and row.character == character]
    methods = [method for method in in_order({row.method for row in rows}) if method != "attachment"]
    names = sorted({row.metric.partition("[")[2].rstrip("]") for row in rows if "_error_" in row.metric})
    body: list[tuple[str, ...] | None] = []
    for kind, unit in (("vertex", "mm"), ("normal", "deg")):
        body += [None] if body else []
        for name in names:
            errors = (find(rows, "table2_segments", character, m, f"{kind}_error_mean[{name}]") for m in methods)
            cells = (our_value(row, spread=False) for row in errors)
            body.append((f"{name}, {unit}", *cells))
    header = (
        "",
        *(method_named(m).title.replace("LBS: ", "LBS ").replace(" bones", "").replace(", ", " ") for m in methods),
    )
    seeds = most_seeds(rows)
    notes = (f"Means over {seeds} seeds; their standard deviations are in table2.csv.",) if seeds > 1 else ()
    return Table(f"Table 2 by segment: {character}, mean errors", (header,), tuple(body), notes)


# The cost of each row of Table 2: megabytes, multiplications for a pose, and the time of its training.

METRICS = ("model_size", "multiplications", "training")
NOTES = (
    "Multiplications: products with weights, map networks as Fig. 3 draws them; the rigid step is left out.",
    "LBS: the blend of a pose whose bones are known; finding them takes the true mesh.",
    "Training: wall time of one core, with what a row builds on, without rig and samples; longer on a busy machine.",
)


def work_table(ours: Iterable[Row], character: str) -> Table | None:
    """Return one character's sizes, multiplications and times of training; None if no row has multiplications."""
    rows = [row for row in ours if row.table == "table2" and row.character == character and row.metric in METRICS]
    if not any(row.metric == "multiplications" for row in rows):
        return None
    body = []
    for method in in_order({row.method for row in rows}):
        size, work, training = (find(rows, "table2", character, method, metric) for metric in METRICS)
        millions = round_off(work.value / 1e6, "ratio") if work else "–"
        cells = map(our_value, (size, training))
        body.append((method_named(method).label, next(cells), millions, next(cells)))
    header = ("", "MB", "million multiplications a pose", "training, s")
    return Table(f"Size, work and training: {character}", (header,), tuple(body), NOTES)


# Two versions of Table 2 side by side: other charts, more samples and a longer schedule, test poses of whole clips.

PROFILE_RATIOS = (("refined", "coarse"), ("refined", "dense"), ("regional", "refined"), ("regional", "dense"))


def paper_profile_rows(results: str) -> list[Row]:
    """Return the rows of the profile `paper` to compare some results with, if there are any.

    results: "reference", or the profile of a run of yours.
    """
    return rows_if_there(paths.PAPER_PROFILE if results in paths.committed_folders() else "paper", ROWS)


def clips_rows(results: str) -> list[Row]:
    """Return the committed rows of networks that were tested on whole clips; none for a run of yours."""
    return rows_if_there(paths.WHOLE_CLIPS, ROWS) if results in paths.committed_folders() else []


def second_layouts(rows: Sequence[Row]) -> dict[str, tuple[str, list[Row]]]:
    """Return, by character, the name of another layout of its charts and the rows with it, as of teen@one_face."""
    found, names = {}, characters_of(rows)
    for name in names:
        character, _, layout = name.partition("@")
        if layout and not layout.isdecimal() and character in names:  # a number is a rung of the ladder
            others = [replace(row, character=character) for row in rows if row.character == name]
            found[character] = layout.replace("_", " "), others
    return found


def layout_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table for each character with rows of two layouts of charts: its errors with either."""
    return [
        side_by_side(f"Two layouts of charts: {character}", rows, others, character, ("its own charts", layout))
        for character, (layout, others) in second_layouts(rows).items()
    ]


def profile_tables(rows: Sequence[Row], others: Sequence[Row]) -> list[Table]:
    """Return a table for each character in both sets of rows, which have two profiles: its errors with either."""
    tables = []
    for name in _in_both(rows, others):
        profiles = [next(row.profile for row in each if row.character == name) for each in (rows, others)]
        tables.append(side_by_side(f"Two profiles: {name}", rows, others, name, profiles))
    return tables


def split_tables(rows: Sequence[Row], others: Sequence[Row]) -> list[Table]:
    """Return a table for each character in both sets of rows: its errors by a split of frames and by one of clips."""
    splits = ("frames", "clips")
    return [side_by_side(f"Two splits: {name}", rows, others, name, splits) for name in _in_both(rows, others)]


def _in_both(rows: Sequence[Row], others: Sequence[Row]) -> list[str]:
    return [name for name in characters_of(others) if name in characters_of(rows)]


def side_by_side(title: str, rows: Sequence[Row], others: Sequence[Row], character: str, names: Sequence[str]) -> Table:
    """Return both mean errors and the training time of each method in two sets of rows, and ratios of errors.

    rows: the first set
    others: the second set
    names: the names of the two sets
    """
    columns = (*((metric, label) for metric, _, label in MEASURES), ("training", "training, s"))
    body: list[tuple[str, ...] | None] = []
    for method in map(method_named, in_order({row.method for row in others})):
        both = [(metric, each) for metric, _ in columns for each in (rows, others)]
        cells = [find(each, "table2", character, method.name, metric) for metric, each in both]
        if all(cells[:4]):
            body.append((method.label, *(our_value(cell, spread=False) for cell in cells)))
    lines = [_ratios(rows, others, character, *pair) for pair in PROFILE_RATIOS]
    body += [None, *(line for line in lines if line)]
    spans = ("", *(cell for _, label in columns for cell in (label, "")))
    return Table(title, (spans, ("", *names * len(columns))), tuple(body))


def _ratios(
    rows: Sequence[Row], others: Sequence[Row], character: str, above: str, below: str
) -> tuple[str, ...] | None:
    cells = []
    for metric, *_ in MEASURES:
        for each in (rows, others):
            ends = [find(each, "table2", character, method, metric) for method in (above, below)]
            if not all(ends):
                return None
            cells.append(round_off(ends[0].value / ends[1].value, "ratio"))
    return (f"{method_named(above).label} / {method_named(below).label}", *cells, "", "")
