"""What all exporters share: poses are drawn, and a folder is written, file by file, and goes on where it stopped."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from shape_faces import ARKIT

from data_recipes.controls import Control
from data_recipes.exporters import blender_samples, maya_samples
from data_recipes.sampled.face_file import LONGEST_NAME
from data_recipes.shapes.control_names import mirrored_pairs
from data_recipes.shapes.shape_acting import sparse_pose

MARK = "# ---- "
EXPORTERS = (blender_samples, maya_samples)
CLIPS = {
    "nod": (np.arange(1, 281), np.stack([np.linspace(0, 1, 280), np.ones(280), np.zeros(280)], 1)),
    "rest": (np.arange(5), np.tile([0.0, 1.0, 0.0], (5, 1))),
}


def shared_text(module):
    lines = Path(module.__file__).read_text(encoding="utf-8").splitlines()
    first, last = (i for i, line in enumerate(lines) if line.startswith(MARK))
    return lines[first:last]


def test_the_exporters_share_their_text_to_the_letter():
    texts = [shared_text(module) for module in EXPORTERS]
    assert len(texts[0]) > 200 and all(text == texts[0] for text in texts)


@pytest.mark.parametrize("module", EXPORTERS)
def test_an_exporter_imports_nothing_but_the_standard_library_and_numpy_before_it_runs(module):
    text = Path(module.__file__).read_text(encoding="utf-8")
    assert "replicate" not in text and "data_recipes" not in text
    outside = [line for line in text.splitlines() if line.startswith(("import ", "from ")) and "numpy" not in line]
    assert not any("bpy" in line or "maya" in line or "mathutils" in line for line in outside)


def small_rig(module, clips=CLIPS, broken_at=None):
    """Return a rig whose three controls move a square along x, along y and by whole steps along z."""
    square = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0], [0, 0.2, 0]])
    controls = [
        module.Control("slide", 0.0, 0.0, 1.0),
        module.Control("gain", -4.0, 1.0, 4.0, limited=False),
        module.Control("step, of lips", -2.0, 0.0, 3.0, whole=True),
    ]
    controls = [
        c._replace(name=n) for c, n in zip(controls, module.names_of_controls([c[0] for c in controls]), strict=True)
    ]
    calls = []

    def evaluate(params):
        calls.append(params)
        if broken_at is not None and len(calls) > broken_at:
            raise KeyboardInterrupt
        return square + (np.asarray(params, float) - (0, 1, 0)) * 0.01

    uvs = square[:, :2] * 5
    faces = [("skin", "a", [0, 1, 2, 3], [0, 1, 2, 3])]
    return module.SampledRig(square, faces, uvs, controls, clips, evaluate, "m", "z", 24.0), calls


def options(module, folder, *words):
    import argparse

    parser = argparse.ArgumentParser()
    module.add_options(parser)
    return parser.parse_args(["--out", str(folder), *words])


def arrays(folder):
    return {path.name: dict(np.load(path)) for path in sorted((folder / "poses").iterdir())}


def same(first, second):
    return first.keys() == second.keys() and all(
        np.array_equal(first[name][key], second[name][key]) for name in first for key in first[name]
    )


@pytest.fixture(params=EXPORTERS, ids=lambda module: module.__name__.rpartition(".")[2])
def module(request):
    return request.param


def test_a_folder_has_all_frames_and_then_drawn_poses_that_know_their_frame(module, tmp_path):
    rig, _ = small_rig(module)
    module.export(rig, options(module, tmp_path / "square", "--poses", "300"))
    shards = arrays(tmp_path / "square")
    assert [name for name in shards if name.startswith("frames")] == [
        "frames-0000000-0000250.npz",
        "frames-0000250-0000285.npz",
    ]
    every = {key: np.concatenate([shard[key] for shard in shards.values()]) for key in next(iter(shards.values()))}
    assert set(every) == {"params", "vertices", "clip", "frame", "drawn"} and len(every["params"]) == 585
    assert every["clip"].dtype.kind == "U" and every["frame"].dtype.kind == "i" and every["drawn"].dtype == bool
    expected = rig.neutral + (every["params"][:, None].astype(float) - (0, 1, 0)) * 0.01
    np.testing.assert_allclose(every["vertices"], expected, atol=1e-6)
    frames = {c: n.tolist() for c, (n, _) in CLIPS.items()}
    assert all(f in frames[c] for c, f in zip(every["clip"].tolist(), every["frame"].tolist(), strict=True))


def test_the_files_that_describe_it_say_what_the_rig_says(module, tmp_path):
    rig, _ = small_rig(module)
    points = tmp_path / "points.toml"
    points.write_text("[points]\nlandmarks = [0, 1, 2]\n")
    words = ("--poses", "0", "--name", "square", "--source", 'a "test"', "--points", str(points))
    module.export(rig, options(module, tmp_path / "out", *words))
    about = tomllib.loads((tmp_path / "out" / "face.toml").read_text())
    assert about["name"] == "square" and about["unit"] == "m" and about["source"] == 'a "test"'
    assert about["segments"] == "islands" and about["points"]["landmarks"] == [0, 1, 2]
    lines = (tmp_path / "out" / "controls.csv").read_text().splitlines()
    assert lines == [
        "name,lower,default,upper,region",
        "slide,0,0,1,face",
        "gain,-4,1,4,face",
        "step_ of lips,-2,0,3,mouth",
    ]
    assert "f 1/1 2/2 3/3 4/4" in (tmp_path / "out" / "mesh.obj").read_text().splitlines()


def test_drawn_poses_are_factors_on_distances_from_the_defaults(module):
    rig, _ = small_rig(module)
    frames = np.array([[0.5, 2.0, 0.0]])
    drawn = np.array([module.draw_pose(rig.controls, frames, 7, i)[0] for i in range(4000)])
    assert drawn[:, 0].max() == 1.0 and np.mean(drawn[:, 0] == 1.0) == pytest.approx(1 / 2.75, abs=0.03)  # clamped
    assert drawn[:, 1].min() >= 1.25 - 1e-6 and drawn[:, 1].max() <= 4.0 + 1e-6
    assert drawn[:, 1].mean() == pytest.approx(1 + 1.625, abs=0.05)
    assert not drawn[:, 2].any()


def test_without_animation_poses_are_within_limits_and_whole_where_the_control_is(module):
    rig, _ = small_rig(module, clips={})
    drawn = np.array([module.draw_pose(rig.controls, np.zeros((0, 3)), 7, i)[0] for i in range(4000)])
    np.testing.assert_allclose(drawn.min(0), [0.0, -4.0, -2.0], atol=0.2)
    np.testing.assert_allclose(drawn.max(0), [1.0, 4.0, 3.0], atol=0.2)
    assert set(drawn[:, 2].tolist()) == {-2.0, -1.0, 0.0, 1.0, 2.0, 3.0}


def test_without_animation_few_controls_move_at_a_time(module):
    controls = [module.Control(f"shape_{k:02d}", 0.0, 0.0, 1.0) for k in range(60)]
    drawn = np.array([module.draw_pose(controls, np.zeros((0, 60)), 0, i)[0] for i in range(3000)])
    shares = np.bincount((drawn > 0).sum(axis=1), minlength=6) / len(drawn)
    np.testing.assert_allclose(shares, [0, 0.35, 0.3, 0.2, 0.1, 0.05], atol=0.03)
    assert (drawn.max(axis=0) > 0.8).all()


@pytest.mark.parametrize(
    "names",
    [
        ARKIT,
        ("lipUp_L", "lipUp_R", "lipDown_L", "lipDown_R", "snarl", "smile.L", "frown.L"),
        ("lip.L.location_x", "lip.R.location_x", "jaw.rotation_x", "eyeLookInLeft", "eyeLookOutLeft"),
    ],
)
def test_poses_without_animation_follow_the_rule_for_faces_of_shapes(names, module):
    limits = [(-1.0, 0.0, 2.0) if k % 3 == 0 else (0.0, 0.0, 1.0) for k in range(len(names))]
    controls = [module.Control(name, *of_name) for name, of_name in zip(names, limits, strict=True)]
    for index in range(300):
        theirs = sparse_pose(
            [Control(*c[:4], "face") for c in controls], mirrored_pairs(names), 1.0, np.random.default_rng([3, index])
        )
        drawn, source = module.draw_pose(controls, np.zeros((0, len(names))), 3, index)
        np.testing.assert_array_equal(drawn, theirs.astype(np.float32))
        assert source == -1


def test_a_node_in_front_of_a_name_changes_no_opposites(module):
    names = ["shapes.jawLeft", "shapes.jawRight", "shapes.eyeBlinkLeft", "shapes.eyeBlinkRight"]
    assert module.mirrored_pairs(names) == [[0], [1], [2, 3]]
    assert module.opposite(*names[:2])
    drawn = np.array([module.sparse_pose([module.Control(n, 0, 0, 1) for n in names], r) for r in generators(200)])
    assert not (drawn[:, :2] > 0).all(axis=1).any() and (drawn[:, 2:] > 0).all(axis=1).any()


def generators(count):
    return [np.random.default_rng(seed) for seed in range(count)]


def test_shapes_with_one_name_are_one_control_as_far_as_any_of_them_goes(module):
    controls = [module.Control(n, 0.0, 0.0, u) for n, u in (("jaw", 1.0), ("smile", 1.0), ("jaw", 2.0), ("jaw", 1.0))]
    shapes = [("jaw", "Head"), ("smile", "Head"), ("jaw", "Teeth"), None]
    walk = np.arange(3), np.array([[0.0, 0.0, 0.0, 0.3], [0.5, 0.0, 0.5, 0.2], [1.0, 0.0, 0.2, 0.1]])
    teeth = np.arange(3), np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.5, 0.0], [0.0, 0.0, 0.2, 0.0]])
    joined, columns, clips, remarks = module.join(controls, shapes, {"walk": walk, "teeth": teeth})
    assert [(c.name, c.upper) for c in joined] == [("jaw", 2.0), ("smile", 1.0), ("jaw", 1.0)]  # the last is no shape
    assert columns.tolist() == [0, 1, 0, 2]
    np.testing.assert_array_equal(clips["walk"][1], walk[1][:, [0, 1, 3]])
    np.testing.assert_array_equal(clips["teeth"][1], teeth[1][:, [2, 1, 3]])
    assert len(remarks) == 2
    assert remarks[0].endswith("one control each: jaw (Head, Teeth)") and remarks[1].endswith(": jaw in walk")


def test_without_equal_names_nothing_is_joined_and_nothing_said(module):
    rig, _ = small_rig(module)
    joined, columns, clips, remarks = module.join(rig.controls, [("slide", "Head"), None, ("step", "Head")], CLIPS)
    assert joined == rig.controls and columns.tolist() == [0, 1, 2] and remarks == ()
    assert all(np.array_equal(clips[name][1], CLIPS[name][1]) for name in CLIPS)


def rig_of(module, names, offsets, clips=None):
    """Return the small rig with controls from 0 to 1, moved by offsets: a function of their values."""
    rig, calls = small_rig(module, clips or {})
    controls = [module.Control(name, 0.0, 0.0, 1.0) for name in names]

    def evaluate(params):
        calls.append(params)
        moved = rig.neutral.copy()
        moved[1] += offsets(*np.asarray(params, float))
        return moved

    return rig._replace(controls=controls, evaluate=evaluate), calls


def test_a_control_that_moves_no_vertex_is_left_out_by_name_and_stays_at_its_default(module, tmp_path, capsys):
    rig, _ = rig_of(module, ("jaw", "mood", "brow"), lambda jaw, mood, brow: 0.01 * np.array([jaw, 1e-6 * mood, brow]))
    less = module.without_idle(rig)
    assert [control.name for control in less.controls] == ["jaw", "brow"]
    np.testing.assert_allclose(less.evaluate(np.array([0.5, 0.2])), rig.evaluate(np.array([0.5, 0.0, 0.2])), atol=1e-9)
    module.export(less, options(module, tmp_path / "square", "--poses", "20"))
    lines = capsys.readouterr().err.splitlines()
    assert lines[-2].endswith("they move no vertex of the meshes between their limits: mood")
    assert "mood" not in (tmp_path / "square" / "controls.csv").read_text()


@pytest.mark.parametrize(
    "offsets",
    [
        lambda a, b: [0.01 * (a - b), 0, 0],  # opposites that cancel
        lambda a, b: [0.01 * a, 0.01 * a * b, 0],  # one that acts with the other alone
        lambda a, b: [0.01 * a, 0.01 * np.sin(np.pi * b), 0],  # one that is back at rest at its limit
        lambda a, b: [0.01 * a, 0.01 * (b > 0.999), 0],  # one that acts at its limit alone
    ],
)
def test_a_control_with_some_effect_stays(offsets, module):
    rig, _ = rig_of(module, ("a", "b"), offsets)
    assert module.without_effect(rig) == [] and module.without_idle(rig) is rig


def test_a_hundred_idle_controls_are_found_by_few_poses(module):
    names = [f"bone_{k}" for k in range(200)]
    rig, calls = rig_of(module, names, lambda *values: [0.01 * values[7], 0.01 * values[140], 0])
    assert module.without_effect(rig) == [k for k in range(200) if k not in (7, 140)]
    assert len(calls) < 80


def test_clips_that_move_only_what_is_left_out_are_left_out_too(module):
    still, moving = np.zeros((30, 2)), np.linspace(0, 1, 30)[:, None]
    frames = np.arange(30)
    clips = {"walk": (frames, moving * (0, 1)), "talk": (frames, moving * (1, 1)), "rest": (frames, still)}
    rig, _ = rig_of(module, ("jaw", "hip"), lambda jaw, hip: [0.01 * jaw, 0, 0], clips)
    less = module.without_idle(rig)
    assert list(less.clips) == ["talk", "rest"] and less.clips["talk"][1].shape == (30, 1)
    assert less.remarks[0].endswith("limits: hip; clips left out, since they move only these: walk")


def test_a_rig_in_which_nothing_has_an_effect_is_refused(module):
    rig, _ = rig_of(module, ("jaw", "hip"), lambda jaw, hip: [0, 0, 0])
    with pytest.raises(module.Refusal, match="no control is left: no vertex of the meshes moves by jaw, hip"):
        module.without_idle(rig)


def test_a_folder_that_was_drawn_in_another_way_does_not_go_on(module, tmp_path):
    folder = tmp_path / "square"
    module.export(small_rig(module, clips={})[0], options(module, folder, "--poses", "20"))
    record = json.loads((folder / ".export.json").read_text())
    del record["draws"]  # as of a folder of uniform poses
    (folder / ".export.json").write_text(json.dumps(record))
    with pytest.raises(module.Refusal, match="holds an export with other draws"):
        module.export(small_rig(module, clips={})[0], options(module, folder, "--poses", "40"))


def test_what_was_stopped_goes_on_and_ends_as_if_it_had_not(module, tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    module.export(small_rig(module)[0], options(module, whole, "--poses", "600"))
    for broken_at in (100, 400):
        with pytest.raises(KeyboardInterrupt):
            module.export(small_rig(module, broken_at=broken_at)[0], options(module, parts, "--poses", "600"))
    rig, calls = small_rig(module)
    module.export(rig, options(module, parts, "--poses", "600"))
    assert len(calls) < 886 and same(arrays(whole), arrays(parts))


def test_two_shares_make_what_one_process_makes(module, tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    module.export(small_rig(module)[0], options(module, whole, "--poses", "600"))
    for share in ("2/2", "1/2"):
        module.export(small_rig(module)[0], options(module, parts, "--poses", "600", "--share", share))
    assert same(arrays(whole), arrays(parts))


def test_processes_that_begin_at_the_same_time_take_each_other_s_files_for_their_own(module, tmp_path, monkeypatch):
    folder, written, write_whole = tmp_path / "square", [], module.write_whole

    def write(path, *words):
        write_whole(path, *words)
        written.append(path.name)
        if len(written) < 4:  # another process begins after each file
            module.begin(small_rig(module)[0], folder, options(module, folder), "square")

    monkeypatch.setattr(module, "write_whole", write)
    module.begin(small_rig(module)[0], folder, options(module, folder), "square")
    assert written[0] == ".export.json" and {"mesh.obj", "controls.csv", "face.toml"} <= set(written)


def test_a_description_that_was_not_finished_is_finished(module, tmp_path):
    folder = tmp_path / "square"
    module.export(small_rig(module)[0], options(module, folder, "--poses", "0"))
    whole = (folder / "face.toml").read_text()
    (folder / "face.toml").unlink()
    module.export(small_rig(module)[0], options(module, folder, "--poses", "0"))
    assert (folder / "face.toml").read_text() == whole


def test_more_poses_are_added_and_none_that_is_there_changes(module, tmp_path):
    folder = tmp_path / "square"
    module.export(small_rig(module)[0], options(module, folder, "--poses", "60"))
    before = arrays(folder)
    module.export(small_rig(module)[0], options(module, folder, "--poses", "300"))
    after = arrays(folder)
    assert same(before, {name: after[name] for name in before})
    names = [name for name in after if name.startswith("drawn")]
    assert names == ["drawn-0000000-0000060.npz", "drawn-0000060-0000250.npz", "drawn-0000250-0000300.npz"]
    rig, calls = small_rig(module)
    module.export(rig, options(module, folder, "--poses", "300"))
    assert len(calls) == 1  # the pose that shows that the rig is still the same


def test_a_half_written_file_is_no_shard(module, tmp_path):
    folder = tmp_path / "square"
    with pytest.raises(KeyboardInterrupt):
        module.export(small_rig(module, broken_at=270)[0], options(module, folder, "--poses", "0"))
    (folder / "poses" / "frames-0000250-0000285.npz.1.part").write_bytes(b"half")
    module.export(small_rig(module)[0], options(module, folder, "--poses", "0"))
    assert np.load(folder / "poses" / "frames-0000250-0000285.npz")["params"].shape == (35, 3)


def test_a_control_belongs_to_the_region_that_a_word_of_its_name_says(module):
    named = {"slide": "face", "lid.T.L.002.location_x": "eyes", "browOuterUp_L": "brows", "upperLipRaise": "mouth"}
    named |= {"master_eye.L.scale_x": "eyes", "eyebrow": "brows", "ear.L.rotation_z": "ears", "heart": "face"}
    assert {name: module.region(name) for name in named} == named


def test_names_fit_a_table_and_occur_once(module):
    names = module.names_of_controls(["a,b", "a_b", "x" * 280, "x" * 290, " ", "\n", "Wange\u00e4" * 40])
    assert len(set(names)) == len(names) and all(0 < len(name.encode()) <= LONGEST_NAME for name in names)
    assert not any("," in name or not name.isprintable() for name in names)


def test_long_names_keep_their_ends_and_a_name_that_changes_is_said(module):
    bone = "b" * 63
    kept = [module.Control(f"{bone}.location_{axis}", 0.0, 0.0, 1.0) for axis in "xyz"]
    assert module.renamed(kept) == (kept, ())
    changed = [module.Control(name, 0.0, 0.0, 1.0) for name in ("x" * 201, "x" * 202, "smile", "smile")]
    controls, (remark,) = module.renamed(changed)
    assert [c.name for c in controls] == ["x" * 200, "x" * 198 + "~2", "smile", "smile~2"]
    assert "at most 200 bytes" in remark and remark.endswith("'smile' to 'smile~2'")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--share", "0/2"), "--share: expected a part such as 1/2 or 2/2, got 0/2"),
        (("--name", "a b"), "--name: expected 1 to 40 letters, digits, _ and -, got 'a b'"),
        (("--poses", "-1"), "--poses and --seed"),
        (("--points", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_written(module, words, sentence, tmp_path):
    with pytest.raises(module.Refusal, match=sentence):
        module.export(small_rig(module)[0], options(module, tmp_path / "square", *words))
    assert not (tmp_path / "square").exists()


def test_a_rig_of_the_wrong_size_or_without_poses_is_refused(module, tmp_path):
    rig, _ = small_rig(module)
    with pytest.raises(module.Refusal, match="20,000 mm"):
        module.export(rig._replace(neutral=rig.neutral * 100), options(module, tmp_path / "large"))
    with pytest.raises(module.Refusal, match="at least 20"):
        module.export(small_rig(module, clips={})[0], options(module, tmp_path / "few", "--poses", "5"))


def test_a_folder_of_something_else_is_left_alone(module, tmp_path):
    folder = tmp_path / "square"
    folder.mkdir()
    (folder / "letter.txt").write_text("dear")
    with pytest.raises(module.Refusal, match="no exporter wrote"):
        module.export(small_rig(module)[0], options(module, folder, "--poses", "0"))
    assert [path.name for path in folder.iterdir()] == ["letter.txt"]


def test_a_folder_of_another_seed_animation_or_rig_does_not_go_on(module, tmp_path):
    folder = tmp_path / "square"
    module.export(small_rig(module)[0], options(module, folder, "--poses", "0"))
    with pytest.raises(module.Refusal, match="other seed"):
        module.export(small_rig(module)[0], options(module, folder, "--seed", "1"))
    with pytest.raises(module.Refusal, match="other clips, frames"):
        module.export(small_rig(module, clips={"nod": CLIPS["nod"]})[0], options(module, folder))
    rig, _ = small_rig(module)
    heavier = rig._replace(evaluate=lambda params: rig.neutral + np.asarray(params, float) * 0.02)
    with pytest.raises(module.Refusal, match="the rig has changed"):
        module.export(heavier, options(module, folder))


def test_vertices_that_are_no_numbers_are_refused(module, tmp_path):
    rig, _ = small_rig(module)
    bad = rig._replace(evaluate=lambda params: rig.neutral * (np.nan if params[0] > 0.5 else 1.0))
    with pytest.raises(module.Refusal, match="pose 140 of the frames"):
        module.export(bad, options(module, tmp_path / "square"))
