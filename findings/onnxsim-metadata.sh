#!/bin/sh
# onnxsim simplifies an ONNX file whose author wrote one line of metadata.
# Guessed: that line, and no other.
# Measured on 2026-11-27 with onnxsim 0.8.1: the line stays, and about twenty keys "onnxsim.*" are added, with the
# names of removed and changed nodes.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install onnxsim==0.8.1 onnx==1.23.2
python - <<'PYTHON'
from importlib.metadata import version

import onnxsim
from onnx import TensorProto, helper

ports = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [2]) for name in "xy"]
nodes = [
    helper.make_node("Identity", ["x"], ["a"], name="author's secret layer"),
    helper.make_node("Relu", ["a"], ["y"], name="last"),
]
model = helper.make_model(helper.make_graph(nodes, "g", ports[:1], ports[1:]))
helper.set_model_props(model, {"unit": "metres"})
simple, valid = onnxsim.simplify(model)
found = {entry.key: entry.value for entry in simple.metadata_props}
added = sorted(key for key in found if key.startswith("onnxsim."))
named = [key for key in added if "secret" in found[key]]
print(f"onnxsim {version('onnxsim')}: unit = {found.get('unit')}; {len(added)} keys added; {named} name the removed node")
if not (valid and found.get("unit") == "metres" and len(added) > 10 and named):
    raise SystemExit("the behaviour has changed")
PYTHON
