from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from physic_core.types import CameraTrust
from physic_core.types.results import metres_text


@pytest.mark.parametrize(
    ("trust", "focal_sigma", "scale", "expected"),
    [
        (CameraTrust.GUESSED, 0.24, 0.07, pytest.approx(math.hypot(0.07, 0.24))),
        (CameraTrust.ESTIMATED, None, 0.07, 0.07),
        (CameraTrust.KNOWN, 0.24, 0.07, 0.07),
        (CameraTrust.GUESSED, 0.24, None, None),
    ],
)
def test_distances_err_by_scale_and_focal_length(
    reconstruction, trust, focal_sigma, scale, expected
):
    camera = replace(reconstruction.intrinsics, trust=trust, focal_sigma=focal_sigma)
    scene = replace(reconstruction.scene, scale_sigma=scale)
    result = replace(reconstruction, intrinsics=camera, scene=scene)
    assert result.distance_sigma == expected
    assert result.summary()["distance_sigma"] == result.distance_sigma


@pytest.mark.parametrize(
    ("own", "scale", "expected"), [(0.2, 0.07, 0.2), (0.01, 0.07, 0.07), (0.2, None, 0.2)]
)
def test_a_person_is_as_far_off_as_scale_or_stature_at_worst(reconstruction, own, scale, expected):
    people = (replace(reconstruction.people[0], stature_sigma=own), *reconstruction.people[1:])
    camera = replace(reconstruction.intrinsics, trust=CameraTrust.KNOWN)
    scene = replace(reconstruction.scene, scale_sigma=scale)
    result = replace(reconstruction, people=people, intrinsics=camera, scene=scene)
    assert result.distance_sigmas == (pytest.approx(expected), *[scale] * (len(people) - 1))


def test_a_measured_depth_gives_the_error_along_the_optical_axis(
    reconstruction,
):
    camera = replace(reconstruction.intrinsics, trust=CameraTrust.GUESSED, focal_sigma=0.25)
    scene = replace(reconstruction.scene, scale_sigma=0.01, measured=True)
    joints = np.zeros((55, 3), np.float32)
    ahead, aside = (joints + np.float32([x, 0, 3]) for x in (0, 3))
    people = tuple(
        replace(reconstruction.people[0], joints=one, stature_sigma=0.2) for one in (ahead, aside)
    )
    result = replace(reconstruction, people=people, intrinsics=camera, scene=scene)
    assert result.distance_sigma == 0.01
    assert result.distance_sigmas == pytest.approx((0.01, math.hypot(0.01, 0.125)))


def test_a_length_is_written_with_its_standard_deviation():
    assert metres_text(4.2, 0.25) == "4.20 ± 1.05 m"
    assert metres_text(12.5, 0.07, 1) == "12.5 ± 0.9 m"
    assert metres_text(3.6, 0.01, 1) == "3.60 ± 0.04 m"
    assert metres_text(-0.001, None) == "0.00 m"
