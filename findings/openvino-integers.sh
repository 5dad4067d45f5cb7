#!/bin/sh
# An ONNX graph adds 1 to int64 numbers, as times and ids are, and another takes 10 from bytes.
# Guessed: 3,000,000,001, and as in NumPy 251 for 5 - 10.
# Measured on 2026-11-28 with openvino 2026.4.1 on a CPU: -1,294,967,295, since it computes int64 in 32 bits, and
# returns int64 all the same; bytes end at 0. opencv-python-headless 5.0.0.93 has the first number, too. onnxruntime
# 1.32.0 is right in both.
# Readers guessed: in part, in part, in part.
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
from onnx import helper, numpy_helper


def graph(operator, value, number):
    """A graph that applies an operator to a value and a constant of its type."""
    kind = helper.np_dtype_to_tensor_dtype(value.dtype)
    ports = [helper.make_tensor_value_info(name, kind, [1]) for name in ("value", "result")]
    node = helper.make_node(operator, ["value", "number"], ["result"])
    constant = numpy_helper.from_array(np.array([number], value.dtype), "number")
    made = helper.make_graph([node], "numbers", ports[:1], ports[1:], [constant])
    return helper.make_model(made, opset_imports=[helper.make_opsetid("", 18)], ir_version=9).SerializeToString()


def answers(operator, value, number):
    text = graph(operator, value, number)
    session = onnxruntime.InferenceSession(text, providers=["CPUExecutionProvider"])
    compiled = openvino.compile_model(openvino.Core().read_model(io.BytesIO(text)), "CPU")
    network = cv2.dnn.readNetFromONNX(np.frombuffer(text, np.uint8))
    network.setInput(value, "value")
    made = (session.run(None, {"value": value})[0], compiled([value])[0], network.forward())
    return [int(one.ravel()[0]) for one in made]


large = answers("Add", np.array([3_000_000_000]), 1)
small = answers("Sub", np.array([5], np.uint8), 10)
names = [f"{name} {version(name)}" for name in ("onnxruntime", "openvino", "opencv-python-headless")]
print(f"{', '.join(names)}: 3,000,000,000 + 1 is {large}; 5 - 10 of bytes is {small}")
if not (large == [3_000_000_001, -1_294_967_295, -1_294_967_295] and small[:2] == [251, 0]):
    raise SystemExit("the behaviour has changed")
PYTHON
