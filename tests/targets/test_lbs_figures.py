"""The pictures of linear blend skinning: colours are weights, lines are errors, floors are below them."""

import json

import numpy as np
import pytest
from plain_rig import PlainRig
from small_face import pose_offsets, small_mesh

from replicate.baselines.skinning import ssdr as lbs
from replicate.targets.lbs import DEEP, PALE, bone_colours, lbs_table, measured_lines, save_all, weight_colours

BONES = (2, 4, 8)


@pytest.fixture(scope="module")
def fit_set():
    mesh = small_mesh()
    rng = np.random.default_rng(4)
    training, test = (
        mesh.neutral + pose_offsets(mesh, rng.uniform(-1, 1, (count, 12)).astype(np.float32)) for count in (60, 24)
    )
    fits = {
        b: lbs.fit(mesh.neutral, training, b, np.random.default_rng(0), iterations=8, faces=mesh.faces) for b in BONES
    }
    return mesh, fits, training, test


def test_a_vertex_of_one_bone_has_its_colour_and_others_mix(fit_set):
    mesh, fits, _, _ = fit_set
    skin = fits[4]
    alone, mixed = np.eye(4)[[0, 1, 2, 3]], np.array([[0.5, 0.5, 0, 0]])
    weights = np.concatenate([alone, mixed]).astype(np.float32)
    index = np.tile(np.int32([0, 1, 2, 3]), (5, 1))
    colours = bone_colours(lbs.Skin(mesh.neutral[:5], index, weights, 4)).astype(int)
    assert len({tuple(c) for c in colours[:4]}) == 4
    light = (colours[:2] / 255) ** 2.2
    assert np.abs(colours[4] - 255 * light.mean(0) ** (1 / 2.2)).max() <= 1
    assert bone_colours(skin).shape == (len(mesh.neutral), 3)
    ends = weight_colours(np.array([0.0, 1.0]))
    assert tuple(ends[0]) == PALE and tuple(ends[1]) == DEEP


def test_lines_are_errors_of_refitted_skins_and_floors_lie_below(fit_set):
    mesh, fits, _, test = fit_set
    lines = measured_lines(mesh, fits, test)
    assert [line[0] for line in lines] == sorted(BONES) and {line[1] for line in lines} == {24}
    bones, _, rmse, mean, _, floor, _ = lines[0]
    distance = np.linalg.norm(fits[bones].deform(*lbs.refit(fits[bones], test)) - test, axis=-1)
    assert mean == pytest.approx(distance.mean(), rel=1e-4) and rmse == pytest.approx(
        np.sqrt((distance**2).mean()), rel=1e-4
    )
    offsets = (test - mesh.neutral).transpose(0, 2, 1).reshape(72, -1).astype(float)
    remainder = np.linalg.svd(offsets, compute_uv=False)[4 * bones :]
    assert floor == pytest.approx(np.sqrt((remainder**2).sum() / (24 * len(mesh.neutral))), rel=1e-3)
    assert all(line[5] < line[2] for line in lines)


class MeshAlone(PlainRig):
    name, controls = "small", ()

    def __init__(self, mesh):
        self.mesh = mesh

    def __call__(self, params):
        return self.mesh.neutral


def test_all_pictures_are_saved_with_their_words_and_numbers(fit_set, tmp_path):
    mesh, fits, training, test = fit_set
    rig = MeshAlone(mesh)
    save_all(rig, fits, training, test, test[3], 25.0, tmp_path / "lbs_small")
    names = [f"lbs_small_{name}" for name in ("1_weights", "2_bones", "3_curve", "4_wrinkles")]
    assert sorted(p.stem for p in tmp_path.glob("*.png")) == names
    words = json.loads((tmp_path / "lbs_small_3_curve.json").read_text())
    assert "from 0 to 25 degrees" in json.loads((tmp_path / "lbs_small_4_wrinkles.json").read_text())["alt"]
    lines = measured_lines(mesh, fits, test)
    assert f"{lines[0][2]:.2f} mm" in words["caption"] and f"{lines[-1][4]:.2f}°" in words["alt"]
    table = lbs_table(tmp_path / "lbs_small.csv", "small")
    assert [row[0] for row in table.body] == ["2", "4", "8"] and table.body[0][1] == f"{lines[0][2]:.2f}"
