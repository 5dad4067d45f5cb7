"""Interface RelativePointmap: a 3D point for each pixel, up to an unknown scale."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, get_args

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    check_array,
    check_camera,
    check_finite,
    check_median,
    check_notes,
)
from physic_core.interfaces.limits import RELATIVE_DEPTH
from physic_core.types import AffineAmbiguity, Hints, Pointmap

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array


@dataclass(frozen=True)
class RelativePointmapRequest(Request[Pointmap]):
    """Input of a RelativePointmap: the inpainted or the original photo, and hints.

    ``hole`` and ``photo`` of the hints are None for the original photo.
    """

    hints: Hints = field(default_factory=Hints)


class RelativePointmap(Backend):
    """Estimates a point map up to a scale, or up to a scale and an offset (paper: MoGe).

    Called for the inpainted photo (``hints.hole`` is the inpainted region, ``hints.photo`` the original photo), then
    for the original photo (both are None, ``hints.scene`` is the first result). Inpainted pixels are invented: cues of
    the camera, such as straight lines, are better taken from ``hints.photo`` outside the hole.
    """

    interface = "relative_pointmap"
    api = 1
    Request = RelativePointmapRequest
    Result = Pointmap
    sees = "inpainted"
    hints = ("intrinsics", "people", "keypoints", "hole", "photo")

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Estimate a point map of an image; ``hints.intrinsics`` are used if given.

        Example: with cx = 159.5, fx = 300 and z = 2, the point of column 159 has x = (159 - 159.5) / 300 * 2.
        """

    @classmethod
    def check(cls, result: Pointmap, request: RelativePointmapRequest) -> Iterator[str]:
        """Check points (H, W, 3), within limits and in front of the camera where valid; and the rest."""
        height, width = request.image.shape[:2]
        wrong = [
            *check_array("points", result.points, (height, width, 3), "float"),
            *check_array("valid", result.valid, (height, width), "bool"),
        ]
        yield from wrong
        if not wrong:
            yield from _check_points(result.points[result.valid])
        if result.unknown not in get_args(AffineAmbiguity):
            yield f"unknown must be one of {', '.join(get_args(AffineAmbiguity))}, got {result.unknown!r}"
        if result.shift_sigma is not None and not 0 <= result.shift_sigma < math.inf:
            yield f"shift_sigma must be finite and at least 0, or None, got {result.shift_sigma!r}"
        if result.people_farther is not None and not _is_mean_and_sigma(result.people_farther):
            yield f"people_farther must be a finite mean and a sigma > 0, or None, got {result.people_farther!r}"
        yield from check_camera(result.intrinsics, height, width)
        yield from check_notes(result.notes)


def _is_mean_and_sigma(given: tuple[float, float]) -> bool:
    try:
        mean, sigma = given
        return math.isfinite(mean) and 0 < sigma < math.inf
    except (TypeError, ValueError):
        return False


def _check_points(points: FloatArray) -> Iterator[str]:
    """Check the valid points (M, 3)."""
    if not len(points):
        yield "no pixel is valid"
        return
    not_finite = list(check_finite("points", points))
    if not_finite:
        yield from not_finite
    elif (points[:, 2] <= 0).any():
        share = float((points[:, 2] <= 0).mean())
        yield f"z must be > 0 where valid (z forward), {share:.0%} of the valid points lie behind"
    else:
        yield from check_median("z", points[:, 2], RELATIVE_DEPTH)
