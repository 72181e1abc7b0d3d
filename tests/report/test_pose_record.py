"""The pose that figures show: the same after a trip to disk, to a micrometre."""

import numpy as np
import pytest
from plane import flat_grid

from replicate.base.exceptions import InputError
from replicate.report.pose_record import PoseRecord, load_pose, save_pose

TENT = np.float32([[0, -10, 0], [0, 10, 0], [-10, 0, 0], [10, 0, 0]])
TENT_FACES = np.int32([[0, 1, 2], [1, 0, 3]])


def sheet() -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices of a flat sheet, 35 mm wide, and its faces."""
    return flat_grid(5 * np.arange(8), 5 * np.arange(8))


def test_a_record_comes_back_from_disk_to_a_micrometre(tmp_path):
    neutral, faces = sheet()
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(64, 3)).astype(np.float32) * 10
    props = [("eye", TENT, TENT_FACES, (250.0, 250.0, 245.0)), ("brow", TENT, TENT_FACES, (0.2, 0.0, 1.0))]
    props.append(("iris", TENT, TENT_FACES, np.arange(TENT.size, dtype=np.uint8).reshape(TENT.shape)))
    truth = neutral + offsets
    pose_vertices = {"truth": truth, "coarse": truth + np.float32(0.25), "neutral": neutral}
    region = np.int8(np.arange(len(faces)) % 3 - 1)
    record = PoseRecord(
        "teen", 1, neutral, faces, pose_vertices, tuple(props), "worst", "refined", ("eyes", "mouth"), region
    )
    save_pose(tmp_path / "pose.npz", record)
    back = load_pose(tmp_path / "pose.npz")
    assert (back.character, back.pose, list(back.vertices)) == ("teen", 1, ["truth", "coarse", "neutral"])
    for label, vertices in record.vertices.items():
        np.testing.assert_allclose(back.vertices[label], vertices, atol=1e-3)
    np.testing.assert_array_equal(back.faces, faces)
    assert (back.choice, back.ranked_by, back.region_names) == ("worst", "refined", ("eyes", "mouth"))
    np.testing.assert_array_equal(back.region, region)
    assert back.props[0][0] == "eye" and back.props[0][3] == (250, 250, 245)
    assert back.props[1][3] == (51, 0, 255)
    np.testing.assert_array_equal(back.props[2][3], props[2][3])


def test_without_regions_no_face_has_one(tmp_path):
    neutral, faces = sheet()
    save_pose(tmp_path / "pose.npz", PoseRecord("teen", 0, neutral, faces, {"truth": neutral}))
    back = load_pose(tmp_path / "pose.npz")
    assert back.choice == "folded" and back.region_names == () and (back.region == -1).all()


def test_the_same_record_gives_the_same_bytes(tmp_path):
    neutral, faces = sheet()
    record = PoseRecord("teen", 0, neutral, faces, {"truth": neutral + 1})
    for name in ("a.npz", "b.npz"):
        save_pose(tmp_path / name, record)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.npz"]


@pytest.mark.parametrize("content", [b"", b"no npz", b"PK\x03\x04 cut off"])
def test_a_file_that_is_no_pose_is_named(tmp_path, content):
    path = tmp_path / "table2_pose_teen.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match="expected a pose"):
        load_pose(path)
    with pytest.raises(InputError, match="make table2"):
        load_pose(tmp_path / "missing.npz")
