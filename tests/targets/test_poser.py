"""`make poser`: which methods have a page, and what their pages are made from."""

import pytest

import replicate.__main__ as cli
from replicate.config import resolve
from replicate.methods import coarse, regional
from replicate.methods.plan import Plan
from replicate.targets import poser


def test_a_method_that_no_page_evaluates_is_refused_in_a_sentence(capsys):
    assert cli.main(["poser", "--methods", "dense"]) == 2
    sentence = "method 'dense' has no page to pose in; regional, coarse, refined have one\n"
    assert capsys.readouterr().err == sentence


@pytest.mark.parametrize(("methods", "names"), [((), ["regional"]), ((coarse.METHOD, regional.METHOD), None)])
def test_a_page_has_its_methods_model_and_the_networks_that_are_trained_through_it(methods, names):
    *_, page = poser.stages(Plan(resolve("teen", "quick")), methods)
    names = names or ["coarse", "regional"]
    assert [name for name, _ in page.config.models] == names
    inputs = {stage.name for stage in page.inputs}
    assert {*names, *(f"inverse_{name}" for name in names), "rig", "rigid", "influence"} <= inputs
