"""What is measured of what a build states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.scoring import LIMB_JOINTS
from physic_core import Intrinsics
from physic_core.types import MARKS, is_usable

from .measures import depth_errors
from .sets import Sample

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def measured(
    record: Mapping[str, Any], size: tuple[int, int], sample: Sample, depth: Array | None = None
) -> dict[str, Any]:
    """Return what is measured of an answer to a sample, in px of a picture of ``size`` (width,
    height).

    Args:
        record: of :func:`benchmarks.truth.worker.record_of`, or its error alone.
        size: of the picture.
        sample: that was asked about.
        depth: (H, W) m, NaN where unknown, if the sample has a true one.
    """
    if record["error"]:
        return {"error": record["error"], "people": [], "floor": None}
    intrinsics = Intrinsics(**record["camera"])
    camera = intrinsics.resized(*size)
    factor = np.array([size[0] / intrinsics.width, size[1] / intrinsics.height])
    names = [record["skeleton"].index(n) if n in record["skeleton"] else -1 for n in LIMB_JOINTS]
    people = record["people"]
    sigmas = record.get("distance_sigmas") or [None] * len(people)
    answer = {
        "error": "",
        "people": [
            {**_person(person, names, factor), "distance_sigma": sigma}
            for person, sigma in zip(people, sigmas, strict=True)
        ],
        "camera": [camera.fx, camera.fy, camera.cx, camera.cy],
        "floor": record["floor"],
        **{name: record["scene"].get(name) for name in ("up", "up_sigma", "scale_sigma")},
    }
    if depth is not None and "depth_file" in sample.truth:
        answer |= _depth(depth, sample)
    return answer


def usable_of(person: Mapping[str, Any]) -> list[str]:
    """Return the marks of a person that are usable."""
    return [name for name in MARKS if is_usable(person.get(f"trust_{name}"))]


def _person(person: Mapping[str, Any], rows: list[int], factor: Array) -> dict[str, Any]:
    """Return what is measured of a person whose limb joints are these keypoints, -1 for none, in px
    of the result times ``factor`` (2,).
    """
    pixels = (np.array(person["keypoints"], np.float64) + 0.5) * factor - 0.5
    keypoints = np.column_stack([pixels, person["keypoint_confidence"]])
    unknown = np.full(3, np.nan)
    return {
        "box": (np.array(person["box"], np.float64) * np.tile(factor, 2)).tolist(),
        "joints": person["joints"],
        "keypoints": [keypoints[row] if row >= 0 else unknown for row in rows],
        "parts": person.get("world_contact") or {},
        "usable": usable_of(person),
        **{name: person.get(name) for name in ("joint_sigma", "stature_sigma")},
    }


def _depth(depth: Array, sample: Sample) -> dict[str, float]:
    import cv2

    file = str(sample.truth["depth_file"])
    truth = cv2.imread(file, cv2.IMREAD_UNCHANGED).astype(np.float64) / 1000
    size = (truth.shape[1], truth.shape[0])
    resized = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST).astype(np.float64)
    return depth_errors(resized, truth)
