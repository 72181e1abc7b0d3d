"""What each piece of our regional method does: one is taken away, or changed, at a time.

`make bench-regional` trains one network for all regions at a short schedule, then with one thing changed, and compares
the errors on the validation poses, which are held out of the training animation; test poses are not looked at. Three of
the changes together are the method as it is: a network for each region, of the controls that move it, in regions that
overlap. Of each training it measures too whether the borders of regions show. Trainings go through the cache like any
stage, so that a stopped run goes on.
"""

import sys
from collections.abc import Sequence
from functools import partial

from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import add_count, add_only, answer, make_parser
from replicate.benchmarks.region_borders import border_rows, borders_table
from replicate.benchmarks.variants import Variant, compare_variants, variants_tables
from replicate.config import resolve
from replicate.methods import regional
from replicate.methods.method_registry import sections
from replicate.methods.regional import RegionalConfig
from replicate.report.results import Row
from replicate.report.tables import Table

ABOUT = "what each piece of our regional method does to its errors and its size"
WRITES = "results/runs/bench/bench_regional.csv"
TABLE = "bench_regional"
STEPS = 4_000
START = {
    "by_region": False,
    "by_influence": False,
    "blend_rings": 0,
    "hidden": [384, 384],
    "training": {"peak_rate": 8e-3},
}
REGIONAL = {"by_region": True, "hidden": [128, 128], "training": {"peak_rate": 1.6e-2}}
OWN_CONTROLS = REGIONAL | {"by_influence": True}
ONE, OURS = "one network for all regions", "the same, borders blended (ours)"
CHANGES = {
    ONE: {},
    "a network for each region": REGIONAL,
    "the same, each of its region's controls": OWN_CONTROLS,
    OURS: OWN_CONTROLS | {"blend_rings": RegionalConfig().blend_rings},
    "the same, blended over two rings": OWN_CONTROLS | {"blend_rings": 2},
    "no straight line": {"line": False},
    "leaky ReLUs, no products": {"gated": False},
    "squared errors": {"squares": True},
    "balanced draws": {"training": {"draws": "balanced"}},
    "components of positions alone": {"normal_weight": 0.0},
    "one region, as many bytes": {"regions": 1, "components": 148},
    "64 regions": {"regions": 64, "components": 48, "fine": 8},
    "64 components": {"components": 64},
    "hidden layers of 256": {"hidden": [256, 256]},
    "hidden layers of 768": {"hidden": [768, 768]},
    "all components in 16 bits": {"fine": 4_096},
    "160 components": {"components": 160},
    "derivatives of the rig too": {"derivatives": 1.0},
}
SAMPLES = {"3,000 training poses": 3_000, "30,000 training poses": 30_000}
LINES = (*CHANGES, *SAMPLES)


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return one network for all regions, as it is and with each change, at a schedule of `steps`."""
    own, training = sections(profile), {"steps": steps}
    changes = {name: {"regional": change} for name, change in CHANGES.items()}
    changes |= {name: {"samples": {"count": count}, "regional": {}} for name, count in SAMPLES.items()}
    for change in changes.values():
        schedule = training | START["training"] | change["regional"].get("training", {})
        change["regional"] = START | change["regional"] | {"training": schedule}
    return [
        Variant("regional", name, resolve(character, profile, change, sections=own)) for name, change in changes.items()
    ]


def pieces_tables(rows: Sequence[Row]) -> list[Table]:
    """Return two tables for each character in `bench_regional.csv`: the pieces, and the borders of regions."""
    tables = variants_tables(rows, TABLE, "Pieces of the regional method", {"regional": LINES})
    characters = dict.fromkeys(row.character for row in rows)
    borders = [borders_table([row for row in rows if row.character == name], LINES) for name in characters]
    return [*tables, *(table for table in borders if table.body)]


def border_errors(variants: Sequence[Variant], rows: Sequence[Row]) -> list[Row]:
    """Return what the trained variants of one character have on the borders of regions, and elsewhere."""
    plans = {variant.change: Plan(variant.config) for variant in variants}
    return border_rows(rows, plans, regional.stage, RegionalConfig().regions)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose numbers are changed")
    add_count(parser, "steps", STEPS, "of each training")
    add_only(parser)
    compare = partial(compare_variants, TABLE, variants, pieces_tables, afterwards=border_errors)
    return answer(parser, compare, arguments)


if __name__ == "__main__":
    sys.exit(main())
