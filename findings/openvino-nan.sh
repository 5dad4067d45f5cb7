#!/bin/sh
# NaN goes through Relu, Clip and Max of an ONNX file.
# Guessed: it stays NaN, as in onnxruntime, NumPy and torch.
# Measured on 2026-11-28 with openvino 2026.4.1 on a CPU: Relu, Clip from 0 to 1 and Max with the constant 0 make 0 of
# it, so a network that has failed looks like one that has found nothing. Sigmoid keeps it.
# Readers guessed: in part, right, in part.
. "$(dirname "$0")/common.sh"
install openvino==2026.4.1 onnx==1.22.0 \
    onnxruntime==1.31.1 numpy==2.4.6
python -W ignore - <<'PYTHON'
import importlib.metadata

import numpy as np
import onnx
import onnxruntime
import openvino
from onnx import TensorProto, helper

core = openvino.Core()
values = np.full((1, 32), np.nan, np.float32)
CONSTANTS = {"Relu": [], "Clip": [0.0, 1.0], "Max": [0.0], "Sigmoid": []}


def answers(operator):
    """First value of the operator for NaN: of onnxruntime, and of OpenVINO in float32."""
    constants = [
        onnx.numpy_helper.from_array(np.float32(value), f"c{number}") for number, value in enumerate(CONSTANTS[operator])
    ]
    node = helper.make_node(operator, ["x", *(constant.name for constant in constants)], ["y"])
    ports = [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 32])]
    results = [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 32])]
    graph = helper.make_graph([node], "graph", ports, results, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)
    onnx.save(model, f"{operator}.onnx")
    session = onnxruntime.InferenceSession(f"{operator}.onnx", providers=["CPUExecutionProvider"])
    compiled = core.compile_model(core.read_model(f"{operator}.onnx"), "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    return float(session.run(None, {"x": values})[0][0, 0]), float(compiled([values])[0][0, 0])


found = {operator: answers(operator) for operator in CONSTANTS}
versions = [importlib.metadata.version(name) for name in ("onnxruntime", "openvino")]
print(f"NaN in onnxruntime {versions[0]} and openvino {versions[1]}: {found}")
kept = all(first != first for first, second in found.values())
lost = all(found[operator][1] == 0 for operator in ("Relu", "Clip", "Max"))
sigmoid = found["Sigmoid"][1]
if not (kept and lost and sigmoid != sigmoid):
    raise SystemExit("the behaviour has changed")
PYTHON
