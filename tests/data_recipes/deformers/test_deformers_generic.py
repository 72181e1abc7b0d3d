"""The deformers that know nothing of faces: saturation, pose curves, slide, handles, jaw, mush, head shape, teeth."""

import jax
import jax.numpy as jnp
import numpy as np
from plane import plane

from data_recipes.deformers import flesh, handles, head_shape, jaw, pose_curves, rigid_teeth, skull_slide
from data_recipes.deformers.jaw import JawMotion
from data_recipes.deformers.node_chain import add_rows, place_of, rows_at, spread
from data_recipes.deformers.pose_curves import limits, saturate
from data_recipes.deformers.surface_operators import adjacency

RNG = np.random.default_rng(5)


def test_saturation_is_the_identity_at_small_values_and_never_passes_its_limit():
    limit = limits(np.array([0.0, -1.0]), np.array([1.0, 1.0]), np.zeros(2))
    u = saturate(limit, jnp.array([[0.5, -0.5], [3.0, -3.0], [-3.0, 300.0], [0.0, 0.0]]))
    np.testing.assert_allclose(u[0], [0.5, -0.5], rtol=1e-3)
    assert (np.abs(u) < 1.3).all()
    assert -0.16 < u[2, 0] < 0  # a one-sided control gives way only a little
    np.testing.assert_allclose(jax.jacfwd(lambda p: saturate(limit, p[None])[0])(jnp.zeros(2)), np.eye(2), atol=1e-6)


def test_spread_undoes_the_choice_of_a_support():
    support = np.array([4, 1, 7])
    values = spread(jnp.array([[1.0, 2.0, 3.0]]), place_of(support, 9))
    np.testing.assert_array_equal(values[0], [0, 2, 0, 0, 1, 0, 0, 3, 0])


def test_rows_of_a_support_are_its_positions_and_come_back_to_their_vertices():
    support, x = np.array([4, 1, 7]), RNG.normal(size=(2, 3, 9)).astype(np.float32)
    rows = rows_at(x, support)
    np.testing.assert_array_equal(rows, x[:, :, support].transpose(2, 1, 0))
    doubled = x.copy()
    doubled[:, :, support] *= 2
    np.testing.assert_allclose(add_rows(x, rows, place_of(support, 9)), doubled)


def test_a_pose_path_passes_through_its_half_and_full_pose():
    half, full = RNG.normal(size=(2, 20, 3))
    fields = pose_curves.PoseFields(20)
    fields.add_path(1, half, full)
    constants = fields.constants(3)
    u = jnp.array([[9.0, 0.5, 9.0], [9.0, 1.0, 9.0], [9.0, 0.0, 9.0]])
    moved = pose_curves.move(constants, u).transpose(0, 2, 1)
    np.testing.assert_allclose(moved, np.stack([half, full, np.zeros((20, 3))]), atol=1e-5)


def test_a_combination_corrective_acts_only_when_all_its_controls_do():
    fields = pose_curves.PoseFields(4)
    fields.add((0, 2), np.ones((4, 3)))
    moved = pose_curves.move(fields.constants(3), jnp.array([[1.0, 1, 0], [0.5, 0, 0.4]]))
    np.testing.assert_allclose(moved[:, 0, 0], [0, 0.2], rtol=1e-6)


def test_blocks_of_vertices_add_up_to_all_fields_and_leave_the_rest_of_the_face_alone():
    vectors = RNG.normal(size=(9, 400, 3)) * (RNG.random((9, 400, 1)) < 0.2)
    vectors[:, 300:] = 0
    fields = pose_curves.PoseFields(400)
    for column, vector in enumerate(vectors):
        fields.add((column,), vector)
    constants = fields.constants(9)
    u = RNG.normal(size=(5, 9)).astype(np.float32)
    moved = np.asarray(pose_curves.move(constants, jnp.asarray(u)))
    np.testing.assert_allclose(moved, np.einsum("bk,knc->bcn", u, vectors), atol=1e-5)
    assert len(constants["blocks"]) > 1 and not moved[:, :, 300:].any()


def test_a_face_without_fields_stays_as_it_is():
    moved = pose_curves.move(pose_curves.PoseFields(6).constants(2), jnp.ones((3, 2)))
    assert moved.shape == (3, 3, 6) and not np.any(moved)


def test_skin_that_slides_over_a_sphere_stays_on_it():
    radius = 80.0
    directions = RNG.normal(size=(50, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radius
    constants = skull_slide.prepare(lambda p: np.linalg.norm(p, axis=1) - radius, points, np.ones(50))
    tangent = np.cross(points, RNG.normal(size=3)) / radius
    tangent *= 15 / np.linalg.norm(tangent, axis=1, keepdims=True)
    offset = jnp.asarray(tangent.T[None], jnp.float32)
    moved = points + np.asarray(offset + skull_slide.slide(constants, offset))[0].T
    before = np.linalg.norm(points + tangent, axis=1) - radius
    after = np.linalg.norm(moved, axis=1) - radius
    assert before.min() > 1.3
    assert np.abs(after).max() < 0.03
    np.testing.assert_array_equal(skull_slide.slide(constants, jnp.zeros_like(offset)), 0)


def test_handles_interpolate_their_displacements_and_leave_the_far_alone():
    points = np.concatenate([RNG.uniform(0, 50, (60, 3)), [[300.0, 0, 0]]])
    vertices = np.array([3, 9, 27])
    constants = handles.prepare(
        points, vertices, 40.0, np.ones(61), np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8]]), np.full((3, 3), 5.0)
    )
    p = RNG.uniform(-1, 1, (2, 9)).astype(np.float32)
    moved = handles.move(constants, jnp.asarray(p))
    np.testing.assert_allclose(moved[:, :, vertices].transpose(0, 2, 1), 5 * p.reshape(2, 3, 3), atol=1e-4)
    np.testing.assert_array_equal(moved[:, :, -1], 0)


def test_turning_by_a_rotation_vector_agrees_with_the_matrix_exponential():
    from scipy.linalg import expm

    r, v = RNG.normal(size=(2, 3)) * np.array([[0.4], [10]])
    skew = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    vectors = jaw.turn(jnp.asarray(v)[None, :, None], jnp.asarray(r)[None, :, None])[0, :, 0]
    np.testing.assert_allclose(vectors, expm(skew) @ v, atol=1e-4)


def test_the_jaw_moves_its_vertices_rigidly_and_half_weights_turn_half_way():
    points = jnp.asarray(RNG.normal(size=(1, 3, 6)) * 40, jnp.float32)
    constants = jaw.prepare(np.array([0, 0, 1, 1, 1, 0.5]), np.array([0, -14.0, 2]))
    motion = JawMotion(jnp.array([[0.4, 0.1, -0.05]]), jnp.array([[1.0, -2, 3]]))
    moved = np.asarray(jaw.open_jaw(constants, points, motion))
    np.testing.assert_array_equal(moved[0, :, :2], points[0, :, :2])
    length = lambda x: np.linalg.norm(x[0, :, 2] - x[0, :, 3])  # noqa: E731
    np.testing.assert_allclose(length(moved), length(np.asarray(points)), rtol=1e-5)
    back = jaw.undo_jaw(constants["pivot"], jnp.asarray(moved[:, :, 2:5]), motion)
    np.testing.assert_allclose(back, points[:, :, 2:5], atol=1e-4)
    half = JawMotion(motion.rotation / 2, motion.translation / 2)
    whole = jaw.prepare(np.ones(6), constants["pivot"])
    np.testing.assert_allclose(moved[0, :, 5], jaw.open_jaw(whole, points, half)[0, :, 5], atol=1e-4)


def test_delta_mush_keeps_a_rigidly_moved_rest_pose_and_evens_out_a_spike():
    vertices, faces = plane(14, 14)
    vertices[:, 2] = 0.5 * np.sin(vertices[:, 0])
    graph = adjacency(faces, len(vertices))
    constants = flesh.prepare(vertices, faces, graph, np.ones(len(vertices)))
    rest = jnp.asarray(vertices.T[None], jnp.float32)
    np.testing.assert_allclose(flesh.mush(constants, rest), rest, atol=1e-5)
    spin = jnp.broadcast_to(jnp.array([0.3, -0.5, 0.2])[None, :, None], rest.shape)
    turned = jaw.turn(rest, spin) + 7.0
    np.testing.assert_allclose(flesh.mush(constants, turned), turned, atol=1e-4)
    spiked = rest.at[0, 2, 7 * 14 + 7].add(3.0)
    assert float(jnp.abs(flesh.mush(constants, spiked) - rest).max()) < 1.5


SHAPE = head_shape.prepare(-115.0, 0.0, -64.0, np.array([0, -88.0, 70]), np.array([40, -30.0, 60]), 0.0)


def shape_values(**amounts: float) -> head_shape.ShapeValues:
    names = head_shape.ShapeValues.__dataclass_fields__
    return head_shape.ShapeValues(**{name: jnp.full((1, 1), amounts.get(name, 0.0)) for name in names})


def test_the_head_shape_is_the_identity_at_zero_and_squash_keeps_volume():
    points = jnp.asarray(RNG.uniform(-90, 90, (1, 3, 200)), jnp.float32)
    np.testing.assert_allclose(head_shape.warp(SHAPE, shape_values(), points), points, atol=1e-4)
    values = shape_values(squash=1.0)
    spot = jnp.array([10.0, 40, 30])
    jacobian = jax.jacfwd(lambda q: head_shape.warp(SHAPE, values, q[None, :, None])[0, :, 0])(spot)
    np.testing.assert_allclose(jnp.linalg.det(jacobian), 1.0, atol=0.02)
    assert head_shape.warp(SHAPE, values, spot[None, :, None])[0, 1, 0] < 20


def test_no_head_control_turns_space_inside_out_at_its_limits():
    names = list(head_shape.ShapeValues.__dataclass_fields__)
    points = jnp.asarray(RNG.uniform([-90, -190, -110], [90, 130, 120], (400, 3)), jnp.float32)

    @jax.jit
    def moved_and_volume(setting):
        values = head_shape.ShapeValues(*(v[None, None] for v in setting))
        one = lambda q: head_shape.warp(SHAPE, values, q[None, :, None])[0, :, 0]  # noqa: E731
        return jax.vmap(one)(points), jnp.linalg.det(jax.vmap(jax.jacfwd(one))(points))

    for k, name in enumerate(names):
        for value in (-1.3, 1.3):
            moved, volume = moved_and_volume(jnp.zeros(len(names)).at[k].set(value))
            assert float(volume.min()) > 0.2, name
            assert float(jnp.abs(moved - points).max()) > 1.0, name


def test_the_polar_rotation_is_the_nearest_one():
    matrix = np.eye(3) + 0.3 * RNG.normal(size=(3, 3))
    u, _, v = np.linalg.svd(matrix)
    np.testing.assert_allclose(rigid_teeth.polar_rotation(jnp.asarray(matrix)), u @ v, atol=1e-5)


def test_teeth_stay_rigid_to_a_micrometre_under_jaw_and_squash():
    points = RNG.normal(size=(30, 3)) * 5 + np.array([0, -60, 70])
    x = jnp.asarray(points.T[None], jnp.float32)
    groups = [np.arange(10), np.arange(10, 20)]
    constants = rigid_teeth.prepare(points, groups, [False, True], np.array([0, -14.0, 2]))
    motion = JawMotion(jnp.array([[0.4, 0.05, 0]]), jnp.array([[0.0, 0, 3]]))
    values = shape_values(squash=1.0, bend_sideways=0.7, twist=-1.0)
    placed = np.asarray(rigid_teeth.place_teeth(constants, x, motion, lambda q: head_shape.warp(SHAPE, values, q)))[0].T
    for group in groups:
        before = np.linalg.norm(points[group][:, None] - points[group][None], axis=2)
        after = np.linalg.norm(placed[group][:, None] - placed[group][None], axis=2)
        assert np.abs(before - after).max() < 1e-3
    np.testing.assert_array_equal(placed[20:], np.asarray(x)[0].T[20:])
    assert np.linalg.norm(placed[10:20] - points[10:20], axis=1).min() > 5
