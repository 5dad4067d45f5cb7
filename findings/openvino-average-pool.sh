#!/bin/sh
# ONNX's AveragePool of 3 x 3 steps by 2 over a map of ones with a border of 1, with ceil_mode and count_include_pad,
# as torch exports it. The last window reaches beyond the border.
# Guessed: other runtimes have onnxruntime's values.
# Measured on 2026-11-28 with openvino 2026.4.1 and opencv-python-headless 5.0.0.93: they divide by what lies beyond
# the border, too, so the last corner is .111 in place of .25, which onnxruntime 1.32.0 and ONNX's reference have; the
# last row is a third too small.
# Readers guessed: in part, in part, wrong.
. "$(dirname "$0")/common.sh"
install openvino==2026.4.1 onnxruntime==1.32.0 \
    onnx==1.23.2 \
    opencv-python-headless==5.0.0.93 numpy==2.4.6
python - <<'PYTHON'
import io
from importlib.metadata import version

import cv2
import numpy as np
import onnx
import onnxruntime
import openvino
from onnx import helper
from onnx.reference import ReferenceEvaluator

window = {"kernel_shape": [3, 3], "strides": [2, 2], "pads": [1, 1, 1, 1]}
node = helper.make_node("AveragePool", ["map"], ["mean"], ceil_mode=1, count_include_pad=1, **window)
ports = [
    helper.make_tensor_value_info("map", onnx.TensorProto.FLOAT, [1, 1, 6, 6]),
    helper.make_tensor_value_info("mean", onnx.TensorProto.FLOAT, [1, 1, 4, 4]),
]
graph = helper.make_graph([node], "pool", ports[:1], ports[1:])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 19)], ir_version=9)
text = model.SerializeToString()
ones = np.ones((1, 1, 6, 6), np.float32)
session = onnxruntime.InferenceSession(text, providers=["CPUExecutionProvider"])
compiled = openvino.compile_model(openvino.Core().read_model(io.BytesIO(text)), "CPU")
network = cv2.dnn.readNetFromONNX(np.frombuffer(text, np.uint8))
network.setInput(ones, "map")
found = {
    "onnxruntime": session.run(None, {"map": ones})[0],
    "onnx": ReferenceEvaluator(model).run(None, {"map": ones})[0],
    "openvino": compiled([ones])[0],
    "opencv-python-headless": network.forward(),
}
corner = {name: round(float(values[0, 0, -1, -1]), 3) for name, values in found.items()}
print("; ".join(f"{name} {version(name)}: {value}" for name, value in corner.items()))
if list(corner.values()) != [0.25, 0.25, 0.111, 0.111]:
    raise SystemExit("the behaviour has changed")
PYTHON
