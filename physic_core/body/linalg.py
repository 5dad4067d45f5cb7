"""Matrix products and Cholesky solutions of NumPy arrays with torch, to use torch's number of threads.

NumPy's BLAS uses one thread per core. For matrices of the size of a body, such threads only wait for each other.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

_Real = TypeVar("_Real", bound=np.floating[Any])


def matmul(a: NDArray[_Real], b: NDArray[_Real]) -> NDArray[_Real]:
    """Return ``a @ b`` for arrays of the same float type."""
    left, right = (torch.from_numpy(np.require(array, requirements="W")) for array in (a, b))
    found: NDArray[_Real] = torch.matmul(left, right).numpy()
    return found


def cholesky_solve(normal: NDArray[np.float64], rhs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve ``normal x = rhs`` by Cholesky: symmetric positive definite (B, M, M) and (B, M) -> x (B, M)."""
    factor = torch.linalg.cholesky(torch.from_numpy(normal))
    solution: NDArray[np.float64] = torch.cholesky_solve(torch.from_numpy(rhs)[..., None], factor)[..., 0].numpy()
    return solution
