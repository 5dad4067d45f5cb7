#!/bin/sh
# onnxruntime runs in a process that is confined to one core, with its default number of threads.
# Guessed: threads on that core.
# Measured on 2026-11-27 with onnxruntime 1.31.1: it starts a thread for each core of the machine, and pins them
# outside; a stated number of threads stays inside. Needs Linux and two cores.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install onnxruntime==1.31.1 onnx==1.23.2
python - <<'PYTHON'
import os
import time

import onnx
import onnxruntime as ort
from onnx import TensorProto, helper

own = {min(os.sched_getaffinity(0))}
os.sched_setaffinity(0, own)
ports = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1]) for name in "xy"]
graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "g", ports[:1], ports[1:])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 14)], ir_version=8).SerializeToString()


def threads_outside(count):
    before = set(os.listdir("/proc/self/task"))
    options = ort.SessionOptions()
    options.intra_op_num_threads = count
    session = ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    time.sleep(0.5)  # a thread pins itself
    new = set(os.listdir("/proc/self/task")) - before
    return sum(os.sched_getaffinity(int(task)) - own != set() for task in new), session


(default, _), (stated, _) = threads_outside(0), threads_outside(3)
print(f"onnxruntime {ort.__version__}, 1 of {os.cpu_count()} cores: {default} threads outside by default, {stated} with 3")
if not (default > 0 and stated == 0):
    raise SystemExit("the behaviour has changed")
PYTHON
