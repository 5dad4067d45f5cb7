#!/bin/sh
# onnxconverter-common converts a valid float32 ONNX graph to float16.
# Guessed: a valid graph, 1e-3 off.
# Measured on 2026-11-27 with 1.16.0: it leaves the type in which a Cast to float32 ends, as torch's older exporter
# writes one in each attention, and with keep_io_types an input that two nodes read is cast by two nodes of one name.
# It reports neither, and onnxruntime 1.31.1 refuses both files.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install \
    onnxconverter-common==1.16.0 onnxruntime==1.31.1 onnx==1.23.2
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import onnx
import onnxruntime as ort
from onnx import TensorProto, helper
from onnxconverter_common import float16

PORTS = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [2, 4]) for name in "xy"]


def model(nodes, *tensors):
    graph = helper.make_graph(nodes, "g", PORTS[:1], PORTS[1:], tensors)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(made, full_check=True)
    ort.InferenceSession(made.SerializeToString()).run(None, {"x": np.ones((2, 4), np.float32)})
    return made


def answer(made, **options):
    try:
        ort.InferenceSession(float16.convert_float_to_float16(made, **options).SerializeToString())
    except Exception as error:
        return str(error).partition("Error: ")[2] or str(error)
    return "valid"


node, one = helper.make_node, helper.make_tensor("one", TensorProto.INT64, [], [1])
scaled = model(
    [
        node("Shape", ["x"], ["s"]),
        node("Gather", ["s", "one"], ["n"]),
        node("Cast", ["n"], ["f"], to=TensorProto.FLOAT),
        node("Div", ["x", "f"], ["y"]),
    ],
    one,
)
read_twice = model([node("Relu", ["x"], ["r"]), node("Add", ["x", "r"], ["y"])])
cast, twice, plain = answer(scaled), answer(read_twice, keep_io_types=True), answer(read_twice)
print(f"onnxconverter-common {version('onnxconverter-common')}: a Cast to float32: {cast}")
print(f"an input that two nodes read: {plain}; with keep_io_types: {twice}")
if "tensor(float16)" not in cast or "same node name" not in twice or plain != "valid":
    raise SystemExit("the behaviour has changed")
PYTHON
