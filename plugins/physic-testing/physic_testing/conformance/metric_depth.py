"""Checks of a MetricDepth: metres, depth along z, orientation, intrinsics and scale uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.depth_checks import (
    expect_along_z,
    expect_camera_of_photo,
    expect_coverage,
    expect_depth_grows_with_distance,
    expect_not_flipped,
)
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MAX_FACTOR = 3.0
"""Maximum factor between the median depth and the truth; it detects a wrong unit, not a low accuracy."""


def check_depth_covers_the_photo(subject: BackendUnderTest) -> None:
    """At least 30 % of the pixels have a finite depth."""
    expect_coverage(np.isfinite(subject.result().depth))


def check_depth_is_not_transposed_or_flipped(subject: BackendUnderTest) -> None:
    """The depth map has the rows and columns of the photo: not transposed, mirrored or rotated."""
    expect_not_flipped(subject.result().depth, subject.case("one person").truth.empty_depth)


def check_depth_grows_with_distance(subject: BackendUnderTest) -> None:
    """Farther points have larger depth values; disparity fails."""
    expect_depth_grows_with_distance(subject.result().depth, subject.case("one person").truth.empty_depth)


def check_depth_is_in_metres(subject: BackendUnderTest) -> None:
    """The median depth is within a factor of 3 of the true depth in metres."""
    depth, truth = subject.result().depth, subject.case("one person").truth.empty_depth
    both = np.isfinite(depth) & np.isfinite(truth)
    if not both.any():
        raise CheckSkipped("no depth is known")
    ratio = float(np.median(depth[both] / truth[both]))
    units = {100.0: "Is it centimetres?", 1000.0: "Is it millimetres?"}
    hint = next((words for factor, words in units.items() if factor / MAX_FACTOR < ratio < factor * MAX_FACTOR), "")
    expect(
        1 / MAX_FACTOR < ratio < MAX_FACTOR,
        f"metres: a median depth within a factor {MAX_FACTOR:g} of the true {float(np.median(truth[both])):.2f} m",
        f"{float(np.median(depth[both])):.4g}, {ratio:.3g} times the truth",
        hint,
    )


def check_depth_is_along_z(subject: BackendUnderTest) -> None:
    """Depth is measured along the optical axis, not along the ray of each pixel."""
    truth = subject.case("one person").truth
    expect_along_z(subject.result().depth, truth.empty_depth, truth.intrinsics, "scale")


def check_intrinsics_fit_the_photo(subject: BackendUnderTest) -> None:
    """Returned intrinsics are in pixels of the photo: plausible focal length, principal point inside."""
    expect_camera_of_photo(subject.result().intrinsics, subject.case("one person").intrinsics)


def check_returns_intrinsics_as_promised(subject: BackendUnderTest) -> None:
    """A backend with the capability 'returns_intrinsics' returns intrinsics."""
    expect(
        subject.result().intrinsics is not None, "intrinsics, as its capability 'returns_intrinsics' declares", "None"
    )


def check_scale_sigma_is_a_standard_deviation(subject: BackendUnderTest) -> None:
    """`scale_sigma` is None or a plausible standard deviation of log(scale)."""
    sigma = subject.result().scale_sigma
    if sigma is None:
        raise CheckSkipped("it returns no scale_sigma")
    expect(
        0 < float(sigma) < 3,
        "a standard deviation of log(scale) above 0 and below 3: 0.1 is ten percent; or None",
        f"{sigma!r}",
        "Is it in percent, or in metres?",
    )


_READ = "physic_core.types.DepthMap"
_CALLED = frozenset({"returns_intrinsics"})
CHECKS: tuple[Check, ...] = (
    Check(check_depth_covers_the_photo, _READ),
    Check(check_depth_is_not_transposed_or_flipped, _READ),
    Check(check_depth_grows_with_distance, _READ, after=("depth_is_not_transposed_or_flipped",)),
    Check(check_depth_is_in_metres, _READ),
    Check(check_depth_is_along_z, _READ, after=("depth_is_not_transposed_or_flipped", "depth_grows_with_distance")),
    Check(check_intrinsics_fit_the_photo, _READ),
    Check(check_returns_intrinsics_as_promised, _READ, only_with=_CALLED),
    Check(check_scale_sigma_is_a_standard_deviation, _READ),
)
"""Checks of a MetricDepth, in order of execution."""
