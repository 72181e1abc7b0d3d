"""USD files, opened again by the library of USD itself: every frame is the rig's, and its own checks find nothing."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from moving_sheet import FRAMES, moving_sheet
from refusal import refusal

from replicate.base.exceptions import InputError
from replicate.export.files import linear, posed_parts
from replicate.export.usd import BlendShape, UsdPart, shaped_usd, usd
from replicate.geometry.mesh import vertex_normals
from replicate.targets.export import Request, export

EXACT_MM = 1e-3


def opened(file):
    pxr = pytest.importorskip("pxr", reason="needs usd-core")
    return pxr.Usd.Stage.Open(str(file))


@pytest.fixture(autouse=True)
def _library(request):
    if "without_usd_core" not in request.node.name and "without_blender" not in request.node.name:
        pytest.importorskip("pxr.UsdSkel", reason="needs usd-core")


def exported(folder, name, **request):
    rig, file = moving_sheet(), folder / name
    files, words = export(rig, Request(to=str(file), **request))
    assert files == [file] and list(folder.iterdir()) == [file]
    return rig, opened(file), words


def complaints(stage):
    """Return what USD's validators have against a file, all that usdchecker calls."""
    from pxr import UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    return [(str(error.GetName()), error.GetMessage()) for error in found]


def mesh_at(stage, path):
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
    assert mesh
    return mesh


def in_mm(points):
    return 1000 * np.asarray(points, np.float64)


def test_a_pose_has_points_normals_charts_colours_and_segments_of_the_rig(tmp_path):
    from pxr import UsdGeom, UsdShade

    rig = replace(moving_sheet())
    params = tmp_path / "p.csv"
    params.write_text("smile,brow_up\n1.5,-0.25\n")
    file = tmp_path / "pose.usda"
    _, words = export(rig, Request(params=str(params), to=str(file)))
    stage, pose = opened(file), np.float32([0, -0.25, 1.5])
    assert words == "30 vertices and 1 props" and complaints(stage) == []
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1 and UsdGeom.GetStageUpAxis(stage) == "Y"
    assert not stage.HasAuthoredTimeCodeRange()
    mesh = mesh_at(stage, "/sheet/sheet")
    np.testing.assert_allclose(in_mm(mesh.GetPointsAttr().Get()), rig(pose), atol=EXACT_MM)
    np.testing.assert_allclose(mesh.GetNormalsAttr().Get(), vertex_normals(rig(pose), rig.mesh.faces), atol=1e-5)
    np.testing.assert_array_equal(np.reshape(mesh.GetFaceVertexIndicesAttr().Get(), (-1, 3)), rig.mesh.faces)
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3} and mesh.GetSubdivisionSchemeAttr().Get() == "none"
    st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    assert st.GetInterpolation() == "faceVarying" and st.GetTypeName() == "texCoord2f[]"
    np.testing.assert_array_equal(st.ComputeFlattened(), rig.mesh.uv[rig.mesh.faces.ravel()])
    colours = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Get()
    np.testing.assert_allclose(colours, linear(posed_parts(rig, pose)[0].colours) / 255, atol=1e-6)
    subsets = UsdGeom.Subset.GetGeomSubsets(mesh, "face", "segment")
    assert [subset.GetPrim().GetDisplayName() for subset in subsets] == ["lower lip", "upper"]
    for k, subset in enumerate(subsets):
        np.testing.assert_array_equal(subset.GetIndicesAttr().Get(), np.flatnonzero(rig.mesh.face_segment == k))
    np.testing.assert_array_equal(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("segment").Get(), rig.mesh.segment)
    root = stage.GetDefaultPrim()
    assert list(root.GetAttribute("controls:names").Get()) == ["ctl|jaw.open", "brow_up", "smile"]
    np.testing.assert_array_equal(root.GetAttribute("controls:values").Get(), pose)
    eye = mesh_at(stage, "/sheet/eye_left")
    np.testing.assert_allclose(in_mm(eye.GetPointsAttr().Get())[1], [0, 38, 62], atol=EXACT_MM)
    roughness = [
        UsdShade.MaterialBindingAPI(part)
        .ComputeBoundMaterial()[0]
        .ComputeSurfaceSource()[0]
        .GetInput("roughness")
        .Get()
        for part in (mesh, eye)
    ]
    np.testing.assert_allclose(roughness, [0.6, 0.15])


def baked(file):
    """Return a stage whose points USD itself has computed from blend shapes and weights."""
    from pxr import UsdSkel

    stage = opened(file)
    stage.GetSessionLayer().timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # else frames would be at other times
    stage.SetEditTarget(stage.GetSessionLayer())
    assert UsdSkel.BakeSkinning(stage.Traverse())
    return stage


@pytest.mark.parametrize("tolerance", [2.0, 0.01])
def test_blend_shapes_as_usd_deforms_them_keep_every_frame_within_the_tolerance(tmp_path, tolerance):
    from pxr import UsdGeom, UsdSkel

    rig, stage, words = exported(tmp_path, "talk.usdc", clip="talk", tolerance_mm=tolerance)
    assert complaints(stage) == [] and f"{FRAMES} frames at 24 a second" in words and "blend shapes" in words
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, FRAMES - 1)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 24
    np.testing.assert_allclose(
        in_mm(mesh_at(stage, "/sheet/sheet").GetPointsAttr().Get()), rig.mesh.neutral, atol=EXACT_MM
    )
    values, weights = stage.GetDefaultPrim().GetAttribute("controls:values"), rig.clips[0].values
    shapes = UsdSkel.BindingAPI(stage.GetPrimAtPath("/sheet/sheet")).GetBlendShapeTargetsRel().GetTargets()
    assert shapes and not any(UsdSkel.BlendShape(stage.GetPrimAtPath(shape)).GetInbetweens() for shape in shapes)
    plain, worst, turned = baked(tmp_path / "talk.usdc"), 0.0, 0.0
    for k, pose in enumerate(weights):
        np.testing.assert_array_equal(values.Get(k), pose)
        mesh, truth = mesh_at(plain, "/sheet/sheet"), rig(pose)
        there = in_mm(mesh.GetPointsAttr().Get(k))
        worst = max(worst, np.linalg.norm(there - truth, axis=1).max())
        normals = np.asarray(mesh.GetNormalsAttr().Get(k))
        turned = max(turned, np.abs(normals - vertex_normals(truth, rig.mesh.faces)).max())
        box = in_mm(UsdGeom.Boundable(stage.GetDefaultPrim()).GetExtentAttr().Get(k))
        assert (box[0] <= there.min(0) + 1e-3).all() and (box[1] >= there.max(0) - 1e-3).all()
        eye = in_mm(mesh_at(plain, "/sheet/eye_left").GetPointsAttr().Get(k))
        assert np.linalg.norm(eye - (rig.pose_props(pose)[0][1][:4]), axis=1).max() <= tolerance + EXACT_MM
    assert worst <= tolerance + EXACT_MM and turned < (0.1 if tolerance > 1 else 0.02)
    assert np.linalg.norm(rig(weights[-1]) - rig.mesh.neutral, axis=1).max() > 2 * tolerance


def test_a_point_cache_is_every_frame_to_a_micrometre_and_rests_where_the_rig_does(tmp_path):
    rig, stage, words = exported(tmp_path, "cache.usdc", clip="talk", tolerance_mm=0)
    assert complaints(stage) == [] and "the points of each" in words
    mesh, values = mesh_at(stage, "/sheet/sheet"), stage.GetDefaultPrim().GetAttribute("controls:values")
    points, eye = mesh.GetPointsAttr(), mesh_at(stage, "/sheet/eye_left").GetPointsAttr()
    assert points.GetNumTimeSamples() == FRAMES == values.GetNumTimeSamples()
    np.testing.assert_allclose(in_mm(points.Get()), rig.mesh.neutral, atol=EXACT_MM)
    for k, pose in enumerate(rig.clips[0].values):
        there = in_mm(points.Get(k))
        np.testing.assert_allclose(there, rig(pose), atol=EXACT_MM)
        np.testing.assert_allclose(in_mm(eye.Get(k)), rig.pose_props(pose)[0][1][:4], atol=EXACT_MM)
        np.testing.assert_allclose(mesh.GetNormalsAttr().Get(k), vertex_normals(rig(pose), rig.mesh.faces), atol=1e-4)
        np.testing.assert_allclose(in_mm(mesh.GetExtentAttr().Get(k)), [there.min(0), there.max(0)], atol=EXACT_MM)
        np.testing.assert_array_equal(values.Get(k), pose)


def test_sparse_shapes_move_their_vertices_alone_and_keep_their_names(tmp_path):
    from pxr import UsdSkel

    rig = moving_sheet()
    head, generator = posed_parts(rig, rig.default)[0], np.random.default_rng(1)
    dense = generator.normal(size=(30, 3)).astype(np.float32)
    few = BlendShape("mouth.smile", generator.normal(size=(2, 3)).astype(np.float32), np.array([3, 29]))
    weights = np.float32([[0, 0], [1, 0.5], [-2, 1]])
    file = tmp_path / "shapes.usda"
    file.write_bytes(shaped_usd(head, rig.mesh, [BlendShape("all", dense), few], {}, ".usda", weights, 30))
    stage = opened(file)
    assert complaints(stage) == [] and stage.GetTimeCodesPerSecond() == 30
    names = UsdSkel.BindingAPI(stage.GetPrimAtPath("/sheet/sheet")).GetBlendShapesAttr().Get()
    assert list(names) == ["all", "mouth.smile"]
    expected = rig.mesh.neutral + weights[:, :1, None] * dense
    expected[:, [3, 29]] += weights[:, 1:, None] * few.offsets
    plain = baked(file)
    points = mesh_at(plain, "/sheet/sheet").GetPointsAttr()
    np.testing.assert_allclose([in_mm(points.Get(k)) for k in range(3)], expected, atol=EXACT_MM)
    still = tmp_path / "still.usda"
    still.write_bytes(shaped_usd(head, None, [few], {}, ".usda"))
    stage = opened(still)
    assert complaints(stage) == []
    (animation,) = (prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation))
    assert list(UsdSkel.Animation(animation).GetBlendShapeWeightsAttr().Get()) == [0]


def test_names_that_usd_can_not_have_and_names_that_clash_become_others(tmp_path):
    head = posed_parts(moving_sheet(), np.zeros(3, np.float32))[0]
    parts = [UsdPart(replace(head, name=name)) for name in ("2 heads", "2_heads", "Skeleton", "Haar-ß")]
    file = tmp_path / "names.usda"
    file.write_bytes(usd(parts, {"character": "2 heads"}, ".usda"))
    stage = opened(file)
    children = [prim for prim in stage.GetDefaultPrim().GetChildren() if prim.GetTypeName() == "Mesh"]
    assert len({prim.GetName() for prim in children}) == 4 and complaints(stage) == []
    assert [prim.GetDisplayName() for prim in children] == ["2 heads", "2_heads", "Skeleton", "Haar-ß"]


def test_the_tolerance_0_is_for_usd_alone(tmp_path):
    with pytest.raises(InputError, match=r"at least 0\.001 mm, or 0 for every frame's points in a USD, got 0\.0001"):
        Request(clip="0", to=str(tmp_path / "a.usdc"), tolerance_mm=1e-4)
    with pytest.raises(InputError, match=r"at least 0\.001 mm, got 0"):
        Request(clip="0", to=str(tmp_path / "a.glb"), tolerance_mm=0)


def test_without_usd_core_a_sentence_says_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pxr", None)
    sentence = refusal(capsys, "export", "--characters", "tiny", "--to", str(tmp_path / "face.usdc"))
    assert "USD files need the package usd-core, of the extra `usd`: python -m pip install usd-core" in sentence
    assert not list(tmp_path.iterdir())
