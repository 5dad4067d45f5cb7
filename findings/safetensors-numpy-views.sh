#!/bin/sh
# Parameters of two bodies are stored with safetensors as what NumPy makes of them: a transposed table, every second
# column of one, and a copy.
# Guessed: the same values come back.
# Measured on 2026-11-30 with safetensors 0.8.0 and numpy 2.4.6: only the copy comes back. Of the others the values are
# in another place, in silence, with the right shape: the memory behind a view is written from its first byte on.
. "$(dirname "$0")/common.sh"
install safetensors==0.8.0 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from safetensors.numpy import load, save

table = np.arange(12, dtype=np.float32).reshape(4, 3)
views = {"transposed": table.T, "columns": table[:, ::2], "copy": table.T.copy()}
back = {name: load(save({name: view}))[name] for name, view in views.items()}
same = {name: bool(np.array_equal(back[name], view)) for name, view in views.items()}
shapes = all(back[name].shape == view.shape for name, view in views.items())
print(f"safetensors {version('safetensors')}: same values {same}; same shapes: {shapes}")
print(f"first row of the transposed table {views['transposed'][0].tolist()}, read {back['transposed'][0].tolist()}")
if same != {"transposed": False, "columns": False, "copy": True} or not shapes:
    raise SystemExit("the behaviour has changed")
PYTHON
