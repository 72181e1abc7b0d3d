"""A look before training: what makes results worse or meaningless is found where it is, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from plain_rig import PlainRig
from small_face import exact_samples

from data_recipes.controls import Control
from replicate.geometry.mesh import Mesh
from replicate.rig_study.first_look import (
    CONTROL,
    FACE,
    MEANINGLESS,
    OK,
    SEGMENT,
    WORSE,
    Face,
    beyond_training,
    listed,
    look,
    unit_in_words,
    vertices_a_texel,
    warnings,
)

M = 12
PARTS = {"skin": (12, (0, 0, 0), 160), "eye_left": (5, (30, 40, 10), 20), "eye_right": (5, (-30, 40, 10), 20)}


class Sampled(PlainRig):
    """A stand-in for a rig that is known by its samples alone."""

    known_poses = ()

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        self.controls = tuple(Control(f"c{k}", 0.0, 0.0, 1.0, "face") for k in range(M))
        self.lower, self.default, self.upper = np.zeros(M), np.zeros(M), np.ones(M)


class Summed(Sampled):
    """A rig that is a sum of shapes, (m, n, 3), and can be tried."""

    known_poses = None

    def __init__(self, mesh: Mesh, shapes: np.ndarray):
        super().__init__(mesh)
        self.shapes = shapes

    def __call__(self, params):
        return (self.mesh.neutral + np.tensordot(params, self.shapes, 1)).astype(np.float32)


def three_parts(scale: float = 1.0) -> Mesh:
    """Return a skin and two equal eyes, each a bent grid with a chart of its own."""
    neutral, faces, uv, segment = [], [], [], []
    for k, (side, place, size) in enumerate(PARTS.values()):
        v, u = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(0, 1, side)], indexing="ij"))
        first = sum(map(len, neutral))
        a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel() + first
        neutral.append(np.stack([size * (u - 0.5), size * (v - 0.5), size / 9 * np.cos(2 * u)], 1) + place)
        faces += [np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)]
        uv.append(np.stack([u, v], 1))
        segment.append(np.full(side**2, k))
    arrays = (np.concatenate(neutral) * scale, np.concatenate(faces), np.concatenate(uv), np.concatenate(segment))
    return Mesh(*(a.astype(t) for a, t in zip(arrays, ("f4", "i4", "f4", "i4"), strict=True)), tuple(PARTS))


def shapes_on(mesh: Mesh) -> np.ndarray:
    """Return a smooth shape (n, 3) for each control, in another place for each."""
    rng = np.random.default_rng(4)
    places, ways = rng.uniform(-60, 60, (M, 2)), rng.normal(0, 6, (M, 3))
    away = ((mesh.neutral[:, None, :2] - places) ** 2).sum(-1)
    return (np.exp(-away / 2 / 40**2).T[:, :, None] * ways[:, None]).astype(np.float32)


def sound(mesh: Mesh | None = None, shapes: np.ndarray | None = None, hidden=(), count: int = 200) -> Face:
    """Return a face with nothing amiss. hidden: controls that training never moves."""
    mesh = mesh or three_parts()
    shapes = shapes_on(mesh) if shapes is None else shapes
    rng = np.random.default_rng(2)
    training, test = (rng.uniform(0, 1, (n, M)).astype(np.float32) for n in (count, 24))
    training[:, list(hidden)] = 0.0
    moved = [np.tensordot(params, shapes, 1).astype(np.float32) for params in (training, test)]
    samples = exact_samples(training, moved[0], test, moved[1])
    influence = (np.abs(shapes).max(-1) > 1e-3).T
    return Face(Sampled(mesh), samples, influence)


def amiss(face: Face) -> dict[str, str]:
    """Return metric → verdict of what has a sentence."""
    return {finding.metric: finding.verdict for finding in warnings(look(face))}


def of(face: Face, kind: str, metric: str) -> dict[str, tuple]:
    return {each.name: (each.value, each.verdict) for each in look(face) if (each.kind, each.metric) == (kind, metric)}


def test_nothing_is_amiss_with_a_sound_face_and_its_controls_reach_what_their_shapes_do():
    face = sound()
    assert amiss(face) == {}
    reach = of(face, CONTROL, "reach")
    expected = np.linalg.norm(shapes_on(face.rig.mesh), axis=2).max(1) * face.samples.params.max(0)
    np.testing.assert_allclose([reach[f"c{k}"][0] for k in range(M)], expected, rtol=1e-3)
    assert max(value for value, _ in of(face, SEGMENT, "off_its_place").values()) < 1e-3


@pytest.mark.parametrize(("hidden", "verdict"), [((3,), WORSE), ((3, 7), MEANINGLESS)])
def test_controls_that_only_held_out_poses_move_are_named_and_spoil_results_if_they_are_many(hidden, verdict):
    face = sound(hidden=hidden)
    (finding,) = [each for each in warnings(look(face)) if each.metric == "bad_used_in_training"]
    assert finding.verdict == verdict and all(f"c{k}" in finding.sentence for k in hidden)
    assert "but all of these do in held-out poses" in finding.sentence and "add poses" in finding.sentence
    used = of(face, CONTROL, "used_in_training")
    assert {name for name, (_, bad) in used.items() if bad != OK} == {f"c{k}" for k in hidden}
    assert of(face, CONTROL, "reach")["c3"] == (None, OK), "nothing is known of it"


def test_controls_that_no_pose_moves_make_results_worse_only():
    face = sound(hidden=(3, 7))
    still = face.samples.test_params.copy()
    still[:, [3, 7]] = 0
    face = replace(face, samples=replace(face.samples, test_params=still, validation_params=still))
    (finding,) = warnings(look(face))
    assert finding.verdict == WORSE and "(c3, c7), nor elsewhere" in finding.sentence


def swapped(face: Face) -> Face:
    """Return the face with the poses of its two eyes in each other's place."""
    mesh = face.rig.mesh
    order = np.arange(len(mesh.neutral))
    left, right = (np.flatnonzero(mesh.segment == k) for k in (1, 2))
    order[left], order[right] = right, left
    swap = lambda offsets: (offsets + mesh.neutral)[:, order] - mesh.neutral  # noqa: E731
    s = face.samples
    parts = {"quantised": swap(s.quantised), "test_offsets": swap(s.test_offsets)}
    return replace(face, samples=replace(s, validation_offsets=parts["test_offsets"], **parts))


def test_parts_whose_poses_lie_where_others_are_are_named_with_those():
    face = swapped(sound())
    off = of(face, SEGMENT, "off_its_place")
    assert off["skin"][1] == OK and off["skin"][0] < 1e-3
    assert off["eye_left"][1] == off["eye_right"][1] == MEANINGLESS and 59 < off["eye_left"][0] < 61
    (finding,) = warnings(look(face))
    assert "eye_left: its poses lie where eye_right is in the mesh" in finding.sentence


def test_vertices_in_another_order_within_a_part_are_found_too():
    face = sound()
    skin, order = np.flatnonzero(face.rig.mesh.segment == 0), np.arange(len(face.rig.mesh.neutral))
    order[skin] = skin[::-1]
    neutral = face.rig.mesh.neutral
    turned = (face.samples.quantised + neutral)[:, order] - neutral
    face = replace(face, samples=replace(face.samples, quantised=turned))
    assert amiss(face) == {"bad_off_its_place": MEANINGLESS} and of(face, SEGMENT, "off_its_place")["eye_left"][1] == OK


def test_held_out_poses_of_a_sum_of_shapes_are_on_a_straight_line_and_those_of_a_bend_are_not():
    face = sound()
    samples = face.samples
    all_poses = [
        (params, offsets + 0.1 * params[:, :1, None] ** 2 * offsets)
        for params, offsets in (
            (samples.params, samples.offsets(np.arange(len(samples)))),
            (samples.validation_params, samples.validation_offsets),
        )
    ]
    bent = replace(face, samples=exact_samples(*all_poses[0], *all_poses[1]))
    off = [float(of(each, FACE, "straight_line_off")[""][0]) for each in (face, bent)]
    assert off[0] < 1e-3 and off[1] > 0.05


def test_a_rig_that_bends_is_in_its_place():
    face = sound()
    bent = face.samples.quantised + 8 * (face.samples.params[:, :1, None] ** 2) * [0, 1, 0]
    assert amiss(replace(face, samples=replace(face.samples, quantised=bent.astype(np.float32)))) == {}


def seam(alike: bool) -> Face:
    """Return a face whose eyes have a corner of the skin's once more; alike: whether both move as one."""
    mesh = three_parts()
    neutral, ends = mesh.neutral.copy(), [np.flatnonzero(mesh.segment == k)[0] for k in (0, 1)]
    neutral[ends[1]] = neutral[ends[0]]
    shapes = shapes_on(mesh)
    shapes[:, ends[1]] = shapes[:, ends[0]] * (1.0 if alike else 0.5)
    return sound(Mesh(neutral, mesh.faces, mesh.uv, mesh.segment, mesh.segment_names), shapes)


@pytest.mark.parametrize("alike", [True, False])
def test_vertices_in_one_place_are_a_seam_if_they_move_alike(alike):
    face = seam(alike)
    values = {each.metric: each.value for each in look(face) if each.kind == FACE}
    assert values["torn_pairs"] == values["seam_pairs_of_two_segments"] == (1 if alike else 0)
    assert amiss(face) == ({"torn_pairs": WORSE} if alike else {})


@pytest.mark.parametrize("scale", [0.5, 10])
def test_a_face_of_an_odd_size_is_asked_about_its_unit(scale):
    mesh = three_parts(scale)
    (finding,) = warnings(look(replace(sound(mesh, shapes_on(three_parts())), unit="m, as its face.toml says")))
    assert finding.metric == "size" and f"{160 * scale:g} mm" in finding.sentence and "m, as its" in finding.sentence


def test_controls_without_effect_and_controls_with_one_effect_are_named():
    shapes = shapes_on(three_parts())
    shapes[2], shapes[5] = 0, 0.7 * shapes[4]
    face = sound(shapes=shapes)
    said = {each.metric: each.sentence for each in warnings(look(face))}
    assert set(said) == {"bad_reach", "pairs_alike"}
    assert "1 control moves nothing (c2)" in said["bad_reach"] and "(c4 and c5)" in said["pairs_alike"]
    tried = replace(face, rig=Summed(face.rig.mesh, shapes))
    assert {each.metric: each.sentence for each in warnings(look(tried))} == said
    assert of(tried, CONTROL, "reach")["c4"][0] == pytest.approx(np.linalg.norm(shapes[4], axis=1).max(), rel=1e-5)
    assert {each.metric for each in warnings(look(tried, tries=False))} == {"bad_reach"}, "a glance tries nothing"


def test_opposite_controls_are_no_pair():
    shapes = shapes_on(three_parts())
    shapes[5] = -shapes[4]
    assert amiss(sound(shapes=shapes)) == {}


def test_training_in_a_small_part_of_a_controls_limits_is_worth_a_word():
    face = sound()
    rig = Sampled(face.rig.mesh)
    rig.upper[6] = 40
    assert amiss(replace(face, rig=rig)) == {"bad_training_of_limits": WORSE}


def test_test_poses_are_beyond_if_they_lie_outside_or_far_from_all_of_training():
    rng = np.random.default_rng(0)
    on_a_line = rng.uniform(0, 1, (300, 1)) * np.ones((1, 2))
    test = np.array([[0.5, 0.5], [0.2, 0.9], [1.2, 1.0], [0.0, 1.02]])
    assert beyond_training(on_a_line, test, np.ones(2)).tolist() == [False, True, True, True]
    still = np.concatenate([on_a_line, np.zeros((300, 1))], axis=1)
    moved = np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.5]])
    assert beyond_training(still, moved, np.ones(3)).tolist() == [False, True]


def test_few_poses_and_poses_that_are_not_finite_are_said():
    assert amiss(sound(count=20))["poses_a_control"] == WORSE
    face = sound()
    broken = face.samples.test_offsets.copy()
    broken[3, 5] = np.nan
    assert amiss(replace(face, samples=replace(face.samples, test_offsets=broken)))["finite"] == MEANINGLESS


def test_segments_with_too_few_texels_and_rigid_ones_that_follow_nothing_are_named():
    face = replace(sound(), map_size=8, misplaced_mm={"eye_left": 2.0})
    said = {each.metric: each.sentence for each in warnings(look(face))}
    assert set(said) == {"bad_texels_a_vertex", "bad_misplaced"}
    assert "(skin)" in said["bad_texels_a_vertex"] and "(eye_left)" in said["bad_misplaced"]
    carried = replace(face, rigid=(0,))
    assert "bad_texels_a_vertex" not in amiss(carried), "a segment that others carry has no map"
    named = replace(face, rigid=(1,))
    assert amiss(named) == {"bad_texels_a_vertex": WORSE, "bad_attached_yet_misplaced": WORSE}
    crowd = vertices_a_texel(carried)
    assert crowd[face.rig.mesh.segment == 0].max() == 0 and crowd[face.rig.mesh.segment == 1].max() == 1


def test_a_segment_that_no_control_was_found_to_move_is_named():
    face = sound()
    influence = face.influence & (face.rig.mesh.segment != 1)[:, None]
    assert amiss(replace(face, influence=influence)) == {"bad_controls": WORSE}


def test_long_lists_of_names_are_cut():
    assert listed(list("abc")) == "a, b, c" and listed(list("abcdefgh")) == "a, b, c, d, e, f and 2 more"


def test_the_unit_is_stated_or_guessed():
    recipe = type("Recipe", (), {"face": type("Face", (), {"unit": "cm"})})
    assert unit_in_words(recipe) == "cm, as its face.toml says" and unit_in_words(object()) == "mm, as in all recipes"
    recipe.face.unit = "guess"
    assert "guessed" in unit_in_words(recipe)
    recipe = type("Recipe", (), {"face": type("Face", (), {"unit": "mm", "states_unit": True})})
    assert unit_in_words(recipe).startswith("the USD's own")
