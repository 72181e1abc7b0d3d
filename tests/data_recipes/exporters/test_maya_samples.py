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
        kinds = {"lip_ctrl": "transform", "shapes": "blendShape", "curve": "animCurve"}
        return kinds[node] == isAType if isAType else kinds[node]

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
