#!/bin/sh
# grid_sample of torch on a CPU, in half precision, from a map whose channels lie side by side in memory, as
# deformable attention of DETR networks has it.
# Guessed: the values of float32, rounded. A check of answers for finite numbers met it.
# Measured on 2026-11-28 with torch 2.13.0: in bfloat16 and float16 some calls return NaN, others the right values, by
# what was in memory before. A contiguous map, and float32, are always right.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install torch==2.13.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
import torch
from torch.nn.functional import grid_sample

torch.manual_seed(0)
torch.set_num_threads(1)
CALLS = 60


def calls_with_nan(dtype, contiguous):
    """Number of calls of finite maps (2, 16, 60, 100) and finite places that return NaN."""
    found = 0
    for _ in range(CALLS):
        values = torch.randn(2, 60, 100, 16).to(dtype).permute(0, 3, 1, 2)
        if contiguous:
            values = values.contiguous()
        places = (torch.rand(2, 500, 4, 2) * 2.4 - 1.2).to(dtype)
        for _ in range(3):  # what other parts of a program leave in memory
            torch.full((2 * 16 * 500 * 4,), torch.nan, dtype=dtype)
        found += int(grid_sample(values, places, align_corners=False).isnan().any())
    return found


side_by_side = {dtype: calls_with_nan(dtype, False) for dtype in (torch.bfloat16, torch.float16, torch.float32)}
contiguous = {dtype: calls_with_nan(dtype, True) for dtype in side_by_side}
print(f"torch {torch.__version__}: of {CALLS} calls with NaN: {side_by_side}; of contiguous maps: {contiguous}")
halves = side_by_side[torch.bfloat16] > 0 and side_by_side[torch.float16] > 0
if not (halves and side_by_side[torch.float32] == 0 and not any(contiguous.values())):
    raise SystemExit("the behaviour has changed")
PYTHON
