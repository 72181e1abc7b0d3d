"""Vertices that a file has twice, along a texture's seam: one to the networks if they move alike, else two."""

import numpy as np
import pytest
from shape_faces import shapes_of, split_sheet

from data_recipes.catalogue import forget_folders, load_rig, sampled_parts
from data_recipes.sampled import sampled_rig
from data_recipes.sampled.importing import import_rig
from replicate.base.exceptions import InputError

NAMES = ("a", "b", "c", "d")


def folder_of(folder, torn: bool = False, more: str = ""):
    """Write a folder of samples of a sheet with a seam; torn: whether one side moves by itself in the last pose."""
    vertices, faces, _ = split_sheet()
    shapes = np.stack(list(shapes_of(vertices, NAMES).values()))
    poses = np.random.default_rng(0).uniform(0, 1, (40, len(NAMES))).astype(np.float32)
    moved = vertices + np.tensordot(poses, shapes, 1)
    if torn:
        moved[-1, : len(vertices) // 2, 2] -= 1.0
    (folder / "poses").mkdir(parents=True)
    np.savez(folder / "poses" / "a.npz", params=poses, vertices=moved.astype(np.float32))
    text = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in vertices)
    (folder / "mesh.obj").write_text(text + "g skin\n" + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces))
    (folder / "controls.csv").write_text("name,lower,default,upper\n" + "".join(f"{name},0,0,1\n" for name in NAMES))
    (folder / "face.toml").write_text(f'name = "sheet"\nunit = "mm"\nup = "y"\nmesh = "mesh.obj"\n{more}')
    return vertices, poses, moved


def imported(folder, target):
    forget_folders()
    target.mkdir()
    recipe, files = sampled_parts(folder)
    sampled_rig.save_rig(import_rig(recipe, files, target), target)
    return load_rig(target)


def test_both_sides_of_a_seam_that_move_alike_are_one_vertex(tmp_path):
    vertices, poses, moved = folder_of(tmp_path / "face")
    rig = imported(tmp_path / "face", tmp_path / "rig")
    assert len(rig.mesh.neutral) == len(vertices) - 12 and len(rig.file_vertices) == len(vertices)
    shift = rig.mesh.neutral[rig.file_vertices[0]] - vertices[0]
    for pose, truth in zip(poses[:3], moved[:3], strict=True):
        np.testing.assert_allclose(rig(pose)[rig.file_vertices] - shift, truth, atol=2e-3)
    faces = {tuple(sorted(face)) for face in rig.mesh.faces.tolist()}
    assert len(faces) == len(rig.mesh.faces), "each triangle once"


def test_sides_that_come_apart_in_one_pose_stay_two(tmp_path):
    vertices, *_ = folder_of(tmp_path / "face", torn=True)
    rig = imported(tmp_path / "face", tmp_path / "rig")
    assert len(rig.file_vertices) == 0 and len(rig.mesh.neutral) == len(vertices)


def test_points_that_a_face_toml_names_are_the_files_vertices(tmp_path):
    vertices, *_ = folder_of(tmp_path / "face", more="[points]\nlandmarks = [0, 150, 215]\n")
    rig = imported(tmp_path / "face", tmp_path / "rig")
    shift = rig.mesh.neutral[rig.file_vertices[0]] - vertices[0]
    np.testing.assert_allclose(rig.mesh.neutral[rig.landmarks] - shift, vertices[[0, 150, 215]], atol=1e-3)


def test_a_face_toml_names_segments_that_are_rigid(tmp_path):
    folder_of(tmp_path / "face", more='rigid = ["skin"]\n')
    assert imported(tmp_path / "face", tmp_path / "rig").rigid_segments == ("skin",)
    folder_of(tmp_path / "other", more='rigid = ["skn"]\n')
    with pytest.raises(InputError, match=r"face.toml: rigid: there is no segment skn; did you mean skin\?"):
        imported(tmp_path / "other", tmp_path / "refused")
