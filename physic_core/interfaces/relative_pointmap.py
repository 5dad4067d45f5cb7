"""Interface RelativePointmap: detailed geometry without a unit."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array, check_camera, check_finite, check_notes
from physic_core.types import AffineAmbiguity, Pointmap

if TYPE_CHECKING:
    from physic_core.types import Hints, UInt8Array

__all__ = ["RelativePointmap", "RelativePointmapRequest"]


@dataclass(frozen=True)
class RelativePointmapRequest(Request[Pointmap]):
    """What a RelativePointmap is given.

    Attributes:
        image: (H, W, 3) uint8 RGB: the photo with its people inpainted, or the photo itself.
        hints: what is known of the photo. ``hole`` is None for the photo itself.
    """

    hints: Hints


class RelativePointmap(Backend):
    """Estimates detailed geometry up to a scale, or up to a scale and an offset (paper: MoGe).

    Called for the inpainted photo (``hints.hole`` is what was inpainted), then for the original photo (``hints.hole``
    is None, ``hints.scene`` the first result).
    """

    interface = "relative_pointmap"
    api = 1
    Request = RelativePointmapRequest
    Result = Pointmap
    sees = "inpainted"
    hints = ("intrinsics", "people", "keypoints", "hole")

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) -> point map; ``hints.intrinsics`` are respected if given."""

    @classmethod
    def check(cls, result: Pointmap, request: RelativePointmapRequest) -> Iterator[str]:
        """Points (H, W, 3), finite and in front of the camera where valid; a camera of this image if there is one."""
        height, width = request.image.shape[:2]
        wrong = [
            *check_array("points", result.points, (height, width, 3), "float"),
            *check_array("valid", result.valid, (height, width), "bool"),
        ]
        yield from wrong
        if not wrong:
            points = result.points[result.valid]
            if not len(points):
                yield "no pixel is valid"
            else:
                yield from check_finite("points", points)
                if (points[:, 2] <= 0).any():
                    share = float((points[:, 2] <= 0).mean())
                    yield f"z must be > 0 where valid (z forward), {share:.0%} of the valid points lie behind"
        if result.unknown not in get_args(AffineAmbiguity):
            yield f"unknown must be one of {', '.join(get_args(AffineAmbiguity))}, got {result.unknown!r}"
        yield from check_camera(result.intrinsics, height, width)
        yield from check_notes(result.notes)
