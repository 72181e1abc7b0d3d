"""A stage's key names all that its numbers depend on, and nothing else."""

import dataclasses

import pytest
from toy_stages import ToyConfig

from replicate.base.code_hash import sources_digest
from replicate.engine.stage import Stage, StageContext, in_order, input_names, stream_rng

STAGE = Stage("numbers", "toy_stages:numbers", ToyConfig())


def test_the_key_is_the_same_for_the_same_stage():
    assert dataclasses.replace(STAGE).key == STAGE.key
    assert len(STAGE.key) == 16 and STAGE.identifier == f"numbers-{STAGE.key}"


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"config": ToyConfig(seed=1)},
        {"config": ToyConfig(pause_s=0.5)},
        {"function": "toy_stages:total"},
        {"inputs": (Stage("first", "toy_stages:numbers", ToyConfig()),)},
    ],
)
def test_the_key_changes_with_what_the_numbers_depend_on(change):
    assert dataclasses.replace(STAGE, **change).key != STAGE.key


def test_the_key_changes_with_the_sources_that_the_function_reaches(monkeypatch):
    def changed(functions):
        return sources_digest(functions) + "1" * (functions == STAGE.function)

    key = STAGE.key
    monkeypatch.setattr("replicate.engine.stage.sources_digest", changed)
    assert dataclasses.replace(STAGE).key != key


def test_the_key_changes_with_the_key_of_an_input():
    inputs = [Stage("first", "toy_stages:numbers", ToyConfig(seed=seed)) for seed in (0, 1)]
    first, second = (dataclasses.replace(STAGE, inputs=(stage,)) for stage in inputs)
    assert first.key != second.key


def test_the_key_does_not_change_with_how_a_stage_is_run_or_shown():
    assert dataclasses.replace(STAGE, threads=0, label="teen").key == STAGE.key


def test_the_key_follows_the_content_of_a_data_file_and_not_its_path(tmp_path):
    for name, text in (("a", "1"), ("b", "1"), ("c", "2")):
        (tmp_path / name).write_text(text)
    a, b, c = (dataclasses.replace(STAGE, files=(tmp_path / name,)).key for name in "abc")
    assert a == b != c


@pytest.mark.parametrize("name", ["", "a/b", "..\\a", "two words"])
def test_a_name_that_names_no_folder_is_refused(name):
    with pytest.raises(ValueError, match="letters, digits"):
        dataclasses.replace(STAGE, name=name)


def test_streams_are_apart_and_repeatable():
    draws = {
        (seed, name, stream): stream_rng(seed, name, stream).integers(2**62)
        for seed in (0, 1)
        for name in ("coarse", "dense")
        for stream in ("weights", "batch 1")
    }
    assert len(set(draws.values())) == 8
    assert stream_rng(0, "coarse", "weights").integers(2**62) == draws[0, "coarse", "weights"]


def test_a_context_draws_from_its_own_stages_streams(tmp_path):
    context = StageContext("coarse", ToyConfig(seed=3), {}, tmp_path, tmp_path)
    assert context.rng("weights").integers(2**62) == stream_rng(3, "coarse", "weights").integers(2**62)


def test_notes_must_be_fit_for_a_manifest(tmp_path):
    context = StageContext("coarse", ToyConfig(), {}, tmp_path, tmp_path)
    context.note(steps=3)
    with pytest.raises(TypeError):
        context.note(path=tmp_path)
    assert context.notes == {"steps": 3}


def test_inputs_go_by_name_and_by_title_where_a_name_is_shared():
    rig = Stage("rig", "toy_stages:numbers", ToyConfig(), label="teen")
    errors = [Stage("errors", "toy_stages:numbers", ToyConfig(seed=k), label=f"{k}") for k in range(2)]
    assert set(input_names((rig, *errors))) == {"rig", "rig-teen", "errors-0", "errors-1"}


def test_two_inputs_with_one_title_are_refused():
    twins = tuple(Stage("errors", "toy_stages:numbers", ToyConfig(seed=k)) for k in range(2))
    with pytest.raises(ValueError, match="same title"):
        input_names(twins)


def test_stages_come_in_order_each_once():
    rig = Stage("rig", "toy_stages:numbers", ToyConfig())
    samples = Stage("samples", "toy_stages:numbers", ToyConfig(), (rig,))
    again = Stage("samples", "toy_stages:numbers", ToyConfig(), (rig,))
    dense = Stage("dense", "toy_stages:numbers", ToyConfig(), (again, rig))
    coarse = Stage("coarse", "toy_stages:numbers", ToyConfig(), (samples,))
    assert [stage.name for stage in in_order([dense, coarse])] == ["rig", "samples", "dense", "coarse"]
