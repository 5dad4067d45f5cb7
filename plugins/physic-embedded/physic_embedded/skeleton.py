"""Which row of a keypoint set is which joint."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types import Keypoints

__all__ = ["fitted_keypoints", "point_rows"]


def fitted_keypoints(keypoints: Keypoints) -> Keypoints:
    """The part of a keypoint set that body models know: whole-body sets are cut to their body and feet.

    Raises:
        BackendError: body models know no part of it.
    """
    from physic_core.body.landmarks import DETECTED, SKELETONS
    from physic_core.errors import BackendError

    if keypoints.skeleton in ("coco_wholebody133", "wholebody69", "halpe26"):
        names = DETECTED[keypoints.skeleton]
        columns = [names.index(name) for name in SKELETONS["coco23"]]
        return replace(
            keypoints,
            points=keypoints.points[:, columns],
            confidence=keypoints.confidence[:, columns],
            skeleton="coco23",
            world=None if keypoints.world is None else keypoints.world[:, columns],
        )
    if keypoints.skeleton not in SKELETONS or "left_hip" not in SKELETONS[keypoints.skeleton]:
        known = ", ".join(name for name, points in DETECTED.items() if "left_hip" in points and name != "wholebody69")
        raise BackendError(
            f"keypoints of the joint set {keypoints.skeleton!r} came, and the embedded body knows {known}: "
            "choose a keypoint detector that answers one of them"
        )
    return keypoints


def point_rows(skeleton: str) -> dict[str, int]:
    """Name of each point of a joint set -> its row; names as the body models have them ("left_knee", "nose", ...)."""
    from physic_core.body.landmarks import SKELETONS

    return {name: row for row, name in enumerate(SKELETONS[skeleton])}
