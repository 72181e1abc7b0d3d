"""A method that fails costs Tables 2, 3 and 4 its own row alone: the others are made, published and printed."""

import pytest

from replicate import __main__ as cli
from replicate.base.exceptions import InputError, RunError
from replicate.cli import running
from replicate.config import resolve
from replicate.engine.stage import Stage, in_order
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.targets import table2, table3, table4


@pytest.fixture
def failing(monkeypatch, cache, tmp_path):
    """(target, the titles of stages that fail and why) → the exit code, and the stages that are published then."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    published = []
    for module in (table2, table3, table4):
        monkeypatch.setattr(module, "publish", lambda results, *_: published.extend(each.stage for each in results))

    def start(target: str, reasons: dict[str, Exception], *words: str) -> tuple[int, list[Stage]]:
        def run(stages, workers, facts, cluster, forecast, failures, *_):
            titles = {stage.title for stage in in_order(stages)}
            failed = {title: error for title, error in reasons.items() if title in titles}
            if failures is None:  # the first failure ends all
                raise next(iter(failed.values()))
            failures |= failed

        monkeypatch.setattr(running, "run", run)
        line = [
            target,
            "--profile",
            "quick",
            "--characters",
            "tiny",
            *words,
            "--methods",
            "neutral",
            "coarse",
            "linear",
        ]
        return cli.main(line), published

    return start


@pytest.mark.parametrize("target", ["table2", "table3", "table4"])
def test_other_rows_are_published_and_each_missing_one_has_its_reason(failing, target, capfd):
    reasons = {"coarse-tiny": RunError("out of memory"), "errors_linear-tiny": InputError("no pose today")}
    code, published = failing(target, reasons)
    assert code == 1
    expected = "tiny has no row of coarse: out of memory; tiny has no row of linear: no pose today"
    assert capfd.readouterr().err.splitlines()[-1].endswith(expected)
    names = {stage.name for stage in in_order(published)}
    assert "errors_neutral" in names and [stage.title for stage in published] == [f"{target}-tiny"]
    assert names.isdisjoint({"coarse", "errors_coarse", "inverse_coarse", "linear", "errors_linear"})


def test_a_method_that_fails_with_one_seed_is_left_out_of_a_measurement_that_rigs_share(failing):
    reasons = {"errors_linear-tiny-seed1": RunError("no pose today")}
    code, (first, second) = failing("table3", reasons, "--seed", "0", "1")
    assert code == 1 and first.inputs == second.inputs
    assert [{each.method for each in rig.methods} for rig in first.inputs[0].config.rigs] == 2 * [{"neutral", "coarse"}]


def test_ik_networks_that_can_not_be_trained_through_a_method_cost_its_row_of_table_4(failing, capfd):
    code, (table,) = failing("table4", {"inverse_coarse-tiny": InputError("it can't be differentiated")})
    assert code == 1 and {each.method for each in table.config.methods} == {"neutral", "linear"}
    assert "tiny has no row of coarse: it can't be differentiated" in capfd.readouterr().err


@pytest.mark.parametrize("target", ["table2", "table3", "table4"])
def test_nothing_is_published_where_no_method_is_left_or_none_is_at_fault(failing, target, capfd):
    all_fail = {f"errors_{name}-tiny": RunError("no pose today") for name in ("neutral", "coarse", "linear")}
    last = {"timing-tiny" if target == "table3" else f"{target}-tiny": RunError("the disk is full")}
    for reasons, said in ((all_fail, "no pose today"), (last, "the disk is full")):
        assert failing(target, reasons) == (1, [])
        assert said in capfd.readouterr().err


def test_what_evaluates_all_methods_together_waits_for_the_measurement_of_each():
    plan, methods = Plan(resolve("tiny", "quick")), choose(["neutral", "coarse"])
    for stage in (table3.timing_stage([(plan, methods)]), table4.stages(plan, methods)[-1]):
        assert {"errors_neutral", "errors_coarse"} <= {each.name for each in stage.inputs}
