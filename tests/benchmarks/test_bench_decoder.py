"""What limits the networks: each training changes what it says, and codes of their own are what dense layers make."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from small_artefacts import run_stage, write_artefacts
from small_face import small_mesh

from replicate.approximation import cnn
from replicate.approximation.deformation_map import Floor
from replicate.benchmarks import bench_decoder
from replicate.benchmarks.bench_decoder import (
    CHANGES,
    FewSettings,
    decoder_chart,
    decoder_tables,
    few_trainings,
    variants,
)
from replicate.config import CoarseConfig, DenseConfig, TrainingConfig, resolve
from replicate.drawing.panels import png
from replicate.engine.stage import StageContext, stage_function
from replicate.engine.store import artefact_folder
from replicate.methods import artefacts
from replicate.report.results import Row

SCHEDULE = TrainingConfig("one_cycle", 400, 8, "uniform", peak_rate=1e-2)
MAPS = CoarseConfig(map_size=16, channels=16, hidden=(128,), training=SCHEDULE)


def test_every_training_has_a_name_of_its_own_and_its_widths():
    trainings = [*few_trainings("tiny", "laptop", 700), *variants("tiny", "laptop", 700)]
    names = [str(training) for training in trainings]
    assert len(set(names)) == len(names) == 6 * 3 + 3 + 12 + 12
    for training in trainings:
        section = getattr(training.config, training.method)
        if "start" in training.change:
            words = training.change.split("start ")[1].split(" channels")[0]
            assert words == f"{section.hidden[-1]}, {section.channels}"
        times = int(training.change.rpartition("× ")[2]) if "×" in training.change else 1
        assert section.training.steps == 700 * times
    assert {v.change for v in variants("tiny", "laptop", 700) if v.method == "coarse"} == set(CHANGES["coarse"])


def test_the_papers_widths_and_the_schedule_once_are_one_training():
    by_name = {(v.method, v.change): v.config for v in variants("tiny", "laptop", 700)}
    usual = resolve("tiny", "laptop").coarse
    once = by_name["coarse", "steps × 1"].coarse
    assert once == replace(usual, training=replace(usual.training, steps=700))
    assert by_name["coarse", "start 512, 16 channels"].coarse == once
    deeper = by_name["coarse", bench_decoder.DEEPER].coarse
    assert deeper.hidden == (256, 256, 512) and replace(deeper, hidden=once.hidden) == once


def test_without_hidden_layers_each_pose_has_a_code_of_its_own(tmp_path):
    segments = artefacts.load_coarse_segments(write_artefacts(tmp_path), small_mesh())
    coded, params = bench_decoder.with_codes(segments, 5)
    torch.manual_seed(0)
    network = cnn.make_network(coded[0], cnn.shape_facts(MAPS))
    layer = network.dense[0]
    codes = network._start(torch.from_numpy(params)).flatten(1)
    torch.testing.assert_close(codes, layer.weight.T * 5**0.5 + layer.bias)


def few_notes(folder, settings) -> dict:
    inputs = write_artefacts(folder)
    return run_stage(bench_decoder.train_few, inputs, "few", settings, folder)[1]


def motion_mm(folder) -> float:
    samples = artefacts.load_samples({"samples": folder / "samples"})
    return np.linalg.norm(samples.validation_offsets, axis=2)[:, small_mesh().segment < 2].mean()


def test_dense_networks_learn_eight_poses_by_heart(tmp_path):
    section = DenseConfig((32, 32), training=SCHEDULE)
    notes = few_notes(tmp_path, FewSettings(section, 0, "cpu", 8, False))
    assert set(notes) == {"few_vertex_error", "few_normal_error"}
    assert notes["few_vertex_error"] < 0.05 * motion_mm(tmp_path)


def test_codes_are_trained_with_the_convolutions_and_fitted_to_poses_that_these_never_saw(tmp_path):
    notes = few_notes(tmp_path, FewSettings(MAPS, 0, "cpu", 24, True))
    assert set(notes) == set(bench_decoder.METRICS)
    moved = motion_mm(tmp_path)
    assert notes["few_vertex_error"] < 0.3 * moved and notes["fitted_vertex_error"] < 0.6 * moved
    assert notes["few_floor"] < notes["few_normal_error"] and notes["fitted_floor"] < notes["fitted_normal_error"]
    assert notes["fitted_floor"] == pytest.approx(floor_of_normals_deg(tmp_path), rel=1e-3)


def floor_of_normals_deg(folder) -> float:
    """Return the angle between true normals, by another library, and those of the poses that maps hold best."""
    mesh, samples = small_mesh(), artefacts.load_samples({"samples": folder / "samples"})
    segments = artefacts.load_coarse_segments({name: folder / name for name in ("rig", "influence", "rigid")}, mesh)
    offsets = np.asarray(samples.validation_offsets)
    deforms = np.isin(mesh.faces, np.concatenate([segment.vertices for segment in segments])).all(axis=1)
    angles = []
    for true, held in zip(mesh.neutral + offsets, mesh.neutral + Floor(segments, MAPS.map_size)(offsets), strict=True):
        normals = [trimesh.triangles.normals(posed[mesh.faces[deforms]])[0] for posed in (true, held)]
        angles.append(np.degrees(np.arccos(np.clip((normals[0] * normals[1]).sum(axis=1), -1, 1))).mean())
    return np.mean(angles)


def test_a_stopped_fit_goes_on_where_it_was(tmp_path, monkeypatch):
    """A second run finds both trainings' checkpoints and makes no step."""
    settings = FewSettings(replace(MAPS, training=replace(SCHEDULE, steps=12)), 0, "cpu", 8, True)
    inputs = write_artefacts(tmp_path)
    first = run_stage(bench_decoder.train_few, inputs, "few", settings, tmp_path)[1]
    (tmp_path / "few").rename(tmp_path / "before")
    (tmp_path / "few").mkdir()
    context = StageContext("few", settings, inputs, tmp_path / "few", tmp_path / "few-scratch")
    bench_decoder.train_few(context)
    assert context.notes == first


def row(method, metric, unit, value):
    return Row("bench_decoder", "toon", method, metric, unit, value, None, 1, 64, "laptop", "bench-decoder")


def test_few_poses_and_all_samples_have_a_table_each():
    rows = [
        row("coarse", "few_normal_error[8 poses, start 512, 16 channels]", "deg", 0.16),
        row("coarse", "few_floor[8 poses, start 512, 16 channels]", "deg", 0.05),
        row("dense", "few_normal_error[64 poses]", "deg", 0.01),
        row("coarse", "fitted_normal_error[free codes, start 512, 16 channels]", "deg", 0.9),
        row("coarse", "validation_normal_error[start 2048, 32 channels]", "deg", 0.92),
        row("regional", "validation_normal_error[steps × 4]", "deg", 0.3),
    ]
    few, others = decoder_tables(rows)
    assert few.body == (
        ("Coarse", "8 poses, start 512, 16 channels", "", "0.16", "0.05", "", "", ""),
        None,
        ("Dense", "64 poses", "", "0.01", "", "", "", ""),
        None,
        ("Coarse", "free codes, start 512, 16 channels", "", "", "", "", "0.90", ""),
    )
    assert others.body == (
        ("Coarse", "start 2048, 32 channels", "0.92"),
        None,
        ("Regional (ours)", "steps × 4", "0.30"),
    )


def test_the_chart_has_the_lines_that_are_there():
    narrow = "start 512, 16 channels"
    few = {8: 0.16, 64: 0.9}
    rows = [
        *(row("coarse", f"few_normal_error[{poses} poses, {narrow}]", "deg", value) for poses, value in few.items()),
        row("coarse", "few_normal_error[8 poses, start 2048, 16 channels]", "deg", 77.0),
        row("dense", "few_normal_error[64 poses]", "deg", 0.01),
        row("coarse", "validation_normal_error[start 2048, 32 channels]", "deg", 0.92),
        *(row("dense", f"validation_normal_error[steps × {times}]", "deg", 1.0 / times) for times in (1, 2)),
    ]
    figure, words = decoder_chart(rows, "toon")
    drawn = [
        {line.get_label(): line.get_ydata().tolist() for line in axes.lines if len(line.get_xdata())}
        for axes in figure.axes
    ]
    assert drawn == [
        {"CNN": [0.16, 0.9], "Dense": [0.01]},
        {"CNN, wider": [0.92], "Dense": [1.0, 0.5]},
    ]
    assert "By heart: CNN 0.16° at 8, 0.9° at 64; Dense 0.01° at 64." in words.alt
    figure, words = decoder_chart([row for row in rows if "validation" in row.metric], "toon")
    assert png(figure, words), "an axis without a number has no logarithm"
    assert [len([line for line in axes.lines if len(line.get_xdata())]) for axes in figure.axes] == [0, 2]


def test_a_schedule_without_steps_is_refused(capsys):
    assert bench_decoder.main(["--steps", "0"]) == 2
    assert "steps: expected a whole number of at least 1, got 0" in capsys.readouterr().err


def test_other_processes_find_its_stages_since_the_program_calls_the_module(monkeypatch):
    monkeypatch.setattr(bench_decoder, "main", lambda: 7)
    with pytest.raises(SystemExit) as ended:
        exec(Path(bench_decoder.__file__).read_text(encoding="utf-8"), {"__name__": "__main__"})
    assert ended.value.code == 7, "and not its own copy of it"
    (training, *_) = few_trainings("tiny", "quick", 5)
    assert stage_function(bench_decoder.few_stage(training).function) is bench_decoder.train_few


def test_a_part_is_made_alone_and_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    made = []
    monkeypatch.setattr(bench_decoder, "make_stages", lambda name, profile, stages: made.extend(stages))
    notes = {"notes": {"few_vertex_error": 0.25, "few_normal_error": 1.5, "few_floor": 0.5}}
    monkeypatch.setattr(bench_decoder, "read_manifest", lambda folder: notes)
    assert bench_decoder.main(["--characters", "tiny", "--profile", "quick", "--only", "coarse, 8 poses"]) == 0
    assert [stage.config.poses for stage in made] == [8] * 5
    assert len({artefact_folder(stage.identifier) for stage in made}) == 5
    lines = (tmp_path / "bench" / "bench_decoder.csv").read_text().splitlines()
    assert len(lines) == 1 + 5 * 3
