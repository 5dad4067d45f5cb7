"""State the errors of the joints of fitted bodies, by how far the lifter moves them and by how much
of them the picture shows.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import FINGER_JOINTS, JOINT_INDEX, NUM_JOINTS, joint_pair
from physic_embedded.body_fit.limb_keypoints import LIMBS, keypoint_indices

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_embedded.body_fit.observations import BodyObservations


NUMBERS = Path(__file__).with_suffix(".json")
"""Fitted numbers: ``benchmarks/joint_errors.py`` makes them."""

EVIDENCE = ("own", "moved", "hidden")
"""Parts of the variance of a joint: its own, and those by its evidence."""


def limb_evidence(observations: BodyObservations, moved: FloatArray) -> FloatArray:
    """Return the evidence (N, 12, 3) of :data:`EVIDENCE` on the errors of the joints of LIMBS: 1;
    squared metres by which the lifter moves the joint; and the confidence that its keypoint lacks.

    Args:
        observations: of N people.
        moved: (N, 12) metres.
    """
    index = keypoint_indices(observations.skeleton)
    hidden = 1 - observations.confidence[:, [index[name] for name in LIMBS]]
    return np.stack([np.ones_like(hidden), moved**2, hidden], -1)


def joint_sigma(evidence: FloatArray) -> FloatArray:
    """Return the root mean square errors (N, 55) of joints relative to the middle of the hips by
    evidence (N, 12, 3), metres; NaN for joints other than those of limbs, of which ankles stand for
    feet and wrists for fingers.
    """
    limbs = np.sqrt((evidence * variances()).sum(-1))
    sigma = np.full((len(evidence), NUM_JOINTS), np.nan, np.float32)
    for row, name in enumerate(LIMBS):
        sigma[:, JOINT_INDEX[name]] = limbs[:, row]
    sigma[:, joint_pair("foot")] = sigma[:, joint_pair("ankle")]
    for fingers, wrist in zip(FINGER_JOINTS, joint_pair("wrist"), strict=True):
        sigma[:, np.ravel(fingers)] = sigma[:, [wrist]]
    return sigma


@cache
def variances() -> FloatArray:
    """Return the share (12, 3) of each part of :data:`EVIDENCE` in the squared error of a joint of
    LIMBS.
    """
    fitted = json.loads(NUMBERS.read_text(encoding="utf-8"))["variances"]
    return np.array([[fitted[part][kind_of(name)] for part in EVIDENCE] for name in LIMBS])


def kind_of(joint: str) -> str:
    """Return the kind of a joint, such as "wrist" of "left_wrist"."""
    return joint.partition("_")[2]
