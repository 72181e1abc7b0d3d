"""Rigs built from recipes: clips, segments, and recipes that give no face."""

import numpy as np
import pytest

from data_recipes.acting.procedural_acting import act
from data_recipes.catalogue import build_rig, character_parts, load_rig, save_rig
from data_recipes.head.neutral_head import build_head
from data_recipes.recipe.reading import load_recipe
from data_recipes.recipe_paths import RECIPES
from replicate.base.exceptions import InputError
from replicate.geometry.alignment import align


def test_a_recipes_clips_are_its_acting(tiny):
    recipe = load_recipe("tiny")
    clips = act(tiny.controls, recipe.acting)
    assert [clip.name for clip in tiny.clips] == [name for name, _ in clips]
    np.testing.assert_array_equal(tiny.clips[3].values, clips[3][1])


def test_a_recipe_can_bring_its_own_clips_in_place_of_acting(tmp_path):
    text = (RECIPES / "tiny.toml").read_text(encoding="utf-8")
    assert "[acting]" not in text
    text += "\n[acting]\nclips = 0\n"
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / "nod.csv").write_text("squash,jaw_open\n0,0\n0.5,0.25\n", encoding="utf-8")
    recipe = tmp_path / "mine.toml"
    recipe.write_text('clip_files = ["shots/nod.csv"]\n' + text, encoding="utf-8")
    assert character_parts(recipe)[1] == (tmp_path / "shots" / "nod.csv",)
    rig = build_rig(recipe)
    columns = [control.name for control in rig.controls]
    (clip,) = rig.clips
    assert clip.name == "nod" and clip.values.shape == (2, len(columns))
    assert [clip.values[1, columns.index(name)] for name in ("squash", "jaw_open")] == [0.5, 0.25]
    assert np.count_nonzero(clip.values) == 2


def test_a_recipe_without_clips_with_strips_for_teeth_and_shared_charts_is_a_rig(tmp_path):
    text = (RECIPES / "tiny.toml").read_text(encoding="utf-8").replace("[teeth]", '[teeth]\nstyle = "strip"')
    text = text.replace("vertices = 918", "vertices = 930")
    text += '\n[acting]\nclips = 0\n[layouts.one_face.segments]\nears = ["ear_left", "ear_right"]\n'
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    rig = build_rig(tmp_path / "mine.toml")
    assert rig.clips is None
    names = rig.mesh.segment_names
    assert names[3:5] == ("ears", "lid_inner_left") and names[-2:] == ("teeth_upper", "teeth_lower")
    save_rig(rig, tmp_path / "mine")
    assert load_rig(tmp_path / "mine").clips is None
    posed = rig(rig.upper)
    for index in (-2, -1):
        strip = np.flatnonzero(rig.mesh.segment == len(names) + index)
        rotation, translation = align(rig.mesh.neutral[strip], posed[strip])
        left = rig.mesh.neutral[strip] @ rotation + translation - posed[strip]
        assert np.abs(left).max() < 1e-3
        edges = np.concatenate([rig.mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
        inside = edges[np.isin(edges, strip).all(1)]
        assert len(np.unique(inside, axis=0)) == len(inside)  # no two faces run along an edge the same way


def test_a_recipe_that_gives_no_mesh_is_named_once(tmp_path, monkeypatch):
    text = (RECIPES / "tiny.toml").read_text(encoding="utf-8")
    recipe = tmp_path / "mine.toml"
    recipe.write_text(text, encoding="utf-8")

    def flatten(recipe):
        head = build_head(recipe)
        head.faces[5] = head.faces[5, 0]
        return head

    with monkeypatch.context() as patch:
        patch.setattr("data_recipes.recipe_rig.build_head", flatten)
        with pytest.raises(InputError, match=r"^mine\.toml: mesh: faces\[5\]: expected a face with an area, got .*"):
            build_rig(recipe)
    recipe.write_text(text.replace("vertices = 918", "vertices = 917"), encoding="utf-8")
    with pytest.raises(InputError, match=r"^mine\.toml: vertices: expected 918, .*, got 917"):
        build_rig(recipe)


def test_a_recipe_with_a_control_count_out_of_range_is_refused(tmp_path):
    recipe = tmp_path / "odd.toml"
    recipe.write_text('name = "odd"\nvertices = 10\n[controls]\nface = 99\n')
    with pytest.raises(InputError, match=r"controls\.face.*99"):
        build_rig(recipe)
