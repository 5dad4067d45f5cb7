"""Intrinsics of a photo: given by the user, or guessed from a field of view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from physic_core.adapters.canonical_depth import focal_from_fov
from physic_core.types import CameraTrust, Intrinsics

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Hints


def known_camera(hints: Hints, image: NDArray[Any]) -> Intrinsics | None:
    """Return the intrinsics in ``hints``, scaled to the size of ``image``; None if the hints have no intrinsics."""
    camera, (height, width) = hints.intrinsics, image.shape[:2]
    if camera is None or (camera.width, camera.height) == (width, height):
        return camera
    return camera.resized(width, height)


def guessed_camera(fov_deg: float, image: NDArray[Any]) -> tuple[Intrinsics, tuple[str, ...]]:
    """Return intrinsics for a field of view in degrees along the image's long side, and a note for the user."""
    height, width = image.shape[:2]
    source = f"default (field of view {fov_deg:g} degrees along the long side)"
    focal = focal_from_fov(fov_deg, max(height, width))
    camera = Intrinsics.from_focal(focal, width, height, source, CameraTrust.GUESSED)
    return camera, (f"focal length is a {source}",)
