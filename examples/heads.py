"""Write heads that others made as GLBs with morph targets, the kind of file that an avatar is.

    python examples/heads.py makehuman /path/to/makehuman makehuman.glb     # its base mesh's head, CC0
    python examples/heads.py ict /path/to/ICT-FaceKit ict.glb               # USC ICT's generic head, in ARKit's names

The folders are those of the two repositories on GitHub, makehumancommunity/makehuman and USC-ICT/ICT-FaceKit.
"""

import argparse
import json
import os
import struct
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the project's folder, wherever this is run from

from data_recipes.ict.facekit_files import VARIABLE, read_model
from data_recipes.recipe.reading import load_recipe
from replicate.base.exceptions import InputError

STILL_M = 1e-5  # a part's shapes that move nothing farther are left out


class Glb:
    """A GLB in the making: its JSON, and the bytes of its one buffer."""

    def __init__(self):
        self.tree = {"asset": {"version": "2.0"}, "scene": 0, "nodes": [], "meshes": [], "accessors": []}
        self.tree["bufferViews"], self.data = [], bytearray()

    def numbers(self, values, code, kind):
        """Add rows of values as an accessor and return its index; code, kind: glTF's for their type and width."""
        rows = np.ascontiguousarray(values, {5126: "<f4", 5125: "<u4", 5123: "<u2"}[code])
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": rows.nbytes})
        self.data += rows.tobytes() + bytes(-rows.nbytes % 4)
        entry = {"bufferView": len(self.tree["bufferViews"]) - 1, "componentType": code, "count": len(rows)}
        entry |= {"type": kind} | ({"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if kind == "VEC3" else {})
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1

    def node(self, **entry):
        """Add a node and return its index."""
        self.tree["nodes"].append(entry)
        return len(self.tree["nodes"]) - 1

    def part(self, name, vertices, uv, corners, uv_corners, shapes, weights=None):
        """Add a mesh (n, 3), in metres, split at its texture's seams, with the shapes (n, 3) that move it.

        corners, uv_corners: vertex and texture coordinate of each triangle's corners (f, 3). weights: (n, joints).
        """
        pairs = np.stack([corners.ravel(), uv_corners.ravel()], axis=1)
        pairs, index = np.unique(pairs, axis=0, return_inverse=True)
        rows, charts = pairs.T
        uv = uv[charts] * [1, -1] + [0, 1]  # a glTF's v grows downwards
        attributes = {"POSITION": self.numbers(vertices[rows], 5126, "VEC3")}
        attributes["TEXCOORD_0"] = self.numbers(uv, 5126, "VEC2")
        entry = {"name": name, "mesh": len(self.tree["meshes"])}
        if weights is not None:
            joints = np.argsort(-weights[rows], axis=1)[:, :4]
            shares = np.take_along_axis(weights[rows], joints, 1)
            attributes["JOINTS_0"] = self.numbers(joints, 5123, "VEC4")
            attributes["WEIGHTS_0"] = self.numbers(shares / shares.sum(axis=1, keepdims=True), 5126, "VEC4")
            entry["skin"] = 0
        shapes = {shape: offset[rows] for shape, offset in shapes.items() if np.abs(offset[rows]).max() > STILL_M}
        primitive = {"attributes": attributes, "indices": self.numbers(index.ravel(), 5125, "SCALAR")}
        mesh = {"name": name, "primitives": [primitive]}
        if shapes:
            primitive["targets"] = [{"POSITION": self.numbers(offset, 5126, "VEC3")} for offset in shapes.values()]
            mesh |= {"weights": [0.0] * len(shapes), "extras": {"targetNames": list(shapes)}}
        self.tree["meshes"].append(mesh)
        self.node(**entry)
        print(f"{name}: {len(rows):,} vertices, {len(corners):,} triangles, {len(shapes)} shapes")

    def write(self, file, licence):
        """Write the file; nodes without parents are its scene's."""
        below = {child for node in self.tree["nodes"] for child in node.get("children", [])}
        self.tree["scenes"] = [{"nodes": [k for k in range(len(self.tree["nodes"])) if k not in below]}]
        self.tree["asset"]["copyright"], self.tree["buffers"] = licence, [{"byteLength": len(self.data)}]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        file.write_bytes(struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks)


# MakeHuman: the base mesh is a body in decimetres. Teeth, tongue and eyes are among its helpers; so are lashes, broad
# strips for a texture to cut out, which are left out here.
PERSON = "macrodetails/caucasian-female-young.target"
PARTS = {
    "body": "Head",
    "helper-upper-teeth": "TeethUpper",
    "helper-lower-teeth": "TeethLower",
    "helper-tongue": "Tongue",
    "helper-l-eye": "EyeLeft",
    "helper-r-eye": "EyeRight",
}
JOINTS = ("neck01", "neck02", "neck03", "head", "jaw", "eye.L", "eye.R")  # parents first; others go with theirs
M_PER_DM = 0.1


def write_makehuman(folder, file):
    data = folder / "makehuman" / "data"
    vertices, uv, corners, uv_corners, groups = read_obj(data / "3dobjs" / "base.obj")
    vertices += read_target(data / "targets" / PERSON, len(vertices))
    units = sorted((data / "targets" / "expression" / "units" / "caucasian").glob("*.target"))
    shapes = {unit.stem: M_PER_DM * read_target(unit, len(vertices)) for unit in units}

    rig = json.loads((data / "rigs" / "default.mhskel").read_text())
    weights = np.zeros((len(vertices), len(JOINTS)))
    for bone, pairs in json.loads((data / "rigs" / "default_weights.mhw").read_text())["weights"].items():
        while bone and bone not in JOINTS:
            bone = rig["bones"][bone]["parent"]
        if bone:
            rows, shares = np.array(pairs).T
            weights[rows.astype(int), JOINTS.index(bone)] += shares
    weights[weights.sum(axis=1) == 0, 0] = 1.0
    glb, places = Glb(), {}
    for bone in JOINTS:
        places[bone] = M_PER_DM * vertices[rig["joints"][rig["bones"][bone]["head"]]].mean(axis=0)
        parent = rig["bones"][bone]["parent"]
        while parent and parent not in JOINTS:
            parent = rig["bones"][parent]["parent"]
        joint = glb.node(name=bone, translation=(places[bone] - places.get(parent, 0)).tolist())
        if parent:
            glb.tree["nodes"][JOINTS.index(parent)].setdefault("children", []).append(joint)
    binds = np.tile(np.eye(4), (len(JOINTS), 1, 1))
    binds[:, 3, :3] = -np.stack(list(places.values()))  # by columns, as the format wants them
    matrices = glb.numbers(binds.reshape(-1, 16), 5126, "MAT4")
    glb.tree["skins"] = [{"joints": list(range(len(JOINTS))), "inverseBindMatrices": matrices}]
    cut = (places["neck01"] + places["neck02"])[1] / 2 / M_PER_DM
    inside = (vertices[corners, 1] > cut).any(axis=1)
    vertices[:, 1] = np.maximum(vertices[:, 1], cut)  # a straight edge, where the triangles would leave a jagged one
    names = np.array([PARTS.get(group, "") for group in groups])
    for name in dict.fromkeys(PARTS.values()):
        own = (names == name) & inside
        if own.any():
            glb.part(name, M_PER_DM * vertices, uv, corners[own], uv_corners[own], shapes, weights)
    glb.write(file, "MakeHuman's base mesh, targets and rig: CC0 1.0")


def read_obj(file):
    """Return an OBJ's vertices, texture coordinates, both by triangles' corners, and the triangles' groups."""
    vertices, uv, polygons, groups, group = [], [], [], [], ""
    for line in file.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(x) for x in rest])
        elif word == "vt":
            uv.append([float(x) for x in rest[:2]])
        elif word == "g":
            group = rest[0]
        elif word == "f":
            polygon = [[int(x) - 1 for x in corner.split("/")[:2]] for corner in rest]
            polygons += [(polygon[0], polygon[k], polygon[k + 1]) for k in range(1, len(polygon) - 1)]
            groups += [group] * (len(polygon) - 2)
    corners = np.array(polygons)  # (f, 3, 2)
    return np.array(vertices), np.array(uv), corners[..., 0], corners[..., 1], groups


def read_target(file, n):
    """Return the offsets (n, 3) that one of MakeHuman's targets says, a line a vertex."""
    offsets = np.zeros((n, 3))
    rows = np.loadtxt(file, comments="#", ndmin=2)
    offsets[rows[:, 0].astype(int)] = rows[:, 1:]
    return offsets


# ICT-FaceKit: its own reader gives quads in mm; here they become an avatar's parts and ARKit's names.
ICT_PARTS = {"gums_tongue": "Teeth", "teeth": "Teeth", "eyeball_left": "EyeLeft", "eyeball_right": "EyeRight"}
ONCE = ("browInnerUp", "cheekPuff")  # ARKit has one of each for both sides
M_PER_MM = 0.001


def write_ict(folder, file):
    os.environ[VARIABLE] = str(folder)
    recipe = load_recipe("ict")
    model = read_model(recipe.vertices)
    labels = np.full(len(model.vertices), "", object)
    for part, (first, last) in vars(recipe.parts).items():
        labels[first : last + 1] = ICT_PARTS.get(part, "Head")
    shapes = {}
    for name, offset in model.offsets.items():
        stem, _, side = name.partition("_")
        arkit = stem if stem in ONCE else stem + {"": "", "L": "Left", "R": "Right"}[side]
        shapes[arkit] = shapes.get(arkit, 0) + M_PER_MM * offset
    halves = [(0, 1, 2), (0, 2, 3)]  # of a quad; a triangle's last corner is −1
    corners, uv_corners = (
        np.concatenate([polygons[:, half] for half in halves]) for polygons in (model.polygons, model.uv_polygons)
    )
    whole = (corners >= 0).all(axis=1)
    corners, uv_corners = corners[whole], uv_corners[whole]
    glb = Glb()
    for name in ("Head", "Teeth", "EyeLeft", "EyeRight"):
        own = labels[corners[:, 0]] == name
        glb.part(name, M_PER_MM * model.vertices, model.uv, corners[own], uv_corners[own], shapes)
    glb.write(file, "ICT-FaceKit, USC Institute for Creative Technologies: MIT licence")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("model", choices=("makehuman", "ict"))
    parser.add_argument("folder", type=Path, help="of the repository")
    parser.add_argument("out", type=Path, help="the GLB to write")
    words = parser.parse_args()
    try:
        {"makehuman": write_makehuman, "ict": write_ict}[words.model](words.folder, words.out)
    except (OSError, InputError) as error:
        parser.error(str(error))
