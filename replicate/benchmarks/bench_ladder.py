"""On which rigs would the claims hold? Table 2's errors on rigs of one head, from an easy one to a hard one.

`make bench-ladder` goes up a character's ladder (`data_recipes/README.md`): the same head and controls, with more
deformers at each step. Then it takes uniform poses instead of the animation, and the whole rig three times more: with
the face in one chart, as in the paper; tested on whole clips that training hasn't seen, instead of frames; and tested
on these clips, but trained on the animation as it is, without the factors of Eq. 5. On each it trains the paper's
networks, the straight line and our method for a part of the profile's steps, and measures them on the test poses as
Table 2 does.
No setting is chosen by the results. Trainings are stages in the cache, so that a stopped run goes on where it was.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from data_recipes.recipe_paths import split_character
from replicate.base.exceptions import InputError
from replicate.benchmarks.common import (
    add_count,
    add_only,
    answer,
    artefacts_of,
    bench_folder,
    in_groups,
    make_parser,
    publish,
    save_picture,
    selected,
    split_names,
)
from replicate.config import Config, resolve
from replicate.drawing.panels import DPI, LETTER_PT, MEASURES, WIDTH, Words, enlarge, error_scale, tidy
from replicate.methods import measurement
from replicate.methods.method_registry import choose, in_order, method_named, sections
from replicate.methods.plan import Plan
from replicate.report.results import Row, error_rows, find, read_results
from replicate.report.tables import Table, as_text, our_value, round_off

if TYPE_CHECKING:
    import matplotlib.figure


ABOUT = "on which rigs the claims would hold: Table 2's errors from an easy rig of a head to a hard one"
WRITES = "results/runs/bench/bench_ladder.csv, bench_ladder_<character>.png"
PART = 5
METHODS = ("coarse", "refined", "dense", "lbs32", "regional", "linear", "neutral")
TRAINED = ("coarse", "refinement", "dense", "regional")  # sections of the configuration with a training
SHOWN = ("vertex_error_mean", "vertex_error_p95", "normal_error_mean", "normal_error_p95")


def rung_config(head: str, rung: str, profile: str, part: int) -> Config:
    """Return the configuration of one rig, whose networks train for 1 / `part` of the profile's steps."""
    character, samples = f"{head}@{rung}", {}
    if rung in (CLIPS, RAW):
        character, samples = head, {"split": "clips"} | ({"low": 1.0, "high": 1.0} if rung == RAW else {})
    more = sections(profile)
    usual = resolve(character, profile, sections=more)
    short = {name: {"training": {"steps": max(1, getattr(usual, name).training.steps // part)}} for name in TRAINED}
    return resolve(character, profile, short | {"samples": samples}, sections=more)


def measure(head: str, rung: str, profile: str, part: int, methods: Sequence[str]) -> list[Row]:
    """Train and measure some methods on one rig; return their errors as rows of the character <head>@<rung>.

    head, rung, profile, part: as for `rung_config`.
    methods: their names.
    """
    config = rung_config(head, rung, profile, part)
    plan = Plan(config)
    stages = [measurement.stage(plan, method) for method in choose(methods, config)]
    folders = measurement.error_folders(artefacts_of(TABLE, config, stages))
    errors = {name: measurement.load_errors(folder) for name, folder in folders.items()}
    rows = error_rows(plan.character, errors, profile, TABLE.replace("_", "-"))
    shown = [row for row in rows if row.table == "table2" and row.metric in SHOWN]
    return [replace(row, table=TABLE, character=f"{head}@{rung}") for row in shown]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples and settings")
    parser.add_argument("--rungs", default=",".join(RUNGS), help=f"which rigs of the head (default: {','.join(RUNGS)})")
    add_only(parser)
    add_count(parser, "part", PART, "a training takes so many times fewer steps than the profile's")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    rungs = options.rungs.replace(",", " ").split()
    if not rungs or set(rungs) - set(RUNGS):
        raise InputError(f"rungs: expected some of {', '.join(RUNGS)}, got {options.rungs!r}")
    methods = selected(METHODS, options.only)
    for head in split_names(options.characters):
        if split_character(head)[1]:
            raise InputError(f"character {head!r} is one rig of a ladder: name its head, {split_character(head)[0]!r}")
        for rung in rungs:
            rows = measure(head, rung, options.profile, options.part, methods)
            publish(TABLE, rows, [], command_line, in_part=bool(options.only))
        rows = read_results(bench_folder() / f"{TABLE}.csv")  # those of earlier calls too
        for table in ladder_tables(rows, head):
            print(as_text(table))
        save_picture(f"{TABLE}_{head}", ladder_figure(rows, head))


# The ladder's numbers as tables: the errors on each rig of a head, and the ratios that claims are about.

TABLE = "bench_ladder"
UNIFORM, ONE_FACE, CLIPS, RAW = "uniform", "one_face", "clips", "raw"
APART = (UNIFORM, ONE_FACE, CLIPS, RAW)  # not steps of the ladder, but a whole rig with other charts or poses
RUNGS = {  # of a ladder → what its rig adds to the one before, or what its poses are
    "1": "targets",
    "2": "+ pairs",
    "3": "+ turns",
    "4": "+ flesh",
    "5": "+ wrinkles",
    "6": "shorter wrinkles",
    UNIFORM: "uniform poses",
    ONE_FACE: "@5, the face in one chart",
    CLIPS: "@5, clips held out",
    RAW: "clips, raw animation",
}
ERRORS = {"vertex_error_mean": "Distance error, mm", "normal_error_mean": "Normal error, degrees"}
RATIOS = (  # (title, method, the one below the line)
    ("C1: refined over coarse", "refined", "coarse"),
    ("C2: refined over dense", "refined", "dense"),
    ("C3: refined over LBS with 32 bones", "refined", "lbs32"),
    ("refined over a straight line", "refined", "linear"),
    ("ours over refined", "regional", "refined"),
    ("ours over dense", "regional", "dense"),
    ("ours over a straight line", "regional", "linear"),
)


def rungs_of(rows: Sequence[Row], head: str) -> list[str]:
    """Return those rungs of a head's ladder that have rows, from the lowest up."""
    present = {row.character for row in rows if row.table == TABLE}
    return [rung for rung in RUNGS if f"{head}@{rung}" in present]


def ladder_tables(rows: Sequence[Row], head: str) -> list[Table]:
    """Return two tables: a head's errors on each rung of its ladder, and the ratios of errors that claims are about."""
    rungs = rungs_of(rows, head)
    values = {
        (method, metric, rung): row
        for method in in_order({row.method for row in rows if row.table == TABLE})
        for metric in ERRORS
        for rung in rungs
        if (row := find(rows, TABLE, f"{head}@{rung}", method, metric))
    }
    methods = list(dict.fromkeys(method for method, _, _ in values))
    header = ("", *(RUNGS[rung] if rung in APART else f"@{rung} {RUNGS[rung]}" for rung in rungs))
    errors, ratios, empty = [], [], [""] * len(rungs)
    for metric, title in ERRORS.items():
        errors.append((metric, (title, *empty)))
        for method in methods:
            cells = (our_value(values.get((method, metric, rung))) for rung in rungs)
            errors.append((metric, (method_named(method).title, *cells)))
        ratios.append((metric, (title.partition(",")[0], *empty)))
        for comparison, method, other in RATIOS:
            pairs = [(values.get((method, metric, rung)), values.get((other, metric, rung))) for rung in rungs]
            if any(above and below for above, below in pairs):
                ratios.append((metric, (comparison, *map(_ratio, pairs))))
    poses = sorted({row.poses for row in values.values() if row.poses})
    count = f"{poses[0]:,}" if len(poses) == 1 else f"{poses[0]:,} to {poses[-1]:,}" if poses else "no"
    notes = (f"{count} test poses; one seed; a part of the profile's steps.",)
    return [
        Table(f"The ladder of {head}: mean errors", (header,), in_groups(errors), notes),
        Table(
            f"The ladder of {head}: ratios", (header,), in_groups(ratios), ("Below 1 the first has the smaller error.",)
        ),
    ]


def _ratio(pair: tuple[Row | None, Row | None]) -> str:
    above, below = pair
    return round_off(above.value / below.value if above and below and below.value else None, "ratio")


# The ladder as a figure: each method's errors from an easy rig of a head to a hard one.

HEIGHT = 8.4  # inches, of both panels
LEFT_OUT = "neutral"  # far above all others
SIZES = {"coarse": 14}  # of marks: the refined ones are drawn on the coarse ones
MARKERS = {"dense": "s", "lbs32": "^", "regional": "D", "linear": "v"}  # others are round
WORDS = {"mm": "mm", "deg": "degrees"}


def ladder_figure(rows: Sequence[Row], head: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both mean errors of each method on the rungs of a head's ladder, a method a colour."""
    from matplotlib.figure import Figure

    rungs = rungs_of(rows, head)
    places = {rung: place + 0.4 * (rung in APART) for place, rung in enumerate(rungs)}
    methods = [name for name in in_order({row.method for row in rows if row.table == TABLE}) if name != LEFT_OUT]
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(2, 1, sharex=True), MEASURES, strict=True):
        for name in methods:
            found = {rung: find(rows, TABLE, f"{head}@{rung}", name, metric) for rung in rungs}
            values = {rung: row.value for rung, row in found.items() if row}
            climb, alone = ([rung for rung in values if (rung in APART) is apart] for apart in (False, True))
            looks = {
                "color": method_named(name).colour,
                "marker": MARKERS.get(name, "o"),
                "markersize": SIZES.get(name, 8),
                "linewidth": 2.2,
            }
            title = method_named(name).title
            axes.plot([places[rung] for rung in climb], [values[rung] for rung in climb], label=title, **looks)
            axes.plot([places[rung] for rung in alone], [values[rung] for rung in alone], linestyle="", **looks)
            errors = ", ".join(f"{_label(rung)} {round_off(value, unit)}" for rung, value in values.items())
            phrases.append(f"{title}, {WORDS[unit]}: {errors}")
        axes.set_xticks(list(places.values()), [_label(rung).replace(" ", "\n") for rung in rungs])
        axes.set_ylabel(label)
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=LETTER_PT)
    steps = "; ".join(RUNGS[rung] if rung in APART else f"@{rung} {RUNGS[rung]}" for rung in rungs)
    return figure, Words(
        f"Two line charts of mean errors on rigs of {head}, one above the other, logarithmic. {'; '.join(phrases)}.",
        f"The ladder of {head}: mean errors of each method on rigs of one head, from an easy one to a hard one "
        f"({steps}). Trainings are shorter than the profile's. † sees the true mesh of each test pose.",
    )


def _label(rung: str) -> str:
    return rung.replace("_", " ") if rung in APART else f"@{rung}"


if __name__ == "__main__":
    sys.exit(main())
