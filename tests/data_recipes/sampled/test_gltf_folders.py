"""Folders of samples whose mesh is a GLB or a glTF: its vertices in file order, its nodes as groups."""

import numpy as np
import pytest
from gltf_writer import Gltf
from sample_folders import COLUMNS, FACE, ROWS, neutral, vertices_at, write

from data_recipes.catalogue import forget_folders, load_rig, sampled_parts
from data_recipes.sampled import sampled_rig
from data_recipes.sampled.importing import import_rig
from data_recipes.sampled.mesh_file import read_mesh
from data_recipes.sampled.segment_charts import make_mesh

SHEET = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
UV = np.stack([SHEET % COLUMNS / (COLUMNS - 1), 1 - SHEET // COLUMNS / (ROWS - 1)], axis=2).reshape(-1, 2)


@pytest.fixture(autouse=True)
def fresh():
    """Forget folders of other tests."""
    forget_folders()


def triangles(rows):
    """Return the corners of these rows of the sheet's quads."""
    quads = [SHEET[r : r + 2, c : c + 2].ravel()[[0, 1, 3, 0, 3, 2]] for r in rows for c in range(COLUMNS - 1)]
    return np.concatenate(quads)


def sheet(g, rows, **entry):
    """Return a primitive of the sheet's vertices and these rows of quads, with texture coordinates."""
    return g.primitive(neutral(), triangles(rows), attributes={"TEXCOORD_0": g.numbers(UV)}, **entry)


def rig_of(folder, g, name, target):
    """Write the folder with this mesh, import it and return the rig as it is loaded again."""
    write(folder)
    g.write(folder / name)
    (folder / "face.toml").write_text(FACE.replace("mesh.obj", name))
    target.mkdir()
    recipe, files = sampled_parts(folder)
    sampled_rig.save_rig(import_rig(recipe, files, target), target)
    return load_rig(target), files


@pytest.mark.parametrize("name", ["mesh.glb", "mesh.gltf"])
def test_poses_in_file_order_fit_a_mesh_whose_texture_coordinates_have_no_material(tmp_path, name):
    g = Gltf()
    g.show(sheet(g, range(ROWS - 1)), name="face")
    rig, files = rig_of(tmp_path / "box", g, name, tmp_path / "rig")
    assert rig.mesh.segment_names == ("face",)
    np.testing.assert_allclose(rig.mesh.uv, UV * [1, -1] + [0, 1], atol=1e-6)
    params = rig.known_poses.frame_params[3:5]
    moved = rig(params) - rig.mesh.neutral
    np.testing.assert_allclose(moved, vertices_at(params) - neutral(), atol=1e-3)
    buffers = [file.name for file in files if file.suffix == ".bin"]
    assert buffers == (["mesh data.bin"] if name == "mesh.gltf" else [])  # a change of it makes another rig


@pytest.mark.parametrize("order", [("skin", "left", "right"), ("left", "skin", "right"), ("right", "left", "skin")])
@pytest.mark.parametrize("nested", [False, True])
def test_nodes_follow_one_another_as_in_the_file_nested_or_not(tmp_path, order, nested):
    """Left and right are mirror images: only their order in the file says which is which."""
    parts = {"skin": [0, 0, 0], "left": [3, 0, 0], "right": [-3, 0, 0]}
    g = Gltf(scene=0)
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    nodes = [g.show(g.primitive(corner + parts[name], [0, 1, 2]), name=name) for name in order]
    g.tree["scenes"] = [{"nodes": [g.add("nodes", name="all", children=nodes)] if nested else nodes}]
    mesh = read_mesh(g.write(tmp_path / "mesh.glb"))
    np.testing.assert_array_equal(mesh.vertices, np.concatenate([corner + parts[name] for name in order]))
    assert mesh.groups == order and mesh.uv is None


def test_numbers_are_the_files_quantised_or_under_a_node_that_a_skin_overrules(tmp_path):
    whole = np.rint(neutral() / 200 * 32767)
    g = Gltf(extensionsRequired=["KHR_mesh_quantization"])
    place = g.numbers(whole, "i2", pad=2, normalized=True)
    g.show(sheet(g, range(ROWS - 1)) | {"attributes": {"POSITION": place}}, scale=[200] * 3)
    np.testing.assert_allclose(read_mesh(g.write(tmp_path / "a.glb")).vertices, neutral(), atol=0.01)
    g = Gltf()
    bound = {"JOINTS_0": g.numbers(np.zeros((30, 4)), "u1"), "WEIGHTS_0": g.numbers(np.eye(4)[[0] * 30])}
    g.show(g.primitive(neutral(), triangles(range(ROWS - 1)), attributes=bound), skin=0, scale=[100] * 3)
    g.add("nodes", name="bone"), g.add("skins", joints=[1])
    np.testing.assert_allclose(read_mesh(g.write(tmp_path / "b.glb")).vertices, neutral(), atol=1e-4)


def test_a_part_without_texture_coordinates_beside_others_gets_charts_of_its_own(tmp_path):
    g = Gltf()
    g.show(sheet(g, range(ROWS - 1)), name="skin")
    g.show(g.primitive(), name="tongue")
    found = read_mesh(g.write(tmp_path / "a.glb"))
    tongue = np.array(found.groups) == "tongue"
    assert (found.uv_faces[tongue] == -1).all() and (found.uv_faces[~tongue] >= 0).all()
    mesh = make_mesh(found, "groups", found.vertices, "a.glb")
    own = mesh.uv[mesh.segment == mesh.segment_names.index("tongue")]
    assert len(np.unique(own.round(3), axis=0)) == len(own)
