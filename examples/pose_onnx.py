"""Pose a face with a model that `make deploy` wrote: python pose_onnx.py model.onnx jaw_open=0.6 …"""

import json
import sys

import numpy as np
import onnxruntime


def refuse(sentence):
    print(sentence, file=sys.stderr)
    sys.exit(2)


if len(sys.argv) < 2:
    refuse("no model is named: python pose_onnx.py model.onnx jaw_open=0.6 … is allowed")
session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
about = session.get_modelmeta().custom_metadata_map
controls = json.loads(about["controls"])  # name, region, lower, default and upper of each, in the order of the input
pose = {control["name"]: control["default"] for control in controls}
for word in sys.argv[2:]:
    name, _, value = word.partition("=")
    if name not in pose:
        refuse(f"{word}: there is no control {name!r}; allowed are {', '.join(pose)}")
    try:
        pose[name] = float(value)
    except ValueError:
        pose[name] = np.nan
    if not np.isfinite(pose[name]):
        refuse(f"{word}: control=value is allowed, where the value is a finite number")

params = np.array([list(pose.values())], np.float32)
(vertices,) = session.run(["vertices"], {"parameters": params})  # (poses, vertices, 3), mm
np.savetxt("vertices.txt", vertices[0], "%.4f")
print(f"{about['character']}, {about['title']}: {vertices.shape[1]} vertices in mm, in vertices.txt")
