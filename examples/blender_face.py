"""Pose a face in Blender with a model that `make deploy` wrote: a slider for each control, to be keyed like any other.

In Blender, 4.2 or newer: workspace Scripting, Open, this file, Run Script (the triangle); then choose a model, such as
deploy_teen_regional.onnx, whose .glb lies beside it. The sliders are in the sidebar of the 3D view (key N), tab Face,
and among the object's custom properties. Installed as an add-on (Edit, Preferences, Add-ons, Install from Disk), it is
there after a restart too, so that saved scenes move when they are opened again. From a terminal:

    blender --python blender_face.py -- deploy_teen_regional.onnx

It needs only numpy, which Blender brings: the model is read and computed here. A Python with bpy can import it.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy_extras.io_utils import ImportHelper

bl_info = {
    "name": "Faces of make deploy",
    "blender": (4, 2, 0),
    "category": "Import-Export",
    "location": "3D View, sidebar, Face",
    "description": "Pose faces by the controls of their rig",
}

# An ONNX file: messages of numbered fields, as protocol buffers have them.


def varint(data, place):
    value = shift = 0
    while True:
        byte = data[place]
        value, shift, place = value | (byte & 127) << shift, shift + 7, place + 1
        if byte < 128:
            return value - (value >> 63 << 64), place


def fields(data):
    """Return the values of each field of a message: {number: [whole number or bytes, …]}."""
    found, place = {}, 0
    while place < len(data):
        key, place = varint(data, place)
        if key & 7 == 0:
            value, place = varint(data, place)
        else:
            size, place = (8 if key & 7 == 1 else 4, place) if key & 7 in (1, 5) else varint(data, place)
            value, place = data[place : place + size], place + size
        found.setdefault(key >> 3, []).append(value)
    return found


def integers(values):
    """Return whole numbers, which stand alone or many in a field."""
    found = []
    for value in values:
        place = 0 if not isinstance(value, int) else None
        while place is not None and place < len(value):
            number, place = varint(value, place)
            found.append(number)
        found += [value] if place is None else []
    return found


def words(value):
    return bytes(value).decode()


TYPES = {1: "<f4", 2: "u1", 3: "i1", 5: "<i2", 6: "<i4", 7: "<i8", 9: "?", 10: "<f2"}


def tensor(data):
    known = fields(data)
    return np.frombuffer(known[9][0], TYPES[known[2][0]]).reshape(integers(known.get(1, [])))


def attributes(data):
    """Return an operator's attributes by name: a number, a text or whole numbers."""
    found = {}
    for known in map(fields, data):
        real, whole, text, many = (known.get(number) for number in (2, 3, 4, 8))
        value = np.frombuffer(real[0], "<f4")[0] if real else whole[0] if whole else None
        found[words(known[1][0])] = words(text[0]) if text else integers(many) if many else value
    return found


# The operators that models have, in numpy.


def gemm(x, weight, bias=0, transB=0):
    return x @ (weight.T if transB else weight) + bias


def convolution(x, weight, bias, kernel_shape, pads=(0, 0, 0, 0)):
    """Return a convolution that keeps its image's size."""
    rows, columns = x.shape[2:]
    x = np.pad(x, ((0, 0), (0, 0), (pads[0], pads[2]), (pads[1], pads[3])))
    out = bias[:, None]
    for i in range(kernel_shape[0]):
        for j in range(kernel_shape[1]):
            part = x[:, :, i : i + rows, j : j + columns].reshape(*x.shape[:2], -1)
            out = out + weight[:, :, i, j] @ part
    return out.reshape(len(x), -1, rows, columns)


def resize(x, _, scales, **how):
    return x.repeat(int(scales[2]), 2).repeat(int(scales[3]), 3)


def split(x, lengths=None, axis=0):
    count = x.shape[axis]
    return tuple(np.split(x, np.cumsum([1] * count if lengths is None else lengths)[:-1], axis))


def reshape(x, shape):
    return x.reshape([x.shape[k] if size == 0 else size for k, size in enumerate(shape.tolist())])


def pad(x, ends):
    return np.pad(x, ends.reshape(2, -1).T)


def sigmoid(x):
    return 1 / (1 + np.exp(-np.clip(x, -80, 80)))


def reduction(function):
    def reduce(x, inputs=None, axes=None, keepdims=1):
        return function(x, axis=tuple(axes if inputs is None else inputs.tolist()), keepdims=bool(keepdims))

    return reduce


OPERATORS = {
    "Abs": np.abs,
    "Add": np.add,
    "ArgMax": lambda x, axis, keepdims: np.expand_dims(x.argmax(axis), axis),
    "Cast": lambda x, to: x.astype(np.float32),
    "Clip": lambda x, low, high: np.minimum(np.maximum(x, low), high),
    "Concat": lambda *parts, axis: np.concatenate(parts, axis),
    "Conv": convolution,
    "Cos": np.cos,
    "Div": np.divide,
    "Equal": np.equal,
    "Expand": lambda x, shape: x * np.ones(shape, x.dtype),
    "Gather": lambda x, indices, axis=0: x.take(indices, axis),
    "Gemm": gemm,
    "Identity": lambda x: x,
    "LeakyRelu": lambda x, alpha: np.where(x < 0, np.float32(alpha) * x, x),
    "Less": np.less,
    "MatMul": np.matmul,
    "Max": np.maximum,
    "Min": np.minimum,
    "Mul": np.multiply,
    "Neg": np.negative,
    "Pad": pad,
    "Pow": np.power,
    "ReduceL2": reduction(lambda x, **how: np.sqrt(np.square(x).sum(**how))),
    "ReduceMax": reduction(np.max),
    "ReduceMean": reduction(np.mean),
    "ReduceSum": reduction(np.sum),
    "Relu": lambda x: np.maximum(x, 0),
    "Reshape": reshape,
    "Resize": resize,
    "Sigmoid": sigmoid,
    "Sin": np.sin,
    "Split": split,
    "Sqrt": np.sqrt,
    "Squeeze": lambda x, axes: np.squeeze(x, tuple(axes.tolist())),
    "Sub": np.subtract,
    "Tanh": np.tanh,
    "Transpose": lambda x, perm: x.transpose(perm),
    "Unsqueeze": lambda x, axes: np.expand_dims(x, tuple(axes.tolist())),
    "Where": np.where,
}


class Model:
    """What `make deploy` wrote as ONNX: __call__ takes parameters (b, m) and returns vertices (b, n, 3), mm.

    about: the metadata, words by words. controls: a dict each, with name, region, lower, default and upper.
    """

    def __init__(self, file):
        known = fields(memoryview(Path(file).read_bytes()))
        entries = [fields(entry) for entry in known.get(14, [])]
        self.about = {words(entry[1][0]): words(entry[2][0]) for entry in entries}
        self.controls = json.loads(self.about["controls"])
        graph = fields(known[7][0])
        self._values = {words(fields(data)[8][0]): tensor(data) for data in graph[5]}
        self._nodes = []
        for node in map(fields, graph[1]):
            inputs, outputs = ([words(name) for name in node.get(k, [])] for k in (1, 2))
            step = (words(node[4][0]), inputs, outputs, attributes(node.get(5, [])))
            if all(name in self._values or not name for name in inputs):
                self._compute(step, self._values)  # once: it depends on no parameter
            else:
                self._nodes.append(step)

    def __call__(self, params):
        values = {"parameters": np.asarray(params, np.float32), **self._values}
        for step in self._nodes:
            self._compute(step, values)
        return values["vertices"]

    @staticmethod
    def _compute(step, values):
        operator, inputs, outputs, own = step
        result = OPERATORS[operator](*(values[name] if name else None for name in inputs), **own)
        values |= zip(outputs, result if isinstance(result, tuple) else (result,), strict=True)


# Blender: x to the right in the picture of a face that looks at us, y away from us, z up; metres.

FILE = "face_model"  # the property with the model's file
LONGEST = 63  # characters of a property's name
MODELS, LAST = {}, {}  # models by their files; the parameters that each mesh shows


def in_blender(vertices):
    """Return vertices (n, 3) in mm, y up and z forward, as Blender's."""
    return np.ascontiguousarray(vertices[:, [0, 2, 1]] * np.float32([1e-3, -1e-3, 1e-3]))


def model_of(face):
    """Return the model of an object, or None where its file is gone."""
    file = bpy.path.abspath(face[FILE])
    if file not in MODELS:
        MODELS[file] = Model(file) if Path(file).is_file() else None
        if MODELS[file] is None:
            print(f"{face.name} stays as it is: there is no file {file}")
    return MODELS[file]


def properties(model):
    """Return the name of the property of each control, in their order."""
    names = [control["name"] for control in model.controls]
    return [name if len(name.encode()) <= LONGEST else f"{name[:30]}_{k}" for k, name in enumerate(names)]


def load(file):
    """Add the face of a model, deploy_….onnx, to the scene, with a property for each control; return the object."""
    model, before = Model(file), set(bpy.data.objects)
    mesh_file = Path(file).with_name(f"deploy_{model.about['character']}.glb")
    if not mesh_file.is_file():
        raise ValueError(f"{mesh_file.name} has to lie beside {Path(file).name}: make deploy writes both")
    bpy.ops.import_scene.gltf(filepath=str(mesh_file), import_shading="SMOOTH")
    (face,) = (thing for thing in bpy.data.objects if thing not in before and thing.type == "MESH")
    rest = np.empty((len(face.data.vertices), 3), np.float32)
    face.data.vertices.foreach_get("co", rest.ravel())
    wanted = in_blender(model([[control["default"] for control in model.controls]])[0])
    if len(rest) != len(wanted) or np.median(np.linalg.norm(rest - wanted, axis=1)) > 5e-3:
        bpy.data.objects.remove(face)
        raise ValueError(f"{mesh_file.name} is not the mesh of {Path(file).name}: make deploy writes both")
    for name, control in zip(properties(model), model.controls, strict=True):
        face[name] = float(control["default"])
        limits = {"soft_min": control["lower"], "soft_max": control["upper"], "default": control["default"]}
        face.id_properties_ui(name).update(**limits, description=f"{control['region']}: {control['name']}")
    face[FILE] = str(Path(file).resolve())
    face.data["frame"] = 0.0  # exporters of USD and Alembic write every frame of a mesh of which something moves
    face.data.driver_add('["frame"]').driver.expression = "frame"
    bpy.context.view_layer.objects.active = face
    face.update_tag()
    bpy.context.view_layer.update()
    return face


@persistent
def follow(scene, graph=None):
    """Move every face whose properties have changed: by hand, by keys or by drivers."""
    graph = graph or bpy.context.evaluated_depsgraph_get()
    for face in scene.objects:
        if face.type != "MESH" or FILE not in face or face.mode == "EDIT" or (model := model_of(face)) is None:
            continue
        values = face.evaluated_get(graph)
        params = np.array([values[name] for name in properties(model)], np.float32)
        if np.array_equal(LAST.get(face.data.session_uid), params):
            continue
        LAST[face.data.session_uid] = params
        vertices = in_blender(model(params[None])[0])
        if len(vertices) == len(face.data.vertices):
            face.data.vertices.foreach_set("co", vertices.ravel())
            face.data.update()


class LoadFace(bpy.types.Operator, ImportHelper):
    """Add a face that make deploy wrote: choose its ONNX file; the GLB has to lie beside it"""

    bl_idname, bl_label = "import_scene.deployed_face", "Face of make deploy (.onnx)"
    filename_ext = ".onnx"
    filter_glob: bpy.props.StringProperty(default="*.onnx", options={"HIDDEN"})

    def execute(self, context):
        try:
            load(self.filepath)
        except (OSError, ValueError, LookupError) as error:
            self.report({"ERROR"}, f"{Path(self.filepath).name}: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}


class RestFace(bpy.types.Operator):
    """Set all controls to their defaults"""

    bl_idname, bl_label, bl_options = "object.rest_face", "Rest", {"REGISTER", "UNDO"}

    def execute(self, context):
        face = context.object
        for name, control in zip(properties(model_of(face)), model_of(face).controls, strict=True):
            face[name] = float(control["default"])
        face.update_tag()
        return {"FINISHED"}


class FacePanel(bpy.types.Panel):
    bl_idname, bl_label, bl_category = "VIEW3D_PT_deployed_face", "Face", "Face"
    bl_space_type, bl_region_type = "VIEW_3D", "UI"

    def draw(self, context):
        self.layout.operator(LoadFace.bl_idname)
        face = context.object
        if face is None or FILE not in face or (model := model_of(face)) is None:
            return
        self.layout.operator(RestFace.bl_idname)
        parts = {}
        for name, control in zip(properties(model), model.controls, strict=True):
            parts.setdefault(control["region"], []).append(name)
        for region, names in parts.items():
            header, body = self.layout.panel(f"face_{region}", default_closed=True)
            header.label(text=region)
            for name in names if body else ():
                body.prop(face, f'["{bpy.utils.escape_identifier(name)}"]', text=name, slider=True)


CLASSES = (LoadFace, RestFace, FacePanel)
HANDLERS = ("frame_change_post", "depsgraph_update_post", "load_post")


def in_menu(menu, context):
    menu.layout.operator(LoadFace.bl_idname)


@persistent
def opened(*_):
    LAST.clear()
    MODELS.clear()
    follow(bpy.context.scene)


def register():
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.TOPBAR_MT_file_import.append(in_menu)
    for name in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        handlers[:] = [known for known in handlers if known.__name__ not in ("follow", "opened")]  # of an earlier run
        handlers.append(opened if name == "load_post" else follow)


def unregister():
    for name in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        handlers[:] = [known for known in handlers if known not in (follow, opened)]
    bpy.types.TOPBAR_MT_file_import.remove(in_menu)
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)


if __name__ == "__main__":
    register()
    named = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    for file in named:
        load(file)
    if not named and not bpy.app.background:
        bpy.ops.import_scene.deployed_face("INVOKE_DEFAULT")
