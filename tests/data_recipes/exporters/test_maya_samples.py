"""The exporter for Maya over a stand-in for maya.cmds: it shows that the calls fit together, not that Maya agrees."""

import sys
import types

import numpy as np
import pytest

from data_recipes.exporters import maya_samples

MOVES = ("translation", "rotation", "scale", "enableTranslation", "enableRotation", "enableScale")
FLAGS = {f"{move}{axis}" for move in MOVES for axis in "XYZ"}  # of Maya's transformLimits
SQUARE = np.array([[0, 0, 0], [20, 0, 0], [20, 20, 0], [0, 20, 0]], float)


class Scene:
    """A square that three attributes move: two of a node along x and y, the second keyed, a shape's weight along z."""

    def __init__(self, keyed=True):
        self.values = {"lip_ctrl.translateX": 0.0, "lip_ctrl.curl": 0.0, "shapes.smile": 0.0}
        self.keyed = {"lip_ctrl.curl"} if keyed else set()
        self.cut = []

    def objectType(self, node, isAType=None):
        kinds = {"lip_ctrl": "transform", "shapes": "blendShape", "curve": "animCurveTU"}
        return kinds[node].startswith(isAType) if isAType else kinds[node]

    def ls(self, pattern, type=None):
        if type == "mesh":
            return [pattern] if pattern == "headShape" else []
        return {"*_ctrl": ["lip_ctrl"], "shapes": ["shapes"]}.get(pattern, [])

    def listRelatives(self, name, **flags):
        return ["headShape"] if name == "head" else None

    def listAttr(self, node, multi=False, **flags):
        return ["smile"] if multi else ["visibility", "translateX", "curl"]

    def getAttr(self, plug, lock=False, type=False, time=None):
        if lock or plug.endswith(".intermediateObject"):
            return False
        if type:
            return "double"
        return np.sin(time / 5) if time is not None and plug in self.keyed else self.values[plug]

    def setAttr(self, plug, value):
        self.values[plug] = value

    def listConnections(self, plug, d=True, plugs=False):
        return (["curve.output"] if plugs else ["curve"]) if plug in self.keyed else None

    def disconnectAttr(self, source, plug):
        self.cut.append(plug)

    def transformLimits(self, node, query, **flags):
        (flag,) = flags
        if flag not in FLAGS:
            raise TypeError(f"Invalid flag '{flag}'")
        return [True, True] if flag.startswith("enable") else [-3.0, 3.0]

    def attributeQuery(self, attribute, node, **flags):
        (flag,) = flags
        return {"listDefault": [0.0], "minExists": False, "maxExists": False}[flag]

    def keyframe(self, plug, query, keyframeCount):
        return 5 if plug in self.keyed else 0

    def playbackOptions(self, query, **flags):
        return 1.0 if "minTime" in flags else 30.0

    def currentUnit(self, query, time):
        return "pal"

    def upAxis(self, query, axis):
        return "y"

    def undoInfo(self, state):
        pass

    def points(self):
        return SQUARE + [self.values[plug] for plug in ("lip_ctrl.translateX", "lip_ctrl.curl", "shapes.smile")]


class Mesh:
    """What the exporter asks of OpenMaya.MFnMesh."""

    numPolygons, numVertices = 1, 4

    def __init__(self, scene):
        self.scene = scene

    def name(self):
        return "headShape"

    def getPoints(self, space):
        return np.c_[self.scene.points(), np.ones(4)].tolist()

    def getAssignedUVs(self):
        return [4], [0, 1, 2, 3]

    def getUVs(self):
        return [0, 1, 1, 0], [0, 0, 1, 1]

    def getConnectedShaders(self, instance):
        return ["shader"], [0]

    def getPolygonVertices(self, i):
        return [0, 1, 2, 3]


class Selection:
    def add(self, name):
        self.name = name

    def getDagPath(self, i):
        return self.name


@pytest.fixture
def stage(monkeypatch):
    """Return the function that puts a scene where the exporter imports Maya from."""

    def put(scene):
        maya, api = types.ModuleType("maya"), types.ModuleType("maya.api")
        maya.cmds, maya.api = scene, api
        api.OpenMaya = types.SimpleNamespace(
            MSelectionList=Selection,
            MFnMesh=lambda path: Mesh(scene),
            MSpace=types.SimpleNamespace(kWorld=4),
            MFnDependencyNode=lambda shader: types.SimpleNamespace(name=lambda: "skin"),
        )
        monkeypatch.setitem(sys.modules, "maya", maya)
        monkeypatch.setitem(sys.modules, "maya.api", api)

    return put


NODES = {"shapes": ["smile", "empty"], "teeth_shapes": ["smile", "driven", "w[3]"], "more_shapes": ["w[3]", "up"]}


class Avatar(Scene):
    """Weights of two nodes: "smile" moves the square along x and along y, as on two meshes; others do nothing."""

    def __init__(self, keyed=()):
        super().__init__()
        self.values = {f"{node}.{name}": 0.0 for node, names in NODES.items() for name in names}
        self.keyed = set(keyed)

    def objectType(self, node, isAType=None):
        kind = {"curve": "animCurveTL", "driven_key": "animCurveUU"}.get(node, "blendShape")
        return kind.startswith(isAType) if isAType else kind

    def ls(self, pattern, type=None):
        return super().ls(pattern, type) if type == "mesh" else {"*shapes": list(NODES)}.get(pattern, [])

    def listAttr(self, node, multi=False, **flags):
        return NODES[node.removesuffix(".w")]

    def listConnections(self, plug, d=True, plugs=False):
        return ["driven_key"] if plug == "teeth_shapes.driven" else super().listConnections(plug, d, plugs)

    def points(self):
        return SQUARE + [self.values[plug] for plug in ("shapes.smile", "teeth_shapes.smile", "more_shapes.up")]


def export_avatar(folder, *words):
    return maya_samples.main(["--mesh", "head", "--controls", "*shapes", "--out", str(folder), *words])


def test_weights_with_one_name_are_one_control_and_those_without_effect_are_left_out(stage, tmp_path, capsys):
    stage(Avatar())
    assert export_avatar(tmp_path / "square", "--poses", "60") == 0
    rows = (tmp_path / "square" / "controls.csv").read_text().splitlines()
    assert rows[1:] == ["smile,0,0,1,mouth", "more_shapes.up,0,0,1,face"]
    poses = np.load(tmp_path / "square" / "poses" / "drawn-0000000-0000060.npz")
    np.testing.assert_allclose(poses["vertices"], SQUARE + poses["params"][:, None, [0, 0, 1]], atol=1e-5)
    assert 0 < (poses["params"] > 0).all(axis=1).mean() < 0.8 and "clip" not in poses
    lines = capsys.readouterr().err.splitlines()
    assert any(line.endswith("one control each: smile (shapes, teeth_shapes)") for line in lines)
    (idle,) = (line for line in lines if "move no vertex" in line)
    assert idle.endswith(": shapes.empty, teeth_shapes.w[3], more_shapes.w[3]")  # no names, so not the same


def test_a_joined_weight_moves_in_a_clip_as_the_one_that_has_keys(stage, tmp_path):
    scene = Avatar(keyed=["teeth_shapes.smile"])
    stage(scene)
    assert export_avatar(tmp_path / "square", "--poses", "0", "--clip", "grin=1:30") == 0
    frames = np.load(tmp_path / "square" / "poses" / "frames-0000000-0000030.npz")
    np.testing.assert_allclose(frames["params"][:, 0], np.sin(np.arange(1, 31) / 5), atol=1e-6)
    np.testing.assert_allclose(frames["vertices"], SQUARE + frames["params"][:, None, [0, 0, 1]], atol=1e-5)
    assert scene.cut == ["teeth_shapes.smile"]


def test_an_attribute_with_driven_keys_is_no_control(stage):
    stage(Avatar())
    assert maya_samples.is_driven("teeth_shapes.driven") and not maya_samples.is_driven("shapes.smile")


def call(folder, *words):
    return maya_samples.main(
        ["--mesh", "head", "--controls", "*_ctrl", "--controls", "shapes", "--out", str(folder), *words]
    )


def test_keys_become_clips_and_poses_are_what_the_attributes_make(stage, tmp_path):
    scene = Scene()
    stage(scene)
    assert call(tmp_path / "square", "--poses", "40", "--clip", "curling=1:20", "--clip", "rest=21:30") == 0
    frames = np.load(tmp_path / "square" / "poses" / "frames-0000000-0000030.npz")
    assert frames["clip"].tolist() == ["curling"] * 20 + ["rest"] * 10
    np.testing.assert_allclose(frames["params"][:, 1], np.sin(frames["frame"] / 5), atol=1e-6)
    np.testing.assert_allclose(frames["vertices"], SQUARE + frames["params"][:, None], atol=1e-5)
    assert scene.cut == ["lip_ctrl.curl"]
    text = (tmp_path / "square" / "face.toml").read_text()
    assert 'unit = "cm"' in text and 'up = "y"' in text and "frames_per_second = 25" in text
    rows = (tmp_path / "square" / "controls.csv").read_text().splitlines()
    assert rows[1] == "lip_ctrl.translateX,-3,0,3,mouth" and rows[3] == "shapes.smile,0,0,1,mouth"


@pytest.mark.parametrize("attribute", [f"{move}{axis}" for move in ("translate", "rotate", "scale") for axis in "XYZ"])
def test_maya_knows_every_flag_that_asks_for_the_limits_of_a_transform(attribute, stage):
    stage(Scene())
    assert maya_samples.limits_of("lip_ctrl", attribute) == (-3.0, 3.0)


def test_without_keys_all_controls_need_limits(stage, tmp_path, capsys):
    stage(Scene(keyed=False))
    assert call(tmp_path / "square") == 2
    assert "lip_ctrl.curl has no limits" in capsys.readouterr().err
    assert not (tmp_path / "square").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--clip", "nod"), "--clip: expected name=first:last, got nod"),
        (("--controls", "nobody"), "no node matches 'nobody'"),
        (("--mesh", "nose"), "--mesh nose: expected one mesh, got 0"),
    ],
)
def test_what_is_not_there_is_refused_in_one_sentence(words, sentence, stage, tmp_path, capsys):
    stage(Scene())
    assert call(tmp_path / "square", *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and sentence in line


def test_without_maya_the_sentence_says_so(tmp_path, capsys):
    assert call(tmp_path / "square") == 2
    assert "no maya.cmds" in capsys.readouterr().err
