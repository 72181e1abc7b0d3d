"""Models that come with the repository: who takes them and who trains, what is said, and whether they are as good."""

import json
import shutil
import tomllib
import zipfile

import numpy as np
import onnxruntime
import pytest
import rigs
from glb_shapes import posed_by_shapes

from data_recipes.catalogue import FACE_LANDMARKS
from replicate import __main__ as cli
from replicate.approximation.metrics import evaluate
from replicate.approximation.rigid import Attachments, attach
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import write_landmarks
from replicate.cli.parser import command
from replicate.cli.target_list import targets
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.inverse.control_points import default_section as inverse_section
from replicate.methods import coarse, regional, trained
from replicate.methods.method_registry import method_named, sections
from replicate.methods.plan import reference
from replicate.methods.trained import TrainedPlan, plan_for
from replicate.poser import notebook
from replicate.targets import trained_models

TAKE = reference(trained.take)
LARGEST_MB, LARGEST_PAGE_MB = 30, 7.5
TINY = ["--profile", "quick", "--characters", "tiny"]
SECTIONS = sections("quick") | {"inverse": inverse_section("quick"), "capture": CaptureConfig()}
NUMBERS = """
samples = {count = 300, validation = 8}
coarse = {map_size = 16, training = {steps = 60}}
regional = {regions = 2, components = 12, hidden = [16], training = {steps = 60}}
inverse = {hidden = [24], training = {steps = 60}}
"""
CONFIG = resolve("tiny", "quick", tomllib.loads(NUMBERS), None, SECTIONS, seed=0, device="cpu")
GIT = {"commit": "0123456789abcdef", "clean": True}
NAMES = ["regional", "inverse_regional", "rigid", "influence"]


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """The folders of a cache in which the tiny rig's models were trained, and of those models as the repository's."""
    place = tmp_path_factory.mktemp("trained")
    (place / "models").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATE_CACHE", str(place / "cache"))
        rigs.put_into(place / "cache")
        patch.setattr(trained, "FOLDER", place / "models")
        patch.setattr(trained_models, "MODELS", {"tiny": ()})
        patch.setattr(trained_models, "SHAPES", 10)
        for module in ("replicate.engine.provenance", "replicate.targets.trained_models"):
            patch.setattr(f"{module}.git_state", lambda: GIT)
        trained_models.put(CONFIG, (regional.METHOD, coarse.METHOD), is_first=True)
    return place


@pytest.fixture
def shipped(models, monkeypatch, tmp_path):
    """The folder of the repository's models, beside an empty cache and no results."""
    shutil.copytree(models / "models", tmp_path / "models")
    monkeypatch.setattr(trained, "FOLDER", tmp_path / "models")
    monkeypatch.setenv("REPLICATE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    return tmp_path / "models"


def graph(words, monkeypatch):
    """Return the stages that a command line would make."""
    found = []

    class Seen(Exception):
        pass

    def see(stages, *_):
        found.extend(in_order(list(stages)))
        raise Seen

    monkeypatch.setattr("replicate.cli.running.run", see)
    with pytest.raises(Seen):
        command(words)
    return found


def taken(stages):
    return {stage.name for stage in stages if stage.function == TAKE}


def trains(stages):
    return {"coarse", "regional"} & {
        stage.name for stage in stages if stage.function.partition(",")[0].endswith(":train")
    }


def test_models_are_taken_where_no_other_is_asked_for_and_a_line_says_so(shipped, monkeypatch, capsys):
    poser = graph(["poser", *TINY], monkeypatch)
    assert taken(poser) == set(NAMES) and not trains(poser) and "samples" not in {stage.name for stage in poser}
    assert capsys.readouterr().out.startswith(
        "tiny: with the trained models that come with the repository (quick, seed 0, commit 0123456); "
        "`make table2 CHARACTERS=tiny` trains your own\n"
    )
    assert taken(graph(["poser", *TINY, "--methods", "coarse"], monkeypatch)) == {
        "coarse", "inverse_coarse", "rigid", "influence"
    }  # fmt: skip
    errors = {"errors_coarse", "errors_regional"}
    assert taken(graph(["deploy", *TINY], monkeypatch)) == {"coarse", "regional", "rigid", *errors}
    assert taken(graph(["deploy", *TINY, "--methods", "regional"], monkeypatch)) == {
        "regional", "errors_regional", "rigid"
    }  # fmt: skip


@pytest.mark.parametrize(
    "words",
    [
        ["--methods", "refined"],
        ["--methods", "coarse refined"],
        ["--seed", "1"],
        ["--seed", "0 1"],
        ["--split", "clips"],
        ["--config", "numbers.toml"],
    ],
)
def test_other_methods_seeds_splits_and_settings_are_trained(shipped, monkeypatch, tmp_path, words):
    (tmp_path / "numbers.toml").write_text(NUMBERS)
    monkeypatch.chdir(tmp_path)
    stages = graph(["poser", *TINY, *words], monkeypatch)
    assert not taken(stages) and trains(stages)


def test_another_profile_a_variant_and_a_recipe_by_its_path_are_trained(shipped):
    for character, profile in (("tiny", "laptop"), ("teen", "quick"), ("tiny@one_face", "quick")):
        assert not isinstance(plan_for(resolve(character, profile), [regional.METHOD], NAMES), TrainedPlan)
    assert isinstance(plan_for(resolve("tiny", "quick"), [regional.METHOD], NAMES), TrainedPlan)
    assert not isinstance(
        plan_for(resolve("tiny", "quick"), [regional.METHOD], [*NAMES, "inverse_refined"]), TrainedPlan
    )


def test_a_model_of_ones_own_is_taken_instead(shipped, models, monkeypatch):
    assert isinstance(plan_for(CONFIG, [regional.METHOD], NAMES), TrainedPlan)
    monkeypatch.setenv("REPLICATE_CACHE", str(models / "cache"))
    for method in (regional.METHOD, coarse.METHOD):
        assert not isinstance(plan_for(CONFIG, [method], NAMES), TrainedPlan)


def test_no_table_and_no_other_figure_takes_them(shipped, monkeypatch, tmp_path):
    takes = {target.name for target in targets().values() if target.takes_trained}
    assert takes == {"poser", "deploy", "capture"}
    seen = set()
    for target in targets().values():
        if target.stages and {"profile", "characters", "jobs"} <= {*target.options} and target.name not in takes:
            stages = graph([target.name, *TINY], monkeypatch)
            assert not taken(stages), target.name
            seen |= {target.name} if trains(stages) else set()
    assert {"table2", "table3", "table4", "figure01", "figure09", "figure10", "figure11", "figure13"} <= seen


def test_damaged_or_lost_files_get_one_sentence_with_the_way_out(shipped, capsys):
    whole = (shipped / "tiny.zip").read_bytes()
    way_out = f"`git checkout {shipped}` brings back what is committed\n"
    for damage, sentence in (
        (lambda file: file.write_bytes(whole[:-7]), "tiny.zip: its checksum is not the manifest's; "),
        (lambda file: file.unlink(), "tiny.zip: it can't be read (No such file or directory); "),
    ):
        damage(shipped / "tiny.zip")
        assert cli.main(["poser", *TINY]) == 1
        assert capsys.readouterr().err == f"{shipped}/{sentence}{way_out}"
    (shipped / "manifest.json").write_text('{"tiny": {}}')
    assert cli.main(["deploy", *TINY]) == 1
    assert capsys.readouterr().err.startswith(f"{shipped}/manifest.json: it can't be read")


def changed(folder, name, change):
    """Rewrite an array or a list in the zip, and its checksum in the manifest."""
    file, entry = folder / "tiny.zip", json.loads((folder / "manifest.json").read_text())
    with zipfile.ZipFile(file) as archive:
        contents = {info: archive.read(info) for info in archive.namelist()}
    contents[name] = change(contents[name])
    with zipfile.ZipFile(file, "w") as archive:
        for info, data in contents.items():
            archive.writestr(info, data)
    entry["tiny"]["sha256"] = trained.digest(file)
    (folder / "manifest.json").write_text(json.dumps(entry))


def test_models_of_another_rig_are_refused_with_the_way_out(shipped, capsys):
    changed(shipped, trained.CONTROLS, lambda data: data.replace(b"jaw_open", b"jaw_shut"))
    assert cli.main(["poser", *TINY]) == 1
    assert capsys.readouterr().err.endswith(
        "tiny.zip: expected the rig that these models were trained on, got one with controls of its own; "
        "`make table2 METHODS=regional` of the character trains models of this one\n"
    )


def test_page_models_and_animation_come_from_an_empty_cache(shipped, tmp_path, capsys):
    rig = rigs.landmark_rig("tiny")
    places = np.repeat(rig.mesh.neutral[None, rig.control_points, :2], 9, axis=0).astype(float)
    places[4:, 20:30, 1] += 3
    write_landmarks(tmp_path / "actor.csv", places, tuple(FACE_LANDMARKS), "mm")
    for words in (["poser"], ["deploy"], ["capture", "--landmarks", str(tmp_path / "actor.csv")]):
        assert cli.main([*words, *TINY]) == 0
        said = capsys.readouterr().out
        assert "with the trained models that come with the repository" in said
        if words == ["deploy"]:
            assert said.endswith("tiny: METHODS=refined,dense,linear names the others, which have to be trained\n")
    results = tmp_path / "results"
    assert cli.main(["deploy", *TINY, "--form", "shapes"]) == 0
    assert capsys.readouterr().out.endswith("METHODS=pca,linear,morph names the others, which have to be trained\n")
    file = results / "quick" / "deploy_tiny_regional.onnx"  # which the other form leaves where it is
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    poses = trained.poses_of_errors(shipped / "tiny.zip").astype(np.float32)
    found = posed_by_shapes(results / "quick" / "deploy_shapes_tiny_regional", poses)
    np.testing.assert_allclose(found, session.run(None, {"parameters": poses})[0], atol=1e-3)
    assert np.abs(found - rig.mesh.neutral).max() > 1
    origin = "from trained models of the repository (quick, seed 0, commit 0123456)"
    for name in ("poser_tiny.html", "deploy_tiny.c"):
        assert origin in " ".join((results / "quick" / name).read_text("utf-8").split())
    files = {str(file.relative_to(results)) for file in results.rglob("*.*")}
    assert {"quick/poser_tiny.html", "quick/deploy_tiny.c", "quick/deploy_tiny_coarse.onnx"} <= files
    assert {"quick/deploy_tiny_regional.onnx", "capture/tiny_actor.glb"} <= files
    assert not [folder for folder in (tmp_path / "cache").glob("*") if folder.name.startswith("samples")]
    assert cli.main(["deploy", *TINY, "--methods", "coarse"]) == 0
    assert "removed, being of an earlier call: deploy_tiny.c, " in capsys.readouterr().out
    assert not file.exists()


def test_the_widget_opens_with_them_for_the_reference_results_and_says_so(shipped, monkeypatch, capsys):
    assert notebook.what_is_missing("reference", "tiny") == "" == notebook.what_is_missing("quick", "tiny")
    face = notebook.open_face("reference", "tiny")
    assert "with the trained models that come with the repository" in capsys.readouterr().out
    assert face.model.offsets(face.rig.default[None]).shape == (1, *face.rig.mesh.neutral.shape)
    assert notebook.what_is_missing("laptop", "tiny").endswith("`make figure11 CHARACTERS=tiny` makes it.")
    (shipped / "manifest.json").unlink()
    with pytest.raises(InputError, match="there is no figure11 of tiny"):
        notebook.open_face("reference", "tiny")


def test_what_is_put_there_has_its_errors_measured_and_gives_the_same_bytes_again(models, shipped, monkeypatch):
    entry = trained.entries()["tiny"]
    for errors in entry["errors"].values():
        assert 0 < errors["distance_mm"] < 10 and 0 < errors["as_trained"]["normal_deg"] < 90
    coarse_errors = entry["errors"]["coarse"]
    assert coarse_errors["normal_deg"] == pytest.approx(coarse_errors["as_trained"]["normal_deg"], rel=0.01)
    assert (shipped / entry["page"]["file"]).read_text("utf-8").startswith("<!")
    monkeypatch.setenv("REPLICATE_CACHE", str(models / "cache"))
    monkeypatch.setattr(trained_models, "MODELS", {"tiny": ()})
    monkeypatch.setattr(trained_models, "SHAPES", 10)
    monkeypatch.setattr(trained_models, "git_state", lambda: GIT)
    trained_models.put(CONFIG, (regional.METHOD, coarse.METHOD), is_first=True)
    assert trained.entries()["tiny"]["sha256"] == entry["sha256"]


def test_models_from_a_tree_with_changes_are_not_put_there(shipped, monkeypatch):
    monkeypatch.setattr(trained_models, "git_state", lambda: GIT | {"clean": False})
    with pytest.raises(InputError, match="the models would be of a tree with changes: commit them"):
        trained_models.put(CONFIG, (regional.METHOD,), is_first=False)


# The models that are committed.

COMMITTED = trained.entries()


def test_the_committed_models_are_those_that_the_command_puts_there_and_stay_small():
    assert "teen" in COMMITTED and {*COMMITTED} <= {*trained_models.MODELS}
    files = [*trained.FOLDER.iterdir()]
    assert sum(file.stat().st_size for file in files if file.suffix == ".zip") < LARGEST_MB * 1e6
    named = {facts["file"] for facts in COMMITTED.values()} | {
        facts["page"]["file"] for facts in COMMITTED.values() if "page" in facts
    }
    assert {file.name for file in files} == {trained.MANIFEST, *named}
    for character, facts in COMMITTED.items():
        assert (facts["profile"], facts["seed"]) == ("laptop", 0)
        assert {method.name for method in trained_models.MODELS[character]} == {*facts["errors"]}
        assert trained.digest(trained.FOLDER / facts["file"]) == facts["sha256"]
    page = COMMITTED["teen"]["page"]
    assert trained.digest(trained.FOLDER / page["file"]) == page["sha256"]
    assert (trained.FOLDER / page["file"]).stat().st_size < LARGEST_PAGE_MB * 1e6
    stated = f"{page['errors']['distance_mm']:.2f} mm and {page['errors']['normal_deg']:.2f}°, against"
    assert stated in " ".join((ROOT / "README.md").read_text("utf-8").split()), "what README says of the page"


@pytest.mark.parametrize("character", COMMITTED)
def test_a_committed_model_has_the_errors_that_its_manifest_states(character, tmp_path):
    facts, rig = COMMITTED[character], rigs.rig(character)
    file = trained.FOLDER / facts["file"]
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path)
    assert json.loads((tmp_path / trained.CONTROLS).read_text()) == trained.controls_of(rig)
    assert np.abs(np.load(tmp_path / trained.NEUTRAL) - rig.mesh.neutral).max() < trained.NEAR_MM
    params = trained.poses_of_errors(file)
    truth = np.asarray(rig(params), np.float32)
    attachments = Attachments.load(tmp_path / "rigid" / "attachments.npz")
    inputs = {stage: tmp_path / stage for stage in facts["stages"]}
    for name, stated in facts["errors"].items():
        model = method_named(name).model(inputs)

        def predict(some, _, model=model):
            return attach(rig.mesh, attachments, rig.mesh.neutral + model.offsets(some))

        errors = evaluate(rig.mesh, params, truth - rig.mesh.neutral, {name: predict})[name]
        assert len(errors.pose_mm) == facts["poses"] == 100
        assert errors.pose_mm.mean() == pytest.approx(stated["distance_mm"], rel=0.01)
        assert errors.pose_deg.mean() == pytest.approx(stated["normal_deg"], rel=0.01)
