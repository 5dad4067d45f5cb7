#!/bin/sh
# ONNX's Resize makes 7 values smaller by .6, "linear" with half_pixel: 4 values.
# Guessed: OpenCV's DNN module has the values of onnxruntime to 1e-4, as OpenVINO has.
# Measured on 2026-11-28 with opencv-python-headless 5.0.0.93: it counts with 4 / 7 in place of .6, in silence, so the
# values drift along the row, by .29 of a step at its end. torch exports such files of
# `interpolate(scale_factor=...)`.
. "$(dirname "$0")/common.sh"
install opencv-python-headless==5.0.0.93 \
    openvino==2026.4.1 \
    onnxruntime==1.32.0 onnx==1.23.2 numpy==2.4.6
python - <<'PYTHON'
import io
from importlib.metadata import version

import cv2
import numpy as np
import onnx
import onnxruntime
import openvino
from onnx import helper, numpy_helper

node = helper.make_node("Resize", ["map", "", "scales"], ["small"], mode="linear")
ports = [
    helper.make_tensor_value_info("map", onnx.TensorProto.FLOAT, [1, 1, 7, 7]),
    helper.make_tensor_value_info("small", onnx.TensorProto.FLOAT, [1, 1, 4, 4]),
]
scales = numpy_helper.from_array(np.array([1, 1, 0.6, 0.6], np.float32), "scales")
graph = helper.make_graph([node], "resize", ports[:1], ports[1:], [scales])
text = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9).SerializeToString()
values = np.zeros((1, 1, 7, 7), np.float32) + np.arange(7, dtype=np.float32)
session = onnxruntime.InferenceSession(text, providers=["CPUExecutionProvider"])
compiled = openvino.compile_model(openvino.Core().read_model(io.BytesIO(text)), "CPU")
network = cv2.dnn.readNetFromONNX(np.frombuffer(text, np.uint8))
network.setInput(values, "map")
found = {
    "onnxruntime": session.run(None, {"map": values})[0],
    "openvino": compiled([values])[0],
    "opencv-python-headless": network.forward(),
}
rows = {name: [round(float(value), 3) for value in made[0, 0, 0]] for name, made in found.items()}
print("; ".join(f"{name} {version(name)}: {row}" for name, row in rows.items()))
right, other, drifted = (np.array(row) for row in rows.values())
wanted = np.clip((np.arange(4) + 0.5) / (4 / 7) - 0.5, 0, 6)
same = np.allclose(right, other, atol=0.01)
if not (same and np.allclose(drifted, wanted, atol=0.01) and abs(right - drifted).max() > 0.2):
    raise SystemExit("the behaviour has changed")
PYTHON
