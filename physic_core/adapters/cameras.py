"""Intrinsics of a photo that are given."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Hints, Intrinsics


def known_camera(hints: Hints, image: NDArray[Any]) -> Intrinsics | None:
    """Return the intrinsics in ``hints``, scaled to the size of ``image``; None if the hints have no intrinsics."""
    camera, (height, width) = hints.intrinsics, image.shape[:2]
    if camera is None or (camera.width, camera.height) == (width, height):
        return camera
    return camera.resized(width, height)
