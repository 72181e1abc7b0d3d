"""The numbers of Figures 1, 9 and 10: as rows of results, as printed tables, and as a sentence for their notebooks."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from replicate.base.paths import display_path
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method_registry import in_order, method_named
from replicate.methods.method_registry import methods as all_methods
from replicate.methods.plan import Plan
from replicate.methods.typical_poses import MEDIAN, WORST
from replicate.report.pose_record import (
    CHOICES,
    FIGURE01,
    FIGURE09,
    FOLDED,
    LINE,
    TRUTH,
    WHOLE,
    PoseRecord,
    best_peer,
    close_up_region,
    marks_in_words,
    normal_means_deg,
    panel_title,
    plain_name,
    shown_in,
    vertex_mean_mm,
)
from replicate.report.publication import CharacterResult, by_character, publish_rows, results_folder
from replicate.report.results import Row, characters_of, find, run_name, write_results
from replicate.report.tables import Table, as_text
from replicate.targets.shown_records import load_records, picture_settings, record_stages

KINDS = {"vertex": "distance error, mm", "normal": "normal error, °", "strip": "normal error, °"}
ERROR = re.compile(r"(vertex|normal|strip)_error_mean\[(\w+)\](?:\[(.+)\])?")  # kind, the pose's rule, region
TITLES = {
    "figure01": "Figure 1: mean errors in the pictures' pose",
    "figure09": "Figure 9: mean normal errors of the forehead",
    "figure10": "Figure 10: mean normal errors",
    "strip": "Figure 9: mean normal errors of the lower strip",
}
RIVALS = {"figure01": ("refined", "lbs32"), "figure09": ("refined", "lbs32"), "figure10": ("refined", "dense")}
REGIONS = (WHOLE, "forehead", "eyes", "nose", "cheeks", "mouth", "jaw")  # columns in order; others come after them
RULES = {FOLDED: "the forehead folds most", MEDIAN: "the median", WORST: "the worst"}
Metric = tuple[str, str, str, float]  # method, metric, unit, value


def rows_of(figure: str, records: Mapping[str, PoseRecord], limit_deg: float, profile: str, run: str) -> list[Row]:
    """Return one character's rows of Figure 1, 9 or 10.

    An error's metric has the rule of the pose in brackets and, unless it is of the whole mesh, the region:
    normal_error_mean[folded][forehead]. The rows of the method `TRUTH` say which test pose it is, how much its forehead
    folds (Fig. 9) and where the colours end (Fig. 10). A region without normals has no row.

    figure: its name in results, "figure01"
    records: the poses by the rule that chose them, as from `load_records`
    limit_deg: the upper end of Figure 10's colours
    profile, run: for the rows' columns
    """
    metrics = [metric for rule in CHOICES if rule in records for metric in _metrics(figure, records[rule])]
    if figure == "figure10":
        metrics.append((TRUTH, "colour_limit", "deg", limit_deg))
    character = next(iter(records.values())).character
    return [
        Row(figure, character, method, metric, unit, float(value), None, 1, 1, profile, run)
        for method, metric, unit, value in metrics
        if math.isfinite(value)
    ]


def save_rows(context: StageContext, records: Mapping[str, PoseRecord]) -> None:
    """Write a figure's rows to <figure>.csv. The stage is named like the figure and has the settings `PosePicture`."""
    settings = context.config
    rows = rows_of(context.name, records, settings.limit_deg, settings.profile, run_name(context.inputs))
    write_results(context.out / f"{context.name}.csv", rows)


def _metrics(figure: str, record: PoseRecord) -> Iterator[Metric]:
    rule = f"[{record.choice}]"
    if figure != "figure10" and record.choice != FOLDED:
        return
    yield TRUTH, f"test_pose{rule}", "count", record.pose
    if figure == "figure01":
        for method in shown_in(record, FIGURE01):
            yield method, f"vertex_error_mean{rule}", "mm", vertex_mean_mm(record, method)
            means = normal_means_deg(record, method)
            for region in dict.fromkeys((WHOLE, close_up_region(record))):
                yield method, f"normal_error_mean{rule}{_of(region)}", "deg", means[region]
    elif figure == "figure09":
        from replicate.targets.figure09.forehead_wrinkles import fold_change_deg, refined_spot

        region = close_up_region(record)
        yield TRUTH, f"fold_change_mean{rule}{_of(region)}", "deg", fold_change_deg(record)
        spot = refined_spot(record)
        measured = dict.fromkeys([*shown_in(record, FIGURE09), LINE])  # the line has a number where it isn't shown, too
        for method in (name for name in measured if name in record.vertices):
            yield method, f"normal_error_mean{rule}{_of(region)}", "deg", normal_means_deg(record, method)[region]
            if spot:
                yield method, f"strip_error_mean{rule}", "deg", spot.mean_deg(record, method)
    else:
        peer = best_peer(record)
        for method in set(record.vertices) - {TRUTH}:
            if method_named(method).in_figures or method == peer:
                for region, mean in normal_means_deg(record, method).items():
                    yield method, f"normal_error_mean{rule}{_of(region)}", "deg", mean


def _of(region: str) -> str:
    return "" if region == WHOLE else f"[{region}]"


def publish(figure: str, results: Sequence[CharacterResult]) -> None:
    """Write a figure's rows and pictures of some characters to the profile's folder, and print its tables.

    Of several seeds the first is taken, for rows too, since each seed has other test poses.
    """
    for table in pose_tables(publish_rows(figure, [first for first, *_ in by_character(results).values()]), figure):
        print(as_text(table))
    folder = display_path(results_folder(results[0].config.profile))
    print(f"written to {folder}: {figure}.csv, its pictures, manifest.json, and {figure}.ipynb to read them in")


def pose_tables(rows: Iterable[Row], figure: str) -> list[Table]:
    """Return the tables of a figure: of Figure 10 one for each character, of the others one for all of them.

    Figure 9 has a second one, of the lower strip.
    """
    rows = [row for row in rows if row.table == figure]
    characters = characters_of(rows)
    if figure == "figure10":
        return [_table([row for row in rows if row.character == name], figure, [name]) for name in characters]
    first = [row for row in rows if not row.metric.startswith("strip")]
    second = [row for row in rows if not row.metric.startswith(("normal", "vertex"))]
    return [_table(part, figure, characters) for part in (first, second) if _errors(part)]


def _table(rows: Sequence[Row], figure: str, characters: Sequence[str]) -> Table:
    """Return a table with a line for each method.

    Figure 10 has a heading for each pose and a column for each region, the others have a column for each character.
    """
    errors, by_region = _errors(rows), figure == "figure10"
    found = dict.fromkeys((kind, region if by_region else character) for character, *_, kind, region in errors)
    columns = sorted(found, key=lambda column: [*KINDS].index(column[0]))
    body: list[tuple[str, ...]] = []
    for rule in dict.fromkeys(rule for _, rule, *_ in errors):
        poses = [find(rows, figure, character, TRUTH, f"test_pose[{rule}]") for character in characters]
        names = [f"{pose.value:.0f}" if pose else "–" for pose in poses]
        if by_region:
            body.append((f"test pose {names[0]}, {RULES[rule]}", *[""] * len(columns)))
        else:
            body.append(("test pose", *(names[characters.index(character)] for _, character in columns)))
        for method in in_order({method for _, by, method, *_ in errors if by == rule}):
            cells = {
                (kind, region if by_region else character): f"{value:.2f}"
                for (character, by, name, kind, region), value in errors.items()
                if (by, name) == (rule, method)
            }
            body.append((panel_title(method), *(cells.get(column, "–") for column in columns)))
    kinds = [KINDS[kind] for kind, _ in columns]
    spans = [kind if k == 0 or kind != kinds[k - 1] else "" for k, kind in enumerate(kinds)]
    whose = f", {characters[0]}" if by_region else ""
    header = (("", *spans), ("", *(name for _, name in columns)))
    notes = marks_in_words({method for _, _, method, *_ in errors})
    title = TITLES["strip" if columns[0][0] == "strip" else figure]
    return Table(title + whose, header, tuple(body), (notes,) if notes else ())


def _errors(rows: Iterable[Row]) -> dict[tuple[str, str, str, str, str], float]:
    """Return the rows' mean errors by (character, rule, method, kind, region), in the order of tables."""
    found = {}
    for row in rows:
        if match := ERROR.fullmatch(row.metric):
            kind, rule, region = match.groups(WHOLE)
            found[row.character, rule, row.method, kind, region] = row.value
    characters = characters_of(rows)

    def place(key: tuple[str, ...]) -> tuple:
        character, rule, _, kind, region = key
        at = REGIONS.index(region) if region in REGIONS else len(REGIONS)
        return characters.index(character), CHOICES.index(rule), [*KINDS].index(kind), at, region

    return {key: found[key] for key in sorted(found, key=place)}


def answer(rows: Iterable[Row], figure: str) -> str:
    """Return a figure's result in a sentence or two: in how many poses the paper's claim holds, and the best method.

    It is by the normal error of the whole mesh, or of the forehead if the figure has no other.
    """
    rows = [row for row in rows if row.table == figure]
    errors = _errors(rows)
    regions = {region for *_, kind, region in errors if kind == "normal"}
    region = WHOLE if WHOLE in regions else next(iter(regions), WHOLE)
    poses: dict[tuple[str, str], dict[str, float]] = {}
    for (character, rule, method, kind, where), value in errors.items():
        if kind == "normal" and where == region:
            poses.setdefault((character, rule), {})[method] = value
    first, other = RIVALS[figure]
    both = [pose for pose in poses.values() if first in pose and other in pose]
    sentences = []
    if both:
        nearer = _share(sum(pose[first] < pose[other] for pose in both), both)
        sentences.append(
            f"**“{plain_name(first)}” has smaller normal errors than “{plain_name(other)}” in {nearer}**: "
            f"{_range(pose[first] for pose in both)} against {_range(pose[other] for pose in both)}, "
            f"means over the {region}{_distances(rows, first, other)}."
        )
    blind = [{name: pose[name] for name in pose if not method_named(name).oracle} for pose in poses.values()]
    best = [min(pose, key=pose.__getitem__) for pose in blind if pose]
    if best:
        most = max(in_order(best), key=best.count)
        sentences.append(
            f"Of all that see rig parameters alone, “{plain_name(most)}” is the nearest in "
            f"{_share(best.count(most), best)}, with {_range(pose[most] for pose in blind if most in pose)}."
        )
    return " ".join(sentences)


def _distances(rows: Sequence[Row], first: str, other: str) -> str:
    """Return the mean distances of two methods in brackets, or "" if the rows lack those of either."""
    values = [
        [row.value for row in rows if row.method == name and row.metric.startswith("vertex_error_mean")]
        for name in (first, other)
    ]
    if not all(values):
        return ""
    left, right = (_range(each, " mm") for each in values)
    return f" (in distance {left} against {right})"


def _share(count: int, poses: Sequence[object]) -> str:
    if len(poses) == 1:
        return "this pose" if count else "no pose"
    if count == len(poses):
        return f"all {len(poses)} poses"
    return f"{count} of {len(poses)} poses" if count else f"none of the {len(poses)} poses"


def _range(values: Iterable[float], unit: str = "°") -> str:
    """Return the smallest and the largest value with their unit, or one of them if both look the same."""
    each = list(values)
    low, high = f"{min(each):.2f}", f"{max(each):.2f}"
    return f"{low}{unit}" if low == high else f"{low}{unit if unit == '°' else ''} to {high}{unit}"


# Figures of the test pose whose forehead folds most: the truth, and the predictions of a few methods.


def folded_pose_stages(
    plan: Plan, figure: str, names: Sequence[str], draw: Callable[[StageContext], None]
) -> list[Stage]:
    """Return the stages of one character's figure, those of the methods, the slow ones, first.

    figure: the name of the last stage. names: the methods; unknown ones are left out. draw: the last stage's function.
    """
    registry = all_methods(plan.config)
    shown = [registry[name] for name in names if name in registry]
    return record_stages(plan, shown, figure, draw, picture_settings(plan, shown), typical=False)


def save_folded_pose(context: StageContext, figure_of: Callable[[PoseRecord], tuple]) -> None:
    """Draw the pose of a stage's character, and save the figure, which is named like the stage, and its numbers.

    figure_of: the pose → (figure, words), for `save_figure`.
    """
    records = load_records(context.config.character, context.inputs)
    figure, words = figure_of(records[FOLDED])
    save_figure(figure, context.out / f"{context.name}_{context.config.character}.png", words)
    save_rows(context, records)
