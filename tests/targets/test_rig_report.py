"""The rig report: fits equal to explicit ones, errors and interaction as computed by hand, and the whole command."""

import json
import math

import numpy as np
import pytest
from sample_rows import table2_rows
from sklearn.linear_model import Ridge
from small_artefacts import run_stage, write_artefacts
from small_face import M, pose_offsets, small_influence, small_mesh, small_samples

from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Clip
from replicate import __main__ as cli
from replicate.approximation.metrics import summary
from replicate.baselines.ridge import (
    FITS,
    closest,
    components_of_variance,
    components_within,
    feature_count,
    principal_components,
    product_features,
    product_kernel,
    product_ridges,
    ridges,
)
from replicate.config import ReportFitsConfig
from replicate.engine import store
from replicate.engine.stage import StageContext, in_order, stage_function
from replicate.report.results import read_results
from replicate.report.tables import as_markdown, as_text
from replicate.rig_study.interaction import acting_steps, draw_pairs, interaction
from replicate.targets.rig_report import rows as rig_report_rows
from replicate.targets.rig_report.rows import LIMIT_MM
from replicate.targets.rig_report.shown import beside_table2, pairs_table, report_card, report_table

RNG = np.random.default_rng(0)
INPUTS, TARGETS, FRESH = RNG.uniform(-1, 1, (60, 7)), RNG.normal(size=(60, 4)) + 5, RNG.uniform(-2, 2, (9, 7))

NUMBERS = """
[samples]
count = 150
validation = 16
[evaluation]
test_poses = 12
[rig_report.fits]
components = 8
basis_samples = 60
poses = 6
[rig_report.pairs]
count = 40
poses = 1
[rig_report.maps]
sizes = [8, 16]
poses = 6
"""


def test_the_kernel_is_the_inner_product_of_the_features():
    left, right = product_features(INPUTS), product_features(FRESH)
    assert left.shape[1] == feature_count("products", 7) == 42
    np.testing.assert_allclose(product_kernel(INPUTS, FRESH), left @ right.T, rtol=1e-12)


@pytest.mark.parametrize("strength", [1e-6, 1e-3, 1.0])
def test_the_dual_fit_is_ridge_on_explicit_features_with_a_free_constant(strength):
    (fit,) = product_ridges(INPUTS, TARGETS, (strength,))
    explicit = Ridge(alpha=len(INPUTS) * strength).fit(product_features(INPUTS), TARGETS)
    np.testing.assert_allclose(fit(FRESH), explicit.predict(product_features(FRESH)), rtol=1e-7, atol=1e-7)


def test_a_fit_finds_what_its_features_can_say_and_the_strength_is_chosen_on_fresh_inputs():
    def law(x):
        return np.stack([x[:, 0] * x[:, 3] - np.abs(x[:, 1]) + 2, x[:, 2] ** 2], axis=1)

    errors = {}
    for name in FITS:
        strength, fit = closest(zip((1e-9, 1e3), ridges(name, INPUTS, law(INPUTS), (1e-9, 1e3)), strict=True),
                                FRESH, law(FRESH))  # fmt: skip
        errors[name] = np.abs(fit(FRESH) - law(FRESH)).max(0)
    assert strength == 1e-9 and (errors["products"] < 1e-5).all()
    assert errors["squares"][1] < 1e-5 < 0.1 < errors["squares"][0] and (errors["linear"] > 0.1).all()


def test_components_are_the_singular_vectors_of_what_is_left_of_the_mean():
    offsets = RNG.normal(size=(20, 30, 3)).astype(np.float32) * np.linspace(3, 0.1, 30)[:, None].astype(np.float32)
    flat = offsets.reshape(20, -1).astype(np.float64)
    _, lengths, rows = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    basis = principal_components(offsets, 12)
    np.testing.assert_allclose(basis.mean, flat.mean(0), atol=1e-5)
    np.testing.assert_allclose(basis.variances, lengths[:12] ** 2 / 19, rtol=1e-4)
    np.testing.assert_allclose(basis.total, (lengths**2).sum() / 19, rtol=1e-4)
    np.testing.assert_allclose(np.abs((basis.shapes * rows[:12]).sum(1)), 1, atol=1e-4)
    nearest = flat.mean(0) + (flat - flat.mean(0)) @ rows[:12].T @ rows[:12]
    np.testing.assert_allclose(basis.restore(basis.project(offsets)).reshape(20, -1), nearest, atol=1e-4)
    assert len(principal_components(offsets, 50).variances) == 19, "twenty poses differ in nineteen ways"
    assert len(principal_components(0 * offsets, 5).variances) == 1


def test_counts_of_components_rise_with_what_is_asked_and_say_when_all_are_too_few():
    variances = np.array([6.0, 3.0, 0.9, 0.09])
    counts = [components_of_variance(variances, 10.0, share) for share in (0.5, 0.9, 0.95, 0.999, 0.9999)]
    assert counts == [1, 2, 3, 4, None]
    counts = [components_within(lambda count: 1 / count, 40, limit) for limit in (1.0, 0.5, 0.03, 0.02)]
    assert counts == [1, 2, 34, None]


def test_errors_of_the_fits_are_those_computed_by_hand(tmp_path):
    inputs = write_artefacts(tmp_path)
    section = ReportFitsConfig(samples=150, basis_samples=100, components=8, poses=5)
    settings = rig_report_rows.FitSettings(section, 0, 7, 0)
    inputs, notes = run_stage(rig_report_rows.fit_regressions, inputs, "rig_fits", settings, tmp_path)
    errors, mesh, samples = rig_report_rows.load_errors(inputs), small_mesh(), small_samples(small_mesh())
    offsets = samples.test_offsets.astype(np.float64)
    assert summary(errors["neutral"].vertex).mean == pytest.approx(np.linalg.norm(offsets, axis=-1).mean(), rel=1e-5)
    posed = mesh.neutral + offsets
    normals = [np.cross(v[..., 1, :] - v[..., 0, :], v[..., 2, :] - v[..., 0, :])
               for v in (posed[:, mesh.faces], mesh.neutral.astype(np.float64)[mesh.faces])]  # fmt: skip
    unit = [vectors / np.linalg.norm(vectors, axis=-1, keepdims=True) for vectors in normals]
    degrees = np.degrees(np.arccos(np.clip((unit[0] * unit[1]).sum(-1), -1, 1)))
    assert summary(errors["neutral"].normal).mean == pytest.approx(degrees.mean(), rel=1e-4)
    means = [summary(errors[name].vertex).mean for name in rig_report_rows.METHODS]
    assert means[0] > max(means[1:-1]) and min(means[1:-1]) > means[-1] > 0, "no fit beats the basis"
    assert notes["features"] == {"linear": M, "squares": 3 * M, "products": M * (M + 5) // 2}
    assert notes["samples"] == 150 and notes["components"] == 8


def made_up_rig() -> FunctionRig:
    """Four controls of the small face: 0 and 1 multiply each other's effect on the face, 2 is curved, 3 straight."""
    mesh = small_mesh()
    face, neck = (mesh.segment == k for k in (0, 1))

    def function(p):
        offsets = np.zeros((len(p), len(mesh.neutral), 3), np.float32)
        offsets[:, face, 1] = (p[:, 0] + p[:, 1] + 0.5 * p[:, 0] * p[:, 1])[:, None]
        offsets[:, face, 2] += (p[:, 2] ** 2)[:, None]
        offsets[:, neck, 0] = (p[:, 3] + p[:, 2])[:, None]
        return mesh.neutral + offsets

    controls = tuple(Control(f"c{k}", -2.0, 0.0, 2.0, "face") for k in range(4))
    return FunctionRig("made_up", mesh, controls, np.arange(3), np.arange(1), ("face",), None, function)


def test_the_one_pair_that_multiplies_is_the_one_that_interacts():
    rig = made_up_rig()
    influence = np.stack([small_influence(rig.mesh)[:, 0]] * 3 + [rig.mesh.segment == 1], axis=1)
    influence[rig.mesh.segment == 1, 2] = True
    pairs = draw_pairs([np.arange(3), np.array([2, 3])], 99, np.random.default_rng(0))
    assert pairs.tolist() == [[0, 1], [0, 2], [1, 2], [2, 3]]
    poses = np.float32([[0, 0, 0, 0], [1.5, 0.5, 1, -1]])
    steps = np.array([1.0, 2.0, 1.0, 0.5])
    tally = interaction(rig, poses, steps, pairs, influence)
    np.testing.assert_allclose(tally.mixed_mm[:, 0], [1.0, 1.0], atol=1e-4)  # 0.5 a b, whatever the sign of a and b
    assert (tally.mixed_mm[:, 1:] < 1e-4).all() and tally.share_above(LIMIT_MM) == 0.25
    face, neck = (rig.mesh.segment == k for k in (0, 1))
    ratio = tally.vertex_ratio()
    assert np.isnan(ratio[rig.mesh.segment == 2]).all() and (ratio[neck] < 1e-3).all()
    # from the default pose: mixed² = 1, and singles 1, 2 and 1 mm in three pairs, halved: (1 + 4 + 1 + 1 + 4 + 1) / 2
    alone = interaction(rig, poses[:1], steps, pairs, influence)
    np.testing.assert_allclose(alone.vertex_ratio()[face], math.sqrt(1 / 6), rtol=1e-4)
    line = rig_report_rows.strongest_pairs(rig, alone)[0]
    assert line[:4] == ("c0", "c1", "face", "default") and line[4:] == pytest.approx((1.0, 1.0, 2.0), abs=1e-4)


def test_steps_are_what_poses_use_and_a_quarter_of_the_range_where_none_does():
    poses = np.float32([[0.5, -1, 0.01, 0], [0.5, -0.6, 0, 0], [1.5, 0, 0, 0]])
    np.testing.assert_allclose(acting_steps(made_up_rig(), poses), [0.5, -0.8, 0.5, 0.5], rtol=1e-6)


def animated_rig() -> FunctionRig:
    """The small face with an animation of its twelve controls."""
    mesh, time = small_mesh(), np.arange(240)[:, None] / 24
    values = np.sin(time * np.linspace(0.5, 3, M) + np.arange(M)).astype(np.float32) * 0.8
    controls = tuple(Control(f"c{k:02}", -1.0, 0.0, 1.0, "face") for k in range(M))
    clips = (Clip("waves", values),)
    marks = np.arange(0, 300, 15)

    def function(p):
        return mesh.neutral + pose_offsets(mesh, p)

    return FunctionRig("tiny", mesh, controls, marks, marks[:1], ("face",), clips, function)


@pytest.fixture
def in_this_process(monkeypatch):
    """Stages run here, one after the other, on a small stand-in for the tiny rig; notebooks aren't executed.

    Other tests start processes and build rigs, which takes longer than all that is tested here.
    """

    def run(stages, jobs, facts, cluster, foresee=None, failures=None, arrived=None):
        for stage in in_order(stages):
            sources = {source.name: store.artefact_folder(source.identifier) for source in stage.inputs}

            def build(out, scratch, stage=stage, sources=sources):
                context = StageContext(stage.name, stage.config, sources, out, scratch, 1, stage.files)
                if stage.name == "rig":
                    small_mesh().save(out / "mesh.npz")
                else:
                    stage_function(stage.function)(context)
                return {"notes": context.notes, "run": facts, "wall_s": 0.0, "key": stage.key}

            store.make(stage.identifier, build)

    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda inputs: animated_rig())
    monkeypatch.setattr("replicate.cli.running.run", run)
    monkeypatch.setattr("replicate.report.notebooks.execute", lambda source, out, given, stamp: out.write_text(stamp))


def test_the_command_writes_finite_numbers_of_all_five_questions_and_a_figure(
    cache, tmp_path, monkeypatch, capsys, in_this_process
):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    (tmp_path / "few.toml").write_text(NUMBERS)
    given = ["--characters", "tiny", "--profile", "quick", "--config", str(tmp_path / "few.toml"), "--jobs", "1"]
    assert cli.main(["rig-report", *given]) == 0, capsys.readouterr().err
    folder = tmp_path / "runs" / "quick"
    rows = read_results(folder / "rig_report.csv")
    assert all(math.isfinite(row.value) for row in rows) and {row.character for row in rows} == {"tiny"}
    value = {(row.method, row.metric): row.value for row in rows if row.table == "rig_report"}
    assert {method for method, _ in value} == {*rig_report_rows.METHODS, "influence", "pairs", "maps"}
    errors = [value[name, "normal_error_mean"] for name in ("neutral", "linear", "basis")]
    assert errors == sorted(errors, reverse=True) and errors[-1] > 0
    assert value["maps", "normal_error_mean[8]"] > value["maps", "normal_error_mean[16]"] > 0
    assert value["influence", "controls_per_vertex_max"] <= value["influence", "controls"] == M
    assert 0 <= value["pairs", "interacting_share"] <= 1 and value["pairs", "pairs"] == 8 * 7 / 2 + 4 * 3 / 2 - 1
    segments = {row.metric.partition("[")[2] for row in rows if row.table == "rig_report_segments"}
    assert {"face]", "16][face]"} <= segments
    facts = json.loads((folder / "manifest.json").read_text())["targets"]["rig_report"]["characters"]["tiny"]
    assert facts["files"] == [f"rig_report_tiny{ending}" for ending in (".json", ".png", "_pairs.csv")]
    words = json.loads((folder / "rig_report_tiny.json").read_text())
    assert "how hard" in words["caption"].lower() and (folder / "rig_report_tiny.png").stat().st_size < 300_000
    assert len(pairs_table(folder / "rig_report_tiny_pairs.csv", "tiny").body) == 10
    rig_report_rows.write_pairs(folder / "rig_report_samples_pairs.csv", [])
    assert pairs_table(folder / "rig_report_samples_pairs.csv", "samples") is None
    assert "How hard is a rig?" in capsys.readouterr().out
    shown = as_text(report_table(rows))
    assert "> 8" in shown, "more components than there are"
    assert len({line.count("|") for line in as_markdown(report_table(rows)).splitlines() if line[:1] == "|"}) == 1
    assert as_text(report_card(rows)).splitlines()[-1].split()[0] == "tiny"
    table = beside_table2(table2_rows(("tiny",)), rows, "tiny")
    assert len(table.body) > 5 and beside_table2(table2_rows(("tiny",)), [], "tiny") is None
