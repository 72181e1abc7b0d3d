"""Which control moves what, by samples alone: right where effects add up, and deaf to noise."""

from dataclasses import replace

import numpy as np

from replicate.approximation.influence import estimate_influence
from replicate.approximation.samples import SampleSet, quantise

N, M, POSES = 40, 6, 800


def samples(noise_mm: float) -> tuple[SampleSet, np.ndarray]:
    """Return samples of curved effects with noise, and the truth; control 5 does nothing, 0 works by its square."""
    generator = np.random.default_rng(1)
    truth = generator.random((N, M)) < 0.4
    truth[:, 5] = False
    params = generator.uniform(-1, 1, (POSES, M)) * (generator.random((POSES, M)) < 0.6)
    straight = generator.uniform(0.5, 2, (N, M, 3)) * truth[:, :, None]
    curved = generator.uniform(0.5, 2, (N, M, 3)) * truth[:, :, None]
    straight[:, 0] = 0
    offsets = np.einsum("bm,nmc->bnc", params, straight) + np.einsum("bm,nmc->bnc", params**2, curved)
    offsets += generator.normal(0, noise_mm, offsets.shape)
    whole, steps = quantise(offsets.astype(np.float32))
    nothing = np.zeros((0, M))
    return SampleSet(params.astype(np.float32), whole, steps, nothing, nothing, nothing, nothing, nothing, {}), truth


def test_controls_whose_effects_add_up_are_told_apart():
    found, truth = samples(0.0)
    np.testing.assert_array_equal(estimate_influence(found, np.zeros(M), np.random.default_rng(0)), truth)


def test_noise_is_no_influence():
    found, truth = samples(0.3)
    estimate = estimate_influence(found, np.zeros(M), np.random.default_rng(0))
    assert (estimate & truth).sum() >= 0.97 * truth.sum() and (estimate & ~truth).sum() <= 0.05 * (~truth).sum()


def test_effects_are_measured_from_the_defaults():
    found, truth = samples(0.0)
    found = replace(found, params=found.params + np.float32(0.5))
    np.testing.assert_array_equal(estimate_influence(found, np.full(M, 0.5), np.random.default_rng(0)), truth)
