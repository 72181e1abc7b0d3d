"""What makes no face is refused by what was built, in a sentence that names the section of the recipe."""

from dataclasses import replace

import numpy as np
import pytest
import rigs

from data_recipes.face_check import check_face
from data_recipes.recipe.reading import load_recipe
from replicate.base.exceptions import InputError

RECIPE = load_recipe("tiny")


@pytest.fixture(scope="module")
def tiny():
    return rigs.rig("tiny")


def with_neutral(rig, change):
    x = rig.mesh.neutral.copy()
    change(x)
    return replace(rig, mesh=replace(rig.mesh, neutral=x))


def teeth(rig):
    names = np.array(rig.mesh.segment_names)[rig.mesh.segment]
    return np.char.startswith(names, "tooth")


def mark(rig, name):
    return rig.landmarks[rig.landmark_names.index(name)]


@pytest.mark.parametrize(
    ("section", "key", "value", "sentence"),
    [
        ("nose", "root", (0.0, 300.0, 77.0), r"nose\.root: the head is not a face: this point lies 19\d mm outside"),
        ("nose", "tip", (0.0, -31.0, 300.0), r"nose\.tip: the head is not a face"),
        ("skull", "jaw_angle", (300.0, -52.0, 8.0), r"jaw_angle: the head is not a face: this point lies 2\d\d mm"),
        ("eyes", "centre", (200.0, 0.0, 62.0), r"eyes\.centre: the head is not a face"),
    ],
)
def test_what_lies_far_from_the_head_is_named(tiny, section, key, value, sentence):
    recipe = replace(RECIPE, **{section: replace(getattr(RECIPE, section), **{key: value})})
    with pytest.raises(InputError, match=sentence):
        check_face(tiny, recipe)


def test_our_own_character_is_a_face_and_one_of_another_size_is_none(tiny):
    assert check_face(tiny, RECIPE) is tiny
    for factor in (0.3, 3.0):

        def scale(x, factor=factor):
            x *= factor

        with pytest.raises(InputError, match=r"skull: the head is not a face: it is .* mm wide; expected 100 to 450"):
            check_face(with_neutral(tiny, scale), RECIPE)


@pytest.mark.parametrize(
    ("shift", "sentence"),
    [((0, 0, 60), "a tooth stands .* mm out of the skin"), ((0, 0, -60), "nearest tooth is .* mm from the upper lip")],
)
def test_teeth_lie_in_the_mouth(tiny, shift, sentence):
    def move(x):
        x[teeth(tiny)] += shift

    with pytest.raises(InputError, match=rf"teeth: the head is not a face: .*{sentence}"):
        check_face(with_neutral(tiny, move), RECIPE)


def test_lids_that_stay_open_or_are_never_open_are_no_lids(tiny, monkeypatch):
    monkeypatch.setattr(type(tiny), "__call__", lambda rig, params: rig.mesh.neutral)
    with pytest.raises(InputError, match=r"eyes: .*: the left lids are still .* mm apart when the eye blinks"):
        check_face(tiny, RECIPE)

    def close(x):
        x[mark(tiny, "lid_upper_left"), 1] = x[mark(tiny, "lid_lower_left"), 1]

    with pytest.raises(InputError, match=r"eyes: the head is not a face: the left lids are 0\.0 mm apart at rest"):
        check_face(with_neutral(tiny, close), RECIPE)


def test_landmarks_are_different_vertices_one_above_the_other(tiny):
    twice = tiny.landmarks.copy()
    twice[1] = twice[0]
    with pytest.raises(InputError, match=r"template: .*: the landmarks .* and .* are the same vertex; expected two"):
        check_face(replace(tiny, landmarks=twice), RECIPE)

    def lift(x):
        x[mark(tiny, "chin"), 1] += 100

    with pytest.raises(InputError, match=r"the landmark lip_upper_mid lies .* mm below chin"):
        check_face(with_neutral(tiny, lift), RECIPE)
