"""Pose a face with a model that `make deploy` wrote: python pose_onnx.py model.onnx jaw_open=0.6 …"""

import argparse
import difflib
import json

import numpy as np
import onnxruntime


def setting(word):
    name, _, value = word.partition("=")
    return name, float(value)


parser = argparse.ArgumentParser()
parser.add_argument("model")
parser.add_argument("controls", nargs="*", type=setting, metavar="control=value")
words = parser.parse_args()
session = onnxruntime.InferenceSession(words.model, providers=["CPUExecutionProvider"])
controls = json.loads(session.get_modelmeta().custom_metadata_map["controls"])  # in the order of the input
pose = {control["name"]: control["default"] for control in controls}
for name, value in words.controls:
    if name not in pose:
        near = difflib.get_close_matches(name, pose) or pose
        parser.error(f"there is no control {name}; there are {', '.join(near)}")
    if not np.isfinite(value):
        parser.error(f"{name}: expected a finite number, got {value}")
    pose[name] = value
(vertices,) = session.run(["vertices"], {"parameters": np.array([[*pose.values()]], np.float32)})  # (1, n, 3), mm
np.savetxt("vertices.txt", vertices[0], "%.4f")
