"""What makes the dense networks of the paper fail: the recipe of its released code, taken apart.

The paper's dense networks have 5.0 mm and 8.9° on Ray, several times the errors of its CNN. `make bench-released`
trains dense networks as the released code does (`replicate.methods.released`) and with one thing as in ours, then ours
with one thing as released, and the CNN both ways, all at one short schedule. Errors are those of the validation poses;
test poses are not looked at. Trainings go through the cache like any stage, so that a stopped run goes on.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from functools import partial

from replicate.benchmarks.common import add_count, answer, bench_folder, make_parser
from replicate.benchmarks.variants import Variant, compare_variants, variants_tables
from replicate.config import Config, resolve
from replicate.engine import paths
from replicate.engine.schema import Checked
from replicate.methods import released
from replicate.report.results import Row
from replicate.report.tables import Table

ABOUT = "which part of the released recipe makes the paper's dense networks fail"
WRITES = "results/runs/bench/bench_released.csv, bench_released_<character>.png"
TABLE = "bench_released"
STEPS = 3_000
SECTIONS = {"dense": released.own_dense, "coarse": released.own_coarse}  # of the configuration, by method
PIECES = {  # of a recipe: the keys of the section that it consists of
    "controls": ("conditioning.inputs",),
    "unit of offsets": ("conditioning.unit_mm",),
    "controls and unit": ("conditioning.inputs", "conditioning.unit_mm"),
    "first weights": ("conditioning.weights",),
    "normal weight": ("normal_weight",),
    "controls, unit and normal weight": ("conditioning.inputs", "conditioning.unit_mm", "normal_weight"),
    "schedule": ("training.schedule", "training.peak_rate"),
    "batch, width and bound": ("training.batch", "hidden", "training.largest_gradient"),
}
OF_COARSE = ("controls and unit", "normal weight", "controls, unit and normal weight")  # what is tried on the CNN too
MORE = 4  # times the steps, for dense networks once: whether the failure passes


def changes(method: str) -> tuple[str, ...]:
    """Return what is tried of a method, in words: each recipe as it is, and with one piece of the other."""
    pieces = tuple(PIECES) if method == "dense" else OF_COARSE
    more = (f"released, {MORE} times the steps",) if method == "dense" else ()
    theirs = (f"released, but {piece} as ours" for piece in pieces)
    return ("released", *more, *theirs, "ours", *(f"ours, but {piece} as released" for piece in pieces))


CHANGES = {method: changes(method) for method in SECTIONS}


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return all trainings of one character, at a schedule of `steps`."""
    usual = resolve(character, profile)
    return [
        Variant(method, change, resolve(character, profile, {method: _overrides(usual, method, change, steps)}))
        for method, words in CHANGES.items()
        for change in words
    ]


def _overrides(usual: Config, method: str, change: str, steps: int) -> dict:
    """Return a method's section as a change in words has it, as a nested table."""
    ours, theirs = getattr(usual, method), SECTIONS[method](usual.profile)
    base, other = (ours, theirs) if change.startswith("ours") else (theirs, ours)
    piece = change.partition(", but ")[2].rpartition(" as ")[0]
    table = _as_table(base)
    for key in PIECES.get(piece, ()):
        group, _, name = key.rpartition(".")
        (table[group] if group else table)[name] = _value(other, key)
    table["training"]["steps"] = steps * (MORE if change.endswith(f"{MORE} times the steps") else 1)
    return table


def _as_table(section: Checked) -> dict:
    return {field.name: _plain(getattr(section, field.name)) for field in fields(section)}


def _plain(value: object) -> object:
    if isinstance(value, Checked):
        return {name: _plain(each) for name, each in asdict(value).items()}
    return list(value) if isinstance(value, tuple) else value


def _value(section: Checked, key: str) -> object:
    for name in key.split("."):
        section = getattr(section, name)
    return _plain(section)


def released_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table for each character in `bench_released.csv`."""
    return variants_tables(rows, TABLE, "The released recipe and ours", CHANGES)


def draw_faces(variants: Sequence[Variant], rows: Sequence[Row]) -> list[Row]:
    """Draw one pose as the trained variants of one character predict it; there are no more rows."""
    from replicate.benchmarks.released_faces import faces_of, released_faces
    from replicate.drawing.panels import save_figure

    file = bench_folder() / f"{TABLE}_{rows[0].character}.png"
    figure, words = released_faces(faces_of(variants))
    save_figure(figure, file, words)
    print(f"written to {paths.display_path(file.parent)}: {file.name}")
    return []


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, "toon", profile="whose samples and numbers")
    add_count(parser, "steps", STEPS, "of each training")
    return answer(parser, partial(compare_variants, TABLE, variants, released_tables, afterwards=draw_faces), arguments)


if __name__ == "__main__":
    sys.exit(main())
