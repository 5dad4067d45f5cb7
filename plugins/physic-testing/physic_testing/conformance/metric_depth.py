"""Checks of a MetricDepth: metres, along z, upright."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.surfaces import (
    expect_along_z,
    expect_camera_of_photo,
    expect_cover,
    expect_farther_is_larger,
    expect_lies_like_photo,
)

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

FACTOR = 3.0
"""How far the median depth may be off: conformance asks for the unit, the accuracy is reported beside it."""


def check_depth_covers_the_photo(subject: Subject) -> None:
    """Something is known of a good part of the photo."""
    expect_cover(np.isfinite(subject.answer().depth))


def check_depth_lies_like_the_photo(subject: Subject) -> None:
    """The depth is neither transposed, nor mirrored, nor upside down."""
    expect_lies_like_photo(subject.answer().depth, subject.case("one person").truth.empty_depth)


def check_farther_is_larger(subject: Subject) -> None:
    """What is farther away has the larger depth."""
    expect_farther_is_larger(subject.answer().depth, subject.case("one person").truth.empty_depth)


def check_depth_is_in_metres(subject: Subject) -> None:
    """The median depth is within a factor 3 of the truth."""
    depth, truth = subject.answer().depth, subject.case("one person").truth.empty_depth
    both = np.isfinite(depth) & np.isfinite(truth)
    if not both.any():
        raise CheckSkipped("no depth is known")
    ratio = float(np.median(depth[both] / truth[both]))
    units = {100.0: "Is it centimetres?", 1000.0: "Is it millimetres?"}
    hint = next((words for factor, words in units.items() if factor / FACTOR < ratio < factor * FACTOR), "")
    expect(
        1 / FACTOR < ratio < FACTOR,
        f"metres: a median within a factor {FACTOR:g} of the true {float(np.median(truth[both])):.2f} m",
        f"{float(np.median(depth[both])):.4g}, {ratio:.3g} times the truth",
        hint,
    )


def check_depth_is_along_z(subject: Subject) -> None:
    """Depth is measured along the optical axis, not along each ray."""
    truth = subject.case("one person").truth
    expect_along_z(subject.answer().depth, truth.empty_depth, truth.intrinsics, "scale")


def check_camera_is_the_photos(subject: Subject) -> None:
    """Returned intrinsics have a focal length and a principal point in pixels of the photo."""
    expect_camera_of_photo(subject.answer().intrinsics, subject.case("one person").intrinsics)


def check_returns_its_camera(subject: Subject) -> None:
    """A backend with the capability 'returns_intrinsics' returns intrinsics."""
    expect(subject.answer().intrinsics is not None, "the camera, as its capability 'returns_intrinsics' says", "None")


def check_scale_sigma_is_a_deviation(subject: Subject) -> None:
    """`scale_sigma` is None, or a standard deviation of the logarithm of the scale."""
    sigma = subject.answer().scale_sigma
    if sigma is None:
        raise CheckSkipped("it answers no scale_sigma")
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
    Check(check_depth_lies_like_the_photo, _READ),
    Check(check_farther_is_larger, _READ, after=("depth_lies_like_the_photo",)),
    Check(check_depth_is_in_metres, _READ),
    Check(check_depth_is_along_z, _READ, after=("depth_lies_like_the_photo", "farther_is_larger")),
    Check(check_camera_is_the_photos, _READ),
    Check(check_returns_its_camera, _READ, only_with=_CALLED),
    Check(check_scale_sigma_is_a_deviation, _READ),
)
"""In the order in which they make sense."""
