"""Convert NumPy arrays of backends to tensors of the engine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["tensor"]


def tensor(array: NDArray[Any]) -> torch.Tensor:
    """Convert an array to a CPU tensor: floats to float32, other types unchanged.

    Data is copied only if the type changes or the array is read-only or not contiguous.
    """
    kind = np.float32 if array.dtype.kind == "f" else array.dtype
    return torch.from_numpy(np.require(array, kind, ["C", "W"]))
