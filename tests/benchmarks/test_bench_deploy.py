"""What leaves the suite, form by form: each gives the suite's vertices, has its size, and stands in the table."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from posed_face import PosedRig, posed_face
from small_artefacts import write_artefacts
from untrained_models import MESH, coarse_model

from replicate.approximation.rigid import attach
from replicate.base.exceptions import InputError
from replicate.benchmarks import bench_deploy
from replicate.benchmarks.bench_deploy import C99, FORMS, HALF, ONNX, SHAPES, deploy_table, forms_card, forms_of
from replicate.config import resolve
from replicate.regional import model as regional_model

ATTACHMENTS = posed_face().attachments
POSES = np.random.default_rng(0).uniform(-1, 2, (5, 12)).astype(np.float32)


def test_every_form_of_ours_poses_the_face_as_python_does(tmp_path):
    model = posed_face().model
    forms = forms_of(model, PosedRig(), ATTACHMENTS, tmp_path)
    assert list(forms) == [form for form in FORMS if form != C99 or shutil.which("cc")]
    wanted = attach(MESH, ATTACHMENTS, MESH.neutral + model.offsets(POSES))
    for form in forms.values():
        found = np.concatenate([form.evaluate(pose[None]) for pose in POSES])
        assert np.linalg.norm(found - wanted, axis=-1).max() < 1e-3
    assert forms[HALF].size < forms[ONNX].size < forms[SHAPES].size


def test_a_method_without_shapes_has_the_other_forms(tmp_path):
    assert list(forms_of(coarse_model(), PosedRig(), ATTACHMENTS, tmp_path)) == [ONNX, HALF]


def test_sizes_times_and_errors_become_rows_and_a_table(tmp_path, monkeypatch):
    inputs = write_artefacts(tmp_path) | {"regional": tmp_path / "regional"}
    inputs["regional"].mkdir()
    (inputs["regional"] / "manifest.json").write_text(json.dumps({"notes": {}}))
    regional_model.save(posed_face().model, inputs["regional"])
    monkeypatch.setattr(bench_deploy, "artefacts_of", lambda *_: inputs)
    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda _: PosedRig())
    rows = bench_deploy.measure(resolve("tiny", "quick"), ["regional"], 2)
    values = {row.metric: row.value for row in rows}
    assert {row.unit for row in rows} == {"MB", "ms", "mm", "ratio"} and {row.method for row in rows} == {"regional"}
    for form in (ONNX, HALF, SHAPES):
        assert values[f"largest_difference[{form}]"] < 1e-3 < 1 < values[f"vertex_error[{form}]"]
        assert values[f"pose[{form}]"] > 0 and values[f"file_size[{form}]"] > 0.01
        ratio = values[f"pose[{form}]"] / values[f"pose[{ONNX}]"]
        assert values[f"times_as_long_as_onnx[{form}]"] == pytest.approx(ratio)
    table = deploy_table(rows, "tiny")
    assert [line[:2] for line in table.body] == [
        ("Regional (ours)", form) for form in FORMS if f"pose[{form}]" in values
    ]
    assert len(table.body[0]) == len(table.headers[0]) and "–" not in table.body[0]
    card = forms_card([*rows, *(replace(row, character="toon") for row in rows)])
    body = table.body
    assert card.body == (*(("tiny", *line) for line in body), None, *(("toon", *line) for line in body))
    assert len(card.headers[0]) == len(card.body[0])


def test_methods_without_a_model_alone_are_refused_in_a_sentence():
    with pytest.raises(InputError, match="methods: expected at least one with a model, got neutral"):
        bench_deploy._planned(resolve("tiny", "quick"), ["neutral"])


def test_the_repositorys_models_are_taken_where_there_are_some():
    plan, methods = bench_deploy._planned(resolve("woman", "laptop"), [])
    assert [method.name for method in methods] == ["regional"] and plan.facts["file"] == "woman.zip"
    _, methods = bench_deploy._planned(resolve("tiny", "laptop"), [])
    assert [method.name for method in methods] == list(bench_deploy.OTHERWISE)
