"""`make rigify` writes samples enough for its profile and then makes Table 2 of them."""

import argparse

import pytest

from replicate import __main__ as cli
from replicate.targets import rigify, table2


@pytest.mark.parametrize(("profile", "poses"), [("quick", 1_875), ("laptop", 12_500), ("paper", 62_500)])
def test_the_samples_are_a_quarter_more_than_those_that_train(profile, poses, monkeypatch, tmp_path):
    calls = []
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    monkeypatch.setattr(rigify, "write_rigify_samples", lambda *words: calls.append(words))
    monkeypatch.setattr(table2, "run", lambda options: calls.append(options.characters))
    rigify.run(argparse.Namespace(profile=profile, jobs="3"))
    folder = tmp_path / "samples" / "rigify"
    assert calls == [(folder, "woman", poses, 3, "rigify"), [str(folder)]]


def test_without_blender_the_command_says_how_to_get_it(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    monkeypatch.setenv("REPLICATE_BLENDER_PYTHON", str(tmp_path / "none"))
    assert cli.main(["rigify", "--profile", "quick"]) == 2
    assert "expected a Python with bpy, or Blender, got" in capsys.readouterr().err
    assert not (tmp_path / "samples").exists()
