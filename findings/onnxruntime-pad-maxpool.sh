#!/bin/sh
# An ONNX graph puts a border of zeros around a map of negative values, and takes the largest of 3 x 3.
# Guessed: zeros at the border, whether the graph is optimised or not.
# Measured on 2026-11-28 with onnxruntime 1.31.1: by default it makes the border part of the pool, where a border
# counts as -inf, so the corner is -1 in place of 0; with ORT_DISABLE_ALL it is 0. 1.32.0 does not.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install onnx==1.23.2 numpy==2.4.6
cat > run.py <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import helper, numpy_helper

nodes = [
    helper.make_node("Pad", ["map", "border"], ["padded"]),
    helper.make_node("MaxPool", ["padded"], ["largest"], kernel_shape=[3, 3]),
]
ports = [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, 1, 4, 4]) for name in ("map", "largest")]
border = numpy_helper.from_array(np.array([0, 0, 1, 1, 0, 0, 1, 1]), "border")
graph = helper.make_graph(nodes, "peaks", ports[:1], ports[1:], [border])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9).SerializeToString()
values = -1 - np.arange(16, dtype=np.float32).reshape(1, 1, 4, 4)
corner = []
for level in ("ORT_ENABLE_ALL", "ORT_DISABLE_ALL"):
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = getattr(onnxruntime.GraphOptimizationLevel, level)
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    corner.append(int(session.run(None, {"map": values})[0][0, 0, 0, 0]))
print(f"onnxruntime {onnxruntime.__version__}: the corner is {corner[0]} by default, {corner[1]} without optimisation")
wanted = [-1, 0] if onnxruntime.__version__ == "1.31.1" else [0, 0]
if corner != wanted:
    raise SystemExit("the behaviour has changed")
PYTHON
for version in 1.31.1 1.32.0; do
    install "onnxruntime==$version"
    python run.py
done
