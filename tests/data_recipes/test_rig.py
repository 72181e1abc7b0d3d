"""The Rig contract, on the tiny rig, on the teen, and on rigs that users bring."""

import dataclasses
import json
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from data_recipes.acting.procedural_acting import act
from data_recipes.head.neutral_head import build_head
from data_recipes.recipe.reading import load_recipe
from data_recipes.rig import (
    Clip,
    Control,
    Rig,
    build_rig,
    check_rig,
    expression_poses,
    load_rig,
    recipe_files,
    rig_names,
    save_rig,
)
from replicate.engine.exceptions import InputError
from replicate.engine.paths import RECIPES
from replicate.geometry.alignment import align
from replicate.geometry.mesh import Mesh
from replicate.geometry.normals import face_normals


@pytest.fixture(scope="module")
def tiny():
    return build_rig("tiny")


@pytest.fixture(scope="module")
def teen():
    return build_rig("teen")


def augmented(rig: Rig, count: int, seed: int = 0) -> np.ndarray:
    """Eq. 5 with clips of the rig's own: animation values times U(0.25, 3)."""
    generator = np.random.default_rng(seed)
    poses = np.concatenate([clip.values for clip in rig.clips])
    return poses[generator.integers(0, len(poses), count)] * generator.uniform(0.25, 3, (count, poses.shape[1]))


def skin_faces(mesh: Mesh) -> np.ndarray:
    names = ("face", "cranium", "neck", "ear_left", "ear_right", "ears")
    skin = [i for i, name in enumerate(mesh.segment_names) if name in names]
    return mesh.faces[np.isin(mesh.segment[mesh.faces], skin).all(axis=1)]


def flipped_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The share of faces whose normal is more than 90° from the area-weighted normal of the faces around them."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    at_vertex = np.stack([np.bincount(faces.ravel(), np.repeat(normal[:, d], 3), len(vertices)) for d in range(3)], 1)
    return float(((at_vertex[faces].sum(axis=1) - 3 * normal) * normal).sum(axis=1).__lt__(0).mean())


# -- our own rigs ------------------------------------------------------------------------------------------------


def test_the_recipes_that_come_along_are_listed():
    assert {"teen", "tiny"} <= set(rig_names())


@pytest.mark.parametrize("name", ["tiny", "teen"])
def test_the_default_pose_is_the_neutral(name, request):
    rig = request.getfixturevalue(name)
    assert np.abs(rig(rig.default) - rig.mesh.neutral).max() < 1e-4


def test_the_teen_has_258_controls_12510_vertices_and_26_teeth(teen):
    assert len(teen.controls) == 258
    assert teen.mesh.neutral.shape == (12510, 3)
    assert sum(name.startswith("tooth") for name in teen.mesh.segment_names) == 26
    assert len(teen.mesh.segment_names) == 36
    assert 40 <= len(teen.control_points) <= 60
    assert len(set(teen.control_points.tolist())) == len(teen.control_points)
    assert 20 <= len(teen.landmarks) <= 30


def test_a_batch_gives_what_single_poses_give(tiny):
    p = augmented(tiny, 37)
    batch = tiny(p)
    assert batch.shape == (37, *tiny.mesh.neutral.shape)
    assert batch.dtype == np.float32
    for i in (0, 31, 32, 36):
        np.testing.assert_allclose(tiny(p[i]), batch[i], atol=2e-3)


def test_the_nodes_one_by_one_give_the_compiled_rig(tiny):
    p = augmented(tiny, 5)
    np.testing.assert_allclose(tiny.run_nodes(p), tiny(p), atol=2e-3)
    assert len({node.name for node in tiny.nodes}) == len(tiny.nodes) >= 10


MOVES = {"brow_inner_up": 1, "smile": 0.8, "jaw_open": 0.7, "squint": 1, "blink": 0.6, "squash": 0.5, "nose_wrinkle": 1}


def strained(rig: Rig) -> np.ndarray:
    """A pose in which every node has something to do, some controls beyond their limits, as a batch of one."""
    p = np.array([next((v for n, v in MOVES.items() if c.name.startswith(n)), 0.0) for c in rig.controls])
    p += [2.5 * c.name.endswith("_x") + 0.8 * c.name.startswith(("lips_together", "sticky")) for c in rig.controls]
    return p[None].astype(np.float32)


def test_no_node_can_be_left_out_unnoticed(teen):
    p = strained(teen)
    whole = teen(p)
    np.testing.assert_allclose(teen.run_nodes(p), whole, atol=2e-3)
    for node in (node for node in teen.nodes if node.name != "riders"):  # he has no frills; the dragon's are tested
        assert np.abs(teen.run_nodes(p, skip=[node.name]) - whole).max() > 0.05, node.name


def test_a_node_that_is_switched_off_moves_nothing_and_those_after_it_see_it_at_rest(tiny):
    p = strained(tiny)
    jaw = next(k for k, node in enumerate(tiny.nodes) if node.name == "jaw")
    without = {name: np.asarray(state["x"]) for name, state in tiny.node_steps(p, skip=("jaw",))}
    before = tiny.nodes[jaw - 1].name
    np.testing.assert_array_equal(without["jaw"], without[before])
    np.testing.assert_allclose(tiny.run_nodes(p, upto=before), without[before].transpose(0, 2, 1))
    lower = [i for i, name in enumerate(tiny.mesh.segment_names) if name.startswith("tooth_lower")]
    teeth = np.isin(tiny.mesh.segment, lower)
    still = tiny.run_nodes(p, skip=("jaw", "head_shape"))[0]
    np.testing.assert_allclose(still[teeth], tiny.mesh.neutral[teeth], atol=1e-3)
    everything = [node.name for node in tiny.nodes]
    np.testing.assert_allclose(tiny.run_nodes(p, skip=everything)[0], tiny.mesh.neutral, atol=1e-3)


def test_without_the_limits_a_control_of_three_is_three(tiny):
    p = 3 * strained(tiny)
    states = [dict(tiny.node_steps(p, skip=skip)) for skip in ((), ("limit",))]
    limited, free = (np.asarray(state["limit"]["u"]) for state in states)
    np.testing.assert_allclose(free, p)
    assert np.abs(limited).max() < 1.5 < np.abs(free).max()


@pytest.mark.parametrize("choice", [{"skip": ["jaw", "wrinkle"]}, {"skip": "wrinkle"}, {"upto": "wrinkle"}])
def test_a_node_that_there_is_not_is_refused_with_those_that_there_are(tiny, choice):
    with pytest.raises(InputError, match=r"rig 'tiny': it has no node 'wrinkle'; allowed are limit, pose_curves, .*"):
        tiny.run_nodes(tiny.default[None], **choice)


def test_the_jacobian_agrees_with_central_differences(tiny):
    generator = np.random.default_rng(3)
    p = (tiny.default + 0.3 * generator.uniform(-1, 1, len(tiny.controls)) * (tiny.upper - tiny.lower)).astype(
        np.float32
    )
    exact = tiny.jacobian(p)
    assert exact.shape == (*tiny.mesh.neutral.shape, len(p))
    some = np.arange(len(p))[::-1][:40]
    np.testing.assert_allclose(tiny.jacobian(p, some), exact[:, :, some], atol=1e-2)
    step = 4e-3
    moved = np.repeat(p[None], 2 * len(p), axis=0)
    moved[: len(p)] += step * np.eye(len(p), dtype=np.float32)
    moved[len(p) :] -= step * np.eye(len(p), dtype=np.float32)
    vertices = tiny(moved).astype(np.float64)
    central = np.moveaxis((vertices[: len(p)] - vertices[len(p) :]) / (2 * step), 0, 2)
    # float32 gives differences of millimetres an error of about 2e-5 / step = 5e-3 mm; folds start with a root.
    off = np.abs(exact - central)
    assert np.quantile(off, 0.999) < 0.02
    assert off.max() < 0.05 * np.abs(exact).max()
    assert np.linalg.norm(exact - central) < 2e-3 * np.linalg.norm(central)


def test_every_teen_control_moves_something_at_one_of_several_poses(teen):
    m = len(teen.controls)
    moved = np.zeros(m)
    acted = [("smile", "squint"), ("brow_inner", "nose_wrinkle", "chin_raise")]  # what wrinkles most regions
    bases = [0.9 * np.array([c.name.startswith(parts) for c in teen.controls]) for parts in acted]
    mixed = augmented(teen, 2, seed=5).clip(teen.lower, teen.upper)
    bases += list(mixed + 0.3 * (mixed == 0) * teen.upper)
    for base in bases:
        step = np.where(base < 0.5 * (teen.lower + teen.upper), 0.4, -0.4)
        poses = base[None] + np.eye(m) * step
        moved = np.maximum(moved, np.abs(teen(poses) - teen(base)[None]).max(axis=(1, 2)))
    still = [control.name for control, far in zip(teen.controls, moved, strict=True) if far < 0.1]
    assert not still


def test_augmented_poses_are_faces_and_not_explosions(teen):
    vertices = teen(augmented(teen, 1_000, seed=1))
    assert np.isfinite(vertices).all()
    centre = teen.mesh.neutral.mean(axis=0)
    size = np.linalg.norm(teen.mesh.neutral - centre, axis=1).max()
    assert np.linalg.norm(vertices - centre, axis=2).max() < 2 * size
    faces = skin_faces(teen.mesh)
    assert np.mean([flipped_share(v, faces) for v in vertices]) < 0.01


def test_random_controls_far_beyond_their_limits_stay_finite_and_near(teen):
    generator = np.random.default_rng(2)
    p = generator.uniform(teen.lower, teen.upper, (64, 258)) * generator.uniform(0.25, 3, (64, 258))
    vertices = teen(np.concatenate([p, 100 * p[:8]]))
    assert np.isfinite(vertices).all()
    assert np.linalg.norm(vertices - teen.mesh.neutral.mean(axis=0), axis=2).max() < 420
    faces = skin_faces(teen.mesh)
    assert np.mean([flipped_share(v, faces) for v in vertices]) < 0.01


def test_every_tooth_is_rigid_to_a_micrometre_also_under_squash(teen):
    p = augmented(teen, 12, seed=4)
    p[:, [c.name in ("squash", "squash_lower", "jaw_open", "twist") for c in teen.controls]] = 1.0
    vertices = teen(p).astype(np.float64)
    for i, name in enumerate(teen.mesh.segment_names):
        if name.startswith("tooth"):
            ids = np.flatnonzero(teen.mesh.segment == i)
            rest = teen.mesh.neutral[ids].astype(np.float64)
            gap = np.linalg.norm(rest[:, None] - rest[None], axis=2)
            for v in vertices[:, ids]:
                assert np.abs(np.linalg.norm(v[:, None] - v[None], axis=2) - gap).max() < 1e-3


def test_a_full_brow_raise_turns_the_foreheads_normals_by_five_degrees(teen):
    columns = {c.name: i for i, c in enumerate(teen.controls)}
    p = teen.default.copy()
    for name in ("brow_inner_up", "brow_outer_up"):
        p[[columns[f"{name}_left"], columns[f"{name}_right"]]] = 1
    smooth = p.copy()
    smooth[[i for name, i in columns.items() if name.startswith("wrinkle_")]] = -1.2
    region = np.unique(teen.face.constants["wrinkles"]["forehead"]["corners"])
    faces = teen.mesh.faces[np.isin(teen.mesh.faces, region).all(axis=1)]
    with_folds, without = (np.asarray(face_normals(teen(q), faces)) for q in (p, smooth))
    turned = np.degrees(np.arccos(np.clip((with_folds * without).sum(axis=1), -1, 1)))
    assert turned.mean() > 5


def test_a_blink_covers_the_eyeball_and_no_lid_enters_it(teen):
    columns = {c.name: i for i, c in enumerate(teen.controls)}
    p = teen.default.copy()
    p[[columns["blink_left"], columns["blink_right"]]] = 1
    closed, rest = teen(p), teen.mesh.neutral
    marks = dict(zip(teen.landmark_names, teen.landmarks.tolist(), strict=True))
    for side in ("left", "right"):
        upper, lower = marks[f"lid_upper_{side}"], marks[f"lid_lower_{side}"]
        assert np.linalg.norm(rest[upper] - rest[lower]) > 8
        assert np.linalg.norm(closed[upper] - closed[lower]) < 1.5
        lids = teen.face.constants[f"lids_{side}"]
        distance = np.linalg.norm(closed[lids["support"]] - lids["centre"], axis=1)
        assert (distance > lids["ball"] - 0.06).all()


def still_headed(rig: Rig, pose: np.ndarray) -> np.ndarray:
    """The pose with the head's shape at rest, so that heights can be compared."""
    return np.where([c.region == "head" for c in rig.controls], rig.default, pose)


@pytest.mark.parametrize("name", ["joy", "laugh", "grin", "snarl", "fear", "shout"])
def test_a_mouth_that_should_bare_the_upper_teeth_does(teen, name):
    marks = dict(zip(teen.landmark_names, teen.landmarks.tolist(), strict=True))
    teeth = np.isin(
        teen.mesh.segment, [i for i, n in enumerate(teen.mesh.segment_names) if n.startswith("tooth_upper")]
    )
    front = np.flatnonzero(teeth & (np.abs(teen.mesh.neutral[:, 0]) < 9))
    rest, posed = teen.mesh.neutral, teen(still_headed(teen, expression_poses(teen)[name]))
    bared = lambda v: v[marks["lip_upper_mid"], 1] - v[front, 1].min()  # noqa: E731
    assert bared(posed) > 4
    assert rest[marks["lip_lower_mid"], 1] > rest[front, 1].min() + 1  # at rest the lower lip hides them
    assert posed[marks["lip_lower_mid"], 1] < posed[front, 1].min() + 1


@pytest.mark.parametrize("with_it", ["squint", "eye_wide", "look_y", "look_x", "smile", "brow_outer_up", "brow_down"])
def test_lids_close_whatever_the_face_does_besides(teen, with_it):
    columns = {c.name: i for i, c in enumerate(teen.controls)}
    marks = dict(zip(teen.landmark_names, teen.landmarks.tolist(), strict=True))
    for amount in (1, -1):
        p = teen.default.copy()
        for side in ("left", "right"):
            p[columns[f"{with_it}_{side}"]] = amount
            p[columns[f"blink_{side}"]] = 1
        closed = teen(p)
        for side in ("left", "right"):
            assert np.linalg.norm(closed[marks[f"lid_upper_{side}"]] - closed[marks[f"lid_lower_{side}"]]) < 1.5


def test_the_upper_lid_rests_on_the_iris_and_bares_white_in_surprise_and_fear_alone(teen):
    marks = dict(zip(teen.landmark_names, teen.landmarks.tolist(), strict=True))

    def white_mm(name):
        p = still_headed(teen, expression_poses(teen)[name])
        iris = next(vertices for part, vertices, _, _ in teen.pose_props(p) if part == "eye_limbus_left")
        return teen(p)[marks["lid_upper_left"], 1] - iris[:, 1].max()

    assert min(white_mm(name) for name in ("surprise", "shock", "fear")) > 2
    assert max(white_mm(name) for name in ("neutral", "joy", "anger", "sadness", "disgust")) < 0.3


def test_wrinkles_sleep_at_rest_and_no_pose_of_a_batch_costs_15_ms_of_processor_time(teen):
    assert np.abs(teen(np.zeros((2, 258)))[1] - teen.mesh.neutral).max() < 1e-4
    p = augmented(teen, 64, seed=6)
    teen(p)
    cost = []
    for _ in range(3):
        start = time.process_time()
        teen(p)
        cost.append((time.process_time() - start) / len(p) * 1e3)
    assert min(cost) < 15  # processor time counts both cores, and no other process


def test_a_saved_rig_comes_back_the_same_and_without_its_geometry(teen, tmp_path, monkeypatch):
    save_rig(teen, tmp_path / "teen")
    monkeypatch.setattr("data_recipes.face_rig.build", lambda _: pytest.fail("built again"))
    start = time.process_time()
    again = load_rig(tmp_path / "teen")
    assert time.process_time() - start < 3
    p = augmented(teen, 3)
    np.testing.assert_array_equal(again(p), teen(p))
    assert again.controls == teen.controls
    assert again.control_point_regions == teen.control_point_regions
    assert [c.name for c in again.clips] == [c.name for c in teen.clips]
    for one, other in zip(again.pose_props(p[0]), teen.pose_props(p[0]), strict=True):
        np.testing.assert_array_equal(one[1], other[1])
        np.testing.assert_array_equal(one[3], other[3])
    np.testing.assert_array_equal(again.paint, teen.paint)
    assert not list((tmp_path / "teen").glob("*.part"))


@pytest.mark.parametrize("fault", ["cut", "no arrays", "other format", "no json"])
def test_a_damaged_folder_is_named(tiny, tmp_path, fault):
    folder = tmp_path / "tiny"
    save_rig(tiny, folder)
    if fault == "cut":
        (folder / "rig.npz").write_bytes((folder / "rig.npz").read_bytes()[:5000])
    elif fault == "no arrays":
        (folder / "rig.npz").unlink()
    elif fault == "other format":
        about = json.loads((folder / "rig.json").read_text())
        (folder / "rig.json").write_text(json.dumps(about | {"format": 99}))
    else:
        (folder / "rig.json").write_text("{")
    with pytest.raises(InputError, match=r"rig|tiny"):
        load_rig(folder)


def test_eyeballs_turn_with_the_gaze_and_brows_ride_on_the_skin(tiny):
    names = [control.name for control in tiny.controls]
    rest = {name: vertices for name, vertices, _, _ in tiny.pose_props(tiny.default)}
    raised = tiny.default.copy()
    raised[names.index("brow_outer_up_left")] = raised[names.index("brow_inner_up_left")] = 1
    raised[names.index("look_y_left")] = 1
    posed = {name: vertices for name, vertices, _, _ in tiny.pose_props(raised)}
    assert (posed["brow_left"] - rest["brow_left"])[:, 1].mean() > 1.5
    assert np.abs(posed["brow_right"] - rest["brow_right"]).max() < 1.5
    assert (posed["eye_pupil_left"] - rest["eye_pupil_left"])[:, 1].mean() > 3
    np.testing.assert_allclose(posed["eye_pupil_right"], rest["eye_pupil_right"], atol=1e-4)


def test_a_recipes_clips_are_its_acting(tiny):
    recipe = load_recipe("tiny")
    played = act(tiny.controls, recipe.acting)
    assert [clip.name for clip in tiny.clips] == [name for name, _ in played]
    np.testing.assert_array_equal(tiny.clips[3].values, played[3][1])


def test_a_recipe_can_bring_its_own_clips_in_place_of_acting(tmp_path):
    text = (RECIPES / "tiny.toml").read_text(encoding="utf-8")
    assert "[acting]" not in text
    text += "\n[acting]\nclips = 0\n"
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / "nod.csv").write_text("squash,jaw_open\n0,0\n0.5,0.25\n", encoding="utf-8")
    recipe = tmp_path / "mine.toml"
    recipe.write_text('clip_files = ["shots/nod.csv"]\n' + text, encoding="utf-8")
    assert recipe_files(recipe) == (recipe, tmp_path / "shots" / "nod.csv")
    rig = build_rig(recipe)
    columns = [control.name for control in rig.controls]
    (clip,) = rig.clips
    assert clip.name == "nod" and clip.values.shape == (2, len(columns))
    assert [clip.values[1, columns.index(name)] for name in ("squash", "jaw_open")] == [0.5, 0.25]
    assert np.count_nonzero(clip.values) == 2


def test_a_recipe_without_clips_with_strips_for_teeth_and_shared_charts_is_a_rig(tmp_path):
    text = (RECIPES / "tiny.toml").read_text(encoding="utf-8").replace("[teeth]", '[teeth]\nstyle = "strip"')
    text = text.replace("vertices = 918", "vertices = 930")
    text += '\n[acting]\nclips = 0\n[segments]\nears = ["ear_left", "ear_right"]\n'
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

    def flattened(recipe):
        head = build_head(recipe)
        head.faces[5] = head.faces[5, 0]
        return head

    with monkeypatch.context() as patch:
        patch.setattr("data_recipes.head.neutral_head.build_head", flattened)
        with pytest.raises(InputError, match=r"^mine\.toml: mesh: faces\[5\] .* is degenerate"):
            build_rig(recipe)
    recipe.write_text(text.replace("vertices = 918", "vertices = 917"), encoding="utf-8")
    with pytest.raises(InputError, match=r"^mine\.toml: 'vertices': found 917"):
        build_rig(recipe)


# -- rigs that users bring ---------------------------------------------------------------------------------------

MESH = Mesh(
    neutral=np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]], np.float32),
    faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32),
    uv=np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5]], np.float32),
    segment=np.zeros(4, np.int32),
    segment_names=("all",),
)
CONTROLS = (Control("lift", 0.0, 0.0, 1.0, "all"), Control("turn", -1.0, 0.0, 1.0, "all"))


def lift(p):
    return MESH.neutral + p[:, :1, None] * np.array([0, 5.0, 0]) + p[:, 1:, None] * np.array([0, 0, 2.0])


def foreign(**changes) -> Rig:
    given = {"name": "box", "mesh": MESH, "controls": CONTROLS, "landmarks": np.array([0, 3]), "function": lift,
             "control_points": np.array([1]), "control_point_regions": ("all",), "clips": None}  # fmt: skip
    return Rig(**(given | changes))


def test_a_plain_numpy_function_is_a_rig():
    rig = check_rig(foreign())
    np.testing.assert_allclose(rig(np.array([0.5, 0])) - MESH.neutral, np.tile([0, 2.5, 0], (4, 1)))
    assert rig(np.zeros((33, 2))).shape == (33, 4, 3)
    assert rig.nodes == () and rig.pose_props(rig.default) == [] and rig.paint is None
    with pytest.raises(InputError, match="rig 'box': it has no nodes"):
        rig.run_nodes(np.zeros((1, 2)))
    with pytest.raises(InputError, match="built from recipes"):
        save_rig(rig, Path("nowhere"))


def test_a_foreign_jax_rig_has_an_exact_jacobian():
    rig = foreign(function=lambda p: jnp.asarray(MESH.neutral) + jnp.sin(p[:, :1, None]) * jnp.array([0, 5.0, 0]))
    jacobian = rig.jacobian(np.array([0.3, 0.0]))
    np.testing.assert_allclose(jacobian[2], [[0, 0], [5 * np.cos(0.3), 0], [0, 0]], rtol=1e-5)


@pytest.mark.parametrize(
    "changes, part",
    [
        ({"controls": ()}, "no controls"),
        ({"controls": (CONTROLS[0], CONTROLS[0])}, "'lift' is there twice"),
        ({"landmarks": np.array([0, 4])}, r"landmarks\[1\] is 4"),
        ({"control_points": np.array([-1])}, r"control_points\[0\] is -1"),
        ({"control_point_regions": ()}, "control_point_regions"),
        ({"clips": (Clip("walk", np.zeros((5, 3), np.float32)),)}, "clip 'walk'"),
        ({"clips": (Clip("nan", np.full((5, 2), np.nan, np.float32)),)}, "clip 'nan'"),
    ],
)
def test_what_does_not_fit_a_foreign_rig_is_named(changes, part):
    with pytest.raises(InputError, match=part):
        foreign(**changes)


@pytest.mark.parametrize(
    "function, part",
    [
        (lambda p: np.zeros((len(p), 3, 3)), "shape"),
        (lambda p: lift(p) + np.array([0, 0, 0.1]), "vertex 0 lies 0.1 mm"),
        (lambda p: lift(p) * np.where(np.arange(4) == 2, np.nan, 1)[:, None], "vertex 2"),
    ],
)
def test_a_function_that_is_no_rig_is_refused(function, part):
    with pytest.raises(InputError, match=part):
        check_rig(foreign(function=function))


def test_parameters_of_the_wrong_length_are_refused():
    with pytest.raises(InputError, match=r"shape \(3,\), where \(2,\) or \(b, 2\)"):
        foreign()(np.zeros(3))


def test_a_recipe_with_a_control_count_out_of_range_is_refused(tmp_path):
    recipe = tmp_path / "odd.toml"
    recipe.write_text('name = "odd"\nvertices = 10\n[controls]\nface = 99\n')
    with pytest.raises(InputError, match=r"controls\.face.*99"):
        build_rig(recipe)


def test_the_mesh_of_a_rig_is_a_frozen_value(tiny):
    with pytest.raises(dataclasses.FrozenInstanceError):
        tiny.name = "other"
