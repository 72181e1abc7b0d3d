"""Faces of glTF files: order, places, shapes, texture coordinates, targets and joints as the format has them."""

import io

import numpy as np
import pytest
from gltf_writer import GRID, PAIR, Gltf
from PIL import Image

from data_recipes.gltf.gltf_face import read_gltf
from replicate.base.exceptions import InputError

QUARTER = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter turn about z: x to y


def read(gltf, tmp_path, name="face.glb"):
    return read_gltf(gltf.write(tmp_path / name))


def normals(face):
    a, b, c = face.vertices[face.faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def test_vertices_are_in_file_order_depth_first_and_each_face_knows_its_node(tmp_path):
    g = Gltf(scenes=[{"nodes": [3, 1]}])
    for k, name in enumerate(("eye", "skin", "eye")):
        g.show(g.primitive(GRID + 10 * k), name=name)
    g.add("nodes", name="root", children=[2, 0])
    face = read(g, tmp_path)
    np.testing.assert_array_equal(face.vertices, np.concatenate([GRID + 20, GRID, GRID + 10]))
    assert face.nodes == ("eye",) * 2 + ("eye_2",) * 2 + ("skin",) * 2 and face.materials == ("",) * 6
    np.testing.assert_array_equal(face.faces, np.concatenate([np.reshape(PAIR, (-1, 3)) + 4 * k for k in range(3)]))


def test_the_default_scene_is_read_and_without_scenes_all_of_the_file(tmp_path):
    g = Gltf()
    g.show(g.primitive(), name="a"), g.show(g.primitive(GRID + 5), name="b")
    assert set(read(g, tmp_path).nodes) == {"a", "b"}
    g.tree["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
    assert set(read(g, tmp_path).nodes) == {"a"}
    g.tree["scene"] = 1
    assert set(read(g, tmp_path).nodes) == {"b"}


def test_nodes_place_what_is_below_them_by_parts_or_by_a_matrix(tmp_path):
    g = Gltf()
    g.show(g.primitive(), translation=[1, 0, 0])
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = [[0, -2, 0], [2, 0, 0], [0, 0, 2]], [0, 0, 7]
    g.add("nodes", children=[0], matrix=turn.T.ravel().tolist())
    expectation = (GRID + np.array([1, 0, 0]))[:, [1, 0, 2]] * [-2, 2, 2] + [0, 0, 7]
    np.testing.assert_allclose(read(g, tmp_path).vertices, expectation, atol=1e-6)
    g.tree["nodes"][1] = {"children": [0], "rotation": QUARTER, "scale": [2, 2, 2], "translation": [0, 0, 7]}
    np.testing.assert_allclose(read(g, tmp_path).vertices, expectation, atol=1e-6)


def test_a_mesh_may_be_shown_by_several_nodes_and_mirrored_ones_stay_outside_out(tmp_path):
    g = Gltf()
    g.show(g.primitive(GRID * [1, 1, 0]), name="left")
    g.add("nodes", mesh=0, name="right", scale=[-1, 1, 1])
    face = read(g, tmp_path)
    np.testing.assert_array_equal(face.vertices[4:], face.vertices[:4] * [-1, 1, 1])
    assert (normals(face)[:, 2] > 0).all()


def test_strips_fans_and_lists_without_indices_become_triangles_and_points_are_left_out(tmp_path):
    g = Gltf()
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]])
    strip = g.primitive(vertices, None, mode=5)
    points = g.primitive(vertices, None, mode=0)
    fan = g.primitive(vertices[[0, 1, 3, 4]], [0, 1, 2, 3], mode=6)
    corners = g.primitive(vertices[[0, 1, 2]], None)
    stitched = g.primitive(vertices, [0, 1, 2, 3, 3, 4], mode=5)
    g.show(strip, points, fan, corners, stitched)
    face = read(g, tmp_path)
    expectation = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [6, 7, 5], [7, 8, 5], [9, 10, 11], [12, 13, 14], [13, 15, 14]]
    np.testing.assert_array_equal(face.faces, expectation)
    assert len(face.vertices) == 17 and (normals(face)[:, 2] > 0).all()


def test_a_strip_of_no_area_is_no_scene_with_triangles(tmp_path):
    g = Gltf()
    g.show(g.primitive(indices=[0, 1, 1, 0], mode=5))
    with pytest.raises(InputError, match=r"face\.glb: expected a scene with triangles, got none"):
        read(g, tmp_path)


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_indices_have_any_size(tmp_path, dtype):
    g = Gltf()
    g.show({"attributes": {"POSITION": g.numbers(GRID)}, "indices": g.numbers(np.reshape(PAIR, (-1, 1)), dtype)})
    np.testing.assert_array_equal(read(g, tmp_path).faces.ravel(), PAIR)


def test_views_may_be_interleaved(tmp_path):
    g = Gltf()
    rows = np.zeros((4, 5), "<f4")
    rows[:, :3], rows[:, 3:] = GRID, GRID[:, :2]
    view = g.view(rows.tobytes(), byteStride=20)
    kind = {"bufferView": view, "componentType": 5126, "count": 4}
    place = g.add("accessors", type="VEC3", **kind), g.add("accessors", type="VEC2", byteOffset=12, **kind)
    g.show(
        {"attributes": dict(zip(("POSITION", "TEXCOORD_0"), place, strict=True))}
        | {"indices": g.primitive()["indices"]}
    )
    face = read(g, tmp_path)
    np.testing.assert_array_equal(face.vertices, GRID)
    np.testing.assert_array_equal(face.uv, GRID[:, :2] * [1, -1] + [0, 1])


def test_quantised_numbers_are_what_they_stand_for_with_and_without_normalising(tmp_path):
    g = Gltf(extensionsRequired=["KHR_mesh_quantization"])
    whole = np.rint(GRID * [1000, -1000, 1000])
    for normalised in (True, False):
        primitive = g.primitive()
        primitive["attributes"] = {
            "POSITION": g.numbers(whole, "i2", pad=2, normalized=normalised),
            "TEXCOORD_0": g.numbers(GRID[:, :2] * 255, "u1", pad=2, normalized=True),
        }
        primitive["targets"] = [{"POSITION": g.numbers(whole / 10, "i1", pad=1, normalized=normalised)}]
        g.show(primitive, scale=[0.5] * 3)
    face = read(g, tmp_path)
    np.testing.assert_allclose(face.vertices, np.concatenate([whole / 32767, whole]) / 2)
    small = np.trunc(whole / 10).astype("i1")
    np.testing.assert_allclose(face.targets["target_00"], np.concatenate([small / 127.0, small]) / 2)
    np.testing.assert_allclose(face.uv, np.tile(GRID[:, :2] * [1, -1] + [0, 1], (2, 1)))
    lowest = np.array([[-32768, 0, 0]] * 3)
    g = Gltf()
    g.show({"attributes": {"POSITION": g.numbers(lowest, "i2", pad=2, normalized=True)}})
    np.testing.assert_array_equal(read(g, tmp_path).vertices[:, 0], -1)


def test_texture_coordinates_are_used_without_a_material_and_known_where_they_are(tmp_path):
    g = Gltf()
    uv = {"TEXCOORD_0": g.numbers(GRID[:, :2])}
    g.show(g.primitive(attributes=uv), g.primitive())
    face = read(g, tmp_path)
    assert face.has_uv.tolist() == [True] * 4 + [False] * 4
    np.testing.assert_array_equal(face.uv[:4], GRID[:, :2] * [1, -1] + [0, 1])
    g = Gltf()
    g.show(g.primitive())
    assert read(g, tmp_path).uv is None and not read(g, tmp_path).has_uv.any()


def test_the_first_set_of_texture_coordinates_that_all_primitives_have_is_taken(tmp_path):
    g = Gltf()
    first, second = ({f"TEXCOORD_{k}": g.numbers(GRID[:, :2] + k)} for k in (0, 1))
    g.show(g.primitive(attributes=first | second), g.primitive(attributes=second))
    face = read(g, tmp_path)
    assert face.has_uv.all()
    np.testing.assert_array_equal(face.uv[:, 0], np.tile(GRID[:, 0] + 1, 2))


def test_materials_and_their_colours_are_known(tmp_path):
    g = Gltf()
    g.add("materials", name="skin", pbrMetallicRoughness={"baseColorFactor": [0.8, 0.6, 0.5, 1]}), g.add("materials")
    g.show(g.primitive(material=0), g.primitive(material=1), g.primitive())
    face = read(g, tmp_path)
    assert face.materials == ("skin",) * 2 + ("material_1",) * 2 + ("",) * 2
    np.testing.assert_array_equal(face.base_colour, np.repeat([[0.8, 0.6, 0.5], [1, 1, 1], [1, 1, 1]], 4, axis=0))


def textured(picture, view=True, **info):
    """Return a file whose one material has a texture, and a factor that leaves its red out."""
    g, data = Gltf(), io.BytesIO()
    picture.save(data, "PNG")
    g.add("images", **({"bufferView": g.view(data.getvalue())} if view else {"uri": "skin.png"}))
    g.add("textures", source=0)
    factor = {"baseColorFactor": [0, 1, 1, 1], "baseColorTexture": {"index": 0, **info}}
    g.add("materials", pbrMetallicRoughness=factor)
    uv = np.array([[0.1, 0.1], [0.9, 0.1], [1.1, 0.9], [-0.1, 0.9]])
    g.show(g.primitive(material=0, attributes={"TEXCOORD_0": g.numbers(uv)}))
    return g


def test_vertices_have_the_colours_of_a_texture_where_they_lie_on_it(tmp_path):
    quarters = np.array([[[255, 0, 0], [255, 255, 0]], [[0, 51, 255], [255, 255, 255]]], np.uint8)
    picture = Image.fromarray(quarters.repeat(300, 0).repeat(200, 1))
    wanted = [[0, 0, 0], [0, 1, 0], [0, 0.2, 1], [0, 1, 1]]
    np.testing.assert_allclose(read(textured(picture), tmp_path).base_colour, wanted, atol=1e-6)


def test_a_texture_that_cannot_be_read_leaves_the_factor(tmp_path):
    picture = Image.new("RGB", (8, 8), (9, 9, 9))
    moved = {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    broken = textured(picture)
    first = broken.tree["bufferViews"][0]["byteOffset"]
    broken.data[first + 8 : first + 40] = bytes(32)
    for g in (textured(picture, view=False), textured(picture, texCoord=1), textured(picture, **moved), broken):
        np.testing.assert_array_equal(read(g, tmp_path).base_colour, [[0, 1, 1]] * 4)


def test_primitives_that_share_their_vertices_have_them_once(tmp_path):
    g = Gltf()
    both = g.primitive(targets=[{"POSITION": g.numbers(GRID)}])
    other = both | {"indices": g.numbers([[0], [2], [3]], "u1")}
    g.add("materials", name="lips")
    g.show(both, g.primitive(GRID + 9), other | {"material": 0})
    face = read(g, tmp_path)
    np.testing.assert_array_equal(face.vertices, np.concatenate([GRID, GRID + 9]))
    np.testing.assert_array_equal(face.faces, [[0, 1, 2], [2, 1, 3], [0, 2, 3], [4, 5, 6], [6, 5, 7]])
    assert face.materials == ("", "", "lips", "", "")


# Morph targets


def test_targets_of_one_name_are_one_and_turn_with_their_nodes(tmp_path):
    g = Gltf()
    for name, names in (("head", ["jawOpen", "smile"]), ("teeth", ["jawOpen"])):
        targets = [{"POSITION": g.numbers(np.full((4, 3), [k + 1, 0, 0]))} for k in range(len(names))]
        mesh = {"extras": {"targetNames": names}, "weights": [0.25, 0.5][: len(names)]}
        g.show(g.primitive(targets=targets), mesh=mesh, name=name, rotation=QUARTER, translation=[5, 5, 5])
    g.show(g.primitive(), name="hair")
    face = read(g, tmp_path)
    jaw, smile = np.zeros((12, 3)), np.zeros((12, 3))
    jaw[:8, 1], smile[:4, 1] = 1, 2
    assert list(face.targets) == ["jawOpen", "smile"] and face.weights == {"jawOpen": 0.25, "smile": 0.5}
    np.testing.assert_allclose(face.targets["jawOpen"], jaw, atol=1e-12)
    np.testing.assert_allclose(face.targets["smile"], smile, atol=1e-12)


def test_targets_may_be_sparse_with_and_without_a_view_or_lack_positions(tmp_path):
    g = Gltf()
    change = ([1, 3], [[1, 2, 3], [4, 5, 6]])
    base = np.ones((4, 3))
    targets = [
        {"POSITION": g.numbers((4, 3), sparse=change)},
        {"POSITION": g.numbers(base, sparse=change)},
        {"NORMAL": g.numbers(base)},
        {},
        {"POSITION": g.numbers((4, 3))},
    ]
    g.show(g.primitive(targets=targets, extras={"targetNames": ["a", "b", "c"]}))
    face = read(g, tmp_path)
    assert list(face.targets) == ["a", "b", "c", "target_03", "target_04"] and set(face.weights.values()) == {0}
    expectation = np.zeros((4, 3))
    expectation[change[0]] = change[1]
    np.testing.assert_array_equal(face.targets["a"], expectation)
    expectation[[0, 2]] = 1
    np.testing.assert_array_equal(face.targets["b"], expectation)
    assert not any(face.targets[name].any() for name in ("c", "target_03", "target_04"))


def test_a_target_has_a_name_even_where_names_are_there_twice_or_are_none(tmp_path):
    g = Gltf()
    targets = [{"POSITION": g.numbers(GRID)}] * 4
    g.show(g.primitive(targets=targets), mesh={"extras": {"targetNames": ["a", "a", 7, ""]}})
    assert list(read(g, tmp_path).targets) == ["a", "a_2", "target_02", "target_03"]


def test_a_nodes_weights_come_before_its_meshs(tmp_path):
    g = Gltf()
    g.show(g.primitive(targets=[{}, {}]), mesh={"weights": [0.1, 0.2]}, weights=[0.3, 0.4])
    assert read(g, tmp_path).weights == {"target_00": 0.3, "target_01": 0.4}


# Joints


def skinned(g, joints, weights=None, scale=1.0, dtype="u1", **entry):
    """Return a primitive of which each vertex is at one joint or more: joints (4, 4), weights (4, 4)."""
    one = np.eye(4)[[0] * 4] if weights is None else weights
    attributes = {"JOINTS_0": g.numbers(joints, dtype), "WEIGHTS_0": g.numbers(one)}
    return g.primitive(GRID * scale, attributes=attributes, **entry)


def posed(face, pose):
    """Return a face's vertices with transforms of joints in place of those at rest."""
    skin, world = face.skin, []
    for parent, local in zip(skin.parents, pose, strict=True):
        world.append(local if parent < 0 else world[parent] @ local)
    moved = skin.weights @ (np.array(world) @ skin.bind).reshape(-1, 16)
    points = np.column_stack([face.vertices, np.ones(len(face.vertices))])
    return (moved.reshape(-1, 4, 4) @ points[:, :, None])[:, :3, 0]


def test_a_skin_places_its_mesh_and_the_node_does_not(tmp_path):
    g = Gltf()
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[1, :3, 3] = [0, -1, 0]
    joints = [[0, 1, 0, 0]] * 2 + [[1, 0, 0, 0]] * 2
    weights = [[0.5, 0.5, 0, 0]] * 2 + [[2, 0, 0, 0]] * 2
    target = {"POSITION": g.numbers(np.full((4, 3), [1, 0, 0]))}
    g.show(skinned(g, joints, weights, targets=[target]), skin=0, scale=[100, 100, 100], translation=[9, 9, 9])
    g.add("nodes", name="jaw", translation=[0, 1, 0], rotation=QUARTER)
    g.add("nodes", name="head", children=[3], translation=[3, 0, 0])
    g.add("nodes", name="between", children=[1], translation=[0, 0, 1])
    g.add("nodes", name="all", children=[2], scale=[2, 2, 2])
    g.add("skins", joints=[2, 1], inverseBindMatrices=g.numbers(binds.transpose(0, 2, 1).reshape(2, 16)))
    face = read(g, tmp_path)
    head = GRID + np.array([3, 0, 0])
    jaw = (GRID - [0, 1, 0])[:, [1, 0, 2]] * [-1, 1, 1] + [3, 1, 1]
    np.testing.assert_allclose(face.vertices, 2 * np.where(np.arange(4)[:, None] < 2, (head + jaw) / 2, jaw), atol=1e-6)
    np.testing.assert_allclose(face.targets["target_00"], [[1, 1, 0]] * 2 + [[0, 2, 0]] * 2, atol=1e-6)
    assert face.skin.names == ("head", "jaw") and face.skin.parents.tolist() == [-1, 0]
    np.testing.assert_allclose(face.skin.local[0], np.diag([2, 2, 2, 1]) + 6 * np.eye(4)[[0]].T @ np.eye(4)[[3]])
    np.testing.assert_allclose(face.skin.local[1][:3, 3], [0, 1, 1])
    np.testing.assert_array_equal(face.skin.weights.toarray(), [[0.5, 0.5]] * 2 + [[0, 1]] * 2)
    np.testing.assert_allclose(posed(face, face.skin.local), face.vertices, atol=1e-12)


def test_a_pose_of_a_quantised_skin_is_the_files(tmp_path):
    g = Gltf()
    bind = np.diag([0.1, 0.1, 0.1, 1])
    bind[:3, 3] = [-3, 0, 0]
    g.show(skinned(g, np.zeros((4, 4)), scale=10), skin=0)
    g.add("nodes", name="jaw", translation=[4, 0, 0])
    g.add("skins", joints=[1], inverseBindMatrices=g.numbers(bind.T.reshape(1, 16)))
    face = read(g, tmp_path)
    np.testing.assert_allclose(face.vertices, GRID + np.array([1, 0, 0]), atol=1e-6)
    turned = face.skin.local.copy()
    turned[0, :3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    inside = GRID - [3, 0, 0]
    np.testing.assert_allclose(posed(face, turned), inside[:, [1, 0, 2]] * [-1, 1, 1] + [4, 0, 0], atol=1e-6)


def test_two_skins_share_their_joints_and_rows_of_other_vertices_are_zero(tmp_path):
    g = Gltf()
    g.show(skinned(g, [[1, 0, 0, 0]] * 4, dtype="u2"), skin=0)
    g.show(skinned(g, [[0, 0, 0, 0]] * 4), skin=1)
    g.show(g.primitive())
    for name in ("a", "b", "c"):
        g.add("nodes", name=name)
    g.add("skins", joints=[5, 3]), g.add("skins", joints=[5, 4])
    skin = read(g, tmp_path).skin
    assert skin.names == ("a", "b", "c")
    expectation = np.repeat([[1, 0, 0], [0, 0, 1], [0, 0, 0]], 4, axis=0)
    np.testing.assert_array_equal(skin.weights.toarray(), expectation)


def test_eight_joints_a_vertex_weights_of_whole_numbers_and_of_none(tmp_path):
    g = Gltf()
    joints = np.tile(np.arange(8), (4, 1))
    weights = np.tile([51, 51, 51, 51, 51, 0, 0, 0], (4, 1))
    weights[3] = 0
    primitive = g.primitive()
    for k in (0, 1):
        columns = slice(4 * k, 4 * k + 4)
        primitive["attributes"][f"JOINTS_{k}"] = g.numbers(joints[:, columns], "u1")
        primitive["attributes"][f"WEIGHTS_{k}"] = g.numbers(weights[:, columns], "u1", normalized=True)
    g.show(primitive, skin=0)
    for _ in range(8):
        g.add("nodes")
    g.add("skins", joints=list(range(1, 9)))
    found = read(g, tmp_path).skin.weights.toarray()
    np.testing.assert_allclose(found[:3], [[0.2] * 5 + [0] * 3] * 3)
    assert found[3].tolist() == [1] + [0] * 7  # as viewers do


# Other files


def test_a_glb_a_vrm_and_a_gltf_with_its_buffer_beside_it_or_within_are_read_alike(tmp_path):
    g = Gltf(extensionsUsed=["VRM"], extensions={"VRM": {"blendShapeMaster": {}}})
    g.show(g.primitive(), name="顔")
    for name, embedded in (("a.glb", False), ("a.vrm", False), ("a b.gltf", False), ("c.gltf", True)):
        face = read_gltf(g.write(tmp_path / name, embedded))
        np.testing.assert_array_equal(face.vertices, GRID)
        assert face.nodes == ("顔", "顔")


@pytest.mark.parametrize("seed", range(4))
def test_plain_files_are_read_as_trimesh_reads_them(tmp_path, seed):
    trimesh = pytest.importorskip("trimesh")
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    g = Gltf(scenes=[{"nodes": [4, 0]}], scene=0)
    for k in range(4):
        vertices, corners = rng.normal(size=(20, 3)), rng.permutation(np.arange(60) % 20)
        turn = rng.normal(size=4)
        place = {"rotation": (turn / np.linalg.norm(turn)).tolist(), "translation": rng.normal(size=3).tolist()}
        g.show(g.primitive(vertices, corners), name=f"part {k}", scale=[1, 2, -1 if k == 2 else 1], **place)
    g.tree["nodes"][1]["children"] = [2]
    g.add("nodes", children=[3, 1])
    file = g.write(tmp_path / "plain.glb")
    face = read_gltf(file)
    scene = trimesh.load_scene(file, process=False)
    known = np.concatenate([mesh.triangles for mesh in scene.dump()])
    ours = face.vertices[face.faces]
    for a, b in ((ours, known), (known, ours)):  # from one corner on, all three of them, in any of their orders
        tree = cKDTree(np.concatenate([np.roll(b, k, axis=1).reshape(-1, 9) for k in range(3)]))
        assert tree.query(a.reshape(-1, 9))[0].max() < 1e-5 and len(a) == 80


def test_a_sentence_names_the_file_and_what_is_wrong(tmp_path):
    g = Gltf()
    g.show(g.primitive())
    g.tree["accessors"][0]["count"] = 10**12
    with pytest.raises(
        InputError, match=r"face\.glb: accessors\[0\]\.count: expected a whole number from 1 to 20000000"
    ):
        read(g, tmp_path)
