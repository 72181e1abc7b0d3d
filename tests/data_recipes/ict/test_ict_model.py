"""The model itself, a face that nobody here made; skipped without it."""

import os

import numpy as np
import pytest
from rig_poses import chart_areas, exaggerated_poses, pose_of

from data_recipes.catalogue import build_rig
from replicate.approximation.rigid import find_attachments, segment_errors
from replicate.drawing.scene import forehead_faces
from replicate.geometry.mesh import face_normals
from replicate.rig_study.mouth_contents import deepest, depths, find_mouth
from replicate.rig_study.pose_health import each_alone

TAU_MM = 0.3  # the paper's threshold of Eq. 3
REAL = os.environ.get("ICT_FACEKIT", "").strip()
pytestmark = pytest.mark.skipif(not REAL, reason="ICT_FACEKIT names no folder of ICT-FaceKit")


@pytest.fixture(scope="module")
def ict():
    return build_rig("ict")


def test_the_model_has_its_documented_counts_and_a_heads_size(ict):
    assert (len(ict.mesh.neutral), len(ict.controls), len(ict.mesh.segment_names)) == (21451, 53, 6 + 32)
    head = ict.mesh.neutral[ict.mesh.neutral[:, 1] > -40]
    assert 150 < np.ptp(head[:, 0]) < 200
    assert sum(name.startswith("tooth_upper") for name in ict.mesh.segment_names) == 16
    assert np.abs(ict(ict.default) - ict.mesh.neutral).max() < 1e-4


def test_the_models_charts_flip_nothing(ict):
    for k in range(6):
        faces = ict.mesh.faces[(ict.mesh.segment[ict.mesh.faces] == k).all(1)]
        areas = chart_areas(ict.mesh.uv.astype(np.float64), faces)
        assert (areas > 0).all() or (areas < 0).all(), ict.mesh.segment_names[k]


def test_the_models_32_teeth_and_no_more_are_found_rigid(ict):
    vertices = ict(exaggerated_poses(ict, 60))
    rigid = find_attachments(ict.mesh, vertices, TAU_MM, 10).segment
    assert {name for k, name in enumerate(ict.mesh.segment_names) if name.startswith("tooth")} <= {
        ict.mesh.segment_names[k] for k in rigid
    }
    assert segment_errors(ict.mesh, vertices)[:, 6:].max() < 1e-3
    assert not set(rigid) & {0, 2, 5}  # face, mouth and tongue deform


def test_the_models_brows_fold_its_forehead(ict):
    faces = ict.mesh.faces[forehead_faces(ict.mesh.neutral, ict.mesh.faces)]
    rest, raised = (face_normals(v, faces) for v in (ict.mesh.neutral, ict(pose_of(ict, browInnerUp=1, browOuterUp=1))))
    turn = np.degrees(np.arccos(np.clip((rest * raised).sum(-1), -1, 1)))
    assert 5 < turn.mean() < 20


def test_the_models_teeth_and_gums_stay_behind_its_skin_whatever_a_control_does(ict):
    mouth = find_mouth(ict.mesh)
    _, poses = each_alone(ict)
    assert max(max(deepest(mouth, depths(mouth, ict(pose))).values()) for pose in poses) < 0.5  # mm
