"""Checks of a MetricDepth: metres, depth along z, orientation, intrinsics and scale uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.bias import expect_no_better, expect_no_bias, spread
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.depth_checks import (
    expect_along_z,
    expect_ambiguity,
    expect_camera_of_photo,
    expect_camera_without_bias,
    expect_coverage,
    expect_depth_grows_with_distance,
    expect_not_flipped,
    expect_not_shifted,
)
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MAX_SIGMA = 1.5
"""Standard deviation of log(scale) that no estimate of depth needs: a factor of 4.5."""

_RESCALED = "Is the depth of a network for one focal length rescaled to the focal length of the photo, once?"

MAX_SCALE = 1.2
"""Factor on all depths that is treated as zero."""

ALMOST_ALL = 0.9
"""Depth of networks has errors that an offset explains in part; this is an offset that leaves a twentieth of them."""

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


def check_depth_has_no_bias_of_scale(subject: BackendUnderTest) -> None:
    """Over several photos, depth is not too large or too small by more than a fifth in the mean."""
    logs, focals = [], []
    for case, answer in subject.evidence():
        both = np.isfinite(answer.depth) & np.isfinite(case.truth.empty_depth)
        logs.append(np.median(np.log(answer.depth[both] / case.truth.empty_depth[both])))
        focals.append(np.log(case.intrinsics.fx / np.array([1, case.photo.shape[1], max(case.photo.shape[:2])])))
    expect_no_bias(
        np.array(logs),
        float(np.log(MAX_SCALE)),
        f"metres: a mean log(depth / true depth) within +-{np.log(MAX_SCALE):.2f}",
        "",
        _RESCALED,
    )
    readings = {
        f"{words} the focal length in {unit}": np.array(logs) + sign * np.array(focals)[:, i]
        for sign, words in ((1, "multiplied by"), (-1, "divided by"))
        for i, unit in enumerate(("px", "widths of the photo", "larger sides of the photo"))
    }
    expect_no_better(
        spread(np.array(logs)),
        {words: spread(errors) for words, errors in readings.items()},
        0.01,
        "a scale that does not depend on the camera, deviation of log(depth / true depth) from its mean",
        dict.fromkeys(readings, _RESCALED),
    )


def check_depth_has_no_offset(subject: BackendUnderTest) -> None:
    """A constant added to z, or to 1 / z, is not all that the depth has of an error."""
    expect_ambiguity([(case, answer.depth, "scale") for case, answer in subject.evidence()], ALMOST_ALL)


def check_depth_is_not_shifted(subject: BackendUnderTest) -> None:
    """Edges of depth are where they are in the photo: their mean shift is below half a pixel."""
    expect_not_shifted([(case, answer.depth, "scale") for case, answer in subject.evidence()])


def check_depth_is_along_z(subject: BackendUnderTest) -> None:
    """Depth is measured along the optical axis, not along the ray of each pixel."""
    truth = subject.case("one person").truth
    expect_along_z(subject.result().depth, truth.empty_depth, truth.intrinsics, "scale")


def check_intrinsics_fit_the_photo(subject: BackendUnderTest) -> None:
    """Returned intrinsics are in pixels of the photo: plausible focal length, principal point inside."""
    expect_camera_of_photo(subject.result().intrinsics, subject.case("one person").intrinsics)


def check_intrinsics_are_not_biased(subject: BackendUnderTest) -> None:
    """Returned intrinsics have no common error of the principal point, such as half a pixel, aspect or focal length."""
    expect_camera_without_bias([(answer.intrinsics, case.intrinsics) for case, answer in subject.evidence()])


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
        0 < float(sigma) < MAX_SIGMA,
        f"a standard deviation of log(scale) above 0 and below {MAX_SIGMA}: 0.1 is ten percent; or None",
        f"{sigma!r}",
        "Is it in percent, or in metres?",
    )


_READ = "physic_core.types.DepthMap"
_UPRIGHT = ("depth_is_not_transposed_or_flipped", "depth_grows_with_distance")
_CALLED = frozenset({"returns_intrinsics"})
CHECKS: tuple[Check, ...] = (
    Check(check_depth_covers_the_photo, _READ),
    Check(check_depth_is_not_transposed_or_flipped, _READ),
    Check(check_depth_grows_with_distance, _READ, after=("depth_is_not_transposed_or_flipped",)),
    Check(check_depth_is_in_metres, _READ),
    Check(check_depth_is_along_z, _READ, after=_UPRIGHT),
    Check(check_depth_has_no_bias_of_scale, _READ, after=("depth_is_in_metres",), unless=BLIND),
    Check(check_depth_has_no_offset, _READ, after=(*_UPRIGHT, "depth_is_along_z"), unless=BLIND),
    Check(check_depth_is_not_shifted, _READ, after=_UPRIGHT, unless=BLIND),
    Check(check_intrinsics_fit_the_photo, _READ),
    Check(check_intrinsics_are_not_biased, _READ, after=("intrinsics_fit_the_photo",)),
    Check(check_returns_intrinsics_as_promised, _READ, only_with=_CALLED),
    Check(check_scale_sigma_is_a_standard_deviation, _READ),
)
"""Checks of a MetricDepth, in order of execution."""
