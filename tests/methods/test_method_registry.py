"""The registry of methods: what it lists, what METHODS may name, and what a file from outside must hold."""

import os
import re
from functools import partial
from pathlib import Path

import pytest
from outside import bring  # noqa: F401, a fixture

from replicate import __main__ as cli
from replicate.base.exceptions import InputError
from replicate.config import resolve
from replicate.engine.stage import stage_function
from replicate.methods import method_registry
from replicate.methods.measurement import reading
from replicate.methods.method_registry import VARIABLE, choose, in_order, method_named, methods
from replicate.methods.plan import Plan, reference
from replicate.methods.printed import METHODS

OWN = methods().values()
CONFIG = resolve("tiny", "quick")
LBS = ["lbs16", "lbs24", "lbs32"]


def names(*words: str, config=None) -> list[str]:
    return [method.name for method in choose(words, config)]


def test_names_and_labels_occur_once_and_a_mark_stands_for_one_note():
    assert len({method.label for method in OWN}) == len(OWN) == len(methods())
    notes = {(method.mark, method.note) for method in OWN if method.mark}
    assert len({mark for mark, _ in notes}) == len(notes)
    assert all(method.note for method in OWN if method.mark or method.oracle), "an oracle says that it is one"


@pytest.mark.parametrize("method", OWN, ids=lambda method: method.name)
def test_a_methods_functions_are_found_by_other_processes(method):
    assert re.fullmatch(r"[a-z]\w*", method.name)
    read = reading(method, CONFIG)
    for function in filter(None, (*read.sources, read.load, read.multiplications, method.facts)):
        found = stage_function(reference(function))
        if isinstance(function, partial):  # networks that are read by their stage's name
            assert (found.func, found.args) == (function.func, (method.name,))
        else:
            assert found is function
    plan = Plan(CONFIG)
    for stage in method.stages(plan):
        assert callable(stage_function(stage.function))


def test_every_prediction_says_how_much_work_it_is_and_no_look_at_the_truth_does():
    silent = {method.name for method in OWN if reading(method, CONFIG).multiplications is None}
    assert silent == {"attachment", "floor", "floor_refined"}


def test_the_papers_rows_come_first_and_lbs_is_sorted_by_its_bones():
    assert list(methods())[:6] == ["coarse", "refined", "dense", *LBS]
    assert in_order(["neutral", "lbs64", "odd", "lbs4", "dense"]) == ["dense", "lbs4", "lbs64", "odd", "neutral"]
    assert method_named("odd").title == "odd" and method_named("lbs4").oracle


def test_words_choose_methods_in_the_order_of_the_tables():
    assert names("all", "printed") == list(methods())
    assert names() == names("standard") == [name for name, method in methods().items() if method.standard]
    assert {"coarse", "refined", "dense", "lbs32", "linear", "regional", "neutral"} < set(names()) < set(names("all"))
    assert names("neutral", "coarse", "coarse") == ["coarse", "neutral"]
    assert names("lbs") == LBS and names("lbs", "dense") == ["dense", *LBS]
    config = resolve("tiny", "quick", {"lbs": {"bones": [8, 4]}})
    assert names("lbs", config=config) == ["lbs4", "lbs8"]


def test_an_unknown_method_is_refused_with_those_there_are():
    with pytest.raises(InputError, match=r"^there is no method coarze; did you mean coarse\?$"):
        choose(["coarse", "coarze"])
    words = r"no method quux: there are standard, all, lbs, printed, .*neutral, \d+ more with all or printed, and"
    with pytest.raises(InputError, match=words):
        choose(["coarse", "quux"])


def test_a_file_from_outside_joins_the_others_and_other_processes_find_it(bring):  # noqa: F811
    file = bring()
    assert names("neutral", str(file)) == ["mine", "neutral"]
    assert names("all", "printed", str(file)) == list(methods()) and "mine" in methods()
    assert os.environ[VARIABLE] == str(file) and method_named("mine").title == "Mean pose #"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ((("METHOD = ", "OTHER = "),), "has no METHOD; README shows"),
        ((('Method("mine"', 'Method("coarse"'),), "has a method 'coarse' already; give yours another name"),
        ((('Method("mine"', 'Method("My method"'),), "whose name has only small letters, digits and _"),
        (
            (("METHOD = Method(", "METHOD = dict("), ('"mine", "Mean pose", stages, load, ', "")),
            "must be a Method",
        ),
        ((("import numpy", "import no_such_library"),), "can't be imported .ModuleNotFoundError"),
        ((("def load", "def load("),), "can't be imported .SyntaxError"),
        (
            (("import numpy as np", "import sys\n\nimport numpy as np\n\nsys.exit(0)"),),
            "can't be imported .SystemExit: 0",
        ),
    ],
)
def test_a_file_that_holds_no_usable_method_is_refused(bring, changes, message):  # noqa: F811
    file = bring(*changes, name="brought_bad")
    with pytest.raises(InputError, match=f"brought_bad.py: .*{message}"):
        choose([str(file)])
    assert os.environ[VARIABLE] == "", "it is not handed to other processes"


@pytest.mark.parametrize(
    ("name", "message"),
    [("brought mine", "a module can't be called 'brought mine': use letters"), ("json", "another module json")],
)
def test_a_file_is_named_as_no_other_module_is(bring, name, message):  # noqa: F811
    with pytest.raises(InputError, match=message):
        choose([str(bring(name=name))])


def test_a_method_that_calls_sys_exit_before_the_run_is_named_and_is_no_success(bring, cache, capfd):  # noqa: F811
    file = bring(("def stages(plan):", "def stages(plan):\n    raise SystemExit(0)"), name="brought_exit")
    assert cli.main(["table2", "--profile", "quick", "--characters", "tiny", "--methods", str(file)]) == 1
    assert capfd.readouterr().err == f"{file}: stages called sys.exit(0), where it had to return\n"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('raise ValueError("no data for tiny")', "ValueError: no data for tiny"),
        ("return None", "TypeError: 'NoneType' object is not iterable"),
        ("assert not plan", "AssertionError"),
    ],
)
def test_a_method_whose_stages_fail_is_named_with_the_mistake(bring, cache, capfd, line, said):  # noqa: F811
    file = bring(("def stages(plan):", f"def stages(plan):\n    {line}"), name="brought_broken")
    assert cli.main(["table2", "--profile", "quick", "--characters", "tiny", "--methods", str(file)]) == 2
    assert capfd.readouterr().err == f"{file}: the method 'mine' can't say its stages ({said})\n"
    assert not [folder for folder in cache.glob("*-*") if "-tiny-" in folder.name], "nothing was made"


def test_a_file_that_there_is_not_is_named(bring, tmp_path):  # noqa: F811
    with pytest.raises(
        InputError, match=rf"{tmp_path}/none.py: there is no such file; METHODS expects names and paths"
    ):
        choose([str(tmp_path / "none.py")])


def test_a_name_that_is_too_long_for_a_file_is_none_either():
    with pytest.raises(InputError, match=r"a\.py: there is no such file; METHODS expects names and paths"):
        choose(["a" * 300 + ".py"])


def test_all_methods_of_a_folder_of_samples_are_those_that_do_without_the_rigs_derivatives(monkeypatch):
    every = set(names("all", config=CONFIG))
    monkeypatch.setattr(method_registry, "sample_folder", Path)
    of_samples = set(names("all", config=CONFIG))
    assert every | {*names("printed")} == set(methods(CONFIG)) and every - of_samples == {"regional_derivatives"}


def test_a_method_without_a_section_or_a_model_says_so_when_it_is_asked_for_one():
    bare = method_named("nobody_knows_it")
    with pytest.raises(ValueError, match="'nobody_knows_it' has no section"):
        bare.section(resolve("tiny"))
    with pytest.raises(ValueError, match="got None"):
        reference(bare.model)


def test_the_rows_of_the_texts_recipe_are_asked_for_by_name_since_they_take_most_of_a_day():
    printed = {method.name for method in choose(["printed"])}
    assert printed == {method.name for method in METHODS}
    assert not printed & {method.name for method in choose(["all"])}
    assert printed | {method.name for method in choose(["all"])} == set(methods())
