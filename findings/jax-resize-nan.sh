#!/bin/sh
# A map of 8 x 8 values, one of them unknown (NaN), is made half as large, as a depth map is.
# Guessed: NaN is around that value.
# Measured on 2026-11-28 with jax 0.10.2 on a CPU: all of the result is NaN, for "linear" and "cubic", since each axis
# is a product with a matrix of weights, in which 0 times NaN is NaN. If one axis keeps its length, it is one column.
# Only "nearest" keeps NaN in its place.
. "$(dirname "$0")/common.sh"
install jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
python - <<'PYTHON'
import jax
import numpy as np

values = np.ones((8, 8), np.float32)
values[2, 5] = np.nan
found = {}
for method in ("nearest", "linear", "cubic"):
    made = [np.asarray(jax.image.resize(values, shape, method)) for shape in ((16, 16), (4, 4), (8, 4))]
    found[method] = [f"{np.isnan(one).sum()} of {one.size}" for one in made]
print(f"jax {jax.__version__}: NaN in 16 x 16, 4 x 4, 8 x 4: {found}")
spread = ["256 of 256", "16 of 16", "4 of 32"]
if not (found["linear"] == found["cubic"] == spread and found["nearest"][0] == "4 of 256"):
    raise SystemExit("the behaviour has changed")
PYTHON
