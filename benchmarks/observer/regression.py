"""Logistic and linear regression with a ridge, and their calibration on examples left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, log_softmax, softmax

from benchmarks.fits import FOLDS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Examples:
    """Examples of one question.

    Attributes:
        x: (n, C) tokens.
        y: (n, K) answers: share of readers who say yes, K = 1, or who choose each of K classes; or
            K measured angles.
        weight: (n,).
        groups: n names; examples of one group are left out at once.
    """

    x: Array
    y: Array
    weight: Array
    groups: Sequence[str]

    def take(self, rows: NDArray[np.bool_]) -> Examples:
        """Return the examples of some rows, (n,) bool."""
        groups = [g for g, chosen in zip(self.groups, rows, strict=True) if chosen]
        return Examples(self.x[rows], self.y[rows], self.weight[rows], groups)


def probabilities(logits: Array) -> Array:
    """Return probabilities (n, K) of logits: of yes for K = 1, else of K classes."""
    chances: Array = expit(logits) if logits.shape[1] == 1 else softmax(logits, axis=1)
    return chances


def fit_logistic(of: Examples, ridge: float) -> Array:
    """Return K weights and constants (K, C + 1) that minimise the log loss of the examples and half
    the ridge times the squared weights of standardised tokens.
    """
    n, c = of.x.shape
    k = of.y.shape[1]
    total = of.weight.sum()
    mean = of.weight @ of.x / total
    spread = np.sqrt(of.weight @ (of.x - mean) ** 2 / total) + 1e-9
    z = np.column_stack([(of.x - mean) / spread, np.ones(n)])

    def loss(flat: Array) -> tuple[float, Array]:
        w = flat.reshape(k, c + 1)
        value, slope = _log_loss(z @ w.T, of.y)
        shrunk = w * (np.arange(c + 1) < c)
        gradient = (of.weight[:, None] * slope).T @ z + ridge * shrunk
        return float(of.weight @ value + ridge / 2 * (shrunk**2).sum()), gradient.ravel()

    start = np.zeros(k * (c + 1))
    solution = minimize(loss, start, jac=True, method="L-BFGS-B", options=_PATIENCE)
    w = solution.x.reshape(k, c + 1)
    weights = w[:, :c] / spread
    return np.column_stack([weights, w[:, c] - weights @ mean])


_PATIENCE = {"maxiter": 1000, "gtol": 1e-6, "ftol": 1e-13}


def _log_loss(logits: Array, y: Array) -> tuple[Array, Array]:
    """Return the log loss (n,) and its derivatives (n, K) by the logits."""
    if y.shape[1] == 1:
        value = np.logaddexp(0, logits) - y * logits
        return value[:, 0], expit(logits) - y
    return -(y * log_softmax(logits, axis=1)).sum(1), softmax(logits, axis=1) - y


def logits_of(numbers: Array, x: Array) -> Array:
    """Return the logits (n, K) of tokens (n, C)."""
    logits: Array = x @ numbers[:, :-1].T + numbers[:, -1]
    return logits


def left_out_logits(of: Examples, fit: Callable[[Examples], Array], folds: int = FOLDS) -> Array:
    """Return the logits (n, K) of each example by a fit to the others, without its group."""
    fold_of = folds_of(of.groups, folds)
    logits = np.full(of.y.shape, np.nan)
    for fold in range(folds):
        out = fold_of == fold
        if out.any():
            logits[out] = logits_of(fit(of.take(~out)), of.x[out])
    return logits


def folds_of(groups: Sequence[str], folds: int) -> NDArray[np.int_]:
    """Return the fold (n,) of each example: groups are dealt out, the largest first, to the fold
    with fewest examples.
    """
    names, inverse, counts = np.unique(np.array(groups), return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    sizes = np.zeros(folds, int)
    fold = np.zeros(len(names), int)
    for g in order:
        fold[g] = int(sizes.argmin())
        sizes[fold[g]] += counts[g]
    return fold[inverse]


def calibration(logits: Array, of: Examples) -> tuple[float, float]:
    """Return factor and offset of logits (Platt): one pair for yes, a factor alone for classes."""
    binary = of.y.shape[1] == 1

    def loss(v: Array) -> float:
        value, _ = _log_loss(v[0] * logits + (v[1] if binary else 0.0), of.y)
        return float(of.weight @ value)

    solution = minimize(
        loss, np.array([1.0, 0.0]), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9}
    )
    return float(solution.x[0]), float(solution.x[1]) if binary else 0.0


def calibrated(numbers: Array, pair: tuple[float, float]) -> Array:
    """Return weights and constants with factor and offset folded in."""
    folded = numbers * pair[0]
    folded[:, -1] += pair[1]
    return folded
