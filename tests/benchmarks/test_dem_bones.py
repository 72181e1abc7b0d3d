"""Dem Bones as a peer: parts that are linked, bones that it is given, and the skin that it ends with."""

import numpy as np
import pytest
import trimesh
from skinned_sheets import folded_sheet

from replicate.benchmarks import dem_bones


def test_links_make_one_part_of_several():
    boxes = [trimesh.creation.box((10, 10, 10)) for _ in range(4)]
    for k, box in enumerate(boxes):
        box.apply_translation((14.0 * k, k**2, 0))
    whole = trimesh.util.concatenate(boxes)
    pairs = dem_bones.links(np.asarray(whole.vertices), np.asarray(whole.faces))
    links = {frozenset((int(a) // 8, int(b) // 8)) for a, b in pairs}
    assert links == {frozenset((k, k + 1)) for k in range(3)}, "each part to its nearest"
    one = trimesh.creation.box((10, 10, 10))
    assert len(dem_bones.links(np.asarray(one.vertices), np.asarray(one.faces))) == 0


def test_a_skin_of_dense_weights_keeps_the_largest_eight():
    weights = np.random.default_rng(0).dirichlet(np.full(12, 0.2), size=30)
    weights[np.arange(30)[:, None], np.argsort(weights, 1)[:, :4]] = 0
    weights /= weights.sum(1, keepdims=True)
    skin = dem_bones.skin_of(np.zeros((30, 3), np.float32), weights)
    assert skin.weights.shape == (30, 8) and skin.bones == 12
    np.testing.assert_allclose(skin.dense_weights(), weights, atol=1e-6)


class FakeSolver:
    """Stands in for Dem Bones: its own start finds one bone, and weights follow the clusters that it is given."""

    m = None

    def init(self):
        self.nB = 1 if self.m is None else self.m.shape[1] // 4

    def rmse(self):
        return 1.0

    def computeTranformations(self):
        pass

    computeWeights = computeTranformations

    def get_weights(self):
        return np.full((self.nB, self.nV), 1 / self.nB)


@pytest.mark.parametrize(("options", "bones"), [(dem_bones.BEST, 2), (dem_bones.DEFAULT, 1)])
def test_where_its_start_finds_too_few_bones_the_peer_starts_from_our_clusters(monkeypatch, options, bones):
    monkeypatch.setattr(dem_bones, "solver_class", lambda: FakeSolver)
    neutral, poses, faces = folded_sheet()
    skin, own_start = dem_bones.fit(neutral, poses, faces, 2, options, lambda iteration, seconds, rmse: iteration < 3)
    assert own_start == 1 and skin.bones == bones


def test_our_clusters_move_as_the_peer_wants_its_bones():
    neutral, poses, _ = folded_sheet()
    blocks = dem_bones.cluster_motions(neutral, poses, 4).reshape(len(poses), 4, 4, 4)
    points = np.concatenate([neutral, np.ones((len(neutral), 1))], 1)
    positions = np.einsum("fibj,nj->fbni", blocks, points)
    np.testing.assert_allclose(positions[..., 3], 1)
    error = np.linalg.norm(positions[..., :3] - poses[:, None], axis=-1)
    one = np.linalg.norm(poses - neutral, axis=-1)
    assert np.sqrt((error.min(1) ** 2).mean()) < 0.2 * np.sqrt((one**2).mean()), "a vertex has a bone that carries it"
