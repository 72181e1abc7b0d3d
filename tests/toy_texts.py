"""Texts with the marks that `make reference` writes tables between, in the place of the project's own."""

from pathlib import Path

import pytest

from replicate.targets import reference

TABLES = (
    *(
        "claims_in_brief",
        "claims",
        "table2_ratios",
        "table2",
        "table2_others",
        "table2_today",
        "table3",
        "table3_speed",
    ),
    *("bench_deploy", "bench_poses", "bench_rig", "bench_train", "table2_times", "targets"),
)


def texts_to_fill(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `make reference` write to texts in a folder."""
    for name in ("README", "RESULTS", "DATA_CARD", "REPRODUCING", "ENGINES"):
        monkeypatch.setattr(reference, name, folder / f"{name}.md")
        sections = [f"<!-- {table}, by make reference -->\nold\n<!-- end of {table} -->\n" for table in TABLES]
        (folder / f"{name}.md").write_text("before\n" + "".join(sections) + "after\n")
