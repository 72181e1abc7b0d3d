"""Wrinkles: no strain, no fold; a known compression, the known amplitude."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from plane import plane

from data_recipes.deformers import wrinkles
from data_recipes.deformers.node_chain import rows_at
from data_recipes.deformers.surface_operators import vertex_normals


def region(vertices: np.ndarray, wavelength: float = 6.0) -> wrinkles.Region:
    n = len(vertices)
    return wrinkles.Region(
        name="patch",
        vertices=np.arange(n),
        fibre=np.tile([0.0, 1.0, 0.0], (n, 1)),
        wavelength_mm=np.full(n, wavelength),
        pattern=np.ones(n),
        threshold=np.full(n, 0.012),
        gain_columns=np.array([0]),
        gain_weights=np.ones((1, n)),
    )


def compressed(vertices: np.ndarray, share: float) -> jnp.ndarray:
    return jnp.asarray((vertices * np.array([1, 1 - share, 1])).T[None], jnp.float32)


def test_at_rest_and_under_stretch_the_skin_is_exactly_smooth():
    vertices, faces = plane(12, 12)
    constants = wrinkles.prepare([region(vertices)], vertices, faces)
    for share in (0.0, -0.2):
        x = compressed(vertices, share)
        np.testing.assert_array_equal(wrinkles.wrinkle(constants, x, jnp.zeros((1, 1))), x)


def test_even_compression_is_measured_exactly_and_only_along_the_fibre():
    vertices, faces = plane(12, 12)
    constants = wrinkles.prepare([region(vertices)], vertices, faces)
    across = jnp.asarray((vertices * np.array([0.5, 1, 1])).T[None], jnp.float32)
    for x, expected in ((compressed(vertices, 0.15), 0.15), (across, 0.0)):
        measured = wrinkles.compression(constants, rows_at(x, constants["used"]))
        np.testing.assert_allclose(measured, expected, atol=1e-5)


def test_a_constant_pattern_rises_by_the_buckling_amplitude():
    vertices, faces = plane(12, 12)
    constants = wrinkles.prepare([region(vertices)], vertices, faces)
    x = compressed(vertices, 0.15)
    lift = (wrinkles.wrinkle(constants, x, jnp.zeros((1, 1))) - x)[0, 2]
    y = 0.15 - 0.012
    excess = 0.5 * (y + np.sqrt(y * y + 2e-4)) - 0.004
    np.testing.assert_allclose(lift, 6.0 / np.pi * np.sqrt(excess), rtol=1e-4)


def test_the_layer_is_the_product_of_its_dense_operators():
    vertices, faces = plane(12, 12)
    generator = np.random.default_rng(3)
    vertices = vertices + generator.normal(size=vertices.shape) * (0.1, 0.1, 0.3)
    one = dataclasses.replace(region(vertices), pattern=generator.normal(size=len(vertices)))
    posed = vertices * (1, 0.8, 1) + generator.normal(size=vertices.shape) * 0.05
    constants = wrinkles.prepare([one], vertices, faces)
    x, u = jnp.asarray(posed.T[None], jnp.float32), jnp.zeros((1, 1))
    operators = wrinkles.region_operators(one, vertices, faces)
    along = (posed[operators.corners] * operators.directional[:, :, None]).sum(axis=1)
    shorter = operators.diffuse @ (operators.average @ (1 - np.linalg.norm(along, axis=1)))
    beyond = np.asarray(wrinkles.excess(jnp.asarray(shorter)[:, None], one.threshold))[:, 0]
    height = operators.raise_ @ np.sqrt(beyond)
    assert np.abs(height).max() > 0.3
    normal = vertex_normals(posed, faces)
    np.testing.assert_allclose(wrinkles.wrinkle(constants, x, u)[0].T, posed + height[:, None] * normal, atol=2e-4)


def test_the_gain_control_switches_wrinkles_off_and_doubles_them():
    vertices, faces = plane(12, 12)
    constants = wrinkles.prepare([region(vertices)], vertices, faces)
    x = jnp.concatenate([compressed(vertices, 0.15)] * 3)
    lift = (wrinkles.wrinkle(constants, x, jnp.array([[-1.0], [0.0], [1.0]])) - x)[:, 2]
    np.testing.assert_allclose(lift[0], 0, atol=1e-6)
    np.testing.assert_allclose(lift[2], 2 * lift[1], rtol=1e-5)


def test_where_regions_overlap_heights_add_up():
    vertices, faces = plane(12, 12)
    one = region(vertices)
    other = wrinkles.Region(**{**vars(one), "name": "other", "vertices": np.arange(60), "fibre": one.fibre[:60],
                               "pattern": np.zeros(60), "wavelength_mm": np.full(60, 6.0),
                               "threshold": np.full(60, 0.012), "gain_weights": np.ones((1, 60))})  # fmt: skip
    x = compressed(vertices, 0.15)
    alone = wrinkles.wrinkle(wrinkles.prepare([one], vertices, faces), x, jnp.zeros((1, 1)))
    both = wrinkles.wrinkle(wrinkles.prepare([one, other], vertices, faces), x, jnp.zeros((1, 1)))
    np.testing.assert_allclose(both, alone, atol=1e-6)
    twice = wrinkles.prepare([one, wrinkles.Region(**{**vars(one), "name": "again"})], vertices, faces)
    np.testing.assert_allclose(wrinkles.wrinkle(twice, x, jnp.zeros((1, 1))) - x, 2 * (alone - x), atol=1e-5)


def test_the_states_of_the_regions_hold_what_the_layer_adds():
    vertices, faces = plane(12, 12)
    halves = [np.flatnonzero(vertices[:, 0] <= 6), np.flatnonzero(vertices[:, 0] >= 4)]
    whole = region(vertices)
    parts = [
        dataclasses.replace(
            whole, name=name, vertices=half, fibre=whole.fibre[half], pattern=whole.pattern[half] * scale,
            wavelength_mm=whole.wavelength_mm[half], threshold=whole.threshold[half],
            gain_weights=whole.gain_weights[:, half],
        )
        for name, half, scale in zip(("left", "right"), halves, (1.0, 0.5), strict=True)
    ]  # fmt: skip
    constants = wrinkles.prepare(parts[::-1], vertices, faces)
    x, u = compressed(vertices, 0.15), jnp.zeros((1, 1))
    states = wrinkles.region_states(constants, x, u)
    total = np.zeros(len(vertices))
    for half, (name, state) in zip(halves, states.items(), strict=True):
        np.testing.assert_array_equal(state.vertices, half, err_msg=name)
        assert abs(np.median(state.compression) - 0.15) < 1e-5  # but for corners that lie in no face of the patch
        assert abs(np.median(state.excess) - (0.15 - 0.012)) < 5e-3
        total[half] += state.height_mm
    displacement = np.asarray(wrinkles.wrinkle(constants, x, u) - x)[0]
    np.testing.assert_allclose(np.linalg.norm(displacement, axis=0), np.abs(total), atol=1e-4)
    assert total.max() > 0.1
    assert wrinkles.region_states(wrinkles.prepare([], vertices, faces), x, u) == {}
