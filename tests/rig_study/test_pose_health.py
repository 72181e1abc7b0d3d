"""Broken poses: each criterion is silent on sound ones and says how much of a fault that was built in."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import rigs
import trimesh
from plane import flat_grid

from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Clip
from replicate.benchmarks import bench_poses
from replicate.benchmarks.bench_poses import FLIP_COLOUR, worst_poses
from replicate.geometry.mesh import Mesh
from replicate.geometry.rays import ray_hits
from replicate.report.results import read_results
from replicate.rig_study.mouth_contents import deepest, depths, find_mouth
from replicate.rig_study.pose_health import Skin, each_alone, measure, strongest, worst


def tiny() -> FunctionRig:
    return rigs.rig("tiny")


@cache
def tiny_mouth():
    return find_mouth(tiny().mesh)


# -- triangles ---------------------------------------------------------------------------------------------------


def test_a_ray_meets_the_first_wanted_triangle_and_says_at_what_angle():
    corners = np.asarray(trimesh.creation.box((2, 2, 2)).triangles)
    start, along = np.array([[5.0, 0.1, 0.2], [5, 3, 0], [0.0, 0.1, 0.2]]), np.array([[-10.0, 0, 0]] * 3)
    share, cosine = ray_hits(start, along, corners)
    np.testing.assert_allclose(share, [0.4, np.inf, 0.1])
    np.testing.assert_allclose(cosine, [-1, 0, 1])
    far_side = corners[:, :, 0].max(1) < 0
    np.testing.assert_allclose(ray_hits(start, along, corners, far_side)[0], [0.6, np.inf, 0.1])
    assert not np.isfinite(ray_hits(start, 0.3 * along, corners)[0][:2]).any(), "what is out of reach is not met"


# -- skin --------------------------------------------------------------------------------------------------------


def sheet(side: int = 9) -> Mesh:
    """A sheet of skin, 10 mm a square, with a tooth beside it that is no skin."""
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1) * 10.0
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)])
    tooth = [[200, 0, 0], [210, 0, 0], [200, 10, 0]]
    segment = np.repeat([0, 1], [len(points), 3])
    uv = np.zeros((len(points) + 3, 2), np.float32)
    faces = np.concatenate([faces, [[len(points) + k for k in range(3)]]])
    return Mesh(np.float32(np.concatenate([points, tooth])), np.int32(faces), uv, np.int32(segment), ("face", "tooth"))


def test_a_vertex_pulled_over_its_neighbour_flips_its_triangles_and_no_others():
    mesh, skin = sheet(), Skin(sheet())
    pulled = mesh.neutral[None].copy()
    pulled[0, 40] += (14, 2, 0.5)  # from (40, 40) over the vertex at (50, 40)
    flipped = skin.flipped(pulled)[0]
    normals = np.cross(*(pulled[0][skin.faces[:, k]] - pulled[0][skin.faces[:, 0]] for k in (1, 2)))
    assert 2 <= flipped.sum() <= 3 and (normals[flipped, 2] < 0).all()
    assert (skin.faces[flipped] == 40).any(1).all()
    assert not skin.flipped(mesh.neutral[None]).any()


def test_turning_bending_and_twisting_the_whole_is_no_flip():
    mesh, skin = sheet(), Skin(sheet())
    x, y, _ = mesh.neutral.T
    turned = mesh.neutral * (-1, 1, -1)
    angle = x / 80 * np.radians(170)
    bent = np.stack([27 * np.sin(angle), y, 27 * np.cos(angle)], 1)
    twist = y / 80 * np.radians(120)
    twisted = np.stack([(x - 40) * np.cos(twist), y, (x - 40) * np.sin(twist)], 1)
    assert not skin.flipped(np.float32([turned, bent, twisted])).any()


def test_what_is_sharp_at_rest_and_what_is_no_skin_is_left_out():
    mesh = sheet()
    neutral = mesh.neutral.copy()
    neutral[40] += (14, 2, 0.5)
    sharp = Skin(Mesh(neutral, mesh.faces, mesh.uv, mesh.segment, mesh.segment_names))
    assert not sharp.flipped(neutral[None]).any()
    assert len(sharp.faces) == 128
    flown = mesh.neutral[None].copy()
    flown[0, 40, 2] += 1000
    assert Skin(mesh).furthest(mesh.neutral[None])[0] == pytest.approx(1) and Skin(mesh).furthest(flown)[0] > 4


# -- the mouth ---------------------------------------------------------------------------------------------------


def front_teeth(mesh: Mesh) -> np.ndarray:
    """The vertices of the upper teeth at the middle."""
    upper = [i for i, name in enumerate(mesh.segment_names) if name.startswith("tooth_upper")]
    middle = min(upper, key=lambda i: abs(mesh.neutral[mesh.segment == i, 0].mean()))
    return np.flatnonzero(mesh.segment == middle)


def to_come_out(mesh: Mesh, vertices: np.ndarray) -> float:
    """How far vertices can move straight forwards until the first of them is in front of all skin."""
    skin = np.isin(mesh.segment[mesh.faces], [mesh.segment_names.index("face")]).all(1)
    corners = mesh.neutral[mesh.faces[skin]].astype(float)
    least = np.inf
    for point in mesh.neutral[vertices].astype(float):
        ahead = np.array([[0.0, 0, 60.0]])
        share = ray_hits(point[None] + ahead, -ahead, corners)[0][
            0
        ]  # looked at from outside the last skin is the first
        least = min(least, 60 * (1 - share)) if np.isfinite(share) else least
    return least


def test_a_tooth_moved_out_through_the_lip_is_as_deep_as_it_is_out():
    mesh, mouth = tiny().mesh, tiny_mouth()
    assert set(mouth.kinds) == {"teeth", "gums", "tongue"}
    assert max(deepest(mouth, depths(mouth, mesh.neutral)).values()) == 0
    tooth = front_teeth(mesh)
    free = to_come_out(mesh, tooth)
    moved = mesh.neutral.copy()
    moved[tooth, 2] += free + 2
    through = depths(mouth, moved)
    assert deepest(mouth, through)["teeth"] == pytest.approx(2, abs=0.6)
    assert set(mouth.points[through > 0]) <= set(tooth.tolist())
    moved[tooth, 2] -= 3  # 1 mm short of coming out
    assert deepest(mouth, depths(mouth, moved))["teeth"] == 0


def test_what_shows_through_an_open_mouth_or_moves_with_the_head_is_not_through_the_skin():
    rig, mouth = tiny(), tiny_mouth()
    columns = [control.name for control in rig.controls]
    opened = rig.default.copy()
    opened[columns.index("jaw_open")] = 1
    assert deepest(mouth, depths(mouth, rig(opened)))["teeth"] == 0
    turn = trimesh.transformations.rotation_matrix(2.0, (1, 2, 3))[:3, :3]
    moved = rig.mesh.neutral.copy()
    moved[front_teeth(rig.mesh), 2] += 12
    one, other = depths(mouth, moved), depths(mouth, moved @ turn.T.astype(np.float32) + 50)
    np.testing.assert_allclose(other, one, atol=1e-3)
    assert one.max() > 0


def wall_with_a_tongue() -> tuple[Mesh, np.ndarray]:
    """A sheet of skin that faces forwards up to y = 80, a tooth behind it, and a strip of tongue from root to tip."""
    mesh = sheet()
    steps = np.arange(6)
    strip = np.stack([np.tile([30, 50], 6), np.full(12, 60), np.repeat(-30 + 5 * steps, 2)], 1)
    first = len(mesh.neutral) + 2 * steps[:-1]
    quads = np.stack([first, first + 1, first + 3, first + 2], 1)
    neutral = np.concatenate([mesh.neutral, strip])
    neutral[len(mesh.neutral) - 3 : len(mesh.neutral)] -= (160, -40, 10)
    segment = np.append(mesh.segment, np.full(12, 2))
    faces = np.concatenate([mesh.faces, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    uv, names = np.zeros((len(neutral), 2), np.float32), ("face", "tooth", "tongue")
    return Mesh(np.float32(neutral), np.int32(faces), uv, np.int32(segment), names), np.flatnonzero(segment == 2)


def test_a_tongue_that_lolls_over_the_lip_is_not_through_it_and_one_that_pierces_it_is():
    mesh, tongue = wall_with_a_tongue()
    mouth = find_mouth(mesh)
    pierced, lolling = mesh.neutral.copy(), mesh.neutral.copy()
    pierced[tongue, 2] += 12
    assert deepest(mouth, depths(mouth, pierced))["tongue"] == pytest.approx(7, abs=0.1)
    lolling[tongue, 1] = np.repeat([60, 75, 90, 90, 75, 60], 2)
    lolling[tongue, 2] = np.repeat([-25, -25, -15, 5, 5, 5], 2)
    assert deepest(mouth, depths(mouth, lolling))["tongue"] == 0
    stiff = replace(mouth, lolling=mouth.lolling[:0])
    assert deepest(mouth, depths(stiff, lolling))["tongue"] > 3, "its tip is in front of the lip"


def test_a_tooth_behind_a_fine_lining_of_the_lip_faces_the_skin_and_not_the_lining():
    mesh, side = sheet(), np.arange(34, 47)
    lining, backwards = flat_grid(side, side, -3)
    first, middle = len(mesh.neutral) - 3, 40  # the tooth comes last; the lining joins the sheet at its middle
    lining_faces = backwards[:, ::-1] + first
    lining_faces[lining_faces == first] = middle
    tooth = np.float32([[40, 40, -8], [42, 40, -8], [40, 42, -8]])
    neutral = np.concatenate([mesh.neutral[:first], lining, tooth])
    own = np.array([[len(neutral) - 3, len(neutral) - 2, len(neutral) - 1]])
    faces = np.concatenate([mesh.faces[:-1], lining_faces, own])
    segment = np.repeat([0, 1], [len(neutral) - 3, 3])
    flat = np.zeros((len(neutral), 2), np.float32)
    mouth = find_mouth(Mesh(neutral, np.int32(faces), flat, np.int32(segment), mesh.segment_names))
    assert (mouth.outward[:, 2] > 0.9).all()
    moved = neutral.copy()
    moved[-3:, 2] += 10
    assert deepest(mouth, depths(mouth, moved))["teeth"] == pytest.approx(2, abs=0.2)
    assert deepest(mouth, depths(mouth, neutral - [0, 0, 1]))["teeth"] == 0


def test_a_mesh_without_teeth_has_no_mouth():
    mesh = sheet()
    assert find_mouth(Mesh(mesh.neutral, mesh.faces, mesh.uv, mesh.segment, ("face", "box"))) is None


# -- many poses --------------------------------------------------------------------------------------------------


def fold(p):
    """A sheet whose one control pulls a vertex over its neighbour, and whose other loses a vertex."""
    mesh = sheet()
    moved = np.repeat(mesh.neutral[None], len(p), axis=0)
    moved[:, 40] += p[:, :1] * np.float32([14, 2, 0.5])
    moved[:, 3] = np.where(p[:, 1:] > 0.5, np.nan, moved[:, 3])
    return moved


def folding(clips=None) -> FunctionRig:
    controls = (Control("pull", 0.0, 0.0, 1.0, "all"), Control("lose", -1.0, 0.0, 2.0, "all"))
    return FunctionRig("sheet", sheet(), controls, np.array([0]), np.array([1]), ("all",), clips, fold)


def test_measured_poses_say_which_of_them_is_broken_and_by_what():
    rig = folding()
    params = np.float32([[0, 0], [1, 0], [0.1, 1], [0.2, 0]])
    health = measure(rig, params, Skin(rig.mesh))
    assert health.bad.tolist() == [0, 0, 1, 0]
    assert health.flipped[1] > 0 and (health.flipped[[0, 2, 3]] == 0).all()
    assert worst(health.flipped, 3).tolist() == [1]
    assert strongest(rig.controls, np.float32([0.5, -1])) == "pull +0.50, lose -0.50"
    names, alone = each_alone(rig)
    assert names == ["pull 1", "lose -1", "lose 2"] and alone.tolist() == [[1, 0], [0, -1], [0, 2]]


def test_the_benchmark_writes_a_set_a_kind_of_pose_and_keeps_other_characters(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    clip = Clip("tug", np.float32([[0, 0], [0, 0], [0.2, 0], [1, 0]] + [[0.3 + k / 100, 0.1] for k in range(30)]))
    monkeypatch.setattr(bench_poses, "rig_of", lambda name: folding((clip,)) if name == "a" else folding())
    monkeypatch.setattr(bench_poses, "UNIFORM_MOUTHS", 8)
    monkeypatch.setattr("replicate.benchmarks.bench_poses.render", lambda *arguments: np.zeros((270, 250, 3), np.uint8))
    assert bench_poses.main(["--characters", "a", "--count", "40"]) == 0
    output = capsys.readouterr().out
    assert "worst flips" in output and "tug 3" in output and "pull +1.00" in output
    rows = {(row.method, row.metric): row for row in read_results(tmp_path / "bench" / "bench_poses.csv")}
    assert {kind for kind, _ in rows} == {"augmented", "clips", "controls"}
    assert rows["clips", "flipped_triangles_mean"].poses == 33, "the same frame counts once"
    assert rows["clips", "flipped_triangles_worst"].value > 0 and rows["clips", "bad_vertices"].value == 0
    assert rows["controls", "bad_vertices"].value == 1
    assert (tmp_path / "bench" / "sheet_worst_poses.json").is_file()
    assert bench_poses.main(["--characters", "b", "--count", "16"]) == 0
    rows = read_results(tmp_path / "bench" / "bench_poses.csv")
    assert {row.method for row in rows} == {"uniform", "uniform, mouths", "controls"}, "one name, the last run's rows"
    assert bench_poses.main(["--count", "0"]) == 2


def test_the_picture_of_the_worst_poses_marks_what_is_broken():
    rig = folding()
    names, params = each_alone(rig)
    health = measure(rig, params, Skin(rig.mesh))
    pose_sets = [bench_poses.PoseSet("controls", names, health)]
    figure, words = worst_poses(rig, pose_sets, 60, 60)
    pictures = [image.get_array() for axes in figure.axes for image in axes.get_images()]
    assert "1 with most flipped" in words.alt and "0 with teeth furthest" in words.alt
    reddest = max((np.asarray(picture, int) - FLIP_COLOUR).__abs__().sum(-1).min() for picture in pictures[:1])
    assert reddest == 0, "the ring's colour is exact"


@pytest.mark.parametrize("name", ["mouth_inside", "gums_and_tongue", "gums_tongue"])
def test_gums_and_tongue_are_told_apart_where_they_share_a_segment(name):
    mesh, alone = tiny().mesh, tiny_mouth()
    merged = [name if own.startswith(("gum", "tongue")) else own for own in mesh.segment_names]
    names = tuple(dict.fromkeys(merged))
    segment = np.array([names.index(own) for own in merged], np.int32)[mesh.segment]
    together = find_mouth(replace(mesh, segment=segment, segment_names=names))
    kinds = [
        {point: mouth.kinds[k] for point, k in zip(mouth.points, mouth.kind, strict=True)}
        for mouth in (alone, together)
    ]
    assert kinds[0] == kinds[1]
