"""About how long Table 2 takes, by profile and character, as a table: from the times of the committed results."""

from pathlib import Path

from replicate.artefacts.plan import Plan
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods.method_registry import choose, sections
from replicate.report.tables import Table
from replicate.targets.expected_time import duration, known_times, times_s, wall_s
from replicate.targets.table2 import stages

CHARACTERS = ("teen", "woman", "dragon", "toon")
WORKERS = 2
COMMANDS = (
    ("make table2 PROFILE=quick", "quick", ()),
    ("make table2", "laptop", ()),
    ("make table2 METHODS=all", "laptop", ("all",)),
    ("make table2 PROFILE=paper", "paper", ()),
)


def times_card(folder: Path) -> Table:
    """Return how long `make table2` takes from an empty cache, as it says itself before it starts.

    folder: the results whose manifest has the times of stages.
    """
    known = known_times(folder)

    def cell(character: str, profile: str, names: tuple[str, ...]) -> str:
        config = resolve(character, profile, sections=sections(profile))
        graph = in_order(stages(Plan(config), choose(names, config)))
        return duration(wall_s(graph, times_s(graph, known), WORKERS))

    body = [(f"`{command}`", *(cell(each, *how) for each in CHARACTERS)) for command, *how in COMMANDS]
    note = f"One seed, on {WORKERS} cores. Pictures and notebooks come on top."
    return Table("About how long Table 2 takes", (("", *CHARACTERS),), tuple(body), (note,))
