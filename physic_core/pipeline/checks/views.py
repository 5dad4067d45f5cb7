"""Self-checks of a result of several photos: whether its people are where each photo shows them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from physic_core.pipeline.checks.keypoints import limb_keypoint_error
from physic_core.pipeline.checks.result import Measurement, compare_with_threshold, grade_photo, warning_messages
from physic_core.types.main_people import main_people

if TYPE_CHECKING:
    from physic_core.types import CameraView, CheckResult, Reconstruction


def with_cameras(
    result: Reconstruction,
    cameras: Sequence[CameraView],
    measured: Iterable[tuple[str, str, float | None, str]] = (),
) -> Reconstruction:
    """Return a result with the cameras of several photos, a check for each photo, and the overall grade and warnings.

    Args:
        result: in the frame of the reference camera.
        cameras: the reference first.
        measured: photo, name, value (None if unknown) and advice of further checks.
    """
    cameras = tuple(cameras)
    further = (
        _of_photo(compare_with_threshold(Measurement(name, value, why)), photo) for photo, name, value, why in measured
    )
    found = (*_check_views(result, cameras[1:]), *further)
    checks = (*result.checks, *found)
    main = main_people([person.box for person in result.people])
    return replace(
        result,
        cameras=cameras,
        checks=checks,
        warnings=(*result.warnings, *warning_messages(found)),
        grade=grade_photo(checks, [grade for i in main if (grade := result.people[i].grade) is not None]),
    )


def _check_views(result: Reconstruction, cameras: Sequence[CameraView]) -> Iterator[CheckResult]:
    """Compare the bodies with the keypoints of each photo."""
    for camera in cameras:
        errors = [
            limb_keypoint_error(
                camera.to_camera(result.people[index].joints),
                seen.keypoints,
                seen.keypoint_confidence,
                np.asarray(seen.box, np.float64),
                result.skeleton,
                camera.intrinsics,
            )
            for index, seen in camera.people.items()
        ]
        measured = [error for error in errors if error is not None]
        found = Measurement(
            "view_keypoints",
            median(measured) if measured else None,
            f"the people are not where {camera.photo} shows them: its camera is wrong, or the people moved; look at "
            "its row in preview.png, and leave the photo out",
            unmeasured=f"no person has enough confident keypoints in {camera.photo}",
        )
        yield _of_photo(compare_with_threshold(found), camera.photo)


def _of_photo(check: CheckResult, photo: str) -> CheckResult:
    """Return a check with the name of its photo."""
    label = f"{check.label} in {photo}"
    return replace(check, label=label, message=check.message.replace(check.label, label))
