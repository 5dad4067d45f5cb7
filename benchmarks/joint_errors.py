"""Fit the errors that the body fit states of joints to people with measured joints.

    python -m benchmarks joint_errors DATA [--photos N] [--write]

DATA has the data sets of SETS, as of ``python -m benchmarks truth``. An error is the distance of a
joint of the result from the true one, both relative to the middle of the hips. Its variance is a
sum over the evidence; the fit maximises a normal likelihood, so that the mean of the squared ratios
is 1. Each set is scored by a fit to the others. With ``--write`` the fit to all goes into the
plugin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize

from physic_bench.scoring import LIMB_JOINTS
from physic_core import Intrinsics, Pipeline
from physic_embedded.body_fit import people as body_fit
from physic_embedded.body_fit.joint_sigma import EVIDENCE, NUMBERS, kind_of
from physic_embedded.body_fit.limb_keypoints import LIMBS

from .fits import parser_of, write_record
from .truth.command import samples_of
from .truth.fields import measured
from .truth.scores import compared
from .truth.sets import Sample, picture_of
from .truth.worker import record_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SETS = ("panoptic", "roundtable", "mpi_inf_3dhp")
KINDS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
COMMON = ("moved",)
"""Evidence whose share is the same for all kinds of joints."""

_ROWS = [LIMBS.index(name) for name in LIMB_JOINTS]
_START = {"own": 0.05**2, "moved": 1.0, "hidden": 0.1**2}
_LEAST = {"own": 0.03**2, "moved": 1e-6, "hidden": 1e-6}
_WIDTHS = [1 if part in COMMON else len(KINDS) for part in EVIDENCE]
KEYS = ("joint_errors_m", "evidence")


def main() -> int:
    """Run, fit, print, and write."""
    parser = parser_of("joint_errors", __doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--photos", type=int, help="the first N of each data set")
    given = parser.parse_args()
    people = people_of(samples_of([given.data], SETS, given.photos))
    for name in SETS:
        apart = [person for person in people if person["set"] == name]
        others = [person for person in people if person["set"] != name]
        if apart and others:
            print(f"{name}, fitted to the others: {described(apart, fitted(others))}")
    variances = fitted(people)
    print(f"all, fitted to all: {described(people, variances)}")
    record = {"made by": "benchmarks/joint_errors.py", "variances": variances}
    write_record(record, NUMBERS, write=given.write)
    return 0


def people_of(samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """Return the set, errors (12,) and evidence (12, 3) of all people found, in the order of
    LIMB_JOINTS.
    """
    told: list[Array] = []
    answers = []
    stated = body_fit.joint_sigma

    def joint_sigma(evidence: Array) -> Any:
        told[:] = evidence[:, _ROWS]
        return stated(evidence)

    with patch.object(body_fit, "joint_sigma", joint_sigma), Pipeline("embedded") as pipeline:
        for sample in samples:
            picture = np.ascontiguousarray(picture_of(sample)[..., ::-1])
            size = (picture.shape[1], picture.shape[0])
            fx, fy, cx, cy = sample.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
            result = pipeline(picture, intrinsics=Intrinsics(fx, fy, cx, cy, *size))
            answer = measured(record_of(result), size, sample)
            for person, evidence in zip(answer["people"], told, strict=True):
                person["evidence"] = evidence
            answers.append(answer)
    return [record for record in compared(samples, answers)["people"] if "evidence" in record]


def fitted(people: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the share of each part of the evidence in the variance, by kind of joint."""
    errors, evidence = (np.array([one[key] for one in people]) for key in KEYS)
    columns = np.array([KINDS.index(kind_of(name)) for name in LIMB_JOINTS])
    is_known = np.isfinite(errors)

    def shares(x: Array) -> Array:
        parts = iter(np.split(np.exp(x), np.cumsum(_WIDTHS)[:-1]))
        return np.stack([np.broadcast_to(next(parts), len(KINDS)) for _ in EVIDENCE], -1)

    def loss(x: Array) -> float:
        variance = (evidence * shares(x)[columns]).sum(-1)[is_known]
        return float((np.log(variance) + errors[is_known] ** 2 / variance).mean())

    least = [(bound, None) for bound in np.repeat(np.log(list(_LEAST.values())), _WIDTHS)]
    start = np.repeat(np.log(list(_START.values())), _WIDTHS)
    fitted_shares = shares(minimize(loss, start, method="L-BFGS-B", bounds=least).x)
    return {
        part: {kind: float(f"{share:.3g}") for kind, share in zip(KINDS, column, strict=True)}
        for part, column in zip(EVIDENCE, fitted_shares.T, strict=True)
    }


def described(
    people: Sequence[Mapping[str, Any]], variances: Mapping[str, Mapping[str, float]]
) -> str:
    """Return how errors over stated ones are distributed, and how far these tell errors apart."""
    from scipy.stats import spearmanr

    errors, evidence = (np.array([one[key] for one in people]) for key in KEYS)
    kinds = [kind_of(name) for name in LIMB_JOINTS]
    shares = np.array([[variances[part][kind] for part in EVIDENCE] for kind in kinds])
    stated = np.sqrt((evidence * shares).sum(-1))
    is_known = np.isfinite(errors)
    error, sigma = errors[is_known], stated[is_known]
    ratio = error / sigma
    return (
        f"{is_known.sum()} joints: ratio rms {np.sqrt((ratio**2).mean()):.2f}, "
        f"median {np.median(ratio):.2f}, over 1 {(ratio > 1).mean():.0%}, "
        f"over 2 {(ratio > 2).mean():.0%}, rank correlation "
        f"{spearmanr(sigma, error).statistic:.2f}"
    )
