"""The contents of the notebooks: what JupyterLab opens with, in README's order, and true about what trains."""

import json
import re
import sys
from pathlib import Path

import pytest

from replicate.base.paths import ROOT
from replicate.cli.target_list import targets
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan, TrainingSettings

CONTENTS = (ROOT / "notebooks" / "README.md").read_text(encoding="utf-8")
COMMAND = r"`make ([a-z0-9-]+)(?: [A-Z]+=[\w@]+)?`"
ENTRY = re.compile(rf"^- \[(\w+)\]\((\w+)\.ipynb\): \w.*\. {COMMAND}(, trains)?$", re.MULTILINE)
ENTRIES = [(name, file, command, bool(trains)) for name, file, command, trains in ENTRY.findall(CONTENTS)]


def test_the_contents_have_readmes_groups_in_readmes_order():
    lines = re.findall(r"^\| (\[.*\.ipynb\).*) \| (.*) \|$", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE)
    in_readme = [(about, re.findall(r"\(notebooks/(\w+)\.ipynb\)", names)) for names, about in lines]
    groups = [group.partition("\n") for group in CONTENTS.split("\n## ")[1:]]
    here = [(about[0].lower() + about[1:], [entry[0] for entry in ENTRY.findall(text)]) for about, _, text in groups]
    assert here == [(about[0].lower() + about[1:], names) for about, names in in_readme]


def test_readme_is_a_page_and_no_book():
    text = (ROOT / "README.md").read_text("utf-8")
    shown = re.sub(r"(?s)```.*?```|<!--.*?-->|!\[[^]]*\]", " ", text)  # code, marks and pictures aside
    shown = re.sub(r"\]\([^)]*\)", "]", shown)  # and addresses
    assert len(re.findall(r"[A-Za-z][\w'’-]*", shown)) < 1300


def test_every_notebook_stands_in_the_contents_once():
    names = [name for name, *_ in ENTRIES]
    assert sorted(names) == sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))
    assert names == [file for _, file, *_ in ENTRIES] and len(names) == CONTENTS.count(".ipynb)")


@pytest.mark.parametrize(("command", "trains"), sorted({entry[2:] for entry in ENTRIES}))
def test_the_contents_say_which_commands_train(command, trains):
    if command.startswith("bench-"):
        about = (ROOT / f"replicate/benchmarks/{command.replace('-', '_')}.py").read_text("utf-8").split('"""')[1]
        assert trains == ("trains" in about)
        return
    target = targets()[command]
    graph = in_order(target.stages(Plan(resolve("tiny", "quick")), choose(["coarse"]))) if target.stages else []
    assert trains == any(isinstance(stage.config, TrainingSettings) for stage in graph)


def test_make_lab_opens_the_contents_as_they_are_to_be_read():
    (command,) = re.findall(r"^\t.*-m jupyterlab (.*)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    options = dict(word.removeprefix("--LabApp.").split("=") for word in command.split())
    assert (ROOT / options["default_url"].removeprefix("/lab/tree/")).is_file()
    settings = json.loads((ROOT / options["app_settings_dir"] / "overrides.json").read_text("utf-8"))
    schemas = Path(sys.prefix) / "share" / "jupyter" / "lab" / "schemas"
    for plugin, values in settings.items():
        package, _, name = plugin.partition(":")
        known = json.loads((schemas / package / f"{name}.json").read_text("utf-8"))["properties"]
        assert set(values) <= set(known)


def test_the_index_of_deviations_names_every_entry_by_its_title():
    text = (ROOT / "DEVIATIONS.md").read_text("utf-8")
    index, _, entries = text.partition("\n## ")
    titles = re.findall(r"^### (D\d+)\. (.+)$", entries, re.MULTILINE)
    listed = re.findall(r"\[(D\d+)\]\(#([\w-]+)\) ([^;|*]+)", index)
    slugs = {n: re.sub(r"[^\w -]", "", f"{n}. {title}".lower()).replace(" ", "-") for n, title in titles}
    assert {n: slug for n, slug, _ in listed} == slugs and len(listed) == len(titles)
    assert all(words.strip().lower() == title.lower() for (_, _, words), (_, title) in zip(listed, titles, strict=True))
