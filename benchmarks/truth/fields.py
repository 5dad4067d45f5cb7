"""What is measured of a result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.scoring import LIMB_JOINTS

from .measures import depth_errors
from .sets import Sample

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Person, Reconstruction, Skeleton

    Array = NDArray[np.float64]


def measured_fields(
    result: Reconstruction, size: tuple[int, int], sample: Sample
) -> dict[str, Any]:
    """What is measured of a result, in px of the photo of ``size`` (width, height)."""
    camera = result.intrinsics.resized(*size)
    factor = np.array([size[0] / result.intrinsics.width, size[1] / result.intrinsics.height])
    floor = result.scene.floor
    answer = {
        "people": [
            {**_person(person, result.skeleton, factor), "distance_sigma": sigma}
            for person, sigma in zip(result.people, result.distance_sigmas, strict=True)
        ],
        "camera": [camera.fx, camera.fy, camera.cx, camera.cy],
        "floor": None
        if floor is None
        else [*(float(v) for v in floor.normal), float(floor.offset)],
        "scale_sigma": result.scene.scale_sigma,
        "up": None if result.scene.up is None else result.scene.up.tolist(),
        "up_sigma": result.scene.up_sigma,
    }
    if "depth_file" in sample.truth:
        answer |= _depth(result, sample)
    return answer


def _person(person: Person, skeleton: Skeleton | str, factor: Array) -> dict[str, Any]:
    """What is measured of a person, in px of the result times ``factor`` (2,)."""
    from physic_core.types import skeleton_named

    names = skeleton_named(skeleton).names
    keypoints = np.full((len(LIMB_JOINTS), 3), np.nan)
    for row, name in enumerate(LIMB_JOINTS):
        if name in names:
            k = names.index(name)
            pixel = (person.keypoints[k] + 0.5) * factor - 0.5
            keypoints[row] = (*pixel, person.keypoint_confidence[k])
    return {
        "box": (np.asarray(person.box, np.float64) * np.tile(factor, 2)).tolist(),
        "joints": np.round(person.joints.astype(np.float64), 5).tolist(),
        "keypoints": np.round(keypoints, 4).tolist(),
        "joint_sigma": None if person.joint_sigma is None else person.joint_sigma.tolist(),
        "parts": dict(person.world_contact or {}),
        "usable": list(person.usable),
        "stature_sigma": person.stature_sigma,
    }


def _depth(result: Reconstruction, sample: Sample) -> dict[str, float]:
    import cv2

    truth = (
        cv2.imread(str(sample.truth["depth_file"]), cv2.IMREAD_UNCHANGED).astype(np.float64) / 1000
    )
    depth = np.where(result.scene.valid, result.scene.points[..., 2], np.nan).astype(np.float32)
    size = (truth.shape[1], truth.shape[0])
    return depth_errors(
        cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST).astype(np.float64), truth
    )
