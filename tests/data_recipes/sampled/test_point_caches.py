"""Point caches as samples: what `make export` writes comes back as the same rig, and foreign files are converted."""

import sys

import numpy as np
import pytest
from moving_sheet import FRAMES, moving_sheet
from refusal import refusal
from sample_folders import CONTROLS, NAMES, neutral, obj, vertices_at

from data_recipes import recipe_paths
from data_recipes.exporters.blender_python import VARIABLE, blender_python
from data_recipes.sampled.importing import SampledRecipe, import_rig
from data_recipes.sampled.sample_folder import open_folder, read_folder
from replicate.base.exceptions import InputError
from replicate.config import resolve
from replicate.targets.export import Request, export


@pytest.fixture(autouse=True)
def _library(request):
    open_folder.cache_clear()
    if "without_usd_core" not in request.node.name and "without_blender" not in request.node.name:
        pytest.importorskip("pxr.UsdSkel", reason="needs usd-core")


def imported(folder, tmp_path):
    found = read_folder(folder)
    (tmp_path / "rig").mkdir()
    return import_rig(SampledRecipe(found.face), found.files, tmp_path / "rig")


@pytest.mark.parametrize("tolerance", [0, 0.01])
def test_what_export_writes_is_read_back_as_the_same_rig(tmp_path, tolerance):
    rig, folder = moving_sheet(), tmp_path / "sheet 1"
    folder.mkdir()
    export(rig, Request(clip="talk", to=str(folder / "talk.usdc"), tolerance_mm=tolerance))
    back = imported(folder, tmp_path)
    assert [(c.name, c.lower, c.default, c.upper, c.region) for c in back.controls] == [
        (c.name, c.lower, c.default, c.upper, c.region) for c in rig.controls
    ]
    (clip,) = back.clips
    assert clip.name == "talk" and back.name == "sheet_1"
    np.testing.assert_array_equal(clip.values, rig.clips[0].values)
    shift = back.mesh.neutral.mean(0) - rig.mesh.neutral.mean(0)
    np.testing.assert_allclose(back.mesh.neutral - shift, rig.mesh.neutral, atol=1e-3)
    np.testing.assert_allclose(back(clip.values) - shift, rig(clip.values), atol=1e-3 + tolerance)
    assert back.mesh.segment_names == ("lower_lip", "upper")
    np.testing.assert_array_equal(back.mesh.segment, rig.mesh.segment)
    assert sorted(map(tuple, np.sort(back.mesh.faces))) == sorted(map(tuple, np.sort(rig.mesh.faces)))


PARAMS = np.random.default_rng(3).uniform(0, 1, (25, 3)).astype(np.float32)


def cache(file, points=None, faces=None, metres=0.01, up="Z", rest=True, change=lambda stage, mesh: None):
    """Write the sheet as other programs do: quads, centimetres, z up, on a moved prim, from frame 101 on."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    file.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, up)
    place = UsdGeom.Xform.Define(stage, "/world")
    place.AddTranslateOp().Set((0, 0, 7))
    mesh = UsdGeom.Mesh.Define(stage, "/world/face")
    faces = faces or [
        [int(k.split("/")[0]) - 1 for k in line.split()[1:]] for line in obj().splitlines() if line[0] == "f"
    ]
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([k for face in faces for k in face])
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("map1", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(k % 5 / 4, k // 5 / 5) for k in range(30)])
    theirs = lambda v: Vt.Vec3fArray.FromNumpy(  # noqa: E731
        (np.stack([v[:, 0], -v[:, 2], v[:, 1]] if up == "Z" else v.T, 1) / 1000 / metres - [0, 0, 7]).astype(np.float32)
    )
    attribute = mesh.CreatePointsAttr()
    if rest:
        attribute.Set(theirs(neutral()))
    for k, vertices in enumerate(vertices_at(PARAMS) if points is None else points):
        attribute.Set(theirs(vertices), 101 + k)
    change(stage, mesh)
    stage.GetRootLayer().Save()


def table(file, rows=PARAMS, header=None):
    header = header or ",".join(NAMES)
    file.write_text("\n".join([header, *(",".join(map(repr, row.tolist())) for row in rows)]) + "\n")


@pytest.mark.parametrize("metres, up", [(0.01, "Z"), (0.001, "Y"), (1.0, "Y"), (0.0254, "Z")])
def test_a_cache_and_a_table_are_a_folder_in_any_unit_and_axes(tmp_path, metres, up):
    folder = tmp_path / "myface"
    folder.mkdir()
    cache(folder / "talk.usda", metres=metres, up=up)
    table(folder / "controls.csv", np.column_stack([np.arange(101, 126), PARAMS]), "frame," + ",".join(NAMES))
    place = recipe_paths.named(str(folder / "talk.usda"))
    assert place == str(folder) == recipe_paths.absolute(place) and recipe_paths.character_label(place) == "myface"
    assert recipe_paths.recipe_file(place) == folder / "talk.usda" and resolve(place, "quick").character == place
    found = open_folder(folder)
    np.testing.assert_allclose(found.vertices_mm, neutral(), atol=1e-3)
    np.testing.assert_allclose(found.shards[0].read("vertices"), vertices_at(PARAMS), atol=1e-3)
    np.testing.assert_array_equal(found.poses.params, PARAMS)
    assert found.poses.clips == (("talk", 25),)
    reach = [(control.name, control.lower, control.default, control.upper) for control in found.controls]
    assert reach == [(name, 0.0, 0.0, pytest.approx(PARAMS[:, k].max())) for k, name in enumerate(NAMES)]
    assert found.neutral.uv is not None and set(found.neutral.groups) == {"face"}


def test_caches_are_shards_beside_others_in_the_unit_and_axes_of_face_toml(tmp_path):
    folder = tmp_path / "box"
    (folder / "poses").mkdir(parents=True)
    text = 'name = "box"\nunit = "m"\nup = "z"\nmesh = "mesh.usda"\nsegments = "groups"\n'
    (folder / "face.toml").write_text(text)
    (folder / "controls.csv").write_text(CONTROLS)
    cache(folder / "mesh.usda", points=[])
    cache(folder / "poses" / "talk.usdc")
    table(folder / "poses" / "talk.csv")
    z_up = lambda v: np.stack([v[..., 0], -v[..., 2], v[..., 1]], -1) / 1000  # noqa: E731
    more = np.random.default_rng(4).uniform(0, 1, (6, 3)).astype(np.float32)
    np.savez(folder / "poses" / "more.npz", params=more, vertices=z_up(vertices_at(more)).astype(np.float32))
    found = open_folder(folder)
    np.testing.assert_allclose(found.vertices_mm, neutral(), atol=1e-3)
    for shard, params in zip(found.shards, (more, PARAMS), strict=True):
        np.testing.assert_array_equal(shard.read("params"), params)
        np.testing.assert_allclose(shard.read("vertices"), z_up(vertices_at(params)), atol=1e-6)
    assert [(c.lower, c.upper) for c in found.controls] == [(0, 1), (-1, 1), (0, 1)]


def other_faces(stage, mesh):
    attribute = mesh.GetFaceVertexIndicesAttr()
    corners = list(attribute.Get())
    attribute.Set(corners, 101)
    attribute.Set([*corners[:-1], corners[0]], 120)


def fewer_points(stage, mesh):
    mesh.GetPointsAttr().Set(list(mesh.GetPointsAttr().Get(110))[:-1], 110)


def refers(stage, mesh):
    stage.GetRootLayer().subLayerPaths.append("other.usda")


def in_tens_of_metres(stage, mesh):
    stage.SetMetadata("metersPerUnit", 10.0)


def spoilt(**changes):
    return lambda folder: cache(folder / "talk.usda", **changes)


def retold(*rows):
    return lambda folder: (folder / "controls.csv").write_text("\n".join(rows))


OTHER_FRAMES = np.column_stack([np.arange(25), PARAMS])
FAULTS = {
    "a row less": (lambda f: table(f / "controls.csv", PARAMS[1:]), r"a row for each of the 25 frames of .*, got 24"),
    "other frames": (lambda f: table(f / "controls.csv", OTHER_FRAMES, "frame,a,b,c"), "row 1: expected a frame of"),
    "no table": (lambda f: (f / "controls.csv").unlink(), "nothing says what the controls are in its frames"),
    "a text": (retold("a,b", "1,x"), r"controls\.csv: line 2: b: expected a number, got 'x'"),
    "a short row": (retold("a,b", "1"), "line 2: expected 2 values, got 1"),
    "a control twice": (retold("a,a", "1,1"), "names 'a' 2 times"),
    "other faces": (spoilt(change=other_faces), "mesh 'face': its faces at frame 120 are others than at frame 101"),
    "fewer points": (spoilt(change=fewer_points), "mesh 'face' at frame 110: expected 30 vertices .* got 29"),
    "a still mesh": (spoilt(points=[]), "expected points that move over time"),
    "other files": (spoilt(change=refers), r"it refers to other files, other\.usda: write one"),
    "damage": (lambda f: (f / "talk.usda").write_bytes(b"#usda 1.0\n(\n"), "not a readable USD file"),
    "a wrong face": (spoilt(faces=[[0, 1, 99], [0, 1, 2]]), "face 0 .from 0.: expected vertices from 0 to 29"),
    "two caches": (lambda f: cache(f / "more.usda"), "expected one point cache, or several in poses, got more"),
    "another unit": (spoilt(change=in_tens_of_metres), "metersPerUnit. the mesh is .* mm large"),
}  # fmt: skip


@pytest.mark.parametrize("what", FAULTS)
def test_a_cache_that_contradicts_itself_gets_one_sentence(tmp_path, what):
    folder = tmp_path / "myface"
    folder.mkdir()
    cache(folder / "talk.usda")
    table(folder / "controls.csv")
    fault, sentence = FAULTS[what]
    fault(folder)
    with pytest.raises(InputError, match=sentence) as error:
        open_folder(folder)
    assert str(folder) in str(error.value) and "\n" not in str(error.value)


def test_frames_in_which_nothing_moves_may_be_left_out_of_a_file(tmp_path):
    def held(stage, mesh):
        for frame in (104, 105, 106):
            mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(103), frame)
        mesh.GetPointsAttr().ClearAtTime(104)
        mesh.GetPointsAttr().ClearAtTime(105)
        stage.SetStartTimeCode(101)
        stage.SetEndTimeCode(125)

    cache(tmp_path / "talk.usda", change=held)
    expected = vertices_at(np.concatenate([PARAMS[:3], PARAMS[[2, 2, 2]], PARAMS[6:]]))
    table(tmp_path / "controls.csv")
    found = open_folder(tmp_path)
    np.testing.assert_allclose(found.shards[0].read("vertices"), expected, atol=1e-3)
    open_folder.cache_clear()
    table(tmp_path / "controls.csv", np.column_stack([np.arange(103, 125), PARAMS[2:24]]), "frame," + ",".join(NAMES))
    np.testing.assert_allclose(open_folder(tmp_path).shards[0].read("vertices"), expected[2:24], atol=1e-3)


def test_without_points_at_rest_the_first_frame_is_the_neutral_and_standard_error_says_so(capsys, tmp_path):
    folder = tmp_path / "myface"
    folder.mkdir()
    params = np.concatenate([np.zeros((1, 3), np.float32), PARAMS])
    cache(folder / "talk.usda", points=vertices_at(params), rest=False)
    table(folder / "controls.csv", params)
    found = open_folder(folder)
    np.testing.assert_allclose(found.vertices_mm, neutral(), atol=1e-3)
    assert "it states no points at rest: its first frame is taken for the neutral pose" in capsys.readouterr().err
    open_folder.cache_clear()
    table(folder / "controls.csv", np.roll(params, 5, axis=0))
    with pytest.raises(InputError, match="pose 5 is at all defaults, and its vertex"):
        open_folder(folder)


def test_without_usd_core_a_sentence_says_what_to_install(monkeypatch, tmp_path):
    folder = tmp_path / "myface"
    folder.mkdir()
    (folder / "talk.usda").write_text("#usda 1.0\n")
    table(folder / "controls.csv")
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(
        InputError, match=r"talk\.usda: USD files need the package usd-core, of the extra `usd`: python -m"
    ):
        open_folder(folder)


# -- Alembic, through Blender --------------------------------------------------------------------------------------


@pytest.fixture
def _blender():
    try:
        blender_python()
    except InputError:
        pytest.skip("needs a Python with bpy, or Blender")


@pytest.mark.usefixtures("_blender")
def test_alembic_keeps_points_and_order_and_is_read_in_the_unit_that_face_toml_says(tmp_path):
    rig, folder = moving_sheet(), tmp_path / "sheet"
    (folder / "poses").mkdir(parents=True)
    files, words = export(rig, Request(clip="talk", to=str(folder / "poses" / "talk.abc")))
    assert [file.name for file in files] == ["talk.abc", "talk.csv"] and f"in {FRAMES} more" in words
    files[0].rename(folder / "talk.abc")
    with pytest.raises(InputError, match=r"talk\.abc: Alembic states no unit and no axes: write a face\.toml"):
        files[1].rename(folder / "talk.csv")
        (folder / "poses").rmdir()
        open_folder(folder)
    text = 'name = "sheet"\nunit = "m"\nup = "y"\nmesh = "talk.abc"\n'
    (folder / "face.toml").write_text(text)
    found = open_folder(folder)
    np.testing.assert_allclose(found.vertices_mm, rig.mesh.neutral, atol=1e-3)
    np.testing.assert_array_equal(found.poses.params[1:], rig.clips[0].values)
    np.testing.assert_allclose(1000 * found.shards[0].read("vertices")[1:], rig(rig.clips[0].values), atol=1e-3)
    assert sorted(map(tuple, np.sort(found.neutral.faces))) == sorted(map(tuple, np.sort(rig.mesh.faces)))
    np.testing.assert_allclose(found.neutral.uv[found.neutral.uv_faces], rig.mesh.uv[found.neutral.faces], atol=1e-6)
    open_folder.cache_clear()
    (folder / "face.toml").write_text(text.replace('"m"', '"in"'))
    with pytest.raises(InputError, match='with unit = "in" the mesh is'):
        open_folder(folder)


@pytest.mark.usefixtures("_blender")
def test_what_is_no_alembic_gets_a_sentence(tmp_path):
    (tmp_path / "talk.abc").write_bytes(b"Ogawa")
    (tmp_path / "face.toml").write_text('name = "sheet"\nunit = "m"\nup = "y"\nmesh = "talk.abc"\n')
    table(tmp_path / "controls.csv")
    with pytest.raises(InputError, match=r"talk\.abc: (Blender|expected a mesh)"):
        open_folder(tmp_path)


def test_without_blender_a_sentence_says_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, "no_such_blender")
    sentence = refusal(capsys, "export", "--characters", "tiny", "--to", str(tmp_path / "face.abc"))
    assert "usd-core" in sentence or VARIABLE in sentence
    assert not list(tmp_path.iterdir())
