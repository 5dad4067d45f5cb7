#!/bin/sh
# ONNX's Resize makes a picture of stripes smaller with antialias=1, as exports of torch and preprocessing graphs do.
# Guessed: OpenVINO has the values of onnxruntime to 1e-4.
# Measured on 2026-11-28 with openvino 2026.4.1 on a CPU: it leaves antialias out in silence, for linear and cubic,
# and answers as with antialias=0: stripes of 0 and 1 that become nearly even stay stripes, .5 off. Larger pictures
# are equal.
# Readers guessed: right, right, right.
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
stripes = np.zeros((1, 1, 32, 32), np.float32)
stripes[..., ::2] = 1.0


def answers(mode, antialias, side):
    """The picture at another size, of onnxruntime and of OpenVINO in float32."""
    sizes = onnx.numpy_helper.from_array(np.array([1, 1, side, side]), "sizes")
    node = helper.make_node("Resize", ["x", "", "", "sizes"], ["y"], mode=mode, antialias=antialias)
    ports = [helper.make_tensor_value_info("x", TensorProto.FLOAT, stripes.shape)]
    results = [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 1, side, side])]
    graph = helper.make_graph([node], "graph", ports, results, [sizes])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), "resize.onnx")
    session = onnxruntime.InferenceSession("resize.onnx", providers=["CPUExecutionProvider"])
    compiled = core.compile_model(core.read_model("resize.onnx"), "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    return session.run(None, {"x": stripes})[0], compiled([stripes])[0]


versions = [importlib.metadata.version(name) for name in ("onnxruntime", "openvino")]
for mode in ("linear", "cubic"):
    wanted, smooth = answers(mode, 1, 10)
    plain = answers(mode, 0, 10)[1]
    larger = answers(mode, 1, 48)
    off = float(np.abs(wanted - smooth).max())
    unlike = float(np.abs(smooth - plain).max())
    grown = float(np.abs(larger[0] - larger[1]).max())
    print(f"{mode}: openvino {versions[1]} is {off:.3f} off onnxruntime {versions[0]}, {unlike:.1e} off antialias=0")
    if not (off > 0.3 and unlike < 1e-6 and grown < 1e-4):
        raise SystemExit("the behaviour has changed")
PYTHON
