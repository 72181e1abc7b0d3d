"""The door to the characters: names, files, poses and clips, and rigs only when one is asked for."""

import subprocess
import sys

import numpy as np
import pytest
from box import foreign

from data_recipes.catalogue import character_parts, expression_poses, read_clip
from data_recipes.recipe_paths import character_names
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT


def test_the_recipes_that_come_along_are_listed_with_their_files():
    assert {"teen", "tiny"} <= set(character_names())
    recipe, files = character_parts("tiny")
    assert (recipe.name, files) == ("tiny", ())


def test_a_character_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(InputError, match=r"there is no character nobody: there are .*tiny"):
        character_parts("nobody")


def test_a_recipe_is_read_without_jax_and_scipy():
    program = (
        "import sys; from data_recipes.catalogue import character_parts; character_parts('tiny');"
        "print({'jax', 'scipy', 'torch'} & set(sys.modules))"
    )
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "set()"


def test_a_rig_with_words_of_its_own_has_the_neutral_expression_alone():
    rig = foreign()
    assert list(expression_poses(rig)) == ["neutral"]
    np.testing.assert_array_equal(expression_poses(rig)["neutral"], rig.default)


def test_a_clip_is_read_for_any_rig(tmp_path):
    (tmp_path / "nod.csv").write_text("turn\n0.5\n-0.5\n", encoding="utf-8")
    np.testing.assert_array_equal(read_clip(foreign(), tmp_path / "nod.csv"), np.float32([[0, 0.5], [0, -0.5]]))
