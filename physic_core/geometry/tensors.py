"""From the arrays that backends answer to the tensors that the engine takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["tensor"]


def tensor(array: NDArray[Any]) -> torch.Tensor:
    """Array -> CPU tensor: floats as float32 whatever their width, bools as they are.

    A plugin may answer float64, or a view that may not be written to; only then is anything copied.
    """
    kind = np.float32 if array.dtype.kind == "f" else array.dtype
    return torch.from_numpy(np.require(array, kind, ["C", "W"]))
