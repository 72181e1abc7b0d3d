"""The library of expressions and visemes speaks of controls that exist, within their limits."""

import pytest

from data_recipes.controls import control_groups
from data_recipes.expressions import EXPRESSIONS
from data_recipes.visemes import VISEMES

CONTROLS = {control.name: control for group in control_groups().values() for control in group}


@pytest.mark.parametrize("name,amounts", [*EXPRESSIONS.items(), *VISEMES.items()])
def test_amounts_name_real_controls_and_keep_their_limits(name, amounts):
    for stem, amount in amounts.items():
        for side in ("left", "right") if "*" in stem else ("",):
            control = CONTROLS[stem.replace("*", side)]
            assert control.lower <= amount <= control.upper, stem
            assert amount != 0, stem


def test_expressions_and_visemes_are_all_different():
    for library in (EXPRESSIONS, VISEMES):
        assert len({tuple(sorted(amounts.items())) for amounts in library.values()}) == len(library)
