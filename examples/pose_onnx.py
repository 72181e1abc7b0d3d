"""Pose a face with a model that `make deploy` wrote: python pose_onnx.py model.onnx jaw_open=0.6 …"""

import json
import sys

import numpy as np
import onnxruntime

session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
about = session.get_modelmeta().custom_metadata_map
controls = json.loads(about["controls"])  # name, region, lower, default and upper of each, in the order of the input
wanted = {name: float(value) for name, value in (word.split("=") for word in sys.argv[2:])}
unknown = set(wanted) - {control["name"] for control in controls}
if unknown:
    sys.exit(f"no control {unknown}: allowed are {', '.join(control['name'] for control in controls)}")

params = np.array([[wanted.get(control["name"], control["default"]) for control in controls]], np.float32)
(vertices,) = session.run(["vertices"], {"parameters": params})  # (poses, vertices, 3), mm
np.savetxt("vertices.txt", vertices[0], "%.4f")
print(f"{about['character']}, {about['title']}: {vertices.shape[1]} vertices in mm, in vertices.txt")
