#!/bin/sh
# An ONNX file of version 10 makes a row of 4 values twice as long, "linear". ONNX's converter brings it to version
# 13.
# Guessed: the same values come out, since version 11 can state the old rule (asymmetric).
# Measured on 2026-11-28 with onnx 1.23.2: it leaves the rule out, and the default has changed to half_pixel, so
# values move by a quarter of a step. An Upsample of version 9 fares alike. Neither the converter nor the checker says
# so. onnxruntime 1.32.0 runs both.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
python - <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import checker, helper, numpy_helper, version_converter


def values(model):
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"row": np.arange(4, dtype=np.float32).reshape(1, 1, 1, 4)})[0].ravel().tolist()


found = {}
for name, old in (("Resize", 10), ("Upsample", 9)):
    node = helper.make_node(name, ["row", "scales"], ["long"], mode="linear")
    ports = [
        helper.make_tensor_value_info("row", onnx.TensorProto.FLOAT, [1, 1, 1, 4]),
        helper.make_tensor_value_info("long", onnx.TensorProto.FLOAT, [1, 1, 1, 8]),
    ]
    scales = numpy_helper.from_array(np.array([1, 1, 1, 2], np.float32), "scales")
    graph = helper.make_graph([node], "resize", ports[:1], ports[1:], [scales])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", old)], ir_version=5)
    new = version_converter.convert_version(model, 13)
    checker.check_model(new)
    found[name] = (values(model), values(new))
print(f"onnx {onnx.__version__}, onnxruntime {onnxruntime.__version__}: values before, after: {found}")
before = [0, 0.5, 1, 1.5, 2, 2.5, 3, 3]
after = [0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3]
if any(pair != (before, after) for pair in found.values()):
    raise SystemExit("the behaviour has changed")
PYTHON
