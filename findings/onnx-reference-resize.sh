#!/bin/sh
# ONNX's own reference implementation, which tests of runtimes trust, and onnxruntime make 7 values smaller by .6 with
# align_corners: 4 values, of which the first and the last are those of the input, by ONNX's text.
# Guessed: both agree to 1e-5.
# Measured on 2026-11-28 with onnx 1.23.2: the reference counts with 4.2 values, so the last is not the last of the
# input; onnxruntime 1.32.0 is right. With `sizes` in place of `scales` both agree.
. "$(dirname "$0")/common.sh"
install onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
python - <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import helper, numpy_helper
from onnx.reference import ReferenceEvaluator


def both(names, constant):
    node = helper.make_node(
        "Resize", ["row", "", *names], ["small"], mode="linear", coordinate_transformation_mode="align_corners"
    )
    ports = [
        helper.make_tensor_value_info("row", onnx.TensorProto.FLOAT, [1, 7]),
        helper.make_tensor_value_info("small", onnx.TensorProto.FLOAT, [1, 4]),
    ]
    graph = helper.make_graph([node], "resize", ports[:1], ports[1:], [numpy_helper.from_array(constant, names[-1])])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 19)], ir_version=9)
    row = np.arange(7, dtype=np.float32)[None]
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    made = (ReferenceEvaluator(model).run(None, {"row": row})[0], session.run(None, {"row": row})[0])
    return [np.round(one[0], 3).tolist() for one in made]


scales = both(["scales"], np.array([1, 0.6], np.float32))
sizes = both(["", "sizes"], np.array([1, 4]))
print(f"onnx {onnx.__version__}, onnxruntime {onnxruntime.__version__}: 0 to 6 by scales {scales}, by sizes {sizes}")
right = [0, 2, 4, 6]
if not (sizes == [right, right] and scales[1] == right and scales[0][-1] < 5.9):
    raise SystemExit("the behaviour has changed")
PYTHON
