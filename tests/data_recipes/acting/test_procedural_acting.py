"""The acting: within limits, reproducible, using every control, moving and holding still as animation does."""

from collections import Counter
from dataclasses import asdict

import numpy as np
import pytest

from data_recipes.acting.motion import FRAMES_PER_SECOND
from data_recipes.acting.procedural_acting import KINDS, Acting, act
from data_recipes.controls import control_groups, make_controls
from data_recipes.early_checks import EXERCISE, MOVED
from data_recipes.recipe.sections import Controls

TEEN = make_controls(asdict(Controls()))


@pytest.fixture(scope="module")
def clips():
    return act(TEEN, Acting())


@pytest.fixture(scope="module")
def frames(clips):
    return np.concatenate([values for _, values in clips])


def columns_of(start):
    return [column for column, control in enumerate(TEEN) if control.name.startswith(start)]


def test_there_are_minutes_of_it_in_clips_of_varied_length(clips):
    lengths = [len(values) for _, values in clips]
    assert len(clips) >= 30 and sum(lengths) >= 5 * 60 * FRAMES_PER_SECOND
    assert max(lengths) > 1.8 * min(lengths)
    assert len({name for name, _ in clips}) == len(clips)


def test_every_kind_of_shot_occurs(clips):
    counts = Counter(name.split("_")[1] for name, _ in clips)
    assert counts == {kind: 4 * how["share"] for kind, how in KINDS.items()}


def test_it_stays_within_the_controls_limits(frames):
    lower, upper = np.array([c.lower for c in TEEN]), np.array([c.upper for c in TEEN])
    assert frames.dtype == np.float32 and np.isfinite(frames).all()
    assert (frames >= lower).all() and (frames <= upper).all()
    assert (np.abs(frames) >= 1).mean() < 0.01  # limits are met now and then, not leant on


def test_every_control_moves_both_ways_in_several_clips(clips):
    used = np.stack([np.abs(values).max(axis=0) > 0.15 for _, values in clips]).sum(axis=0)
    highest = np.max([values.max(axis=0) for _, values in clips], axis=0)
    lowest = np.min([values.min(axis=0) for _, values in clips], axis=0)
    for column, control in enumerate(TEEN):
        assert used[column] >= 4, control.name
        assert highest[column] > 0.2, control.name
        assert control.lower == 0 or lowest[column] < -0.2, control.name


def test_the_same_numbers_give_the_same_clips_and_others_do_not(clips):
    again = act(TEEN, Acting())
    assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(clips, again, strict=True))
    other = act(TEEN, Acting(seed=2))
    assert not any(a.shape == b.shape and np.array_equal(a, b) for (_, a), (_, b) in zip(clips, other, strict=True))


def test_holds_make_poses_recur(frames):
    still = (frames[1:] == frames[:-1]).all(axis=1).mean()
    assert 0.1 < still < 0.4
    assert (act_frames(holds=0.0)[1:] == act_frames(holds=0.0)[:-1]).all(axis=1).mean() < still / 2


def act_frames(**changes):
    return np.concatenate([values for _, values in act(TEEN, Acting(clips=12, **changes))])


def test_nothing_jumps(clips):
    for name, values in clips:
        steps = np.abs(np.diff(values, axis=0))
        assert steps.max() < 0.95, name  # a lid may close in two frames
        assert np.quantile(steps.max(axis=1), 0.5) < 0.15, name


def test_clips_begin_and_end_at_rest(clips):
    for name, values in clips:
        assert np.abs(values[[0, -1]]).max() < 0.02, name


def test_smiles_bring_cheeks_and_eyes_along(frames):
    smile = frames[:, columns_of("smile_left")[0]]
    cheek, squint = frames[:, columns_of("cheek_raise_left")[0]], frames[:, columns_of("squint_left")[0]]
    wide = smile > 0.5
    assert cheek[wide].mean() > 2 * cheek[smile < 0.05].mean()
    assert squint[wide].mean() > squint[smile < 0.05].mean()


def test_lids_do_not_open_wide_while_they_blink(frames):
    blink, wide = frames[:, columns_of("blink_left")[0]], frames[:, columns_of("eye_wide_left")[0]]
    assert (blink > 0.97).sum() > 50
    assert np.quantile(wide[blink > 0.97], 0.9) < 0.5


def test_faces_are_uneven_as_far_as_the_character_is():
    left, right = columns_of("smile_left")[0], columns_of("smile_right")[0]

    def unevenness(**changes):
        poses = act_frames(**changes)
        return np.abs(poses[:, left] - poses[:, right]).mean()

    assert unevenness(asymmetry=0.6) > 1.2 * unevenness(asymmetry=0.0)


def test_tempo_and_intensity_are_heard():
    calm, vivid = act_frames(intensity=0.4), act_frames(intensity=1.0)
    smile = columns_of("smile_left")[0]
    assert vivid[:, smile].mean() > 1.5 * calm[:, smile].mean()
    slow, quick = act_frames(tempo=0.6), act_frames(tempo=1.6)
    assert np.abs(np.diff(quick, axis=0)).mean() > 1.3 * np.abs(np.diff(slow, axis=0)).mean()


def test_a_small_rig_performs_with_what_it_has():
    small = make_controls({"face": 24, "jaw": 2, "lids": 2, "handles": 6, "wrinkles": 2, "head": 2})
    clips = act(small, Acting(clips=20))
    poses = np.concatenate([values for _, values in clips])
    assert poses.shape[1] == len(small)
    assert (np.abs(poses).max(axis=0) > 0.2).all()


def test_values_are_offsets_from_each_default():
    groups = control_groups()["head"]
    moved = [type(c)(c.name, -1.0, 0.25, 1.0, c.region) for c in groups]
    plain, shifted = act(groups, Acting(clips=2)), act(moved, Acting(clips=2))
    inside = np.abs(plain[0][1]) < 0.7
    assert np.allclose((shifted[0][1] - plain[0][1])[inside], 0.25, atol=1e-6)


def test_controls_of_too_few_kinds_for_an_exercise_act_without_one():
    few = make_controls(dict.fromkeys(asdict(Controls()), 0) | {"face": 8})
    kinds = {control.name.replace("left", "*").replace("right", "*") for control in few}
    assert len(kinds) < min(MOVED, len(few))
    assert len(act(few, Acting(clips=EXERCISE - 1, clip_s=3.0))) == EXERCISE - 1
    with pytest.raises(ValueError, match="larger sample"):
        act(few, Acting(clips=EXERCISE, clip_s=3.0))


def test_a_character_of_few_words_has_more_takes_instead():
    kinds = Counter(name.split("_")[1] for name, _ in act(TEEN, Acting(clips=20, dialogues=1)))
    assert kinds == {"emotion": 8, "dialogue": 2, "take": 8, "exercise": 2}
