"""Figure 13: errors of every way to move new meshes, rows and a sheet that have the same numbers."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from PIL import Image
from plain_rig import PlainRig
from small_artefacts import run_stage, write_artefacts
from small_face import M, pose_offsets, small_influence, small_mesh

from data_recipes.controls import Control
from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import square_segments
from replicate.approximation.segments import coarse_segments
from replicate.config import CoarseConfig, RefinementConfig
from replicate.drawing.render import render
from replicate.report.results import read_results
from replicate.targets import figure13 as target
from replicate.targets.figure13 import moved
from replicate.targets.figure13 import shown as figure13_shown
from replicate.targets.figure13.moved import rows_of
from replicate.targets.figure13.shown import LABELS, tables13
from replicate.transfer.new_mesh_poses import WAYS

NUMBERS = moved.MovedSettings(0, 10, 0, shifts=(0.0, 1.0, 4.0), turns_deg=(5.0,), draws=2, moved_poses=99)


def write_model(folder, segments, config) -> None:
    """Write networks of drawn weights, as a training would."""
    torch.manual_seed(0)
    networks = [cnn.make_network(segment, cnn.shape_facts(config)) for segment in segments]
    count = len(small_mesh().neutral)
    folder.mkdir()
    cnn.save(SegmentedModel(networks, segments, np.ones(M), [60.0] * len(segments), count), folder, config)


class TheSmallFace(PlainRig):
    """A rig of which only the mesh is asked."""

    mesh = small_mesh()


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """The folders of all stages up to the figure's own, on the small face."""
    folder, mesh = tmp_path_factory.mktemp("figure13"), small_mesh()
    artefacts = write_artefacts(folder) | {name: folder / name for name in ("coarse", "refined")}
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    write_model(artefacts["coarse"], segments, CoarseConfig(map_size=16))
    squares = square_segments(segments[0], np.array([[0.3, 0.7]]), small_influence(mesh), 0.4)
    write_model(artefacts["refined"], squares, RefinementConfig(map_size=32))
    shares = moved.NewMeshSettings(tuple(moved.SHARES.values()))
    artefacts, notes = run_stage(moved.make_meshes, artefacts, "new_meshes", shares, folder)
    assert notes["vertices"]["quarter"] < notes["vertices"]["half"] < (mesh.segment < 2).sum()
    return run_stage(moved.move_meshes, artefacts, "moved_meshes", NUMBERS, folder)[0]


def test_every_way_to_move_every_mesh_is_measured_and_the_map_says_what_the_model_says(inputs):
    means = moved.load_means(inputs)
    distance = {(mean.mesh, mean.method, mean.charts): mean.distance_mm for mean in means}
    assert {method for mesh, method, charts in distance if mesh == "half" and not charts} == set(WAYS)
    assert {method for mesh, method, _ in distance if mesh == "original"} == {"coarse", "refined", "neutral"}
    assert all(np.isfinite([mean.distance_mm, mean.normal_deg]).all() and mean.poses == 24 for mean in means)
    for mesh in moved.SHARES:
        assert distance[mesh, "coarse", ""] == pytest.approx(distance[mesh, "coarse_carried", ""], rel=0.1)
        assert distance[mesh, "coarse", ""] != pytest.approx(distance[mesh, "neutral", ""], rel=0.1)
        assert distance[mesh, "coarse", "shift 0 px"] == pytest.approx(distance[mesh, "coarse", ""], rel=1e-6)
        assert len({distance[mesh, "coarse", f"shift {pixels} px"] for pixels in (0, 1, 4)}) == 3


def test_the_shown_pose_has_the_errors_that_its_vertices_have(inputs):
    new, posed = moved.load_meshes(inputs)["half"], moved.load_moved_pose(inputs, "half")
    original = moved.load_moved_pose(inputs, moved.ORIGINAL)
    assert set(posed) == {"truth", *WAYS} and set(original) == {"truth", "coarse"}
    np.testing.assert_allclose(new.places.mix(original["truth"]), posed["truth"], atol=1e-5)
    np.testing.assert_allclose(new.places.mix(original["coarse"]), posed["coarse_carried"], atol=1e-5)
    np.testing.assert_array_equal(posed["neutral"], new.mesh.neutral)


def test_the_figure_has_a_row_of_meshes_each_and_rows_of_the_same_numbers(inputs, tmp_path, monkeypatch):
    monkeypatch.setattr(figure13_shown, "render", partial(render))
    monkeypatch.setattr(figure13_shown, "cell_width", lambda *_: 40)
    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda _: TheSmallFace())
    settings = target.TransferPicture("tiny", "quick")
    folder = run_stage(target.draw, inputs, "figure13", settings, tmp_path)[0]["figure13"]
    rows = {(row.method, row.metric): row for row in read_results(folder / "figure13.csv")}
    means = moved.load_means(inputs)
    assert len(rows) == 2 * len(means) and {row.table for row in rows.values()} == {"figure13"}
    half = next(mean for mean in means if (mean.mesh, mean.method, mean.charts) == ("half", "coarse", ""))
    assert rows["coarse", "vertex_error_mean[half]"].value == half.distance_mm
    assert rows["coarse", "normal_error_mean[half]"].unit == "deg"
    assert rows["coarse", "vertex_error_mean[half][shift 4 px]"].poses == 24
    meshes, charts = tables13(list(rows.values()))
    assert {line[0] for line in meshes.body if line} >= set(LABELS.values()) and set(LABELS) == set(WAYS)
    other = [replace(row, character="teen", poses=999) for row in rows.values()]
    notes = {table.title: table.notes[-1] for table in tables13([*rows.values(), *other])}
    assert notes["Meshes of other topologies: tiny"].startswith("24 test poses")
    assert notes["Meshes of other topologies: teen"].startswith("999 test poses")
    assert [line[0] for line in charts.body] == ["shift 0 px", "shift 1 px", "shift 4 px", "turn 5 deg"]
    words = json.loads((folder / "figure13_tiny.json").read_text())
    assert f"{half.distance_mm:.2f} mm" in words["caption"] and "(after Fig. 13)" in words["caption"]
    posed, faces = moved.load_moved_pose(inputs, "half"), moved.load_meshes(inputs)["half"].mesh.faces
    shown = np.linalg.norm(posed["coarse"] - posed["truth"], axis=1)[np.unique(faces)].mean()
    assert f"coarse networks on half of the vertices, {shown:.2f} mm" in words["alt"]
    assert Image.open(folder / "figure13_tiny.png").text["Description"] == words["alt"]


class Actor(PlainRig):
    """The small face as a rig that moves, of some size, with some controls and landmarks by name."""

    def __init__(self, name, size, controls):
        mesh = small_mesh()
        self.name, self.size, self.mesh = name, size, replace(mesh, neutral=np.float32(size) * mesh.neutral)
        self.controls = tuple(Control(control, -1.0, 0.0, 1.0, "mouth") for control in controls)
        self.lower, self.default, self.upper = (np.full(M, value, np.float32) for value in (-1, 0, 1))
        self.landmarks = np.array([0, 7, 15, 34, 60, 100, 118, 150, 199, 240, 247, 255], np.int32)
        self.landmark_names = tuple(f"mark_{k}" for k in range(len(self.landmarks)))

    def __call__(self, params):
        return self.mesh.neutral + np.float32(self.size) * pose_offsets(self.mesh, params)


NAMES = [f"control_{j}" for j in range(M)]
OTHERS = {"twice": Actor("twice", 2, NAMES), "stranger": Actor("stranger", 1, [f"other_{j}" for j in range(M)])}


def test_other_faces_are_measured_against_their_rigs_where_controls_have_the_same_names(inputs, tmp_path, monkeypatch):
    rigs = {"tiny": Actor("tiny", 1, NAMES), **OTHERS}
    folders = inputs | {f"landmark_rig-{name}": tmp_path / name for name in rigs}
    monkeypatch.setattr("replicate.capture.landmark_rig.load_landmark_rig", lambda own: rigs[own["landmark_rig"].name])
    for name in OTHERS:
        settings = moved.OtherSettings("tiny", name, 0, 10, 0)
        folders, notes = run_stage(moved.move_others, folders, f"onto_{name}", settings, tmp_path)
        assert notes["landmarks"] == 12 and notes["scale"] == pytest.approx(rigs[name].size)
    distance = {mean.method: mean.distance_mm for mean in moved.load_other_means(folders["onto_twice"])}
    assert set(distance) == set(WAYS) and distance["deformation_transfer"] < 0.01 < distance["neutral"]
    assert distance["coarse"] == pytest.approx(distance["coarse_carried"], rel=0.01)
    assert moved.load_other_means(folders["onto_stranger"]) == []
    monkeypatch.setattr(figure13_shown, "render", partial(render))
    _, words = figure13_shown.sheet_of_others("tiny", folders, {n: folders[f"onto_{n}"] for n in OTHERS}, 40)
    assert "twice: 12 landmarks, scale 2.00, 12 controls" in words.caption
    assert "no control of the same name" in words.caption.split("stranger:")[1]
    (table,) = tables13(rows_of("tiny", "quick", {}, moved.load_other_means(folders["onto_twice"])))[2:]
    assert table.headers[0][1] == "twice" and table.body[0][1] == f"{distance['coarse']:.2f}"


def test_one_pixel_is_not_plural():
    assert [figure13_shown.in_pixels(count) for count in ("0", "0.5", "1", "2")] == [
        "0 pixels", "0.5 pixels", "1 pixel", "2 pixels",
    ]  # fmt: skip
