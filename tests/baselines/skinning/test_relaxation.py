"""What a fit does before its supports are sparse, and how they become so."""

import numpy as np
import pytest
from skinned_sheets import wrinkled_sheet

from replicate.baselines.skinning.alternation import dense
from replicate.baselines.skinning.compression import compress
from replicate.baselines.skinning.ssdr import fit, refit
from replicate.baselines.skinning.starts import alternation, sparsify

BONES, INFLUENCES = 6, 2


@pytest.fixture(scope="module")
def course():
    neutral, poses, faces = wrinkled_sheet()
    return alternation(compress(neutral, poses, np.random.default_rng(0)), faces, 0.1, INFLUENCES, 8)


def test_all_bones_may_act_until_the_last_relaxed_iteration(course):
    state = course.start(BONES)
    counts = []
    for _ in range(course.relaxed + 1):
        counts.append(np.count_nonzero(dense(state.bone_index, state.weights, BONES), axis=1).max())
        state = course.step(state)
    assert max(counts[1:-1]) > INFLUENCES and counts[-1] == INFLUENCES
    assert state.weights.shape[1] == INFLUENCES and state.iteration == course.relaxed + 1
    np.testing.assert_allclose(state.weights.sum(1), 1)


def test_a_vertex_keeps_the_bones_that_its_surroundings_use_most(course):
    state = course.start(BONES)
    for _ in range(course.relaxed - 1):
        state = course.step(state)
    alone = np.zeros((len(state.weights), BONES))  # one vertex alone uses other bones than all the rest
    alone[:, :2] = 0.5
    odd = len(alone) // 2 + 8
    alone[odd] = [0, 0, 0.5, 0.5, 0, 0]
    everywhere = np.tile(np.arange(BONES), (len(alone), 1))
    result = sparsify(course.plain, type(state)(**vars(state) | {"bone_index": everywhere, "weights": alone}), 2)
    assert set(result.bone_index[odd]) == {0, 1} and set(result.bone_index[odd + 1]) == {0, 1}
    np.testing.assert_allclose(result.weights.sum(1), 1)
    assert result.energy == np.inf and result.beta == 0


def test_without_relaxation_supports_are_sparse_from_the_start(course):
    plain = type(course)(course.stiff, course.plain, INFLUENCES, 0)
    state = plain.start(BONES)
    assert state.weights.shape[1] == INFLUENCES
    assert plain.step(state).weights.shape[1] == INFLUENCES


def test_a_relaxed_start_ends_with_smaller_errors():
    neutral, poses, faces = wrinkled_sheet(bones=8)
    errors = []
    for relaxed in (0, 40):
        skin = fit(neutral, poses, 6, np.random.default_rng(0), 3, 30, faces=faces, relaxed=relaxed)
        assert np.count_nonzero(skin.weights, axis=1).max() <= 3
        errors.append(float(np.sqrt(((skin.deform(*refit(skin, poses)) - poses) ** 2).sum(-1).mean())))
    assert errors[1] < errors[0]


def test_as_many_influences_as_bones_and_one_bone_are_fitted_too():
    neutral, poses, faces = wrinkled_sheet(side=6)
    for bones, influences in ((1, 8), (3, 8), (3, 3), (3, 1)):
        skin = fit(neutral, poses, bones, np.random.default_rng(0), influences, 3, faces=faces, relaxed=3)
        assert skin.weights.shape[1] == influences and np.isfinite(skin.weights).all()
        np.testing.assert_allclose(skin.weights.sum(1), 1, rtol=1e-6)
        assert set(skin.bone_index[skin.weights > 0]) == set(range(bones))
