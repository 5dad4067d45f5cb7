"""Interface HandEstimator: finger rotations of each person."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    check_array,
    check_limit,
    check_unit_range,
    rows_to_check,
    valid_rows,
    within,
)
from physic_core.interfaces.limits import RADIANS
from physic_core.types import Hands

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Keypoints, People, UInt8Array


@dataclass(frozen=True)
class HandEstimatorRequest(Request[Hands]):
    """Input of a HandEstimator: the photo, N people and their keypoints."""

    people: People
    keypoints: Keypoints


class HandEstimator(Backend):
    """Estimates the finger rotations of both hands of each person (paper: WiLoR)."""

    interface = "hand_estimator"
    api = 1
    Request = HandEstimatorRequest
    Result = Hands

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Estimate 15 joint rotations and a confidence for each hand; 0 for a hand that is not visible.

        With ``wrists``, the global rotation of each hand, forearms are rotated to fit, weighted by confidence. Fingers
        of every confidence above 0 are used: return 0 for what is likely wrong.

        Example: a network for right hands got the mirrored crop of a left hand. Each of its rotation vectors (x, y, z)
        becomes (x, -y, -z), and hand 0. MANO's hands with flat_hand_mean=False need the mean pose added.
        """

    @classmethod
    def check(cls, result: Hands, request: HandEstimatorRequest) -> Iterator[str]:
        """Check N x 2 hands; rotations with a confidence above 0 must be within limits."""
        n = len(request.people)
        wrong = [
            *check_array("rotvecs", result.rotvecs, (n, 2, 15, 3), "float"),
            *check_array("confidence", result.confidence, (n, 2), "float"),
        ]
        if result.wrists is not None:
            wrong += check_array("wrists", result.wrists, (n, 2, 3), "float")
        yield from wrong
        if wrong:
            return
        rows = rows_to_check(valid_hand_rows(result))
        confidence = result.confidence[rows]
        yield from check_unit_range("confidence", confidence)
        yield from check_limit("rotvecs", result.rotvecs[rows][confidence > 0], RADIANS, "rad")
        if result.wrists is not None:
            yield from check_limit("wrists", result.wrists[rows][confidence > 0], RADIANS, "rad")


def valid_hand_rows(hands: Hands) -> BoolArray:
    """Return (N,) bool: True for people with finite confidence, and rotations of all detected hands within limits."""
    undetected = hands.confidence <= 0
    valid = valid_rows([(hands.confidence, math.inf)], len(hands.confidence))
    valid &= (within(hands.rotvecs, RADIANS).all((-2, -1)) | undetected).all(1)
    if hands.wrists is not None:
        valid &= (within(hands.wrists, RADIANS).all(-1) | undetected).all(1)
    return valid
