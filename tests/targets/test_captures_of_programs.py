"""`make capture` on faces that nobody here made: weights by name, weights that another face plays, named landmarks."""

import json

import numpy as np
import pytest
from landmark_mask import REST, SHAPES, live_link, vertices_at, weights_at, write_glb, write_samples
from refusal import refusal

from data_recipes.catalogue import FACE_LANDMARKS, build_rig, character_parts, read_clip, with_face_landmarks
from replicate import __main__ as cli
from replicate.engine.cache_report import inventory

NUMBERS = """
[samples]
count = 200
validation = 8
[regional]
regions = 2
components = 8
hidden = [16]
[regional.training]
steps = 60
[inverse]
hidden = [32, 32]
[inverse.training]
steps = 300
peak_rate = 0.004
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cache and results of their own, a face as a GLB and as samples, and recordings of two programs."""
    place = tmp_path_factory.mktemp("captures")
    (place / "numbers.toml").write_text(NUMBERS)
    write_glb(place / "shapes")
    write_samples(place / "samples")
    (place / "live.csv").write_text(live_link((*SHAPES, "tongueOut")))
    (place / "face.csv").write_text(openface())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATE_CACHE", str(place / "cache"))
        patch.setenv("REPLICATE_RESULTS", str(place / "results"))
        yield place


def openface(frames=60):
    """Return what OpenFace 2 would write of an actor twice the mask's size, at 30 frames a second."""
    still = 20
    weights = [
        weights_at((k - still) / 30, len(SHAPES)) if k >= still else np.zeros(len(SHAPES)) for k in range(frames)
    ]
    places = vertices_at(np.stack(weights))[:, :68, :2] * (2, -2) + 500
    lines = [
        "frame, face_id, timestamp, confidence, success, " + ", ".join(f"{a}_{k}" for a in "xy" for k in range(68))
    ]
    for k, place in enumerate(places):
        lines.append(", ".join(map(str, [k + 1, 0, f"{k / 30:.3f}", 0.98, 1, *place.T.ravel().tolist()])))
    return "\n".join(lines) + "\n"


def run(folder, character, recording, *more):
    """Run the target on a face and return the exit code."""
    common = ["--profile", "quick", "--jobs", "2", "--config", str(folder / "numbers.toml"), *more]
    return cli.main(["capture", "--characters", str(character), "--landmarks", str(folder / recording), *common])


def test_weights_drive_a_glb_by_name_without_inverse_kinematics(folder, capfd):
    assert run(folder, folder / "shapes/mask.glb", "live.csv") == 0
    printed = capfd.readouterr().out
    assert "120 frames of 9 weights from Live Link Face at 60 frames a second; 60 frames a second become 24" in printed
    assert "\nWithout a counterpart in mask: TongueOut, HeadYaw.\n" in printed
    assert not [entry for entry in inventory() if "capture_ik" in entry.identifier or "landmark" in entry.identifier]
    rig = build_rig(folder / "shapes/mask.glb")
    params = read_clip(rig, folder / "results/capture/mask_live_parameters.csv")
    truth = np.stack([weights_at(k / 24, 9)[:8] for k in range(len(params))])
    assert len(params) == 48 and [control.name for control in rig.controls] == list(SHAPES)
    np.testing.assert_allclose(params, truth, atol=0.02)
    caption = json.loads((folder / "results/capture/mask_live.json").read_text())["caption"]
    assert caption.startswith("Weights by name drive mask") and "IK networks" not in caption


def test_weights_drive_a_face_that_is_known_by_its_samples(folder, capfd):
    assert run(folder, folder / "samples", "live.csv") == 0
    assert (folder / "results/capture/samples_live.glb").is_file()
    assert "They drive the controls of samples by their names" in capfd.readouterr().out


@pytest.mark.parametrize(("character", "label"), [("shapes/mask.glb", "mask"), ("samples", "samples")])
def test_landmarks_that_a_face_names_drive_it(folder, capfd, character, label):
    assert run(folder, folder / character, "face.csv") == 0
    printed = capfd.readouterr().out
    assert (
        "60 frames of 54 landmarks from OpenFace 2 at 30 frames a second" in printed and "scale 0.5 mm per" in printed
    )
    lines = (folder / f"results/capture/{label}_face_parameters.csv").read_text().splitlines()
    params = np.array([line.split(",") for line in lines[1:]], float)
    jaw, smile = (params[:, list(SHAPES).index(name)] for name in ("jawOpen", "mouthSmileRight"))
    assert len(params) == 48 and jaw.max() > 0.3 and smile.max() > 0.3
    assert np.argmax(jaw) < np.argmax(smile)


def test_a_face_with_arkits_names_plays_weights_for_one_without(folder, capfd):
    text = NUMBERS + f'[capture]\nactor = "{folder / "shapes/mask.glb"}"\n'
    (folder / "numbers_with_actor.toml").write_text(text)
    more = ("--config", str(folder / "numbers_with_actor.toml"))
    assert run(folder, "tiny", "live.csv", *more) == 0
    printed = capfd.readouterr().out
    assert "mask plays them, and its 54 landmarks drive tiny; scale" in printed
    assert "Without a counterpart in mask: TongueOut, HeadYaw." in printed
    assert "landmarks of the actor" in json.loads((folder / "results/capture/tiny_live.json").read_text())["alt"]


def test_landmarks_lie_where_the_file_has_the_vertices_that_are_named(tmp_path):
    recipe, _ = character_parts(write_glb(tmp_path))
    rig = with_face_landmarks(build_rig(tmp_path / "mask.glb"), recipe)
    assert len(rig.mesh.neutral) == len(REST) and rig.control_point_names == tuple(FACE_LANDMARKS)
    found = rig.mesh.neutral[rig.control_points]
    truth = REST[list(FACE_LANDMARKS.values())]
    np.testing.assert_allclose(found - found.mean(0), truth - truth.mean(0), atol=1e-3)


def test_landmarks_that_are_missing_or_no_vertices_are_named(tmp_path, cache, capsys, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    (tmp_path / "face.csv").write_text(openface())
    glb = write_glb(tmp_path, ("chin", "nose_tip"), jaw="ajar")
    arguments = ("capture", "--profile", "quick", "--landmarks", str(tmp_path / "face.csv"), "--characters", str(glb))
    lacking = "nor can be found, since no shape is called jawOpen"
    assert f"mask: 2 of its 54 landmarks have no vertex, {lacking}: chin, nose_tip; name them in face.toml" in refusal(
        capsys, *arguments
    )
    toml = (tmp_path / "face.toml").read_text()
    (tmp_path / "face.toml").write_text("")
    assert f"mask: none of its 54 landmarks has a vertex, {lacking}; name them in face.toml" in refusal(
        capsys, *arguments
    )
    (tmp_path / "face.toml").write_text(toml + "chinn = 3\n")
    assert "face_landmarks: there is no landmark chinn; did you mean chin?" in refusal(capsys, *arguments)
    (tmp_path / "face.toml").write_text(toml + "chin = -1\n")
    assert "face_landmarks.chin: expected a vertex, from 0, got -1" in refusal(capsys, *arguments)
    (tmp_path / "face.toml").write_text(toml + "chin = 1\nnose_tip = 1\n")
    assert "face_landmarks: vertex 1 is there twice" in refusal(capsys, *arguments)
    assert not cache.exists()


def test_weights_for_a_face_without_such_names_get_a_sentence_with_the_remedy(tmp_path, cache, capsys, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    (tmp_path / "live.csv").write_text(live_link(("tongueOut",)))
    glb = write_glb(tmp_path)
    arguments = ("capture", "--profile", "quick", "--landmarks", str(tmp_path / "live.csv"), "--characters", str(glb))
    sentence = refusal(capsys, *arguments)
    assert "live.csv: it gives weights of ARKit's shapes, and mask has no control of such a name" in sentence
    assert '[capture] actor = "head.glb"' in sentence and not cache.exists()


def test_status_tells_of_a_face_without_landmarks(tmp_path, cache, capsys):
    glb = write_glb(tmp_path, ("chin",), jaw="ajar")
    assert cli.main(["status", "--profile", "quick", "--characters", str(glb)]) == 0
    printed = capsys.readouterr().out
    assert "table2" in printed and "figure12" not in printed
