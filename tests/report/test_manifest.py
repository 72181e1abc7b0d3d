"""A manifest names files of its own folder alone, and what is damaged counts as none."""

import json
from dataclasses import replace

import pytest
from toy_stages import toy_graph

from replicate.base.exceptions import InputError
from replicate.config import resolve
from replicate.engine.scheduler import run
from replicate.report import manifest

BAD = [
    "../../victim.txt",
    "/etc/passwd",
    "figure05_/../victim.txt",
    "",
    ".",
    "..",
    "table2.csv",
    "figure05_a\0b",
    7,
    None,
]


def write(folder, files):
    characters = {"teen": {"run": "r", "files": files}}
    (folder / "manifest.json").write_text(json.dumps({"targets": {"figure05": {"characters": characters}}}))


@pytest.mark.parametrize("name", BAD)
def test_a_name_that_is_no_plain_one_of_the_target_is_refused(tmp_path, name):
    write(tmp_path, ["figure05_teen.png", name])
    with pytest.raises(InputError, match=r"manifest\.json, files of teen in figure05: expected plain names"):
        manifest.section(tmp_path, "figure05")
    assert manifest.entries(tmp_path, "figure05") == {}, "publishing would remove it"


@pytest.mark.parametrize("files", ["figure05", 5, {"a": 1}])
def test_what_is_no_list_of_names_is_refused(tmp_path, files):
    write(tmp_path, files)
    with pytest.raises(InputError, match="files of teen"):
        manifest.section(tmp_path, "figure05")


def test_plain_names_are_read(tmp_path):
    write(tmp_path, ["figure05_teen.png", "figure05_teen_clips.csv"])
    assert manifest.entries(tmp_path, "figure05")["teen"]["files"] == ["figure05_teen.png", "figure05_teen_clips.csv"]


def test_a_manifest_is_written_with_what_it_told_before(tmp_path):
    manifest.write_entries(tmp_path, "figure05", {"teen": {"run": "r", "files": ["figure05_teen.png"]}})
    manifest.write_entries(tmp_path, "table1", {"teen": {"run": "s"}})
    assert manifest.targets(tmp_path) == ["figure05", "table1"] and len(list(tmp_path.iterdir())) == 1


def test_results_of_seeds_that_several_runs_made_name_each_command_once(cache):
    *_, last = toy_graph()
    lasts = [replace(last, label=f"toy-seed{seed}") for seed in (0, 1, 2)]
    for stages, command in ((lasts[:1], "table4"), (lasts[1:], "table4 --seed 0 1 2")):
        run(stages, facts={"command": command, "profile": "quick", "git": {"commit": "c", "clean": True}})
    configs = [replace(resolve("tiny", "quick"), seed=seed) for seed in (0, 1, 2)]
    facts = manifest.facts_of(configs, lasts, "r")
    assert facts["command"] == "table4; table4 --seed 0 1 2" and facts["seeds"] == [0, 1, 2]
    assert manifest.facts_of(configs[1:], lasts[1:], "r")["command"] == "table4 --seed 0 1 2"
    joined = manifest.joined(facts, {"git": facts["git"], "command": "table4", "seeds": [0]})
    assert joined["command"] == facts["command"], "what stands there already isn't said twice"
