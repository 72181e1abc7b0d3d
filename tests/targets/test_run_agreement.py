"""Two runs of Table 3 beside each other: which of their speed-ups agree."""

from dataclasses import replace

import pytest
from timed_rows import timed_rows as rows

from replicate.targets.table3.shown import agreement_rows, agreement_table


def slower(before, times, **metrics):
    """Return rows in which the metrics of some methods have another value: method=times."""
    return [replace(row, value=times * row.value) if row.metric == metrics.get(row.method) else row for row in before]


def table_of(before, after):
    return agreement_table(agreement_rows(before, after))


def test_a_run_agrees_with_itself():
    table = table_of(rows(), rows())
    assert [line[:4] for line in table.body] == [
        (f"by the {kind}", "8", "0", "0 %") for kind in ("means", "medians", "5th percentiles")
    ], "two methods over two rigs, on one core and on all"


def test_a_slower_method_is_named_by_the_kind_of_time_that_differs():
    after = slower(rows(), 1.25, coarse="time_one_core")
    means, medians, quiet = table_of(rows(), after).body
    assert means[1:4] == ("8", "2", "25 %") and means[4] in (
        "teen, Coarse, node by node, one core",
        "teen, Coarse, compiled, one core",
    )
    assert medians[2:4] == quiet[2:4] == ("0", "0 %")
    assert table_of(after, rows()).body[0][1:4] == means[1:4], "which one is the earlier run makes no difference"


def test_a_slower_rig_moves_every_speed_up_over_it():
    after = slower(rows(), 1.2, rig="p05_all_cores")
    assert table_of(rows(), after).body[2][1:4] == ("8", "2", "20 %")


@pytest.mark.parametrize("before", [[], rows("woman"), [row for row in rows() if row.method == "rig"]])
def test_runs_without_a_speed_up_in_common_have_no_table(before):
    assert table_of(before, rows()) is None


def test_only_what_both_runs_have_is_compared():
    both = [*rows(), *rows("toon")]
    assert table_of(both, rows()).body[0][1] == "8"


def test_a_row_says_how_much_the_later_run_is_ahead():
    changes = agreement_rows(rows(), slower(rows(), 1.25, coarse="time_one_core"))
    slow = [row for row in changes if row.method == "coarse" and row.metric.startswith("change_time_one_core")]
    assert [row.metric for row in slow] == ["change_time_one_core[rig_nodes]", "change_time_one_core[rig]"]
    assert [row.value for row in slow] == pytest.approx([1 / 1.25, 1 / 1.25]) and len(changes) == 24
    assert {row.value for row in changes if row not in slow} == {1.0}


def test_an_earlier_runs_changes_are_not_compared_again():
    before = [*rows(), *agreement_rows(rows(), rows())]
    assert agreement_rows(before, rows()) == agreement_rows(rows(), rows())
