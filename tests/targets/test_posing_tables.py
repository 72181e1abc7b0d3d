"""Table 4 printed: the paper's protocol, who leads in whose poses, and what the IK networks reach."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from plain_rig import PlainRig
from small_face import small_mesh

from replicate.base.exceptions import RunError
from replicate.base.paths import PAPER
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.inverse.control_points import default_section
from replicate.inverse.posing import Posed
from replicate.methods.measurement import MeasurementSettings
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text
from replicate.targets import table4
from replicate.targets.table4 import rows as table4_rows
from replicate.targets.table4.rows import PosingSettings, Source, _first_alike, feeder, resampled_ratio, write_all
from replicate.targets.table4.tables import AS_GIVEN, feeding_table, fresh_table, networks_table, posing_table, tables4


def rows(character="teen"):
    def row(method, metric, unit, value, poses=25):
        return Row("table4", character, method, metric, unit, value, None, 1, poses, "laptop", "r")

    made = []
    for method, mm in (("refined", 0.31), ("dense", 0.62)):
        made += [row(method, "vertex_error_mean", "mm", mm), row(method, "normal_error_mean", "deg", 3 * mm)]
        for k, source in enumerate(("refined", "dense", "rig")):
            made.append(row(method, f"vertex_error_mean[{source}]", "mm", mm + k))
            made.append(row(method, f"normal_error_mean[{source}]", "deg", 3 * mm + k))
        made.append(row(method, "vertex_error_mean_limited", "mm", mm / 2))
        made += [row(method, "point_error_mean", "mm", 2.5), row(method, "derivative_cosine", "ratio", 0.875)]
    return [*made, row("rig", "point_error_mean", "mm", 2.25)]


def test_the_longest_training_begins_first():
    order = [
        stage.name for stage in in_order(table4.stages(Plan(resolve("tiny", "quick")), choose(["coarse", "dense"])))
    ]
    others = [order.index(f"inverse_{name}") for name in ("coarse", "dense")]
    assert max(map(order.index, ("coarse", "dense"))) < order.index("inverse_rig") < min(others)
    assert order[-1] == "table4" and len(order) == len(set(order))


def test_the_papers_numbers_stand_beside_ours():
    table = posing_table(rows(), read_results(PAPER / "table4.csv"))
    assert table.headers == (("", "teen", "Hiccup"),)
    assert ("Dense", "0.31", "–") in table.body, "within limits; the paper has no such number"
    assert ("Refined", "0.31", "0.94") in table.body and ("Dense", "1.86", "5.6") in table.body
    given = posing_table(rows(), read_results(PAPER / "table4.csv"), AS_GIVEN)
    assert len(given.body) < len(table.body) and not any("ithin limits" in text for text in as_text(given).splitlines())
    assert any("25 configurations" in note and "one seed" in note for note in table.notes)


def test_a_column_is_an_ik_model_and_the_rig_comes_last():
    table = feeding_table(rows(), "teen")
    assert table.headers[-1][1:] == ("Refined", "Dense", "the rig itself")
    assert ("Dense", "0.62", "1.62", "2.62") in table.body


def test_what_the_networks_reach_has_a_line_each():
    table = networks_table(rows(), "teen")
    assert [line[0] for line in table.body] == ["Refined", "Dense", "the rig itself"]
    assert table.body[2][1] == "2.25" and table.body[2][5] == "–", "the rig's derivative is its own"
    assert len(tables4([*rows(), *rows("toon")], [])) == 5
    assert all(as_text(each) for each in tables4(rows(), []))


@pytest.mark.parametrize(
    ("own_gradients", "sources", "method", "expected"),
    [
        (False, ("coarse", "refined", "dense", "rig"), "dense", "refined"),
        (False, ("coarse", "dense", "rig"), "dense", "coarse"),
        (False, ("linear", "rig"), "neutral", "linear"),
        (True, ("refined", "dense", "rig"), "dense", "dense"),
        (True, ("refined", "dense", "rig"), "neutral", "refined"),
    ],
)
def test_the_refined_models_networks_feed_all_methods_but_for_toothless(own_gradients, sources, method, expected):
    sources = tuple(Source(name, "") for name in sources)
    assert (
        feeder(PosingSettings("teen", "quick", 0, default_section("quick"), (), sources, own_gradients), method)
        == expected
    )


def test_fresh_drags_show_the_ratio_with_its_interval():
    def row(method, metric, value, unit="ratio"):
        return Row("table4", "teen", method, metric, unit, value, None, 1, 100, "laptop", "r")

    fresh = [row(name, "normal_error_mean_fresh[own]", value, "deg") for name, value in (("refined", 2), ("dense", 4))]
    fresh += [row("dense", f"vertex_error_mean_fresh[{way}]", 0.5, "mm") for way in ("own", "rig")]
    for ending, value in (("", 0.5), ("_low", 0.41), ("_high", 0.62)):
        fresh.append(row("refined", f"normal_error_ratio_fresh{ending}[own]", value))
    table = fresh_table(fresh, "teen")
    assert table.headers[-1][1:] == ("the method itself", "the rig itself")
    assert ("Refined / Dense", "0.50 (0.41 to 0.62)", "–") in table.body and ("Dense", "4.00", "–") in table.body
    assert any("100 drags" in note for note in table.notes)
    assert len(tables4([*rows(), *fresh], [])) == 4 and len(tables4(rows(), [])) == 3


def test_the_interval_is_that_of_the_mean_over_drags():
    rng = np.random.default_rng(0)
    others = rng.uniform(1, 3, 100)
    found = resampled_ratio(0.5 * others, others)
    assert [found[end] for end in ("", "_low", "_high")] == pytest.approx([0.5] * 3), "paired drags: no spread is left"
    noisy = resampled_ratio(0.5 * others * rng.lognormal(0, 0.4, 100), others)
    assert noisy["_low"] < noisy[""] < noisy["_high"]
    width = np.log(noisy["_high"] / noisy["_low"]) / (2 * 1.96)
    assert 0.025 < width < 0.06, "0.4 over the root of a hundred, a little more where large drags weigh more"


def test_poses_that_are_alike_share_one_measurement():
    params = np.array([[2.0, 0], [1, 1], [2, 0], [0, 5]])
    assert _first_alike(params).tolist() == [0, 1, 0, 2]


def test_methods_are_measured_against_the_rig_at_the_same_parameters(monkeypatch):
    mesh = small_mesh()
    posed = Posed(np.float32([[0, 1], [2, 1], [0, 1]]), mesh.neutral + np.float32([[[3]], [[5]], [[3]]]))

    def predict(params, truth):
        return mesh.neutral + np.float32([0, 0, 2]) + 1.5 * (params[:, :1, None] + 2)

    monkeypatch.setattr(table4_rows, "predictor", lambda entry, inputs: predict)
    dense, rig = MeasurementSettings("dense", "", "", None, False, True, 0, 32, 0), PlainRig()
    rig.mesh = mesh
    settings = PosingSettings("teen", "quick", 0, default_section("quick"), (dense,), (), False)
    found = table4_rows._errors(settings, {}, rig, posed)["dense"]
    np.testing.assert_allclose(found.pose_mm, [2, np.sqrt(1 + 1 + 9)], rtol=1e-4)
    np.testing.assert_allclose(found.pose_deg, 0, atol=0.1)


@pytest.mark.parametrize(
    ("name", "advice"), [("dense", "finite; METHODS without dense gives the other rows"), ("rig", "finite")]
)
def test_ik_networks_whose_answers_are_not_finite_are_named_with_their_character(name, advice, monkeypatch, tmp_path):
    params = np.zeros((5, 2), np.float32)
    params[3] = np.nan
    networks = SimpleNamespace(solve=lambda points: params)
    for module, function in ((table4_rows.artefacts, "load_rig"), (table4_rows.artefacts, "load_influence")):
        monkeypatch.setattr(module, function, lambda inputs: None)
    monkeypatch.setattr(table4_rows, "control_points", lambda rig, influence: None)
    monkeypatch.setattr(table4_rows, "configurations", lambda rig, points, files: np.zeros((5, 4, 3), np.float32))
    monkeypatch.setattr(table4_rows.ik_stage, "load", lambda inputs, source: networks)
    settings = PosingSettings("teen", "quick", 0, default_section("quick"), (), (Source(name, ""),), False)
    with pytest.raises(RunError) as told:
        write_all(settings, {}, (), lambda total, label: nullcontext(), tmp_path)
    assert str(told.value) == (
        f"teen: the IK networks trained through {name} answer 1 of 5 configurations of control points with parameters "
        f"that are not {advice}"
    )
    assert not list(tmp_path.iterdir())
