"""L-BFGS for non-smooth functions: line search by bisection for the weak Wolfe conditions.

SciPy's implementation uses BLAS for inner products. Their last bit depends on the CPU, and a fit with kinks then has
another result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray

__all__ = ["minimize"]

_MEMORY = 20
_DESCENT, _CURVATURE = 1e-4, 0.9
_TRIALS = 20
_FLAT, _STILL = 1e-5, 2.2e-9  # largest entry of the gradient, and relative decrease, at which it ends


def minimize(function: Callable[[FloatArray], tuple[float, FloatArray]], x: FloatArray, steps: int) -> FloatArray:
    """Minimise a function by L-BFGS, and return a local minimum near x (n,).

    Args:
        function: x -> value and gradient (n,).
        x: initial point.
        steps: maximum number of steps.
    """
    value, gradient = function(x)
    pairs: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=_MEMORY)
    for _ in range(steps):
        if np.abs(gradient).max() < _FLAT:
            break
        direction = -_inverse_times(gradient, pairs)
        slope = _inner(gradient, direction)
        first = 1.0 if pairs else min(1.0, 1.0 / float(np.abs(gradient).sum()))
        found = _search(function, x, value, slope, direction, first)
        if found is None:
            break
        new, new_value, new_gradient = found
        step, change = new - x, new_gradient - gradient
        curvature = _inner(step, change)
        if curvature > 1e-10 * _inner(change, change):
            pairs.append((step, change, curvature))
        still = value - new_value <= _STILL * max(abs(value), abs(new_value), 1.0)
        x, value, gradient = new, new_value, new_gradient
        if still:
            break
    return x


def _inner(a: FloatArray, b: FloatArray) -> float:
    """Return the inner product of two vectors."""
    return float((a * b).sum())


def _inverse_times(gradient: FloatArray, pairs: deque[tuple[FloatArray, FloatArray, float]]) -> FloatArray:
    """Multiply a gradient by the L-BFGS approximation of the inverse Hessian."""
    direction, shares = gradient, []
    for step, change, curvature in reversed(pairs):
        share = _inner(step, direction) / curvature
        direction = direction - share * change
        shares.append(share)
    if pairs:
        _, change, curvature = pairs[-1]
        direction = direction * (curvature / _inner(change, change))
    for (step, change, curvature), share in zip(pairs, reversed(shares), strict=True):
        direction = direction + (share - _inner(change, direction) / curvature) * step
    return direction


def _search(
    function: Callable[[FloatArray], tuple[float, FloatArray]],
    x: FloatArray,
    value: float,
    slope: float,
    direction: FloatArray,
    length: float,
) -> tuple[FloatArray, float, FloatArray] | None:
    """Return a point along a direction that satisfies the weak Wolfe conditions; None without a decrease."""
    low, high, lower = 0.0, np.inf, None
    for _ in range(_TRIALS):
        new = x + length * direction
        new_value, gradient = function(new)
        if new_value > value + _DESCENT * length * slope:
            high = length
        else:
            lower = new, new_value, gradient
            if _inner(gradient, direction) >= _CURVATURE * slope:
                break
            low = length
        length = (low + high) / 2 if np.isfinite(high) else 2 * low
    return lower
