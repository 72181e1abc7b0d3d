"""Our SSDR beside its peer: when a fit has converged, what is kept of it, and how it is shown."""

import argparse
from pathlib import Path

import numpy as np
import pytest
import trimesh

from replicate.benchmarks import bench_lbs as bench
from replicate.benchmarks import dem_bones
from replicate.report.results import Row, read_results


def test_a_fit_ends_when_its_last_iterations_gain_next_to_nothing():
    course, iteration = bench.Course([], []), 0
    while course.go_on(iteration, float(iteration), 1.0 + 0.9**iteration):
        iteration += 1
    gain = 1 - course.rmse[-1] / course.rmse[-1 - bench.WINDOW]
    assert bench.LEAST < iteration < bench.MOST and 0 < gain < bench.LEAST_GAIN
    assert course.time_to(1.5) == 7 and course.time_to(0.9) == float("inf")


def test_a_fit_that_keeps_gaining_goes_on_to_the_most():
    course, iteration = bench.Course([], []), 0
    while course.go_on(iteration, 0.0, 0.9**iteration):
        iteration += 1
    assert iteration == bench.MOST


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


def wave() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sheet that two bones fold, and its poses."""
    x, y = np.meshgrid(np.arange(12.0), np.arange(8.0))
    neutral = np.stack([10 * x.ravel(), 10 * y.ravel(), 0 * x.ravel()], 1).astype(np.float32)
    a = (np.arange(7)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 13], 1), np.stack([a, a + 13, a + 12], 1)]).astype(np.int32)
    angles = np.random.default_rng(3).uniform(-1, 1, 20)
    share = np.clip(neutral[:, 0] / 40 - 1, 0, 1)
    poses = np.repeat(neutral[None], 20, 0)
    poses[:, :, 2] += angles[:, None].astype(np.float32) * share * (neutral[:, 0] - 55)
    return neutral, poses.astype(np.float32), faces


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
    neutral, poses, faces = wave()
    skin, own_start = dem_bones.fit(neutral, poses, faces, 2, options, lambda iteration, seconds, rmse: iteration < 3)
    assert own_start == 1 and skin.bones == bones


def test_our_clusters_move_as_the_peer_wants_its_bones():
    neutral, poses, _ = wave()
    blocks = dem_bones.cluster_motions(neutral, poses, 4).reshape(len(poses), 4, 4, 4)
    points = np.concatenate([neutral, np.ones((len(neutral), 1))], 1)
    positions = np.einsum("fibj,nj->fbni", blocks, points)
    np.testing.assert_allclose(positions[..., 3], 1)
    error = np.linalg.norm(positions[..., :3] - poses[:, None], axis=-1)
    one = np.linalg.norm(poses - neutral, axis=-1)
    assert np.sqrt((error.min(1) ** 2).mean()) < 0.2 * np.sqrt((one**2).mean()), "a vertex has a bone that carries it"


def test_ours_is_fitted_as_the_library_fits():
    from replicate.approximation.skinning.ssdr import fit
    from replicate.engine.stage import stream_rng

    neutral, poses, faces = wave()
    course = bench.Course([], [])
    course.go_on = lambda iteration, seconds, rmse: (course.rmse.append(rmse), iteration < 6)[1]
    skin = bench.fit_ours(neutral, poses, faces, 3, 0, course)
    same = fit(neutral, poses, 3, stream_rng(0, "lbs", "sketch"), iterations=6, faces=faces)
    np.testing.assert_array_equal(skin.dense_weights(), same.dense_weights())
    errors = bench.held_out(skin, poses, faces)
    motion = np.sqrt(((poses - neutral) ** 2).sum(-1).mean())
    assert 0 < errors["rmse"] <= course.rmse[-1] + 0.005 * motion, (
        "refitted bones are about as good as those of the fit"
    )
    assert errors["mean"] <= errors["rmse"] <= errors["max"]


def test_the_training_error_is_that_of_the_skinned_poses():
    from replicate.approximation.skinning.alternation import Problem, dense
    from replicate.approximation.skinning.bones import weighted_points
    from replicate.approximation.skinning.compression import compress
    from replicate.approximation.skinning.edge_metric import edge_metric
    from replicate.approximation.skinning.first_skin import start

    neutral, poses, faces = wave()
    data = compress(neutral, poses, np.random.default_rng(0))
    state = start(Problem(data, edge_metric(data.points[:, :3], faces, 0.1)), 3, 8)
    spread = weighted_points(data.points, dense(state.bone_index, state.weights, 3))
    moved = np.einsum("nj,fcj->fnc", spread, state.motion.reshape(len(poses), 3, -1)) * data.radius_mm
    exact = np.sqrt(((moved - (poses - neutral)) ** 2).sum(-1).mean())
    assert bench.training_rmse(data, state) == pytest.approx(exact, rel=1e-4)


def fit_facts(rmse: float, course: list[float]) -> dict:
    errors = {"rmse": rmse, "mean": rmse / 2, "normal": 2.0, "max": 9.0}
    return errors | {"seconds": [float(k) for k in range(len(course))], "rmse_course": course, "peak_mb": 100.0}


def append_fit(file: Path, method: str, seed: int, rmse: float, course: list[float], **more: float) -> list[Row]:
    """Put a fit of teen's 16 bones into the file; Dem Bones came to 1 mm. Return all rows."""
    facts = fit_facts(rmse, course) | more
    bench._keep(file, bench.rows_of("teen", method, 16, seed, "rig-1", facts, 1.0, 9))
    return read_results(file)


def lines(rows: list[Row]) -> dict[str, tuple[str, ...]]:
    return {line[0]: line[1:] for line in bench.lbs_table(rows, "teen").body if line}


@pytest.fixture
def both(tmp_path) -> Path:
    """A file with a fit of ours and one of the peer for each of two seeds."""
    file = tmp_path / "bench_lbs.csv"
    for seed, ours in ((0, 0.9), (1, 0.8)):
        append_fit(file, "dem_bones", seed, 1.0, [3.0, 2.0, 1.0])
        append_fit(file, "ssdr", seed, ours, [3.0, 1.0, 0.5])
    return file


def test_what_a_file_lacks_is_fitted_the_peer_first(tmp_path):
    file, options = tmp_path / "bench_lbs.csv", argparse.Namespace(bones=[16], methods=["ssdr", "dem_bones"])
    assert bench._missing(file, "teen", "rig-1", 0, options) == [(16, "dem_bones"), (16, "ssdr")]
    append_fit(file, "dem_bones", 0, 1.0, [3.0, 2.0, 1.0])
    assert bench._missing(file, "teen", "rig-1", 0, options) == [(16, "ssdr")]
    assert bench._peer_error(file, "teen", "rig-1", 16, 0) == 1 and bench._peer_error(file, "teen", "rig-2", 16, 0) == 0
    append_fit(file, "ssdr", 0, 0.9, [3.0, 1.0, 0.5])
    assert bench._missing(file, "teen", "rig-1", 0, options) == []
    assert bench._missing(file, "teen", "rig-2", 0, options), "another rig's numbers don't count"
    bench._keep(file, bench.rows_of("teen", "ssdr", 16, 0, "rig-2", fit_facts(0.5, [1.0]), 0.0, 9))
    assert {row.run for row in read_results(file)} == {"rig-2"}


def test_the_time_to_equal_error_ends_where_the_peers_error_is_reached(both):
    value = {(row.method, row.metric): row.value for row in read_results(both)}
    assert value["ssdr", "time_to_dem_bones_error[16, seed 0]"] == 1000
    assert value["dem_bones", "time_to_dem_bones_error[16, seed 0]"] == 2000


def test_a_line_has_means_over_seeds_and_ratios_have_the_spread_of_theirs(both):
    rows = read_results(both)
    table = lines(rows)
    assert list(table) == ["ours, 16 bones", "Dem Bones, 16 bones", "ours / Dem Bones, 16 bones"]
    assert table["ours / Dem Bones, 16 bones"][0] == "0.85 ± 0.07" and table["ours, 16 bones"][0] == "0.85"
    (note,) = bench.lbs_table(rows, "teen").notes
    assert "means over 2 seeds" in note and "brackets" not in note and "own start" not in note


def test_a_line_of_fewer_seeds_and_a_number_of_fewer_than_its_line_say_so(both):
    rows = append_fit(both, "dem_bones_default", 1, 2.0, [3.0, 2.0])
    assert "Dem Bones, as it comes, 16 bones (1 of 2 seeds)" in lines(rows) and "Dem Bones, 16 bones" in lines(rows)
    assert "brackets" not in bench.lbs_table(rows, "teen").notes[0]
    append_fit(both, "ssdr_sparse", 0, 1.0, [3.0, 1.0])
    rows = append_fit(both, "ssdr_sparse", 1, 1.0, [3.0, 2.0])
    sparse = lines(rows)["ours, sparse from the start, 16 bones"]
    assert "1.0 (1)" in sparse, "only one seed came to Dem Bones' error"
    assert "brackets" in bench.lbs_table(rows, "teen").notes[0]
    partial = [r for r in rows if not (r.method == "dem_bones" and "seed 0" in r.metric)]
    assert "ours / Dem Bones, 16 bones (1 of 2 seeds)" in lines(partial)


def test_a_peer_that_got_our_clusters_is_told(both):
    rows = append_fit(both, "dem_bones", 0, 1.0, [3.0, 2.0, 1.0], bones_of_own_start=3)
    assert "(3 of 16)" in bench.lbs_table(rows, "teen").notes[0]


def test_without_the_peer_a_sentence_says_how_to_get_it(capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "py_dem_bones._py_dem_bones", None)
    assert bench.main(["--characters", "tiny"]) == 2
    assert "pip install py-dem-bones" in capsys.readouterr().err
