"""Products and solutions of numpy arrays by torch, so that its number of threads holds for them too.

numpy's own linear algebra takes a thread a core, whatever torch is told; at the sizes of one body these do nothing but
wait for each other.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

__all__ = ["product", "solved"]

Real = TypeVar("Real", bound=np.floating[Any])


def product(a: NDArray[Real], b: NDArray[Real]) -> NDArray[Real]:
    """``a @ b`` of one float type."""
    left, right = (torch.from_numpy(np.require(array, requirements="W")) for array in (a, b))
    found: NDArray[Real] = torch.matmul(left, right).numpy()
    return found


def solved(normal: NDArray[np.float64], pull: NDArray[np.float64]) -> NDArray[np.float64]:
    """x (B, M) of ``normal x = pull``, (B, M, M) symmetric positive and (B, M), by Cholesky."""
    factor = torch.linalg.cholesky(torch.from_numpy(normal))
    solution: NDArray[np.float64] = torch.cholesky_solve(torch.from_numpy(pull)[..., None], factor)[..., 0].numpy()
    return solution
