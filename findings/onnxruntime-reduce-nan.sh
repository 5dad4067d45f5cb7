#!/bin/sh
# A float32 row with one NaN goes through ReduceMax and ReduceMin.
# Guessed: the result is NaN, as in NumPy and torch.
# Measured on 2026-11-28 with onnxruntime 1.31.1 on a CPU: NaN only if it is the first value. Elsewhere it is skipped,
# and takes values with it: the minimum of 1, NaN, 2, 0 is 1.
# Readers guessed: in part, in part, in part.
. "$(dirname "$0")/common.sh"
install onnxruntime==1.31.1 onnx==1.22.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper


def reduced(name, row):
    """Result of the operator `name` over one row."""
    axes = onnx.numpy_helper.from_array(np.array([1]), "axes")
    node = helper.make_node(name, ["x", "axes"], ["y"], keepdims=0)
    ports = [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, len(row)])]
    results = [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1])]
    graph = helper.make_graph([node], "graph", ports, results, [axes])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return float(session.run(None, {"x": np.array([row], np.float32)})[0][0])


nan = float("nan")
within = [reduced(name, [1, nan, 2, 0]) for name in ("ReduceMax", "ReduceMin")]
first = [reduced(name, [nan, 1, 2, 0]) for name in ("ReduceMax", "ReduceMin")]
print(f"onnxruntime {onnxruntime.__version__}: max, min of 1, NaN, 2, 0: {within}; of NaN, 1, 2, 0: {first}")
if not (within == [2.0, 1.0] and all(value != value for value in first)):
    raise SystemExit("the behaviour has changed")
PYTHON
