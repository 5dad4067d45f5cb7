"""Interface KeypointDetector: 2D keypoints of people with known masks and boxes."""

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
from physic_core.interfaces.limits import METRES, PIXELS
from physic_core.types import Keypoints, Skeleton, skeleton_named

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People, UInt8Array


@dataclass(frozen=True)
class KeypointDetectorRequest(Request[Keypoints]):
    """Input of a KeypointDetector: the photo and N people."""

    people: People


class KeypointDetector(Backend):
    """Detects the 2D keypoints of segmented people (paper: ViTPose whole-body)."""

    interface = "keypoint_detector"
    api = 1
    Request = KeypointDetectorRequest
    Result = Keypoints

    @abstractmethod
    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Detect the keypoints of N people in an image.

        A confidence c says how likely the point is right: about half of the points with c = 0.5 are. In the standard
        preset points weigh as much as their confidence, those below 0.3 a tenth of it, and those with 0 nothing. A
        detector that knows its own errors states them in ``sigma`` and ``depth_sigma``.

        Example: a heat map of 48 x 64 cells over a crop of 192 x 256 px from (x0, y0) on has its maximum in cell
        (i, j): the point is (x0 + 4 (i + 0.5) - 0.5, y0 + 4 (j + 0.5) - 0.5).
        """

    @classmethod
    def check(cls, result: Keypoints, request: KeypointDetectorRequest) -> Iterator[str]:
        """Check the keypoints of N people; points with a confidence above 0 must be within limits."""
        yield from keypoint_violations(result, len(request.people))


def keypoint_violations(keypoints: Keypoints, people: int) -> Iterator[str]:
    """Yield one sentence for each fault of the keypoints of ``people`` people, of a KeypointDetector or a Segmenter."""
    joints = keypoints.points.shape[1] if getattr(keypoints.points, "ndim", 0) == 3 else None
    wrong = [
        *_check_skeleton(keypoints.skeleton, joints),
        *check_array("points", keypoints.points, (people, joints or 0, 2), "float"),
        *check_array("confidence", keypoints.confidence, (people, joints or 0), "float"),
    ]
    if keypoints.world is not None:
        wrong += check_array("world", keypoints.world, (people, joints or 0, 3), "float")
    for name, sigma in _sigmas(keypoints):
        wrong += check_array(name, sigma, (people, joints or 0), "float")
    if keypoints.depth_sigma is not None and keypoints.world is None:
        wrong.append("depth_sigma is given without world, whose depth it is of")
    yield from wrong
    if wrong:
        return
    rows = rows_to_check(valid_keypoint_rows(keypoints))
    confidence = keypoints.confidence[rows]
    yield from check_unit_range("confidence", confidence)
    yield from check_limit("points", keypoints.points[rows][confidence > 0], PIXELS, "px")
    if keypoints.world is not None:
        yield from check_limit("world", keypoints.world[rows][confidence > 0], METRES, "m")
    for name, sigma in _sigmas(keypoints):
        if not (sigma[rows][confidence > 0] > 0).all():
            yield f"{name} must be above 0 where confidence is"


def _sigmas(keypoints: Keypoints) -> list[tuple[str, FloatArray]]:
    """Return name and values of the standard deviations that are given."""
    given = (("sigma", keypoints.sigma), ("depth_sigma", keypoints.depth_sigma))
    return [(name, sigma) for name, sigma in given if sigma is not None]


def _check_skeleton(skeleton: object, joints: int | None) -> Iterator[str]:
    if not isinstance(skeleton, Skeleton | str):
        yield f"skeleton must be a Skeleton or the name of a standard one, got {type(skeleton).__name__}"
        return
    try:
        names = skeleton_named(skeleton).names
    except ValueError as error:
        yield str(error)
        return
    if joints is not None and len(names) != joints:
        yield f"points must be those of the skeleton, {len(names)} a person, got {joints}"


def valid_keypoint_rows(keypoints: Keypoints) -> BoolArray:
    """Return (N,) bool: True for people with finite confidence, and points and errors in limits where it is above 0."""
    undetected = keypoints.confidence <= 0
    valid = valid_rows([(keypoints.confidence, math.inf)], len(keypoints.points))
    valid &= (within(keypoints.points, PIXELS).all(-1) | undetected).all(1)
    if keypoints.world is not None:
        valid &= (within(keypoints.world, METRES).all(-1) | undetected).all(1)
    for _, sigma in _sigmas(keypoints):
        valid &= (within(sigma, PIXELS) & (sigma > 0) | undetected).all(1)
    return valid
