"""The characters beside the teen: the paper's counts, and poses that stay faces."""

import numpy as np
import pytest
import rigs
from rig_poses import augmented_poses, flipped_share, skin_faces

from data_recipes.head.neutral_head import build_head
from data_recipes.recipe.reading import load_recipe
from replicate.geometry.mesh import face_normals
from replicate.geometry.rays import ray_hits

# Vertices, controls, deformable segments and rigid ones, as in Table 1.
COUNTS = {"woman": (12828, 265, 7, 24), "toon": (4922, 99, 6, 2)}


@pytest.fixture(scope="module", params=tuple(COUNTS))
def rig(request):
    return rigs.rig(request.param)


def poses_of(rig, count, seed):
    """Return what training sees: augmented animation, or uniform draws where a rig has none."""
    if rig.clips:
        return augmented_poses(rig, count, seed)
    return np.random.default_rng(seed).uniform(rig.lower, rig.upper, (count, len(rig.controls)))


def test_counts_are_the_papers(rig):
    vertices, controls, deformable, rigid = COUNTS[rig.name]
    assert rig.mesh.neutral.shape == (vertices, 3)
    assert len(rig.controls) == controls
    teeth = [name.startswith(("tooth", "teeth")) for name in rig.mesh.segment_names]
    assert (len(teeth) - sum(teeth), sum(teeth)) == (deformable, rigid)
    assert (rig.clips is None) == (rig.name == "toon")


def test_skin_that_wrinkles_is_fine_enough_to_fold(rig):
    mesh, coarsest = rig.mesh, {}
    for name, region in rig.wrinkle_states(rig.default).items():
        inside = np.isin(np.arange(len(mesh.neutral)), region.vertices)
        a, b, c = mesh.neutral[mesh.faces[inside[mesh.faces].all(1)]].transpose(1, 0, 2)
        quads_mm2 = np.linalg.norm(np.cross(b - a, c - a), axis=1)  # two triangles each
        coarsest[name] = np.sqrt(quads_mm2.mean())
    assert max(coarsest.values()) < {"woman": 4.0, "toon": 7.0}[rig.name], coarsest


def test_the_default_pose_is_the_neutral(rig):
    assert np.abs(rig(rig.default) - rig.mesh.neutral).max() < 1e-4


def test_every_control_moves_something_at_one_of_several_poses(rig):
    m = len(rig.controls)
    moved = np.zeros(m)
    base_controls = [  # what parts the lips, turns the eyes, and compresses each region that wrinkles
        ("smile", "squint", "look", "jaw_open"),
        ("brow_inner", "chin_raise"),
        ("nose_wrinkle", "brow_down", "brow_squeeze", "cheek_raise", "squint"),
    ]
    bases = [0.9 * np.array([c.name.startswith(parts) for c in rig.controls]) for parts in base_controls]
    for base in (*bases, poses_of(rig, 1, seed=5)[0].clip(rig.lower, rig.upper)):
        step = np.where(base < 0.5 * (rig.lower + rig.upper), 0.4, -0.4)
        moved = np.maximum(moved, np.abs(rig(base[None] + np.eye(m) * step) - rig(base)[None]).max(axis=(1, 2)))
    still = [control.name for control, far in zip(rig.controls, moved, strict=True) if far < 0.1]
    assert not still


def test_training_poses_are_faces_and_not_explosions(rig):
    poses, faces, shares = poses_of(rig, 1_024, seed=1), skin_faces(rig.mesh), []
    for part in np.split(poses, 16):
        vertices = rig(part)
        assert np.isfinite(vertices).all()
        shares += [flipped_share(v, faces) for v in vertices]
    assert np.mean(shares) < 0.005
    assert np.max(shares) < 0.03


def test_a_blink_closes_the_lids_over_the_eyeball(rig):
    p = rig.default.copy()
    p[[c.name.startswith("blink") for c in rig.controls]] = 1
    closed, rest = rig(p), rig.mesh.neutral
    marks = dict(zip(rig.landmark_names, rig.landmarks.tolist(), strict=True))
    for side in ("left", "right"):
        upper, lower = marks[f"lid_upper_{side}"], marks[f"lid_lower_{side}"]
        assert np.linalg.norm(rest[upper] - rest[lower]) > 8
        assert np.linalg.norm(closed[upper] - closed[lower]) < 1.5
        lids = rig.face.constants[f"lids_{side}"]
        distance = np.linalg.norm(closed[lids["support"]] - lids["centre"], axis=1)
        assert (distance > lids["ball"] - 0.06).all()


@pytest.mark.parametrize("rig", ["woman"], indirect=True)
def test_a_full_brow_raise_turns_the_womans_forehead_by_five_degrees(rig):
    p = rig.default.copy()
    p[[c.name.startswith(("brow_inner_up", "brow_outer_up")) for c in rig.controls]] = 1
    smooth = p.copy()
    smooth[[c.name.startswith("wrinkle_") for c in rig.controls]] = -1.2
    region = np.unique(rig.wrinkle_states(rig.default)["forehead"].vertices)
    faces = rig.mesh.faces[np.isin(rig.mesh.faces, region).all(axis=1)]
    with_folds, without = (np.asarray(face_normals(rig(q), faces)) for q in (p, smooth))
    turned = np.degrees(np.arccos(np.clip((with_folds * without).sum(axis=1), -1, 1)))
    assert turned.mean() > 5


@pytest.mark.parametrize("rig", ["toon"], indirect=True)
def test_no_lining_comes_through_the_toons_upper_lip(rig):
    grids = build_head(load_recipe("toon")).grids
    mouth, bag = grids["mouth"], grids["mouth_bag"]
    upper = np.arange(mouth.shape[1] // 8, 3 * mouth.shape[1] // 8 + 1)  # the columns between the corners
    lining = bag[1:4, upper].ravel()
    lip = np.isin(rig.mesh.faces, np.concatenate([mouth.ravel(), bag[0]])).all(axis=1)
    through = []
    for x in rig(poses_of(rig, 192, seed=3)).astype(float):
        above_seam = x[lining, 1] > np.tile(x[mouth[0, upper], 1], 3) + 0.5
        ahead, behind = (
            np.isfinite(ray_hits(x[lining], np.tile([0.0, 0.0, far], (len(lining), 1)), x[rig.mesh.faces[lip]])[0])
            for far in (30.0, -15.0)
        )
        through.append((above_seam & behind & ~ahead).any())
    assert np.mean(through) < 0.01
