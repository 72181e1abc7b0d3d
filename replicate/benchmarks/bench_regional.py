"""What each piece of our regional method does: one is taken away, or changed, at a time.

`make bench-regional` trains the method at a short schedule as it is, and with one thing changed, and compares the
errors on the validation poses, which are held out of the training animation; test poses are not looked at. Of each it
measures too whether the borders of regions show. Trainings go through the cache like any stage, so that a stopped run
goes on.
"""

import argparse
import sys
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import answer, check_at_least, make_parser, publish, split_names
from replicate.benchmarks.region_borders import border_rows, borders_table
from replicate.benchmarks.variants import Variant, train_variants, variants_tables
from replicate.config import resolve
from replicate.methods import regional
from replicate.methods.method_registry import sections
from replicate.methods.regional import RegionalConfig
from replicate.report.results import Row
from replicate.report.tables import Table, as_text

ABOUT = "what each piece of our regional method does to its errors and its size"
WRITES = "results/runs/bench/bench_regional.csv"
STEPS = 4_000
CHANGES = {
    "as it is": {},
    "no straight line": {"line": False},
    "leaky ReLUs, no products": {"gated": False},
    "squared errors": {"squares": True},
    "balanced draws": {"training": {"draws": "balanced"}},
    "components of positions alone": {"normal_weight": 0.0},
    "one region, as many bytes": {"regions": 1},
    "64 regions": {"regions": 64, "components": 48, "fine": 8},
    "64 components": {"components": 64},
    "hidden layers of 256": {"hidden": [256, 256]},
    "hidden layers of 768": {"hidden": [768, 768]},
    "all components in 16 bits": {"fine": 4_096},
}


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return the method as it is, and with each change, at a schedule of `steps`."""
    own, training = sections(profile), {"steps": steps}
    return [
        Variant(
            "regional",
            name,
            resolve(
                character,
                profile,
                {"regional": change | {"training": training | change.get("training", {})}},
                sections=own,
            ),
        )
        for name, change in CHANGES.items()
    ]


def pieces_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table for each character in `bench_regional.csv`."""
    return variants_tables(rows, "bench_regional", "Pieces of the regional method", {"regional": tuple(CHANGES)})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser("bench_regional", __doc__, profile="whose numbers are changed")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of each training (default: {STEPS})")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    check_at_least(1, steps=options.steps)
    for character in split_names(options.characters):
        tried = variants(character, options.profile, options.steps)
        rows = train_variants("bench-regional", tried)
        plans = {variant.change: Plan(variant.config) for variant in tried}
        rows += border_rows(rows, plans, regional.stage, RegionalConfig().regions)
        for table in (*pieces_tables(rows), borders_table(rows, tuple(CHANGES))):
            print(as_text(table))
        publish("bench_regional", rows, command_line)


if __name__ == "__main__":
    sys.exit(main())
