"""The face's sculpting on the tiny head: fields where they belong, symmetric, along the skull."""

import numpy as np
import pytest

from data_recipes.controls import control_index, make_controls
from data_recipes.deformers import face_build, mouth_fields, upper_face_fields
from data_recipes.deformers.correctives import CORRECTIVES
from data_recipes.deformers.face import JAW_CONTROLS, jaw_motion
from data_recipes.deformers.face_points import control_points, face_marks, handle_vertices
from data_recipes.deformers.mouth_fields import ACTIONS
from data_recipes.deformers.sculpting import Sculptor
from data_recipes.deformers.upper_face_fields import build_patch, ring_shares
from data_recipes.deformers.wrinkle_regions import build_regions
from data_recipes.head.neutral_head import build_head
from data_recipes.head.shape import FLIP
from data_recipes.recipe.reading import load_recipe
from replicate.base.exceptions import InputError


@pytest.fixture(scope="module")
def sculptor():
    return Sculptor(build_head(load_recipe("tiny")))


def test_a_bump_is_one_at_its_landmark_and_ends_at_its_radius(sculptor):
    bump = sculptor.bump("chin", 45.0)
    chin = sculptor.head.landmarks["chin"]
    assert bump.argmax() == chin
    far = np.linalg.norm(sculptor.x - sculptor.x[chin], axis=1) > 75
    assert np.abs(bump[far]).max() < 1e-3
    assert not bump[sculptor.in_parts("gum_lower", "tongue")].any()


def test_sliding_keeps_the_distance_from_the_skull(sculptor):
    offset = 8.0 * sculptor.bump("forehead", 60.0)[:, None] * sculptor.up
    before = sculptor.head.sdf(sculptor.x)
    drift = sculptor.head.sdf(sculptor.x + sculptor.on_skull(offset)) - before
    free_drift = sculptor.head.sdf(sculptor.x + offset) - before
    assert np.abs(drift).max() < 0.1 < np.abs(free_drift).max()


def test_wrapped_coordinates_come_back(sculptor):
    np.testing.assert_allclose(sculptor.unwrap(sculptor.wrapped), sculptor.x, atol=1e-9)


def test_a_smile_moves_its_own_corner_up_and_out_and_leaves_the_other(sculptor):
    path = mouth_fields.sculpt(sculptor, mouth_fields.ACTIONS["smile_*"])
    left, right = (path.full[sculptor.head.landmarks[f"mouth_corner_{side}"]] for side in ("left", "right"))
    assert left[0] > 4 and left[1] > 7
    assert np.abs(right).max() < 1e-6
    mirrored = path.mirrored(sculptor.head.mirror)
    corner = sculptor.head.landmarks["mouth_corner_right"]
    np.testing.assert_allclose(mirrored.full[corner], left * FLIP, atol=1e-9)
    assert np.abs(path.half - 0.5 * path.full).max() > 0.5  # an arc, not a chord


@pytest.mark.parametrize("name, way", [("upper_lip_raise_*", 1), ("lower_lip_depress_*", -1)])
def test_both_sides_of_a_lip_move_its_middle_too_and_leave_no_notch(name, way):
    action, u = ACTIONS[name], np.linspace(-1, 1, 201)
    travel = way * action.seam(u, np.full(201, float(way)))[1]
    assert travel[100] > 0.8 * travel.max() > 4  # the windows of both sides add up to 1
    assert np.abs(action.seam(u, np.full(201, -float(way)))[1]).max() < 1e-9


@pytest.mark.parametrize("name, which", [("lip_roll_upper", 1), ("lip_roll_lower", -1)])
def test_a_lip_that_rolls_in_takes_the_other_along(name, which):
    middle = np.zeros(1)
    mine, other = (ACTIONS[name].seam(middle, np.full(1, float(side))) for side in (which, -which))
    assert mine[2] < other[2] < 0  # both go back
    assert which * (mine[1] - other[1]) < 0  # and the other one closes up


@pytest.mark.parametrize(("with_", "lifts"), [("smile_*", True), ("pucker_*", False)])
def test_an_open_jaw_makes_a_laugh_rounder_and_an_oh_narrower_than_the_sum(with_, lifts):
    motion, u = dict(CORRECTIVES)[with_, "jaw_open"], np.array([-1.0, 0.0, 1.0])
    across, up, _ = motion(u, np.ones(3))
    assert across[0] > 1 and across[1] == 0 and across[2] < -1  # both corners go inwards
    assert (up[1] > 4) == lifts  # and a laugh bares the upper teeth
    assert motion(u, -np.ones(3))[1][1] == 0  # the lower lip's middle stays


def test_a_lip_rolled_out_leaves_the_lining_deep_in_the_mouth_where_it_is(sculptor):
    path = mouth_fields.sculpt(sculptor, mouth_fields.ACTIONS["lip_roll_lower"])
    seam, bag = sculptor.head.grids["mouth"][0], sculptor.head.grids["mouth_bag"]
    assert np.linalg.norm(path.full[seam], axis=1).max() > 3
    assert np.linalg.norm(path.full[bag[-1]], axis=1).max() < 1.5


def test_both_sides_of_a_lip_action_add_up_to_a_symmetric_mouth(sculptor):
    path = mouth_fields.sculpt(sculptor, mouth_fields.ACTIONS["pucker_*"])
    both = path + path.mirrored(sculptor.head.mirror)
    np.testing.assert_allclose(both.full[sculptor.head.mirror] * FLIP, both.full, atol=1e-6)


def test_the_brow_field_is_one_at_the_brows_and_nothing_below_the_eyes(sculptor):
    field = upper_face_fields.brow_row_field(sculptor)
    assert field[sculptor.head.landmarks["brow_mid_left"]] > 0.45
    assert np.abs(field[sculptor.x[:, 1] < sculptor.point("nose_tip")[1]]).max() < 0.02


def test_wrinkle_regions_fade_out_and_their_gains_add_up_to_one(sculptor):
    for region in build_regions(sculptor, {}, 0):
        assert len(region.vertices) == len(np.unique(region.vertices))
        np.testing.assert_allclose(region.gain_weights.sum(axis=0), 1, atol=1e-5)
        assert np.isfinite(region.pattern).all()


def test_lid_shares_fall_from_the_rim_outwards():
    shares = ring_shares(12)
    assert shares[0] == 1 and shares[-1] == 0
    assert (np.diff(shares) <= 0).all()


def test_a_lid_patch_takes_only_the_controls_that_the_rig_has(sculptor):
    controls = make_controls({"face": 10, "lids": 4})
    patch = build_patch(sculptor, "left", control_index(controls), len(controls))
    assert patch.moves_upper.shape[0] == len(controls)
    used = [controls[i].name for i in np.flatnonzero(np.abs(patch.moves_upper).max(axis=1))]
    assert used == ["brow_outer_up_left", "brow_down_left", "lid_upper_middle_left"]


def test_the_jaw_carries_chin_and_lower_gum_and_leaves_the_brows(sculptor):
    weight = face_build._jaw_weight(sculptor)
    marks = sculptor.head.landmarks
    assert weight[marks["chin"]] > 0.7
    assert weight[marks["lip_lower_mid"]] > 0.95 and weight[marks["lip_upper_mid"]] < 0.05
    assert weight[marks["mouth_corner_left"]] == pytest.approx(0.5)
    assert weight[marks["brow_mid_left"]] < 1e-3
    assert (weight[sculptor.in_parts("gum_lower")] == 1).all()


def test_each_control_of_the_jaw_turns_and_shifts_it_as_far_as_a_real_jaw_goes():
    motion = jaw_motion({"jaw_controls": np.eye(len(JAW_CONTROLS), dtype=np.float32)}, np.eye(len(JAW_CONTROLS)))
    turns = dict(zip(JAW_CONTROLS, np.rad2deg(motion.rotation), strict=True))
    shifts = dict(zip(JAW_CONTROLS, np.asarray(motion.translation), strict=True))
    still = (0, 0, 0)
    expected_deg = {"jaw_open": (27, 0, 0), "jaw_sideways": (0, 4.5, 0), "jaw_twist": (0, 0, -4.5)}
    expected_mm = {
        "jaw_open": (0, -1, 1.5),
        "jaw_sideways": (5, 0, 0),
        "jaw_forward": (0, -0.8, 6),
        "jaw_drop": (0, -7, -1),
    }
    for name in JAW_CONTROLS:
        np.testing.assert_allclose(turns[name], expected_deg.get(name, still), atol=1e-4, err_msg=name)
        np.testing.assert_allclose(shifts[name], expected_mm.get(name, still), atol=1e-6, err_msg=name)


def test_a_recipe_lists_control_points_by_the_region_that_they_drive(sculptor):
    names, points, regions = control_points(sculptor, {"jaw": ("chin",), "mouth": ("lip_upper_03", "lip_lower_03")})
    assert (names, regions) == (("chin", "lip_upper_03", "lip_lower_03"), ("jaw", "mouth", "mouth"))
    assert points[0] == sculptor.head.landmarks["chin"]
    heights = sculptor.head.vertices[points, 1]
    assert heights[1] > heights[2] > heights[0]


@pytest.mark.parametrize(
    "names, part",
    [
        ({"jaw": ("chim",)}, "control_points.jaw: there is no point 'chim'; there are .*chin, "),
        ({"jaw": ("chin",), "mouth": ("chin",)}, "control_points.mouth: 'chin' and 'chin' are the same vertex"),
    ],
)
def test_a_control_point_that_cannot_be_is_named(sculptor, names, part):
    with pytest.raises(InputError, match=part):
        control_points(sculptor, names)


def test_the_marks_of_a_face_are_distinct_and_each_has_a_region(sculptor):
    points, regions = face_marks(sculptor)
    assert len(points) == len(regions) == len(np.unique(points))
    assert {"brows", "eye_left", "eye_right", "nose", "cheeks", "mouth", "jaw"} == set(regions)


def test_two_handles_at_one_vertex_are_refused(sculptor):
    with pytest.raises(InputError, match="at the same vertex"):
        handle_vertices(sculptor, ["chin", "nose_tip", "chin"])
