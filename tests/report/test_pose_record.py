"""The pose that figures show: chosen by folds alone, and the same after a trip to disk."""

import numpy as np
import pytest

from replicate.engine.exceptions import InputError
from replicate.geometry.edges import edges, inner_edges
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import PoseRecord, fold_angles, load_pose, most_wrinkled, save_pose

TENT = np.float32([[0, -10, 0], [0, 10, 0], [-10, 0, 0], [10, 0, 0]])
TENT_FACES = np.int32([[0, 1, 2], [1, 0, 3]])


def sheet(n=8) -> Mesh:
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    vertices = np.float32(np.stack([x, y, 0 * x], -1).reshape(-1, 3)) * 5
    corner = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    faces = np.int32(np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    uv = vertices[:, :2] / vertices[:, :2].max()
    return Mesh(vertices, faces, uv, np.zeros(n * n, np.int32), ("sheet",))


@pytest.mark.parametrize("degrees", [-100.0, -30, 0, 5, 90])
def test_the_fold_of_a_tent_is_the_angle_between_its_sides(degrees):
    half = np.radians(degrees) / 2
    posed = TENT.copy()
    posed[2:, 0] = [-10 * np.cos(half), 10 * np.cos(half)]
    posed[2:, 2] = -10 * np.sin(half)
    ridge, sides = inner_edges(TENT_FACES)
    assert ridge.tolist() == [[0, 1]] and sides.tolist() == [[0, 1]]
    assert fold_angles(posed, TENT_FACES, ridge, sides)[0] == pytest.approx(degrees, abs=1e-3)


def test_inner_edges_are_all_edges_but_the_border():
    mesh = sheet()
    pairs, sides = inner_edges(mesh.faces)
    assert len(pairs) == len(edges(mesh.faces)) - 4 * 7
    shared = [len(set(mesh.faces[a]) & set(mesh.faces[b])) for a, b in sides]
    assert shared == [2] * len(pairs)


def test_the_most_wrinkled_pose_is_the_most_folded_one_and_not_the_most_moved():
    mesh = sheet()
    x = mesh.neutral[:, 0]
    t = np.radians(70)
    turned = mesh.neutral @ np.float32([[np.cos(t), 0, -np.sin(t)], [0, 1, 0], [np.sin(t), 0, np.cos(t)]]) + 50
    ripple = np.zeros_like(mesh.neutral)
    ripple[:, 2] = np.sin(x * 2) * 0.4
    offsets = np.stack([0 * x[:, None] + np.float32([200, 0, 0]), turned - mesh.neutral, ripple, ripple * 0.5])
    params = np.arange(8, dtype=np.float32).reshape(4, 2)
    assert most_wrinkled(mesh, params, offsets, np.ones(len(mesh.faces), bool), batch=3) == 2


def test_folds_that_the_neutral_has_do_not_count():
    flat = sheet()
    ripple = flat.neutral + np.float32([0, 0, 2]) * np.sin(flat.neutral[:, :1] * 2)
    mesh = Mesh(ripple, flat.faces, flat.uv, flat.segment, flat.segment_names)
    offsets = np.stack([np.zeros_like(ripple), flat.neutral - ripple])
    assert most_wrinkled(mesh, np.float32([[0], [1]]), offsets, np.ones(len(mesh.faces), bool)) == 1


def test_only_folds_of_the_shown_faces_count():
    mesh = sheet()
    left = mesh.neutral[mesh.faces].mean(1)[:, 0] < 12
    offsets = np.zeros((2, 64, 3), np.float32)
    offsets[0, mesh.neutral[:, 0] > 20, 2] = 3
    offsets[1, 9, 2] = 0.5
    params = np.float32([[0], [1]])
    assert most_wrinkled(mesh, params, offsets, left) == 1
    assert most_wrinkled(mesh, params, offsets, ~left) == 0
    with pytest.raises(InputError, match="no two of the shown faces share an edge"):
        most_wrinkled(mesh, params, offsets, np.zeros(len(mesh.faces), bool))


def test_a_record_comes_back_from_disk_to_a_micrometre(tmp_path):
    mesh = sheet()
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(64, 3)).astype(np.float32) * 10
    props = [("eye", TENT, TENT_FACES, (250.0, 250.0, 245.0)), ("brow", TENT, TENT_FACES, (0.2, 0.0, 1.0))]
    props.append(("iris", TENT, TENT_FACES, np.arange(TENT.size, dtype=np.uint8).reshape(TENT.shape)))
    truth = mesh.neutral + offsets
    shown = {"truth": truth, "coarse": truth + np.float32(0.25), "neutral": mesh.neutral}
    record = PoseRecord("teen", 1, mesh.neutral, mesh.faces, shown, tuple(props))
    save_pose(tmp_path / "pose.npz", record)
    back = load_pose(tmp_path / "pose.npz")
    assert (back.character, back.pose, list(back.vertices)) == ("teen", 1, ["truth", "coarse", "neutral"])
    for label, vertices in record.vertices.items():
        np.testing.assert_allclose(back.vertices[label], vertices, atol=1e-3)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    assert back.props[0][0] == "eye" and back.props[0][3] == (250, 250, 245)
    assert back.props[1][3] == (51, 0, 255)
    np.testing.assert_array_equal(back.props[2][3], props[2][3])


def test_the_same_record_gives_the_same_bytes(tmp_path):
    mesh = sheet()
    record = PoseRecord("teen", 0, mesh.neutral, mesh.faces, {"truth": mesh.neutral + 1})
    for name in ("a.npz", "b.npz"):
        save_pose(tmp_path / name, record)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.npz"]


@pytest.mark.parametrize("content", [b"", b"no npz", b"PK\x03\x04 cut off"])
def test_a_file_that_is_no_pose_is_named(tmp_path, content):
    path = tmp_path / "table2_pose_teen.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match="found no pose"):
        load_pose(path)
    with pytest.raises(InputError, match="make table2"):
        load_pose(tmp_path / "missing.npz")
