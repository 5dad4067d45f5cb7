"""Checks of a RelativePointmap: OpenCV camera frame, pixel centres, given intrinsics, and stated ambiguity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_core.types import AffineAmbiguity
from physic_testing.conformance.check import Check
from physic_testing.conformance.contract import contract_violations
from physic_testing.conformance.depth_checks import (
    aligned_depth_error,
    expect_along_z,
    expect_coverage,
    expect_depth_grows_with_distance,
    expect_not_flipped,
)
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.metric_depth import check_intrinsics_fit_the_photo, check_returns_intrinsics_as_promised
from physic_testing.conformance.output_checks import check_works_without_hints
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Pointmap
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MAX_OFFSET_PX, MAX_STRETCH = 0.25, 0.03
"""Maximum offset of the pixel centres, px, and maximum relative error of the focal length."""


def check_points_cover_the_photo(subject: BackendUnderTest) -> None:
    """At least 30 % of the pixels have a valid point."""
    expect_coverage(subject.result().valid)


def check_points_are_not_transposed_or_flipped(subject: BackendUnderTest) -> None:
    """The point map has the rows and columns of the photo: not transposed, mirrored or rotated."""
    expect_not_flipped(_depth(subject.result()), subject.case("one person").truth.empty_depth)


def check_depth_grows_with_distance(subject: BackendUnderTest) -> None:
    """Farther points have larger z values; disparity fails."""
    expect_depth_grows_with_distance(_depth(subject.result()), subject.case("one person").truth.empty_depth)


def check_z_is_not_ray_length(subject: BackendUnderTest) -> None:
    """z is the depth along the optical axis, not the length of the ray."""
    truth, answer = subject.case("one person").truth, subject.result()
    expect_along_z(_depth(answer), truth.empty_depth, truth.intrinsics, answer.unknown)


def check_frame_is_opencv(subject: BackendUnderTest) -> None:
    """In the photo, x grows to the right and y grows downwards."""
    for axis, way, seen in zip("xy", ("to the right", "downwards"), _projection_fits(subject), strict=True):
        expect(
            seen.slope > 0,
            f"{axis} to grow {way} in the photo (OpenCV camera: x right, y down, z forward)",
            f"{axis} grows the other way",
            "Multiply points of an OpenGL camera (x right, y up, z back) by (1, -1, -1).",
        )


def check_given_camera_is_used(subject: BackendUnderTest) -> None:
    """The points lie on the pixel rays of `hints.intrinsics`."""
    camera = subject.case("one person").intrinsics
    for axis, focal, seen in zip("xy", (camera.fx, camera.fy), _projection_fits(subject), strict=True):
        expect(
            abs(seen.slope - 1) < MAX_STRETCH,
            f"points on the rays of the given camera, focal length {focal:.1f} px along {axis}",
            f"points on rays of a focal length of {focal / seen.slope if seen.slope else float('inf'):.1f} px",
            "Use hints.intrinsics if they are given.",
        )


def check_pixel_centres_are_integers(subject: BackendUnderTest) -> None:
    """Each point projects to the centre of its pixel; pixel centres have integer coordinates."""
    for axis, seen in zip("xy", _projection_fits(subject), strict=True):
        expect(
            abs(seen.offset) < MAX_OFFSET_PX,
            "points that project to pixel centres, which have integer coordinates",
            f"an offset of {seen.offset:+.2f} px along {axis}",
            "Use u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centred principal point.",
        )


def check_unknown_names_the_ambiguity(subject: BackendUnderTest) -> None:
    """After a fit of the scale and shift that `unknown` names, the points agree with the truth."""
    answer, truth = subject.result(), subject.case("one person").truth.empty_depth
    errors = {kind: aligned_depth_error(_depth(answer), truth, kind) for kind in get_args(AffineAmbiguity)}
    best = min(errors, key=lambda kind: errors[kind])
    own = errors[answer.unknown]
    expect(
        own < 0.02 or errors[best] > 0.4 * own,
        f"agreement with the truth after a fit of {answer.unknown!r}",
        f"{own:.1%} relative depth error, but {errors[best]:.1%} after fitting {best!r}",
        f"Return unknown={best!r}.",
    )


def check_works_without_intrinsics(subject: BackendUnderTest) -> None:
    """Without `hints.intrinsics`, the output is valid: the camera of most photos is unknown."""
    subject.result()
    case = subject.case("one person")
    image, hints = infer_arguments(subject.interface, case)
    try:
        answer = subject.infer(subject.loaded(case), case, (image, replace(hints, intrinsics=None)))
    except Exception as error:
        raise CheckFailed(
            "valid output for a photo without known intrinsics", describe_error(error, subject.kind)
        ) from error
    faults = contract_violations(subject.interface, answer, case)
    expect(not faults, "valid output for a photo without known intrinsics", "; ".join(faults))


def check_accepts_the_photo_with_people(subject: BackendUnderTest) -> None:
    """For the photo with people and with `hints.scene`, as in the pipeline's second call, the output is valid."""
    subject.result()
    case = subject.case("one person")
    _, hints = infer_arguments(subject.interface, case)
    try:
        answer = subject.infer(
            subject.loaded(case), case, (case.photo.copy(), replace(hints, hole=None, scene=case.scene))
        )
    except PhysicError as error:
        raise CheckFailed("valid output for the photo with people", describe_error(error, subject.kind)) from error
    except Exception as error:
        raise CheckFailed(
            "valid output for the photo with people, with hints.scene set and hints.hole None",
            describe_error(error, subject.kind),
        ) from error
    faults = contract_violations(subject.interface, answer, case)
    expect(not faults, "valid output for the photo with people", "; ".join(faults))


@dataclass(frozen=True)
class _AxisFit:
    """Linear fit of the projections along one image axis: (u - c) is seen at ``slope`` (u - c) + ``offset`` px."""

    slope: float
    offset: float


def _projection_fits(subject: BackendUnderTest) -> tuple[_AxisFit, _AxisFit]:
    """Fit the projections of the points along x and y."""
    answer, camera = subject.result(), subject.case("one person").intrinsics
    rows, columns = np.nonzero(answer.valid)
    if len(rows) < 64:
        raise CheckSkipped("too few points are valid")
    points = answer.points[rows, columns].astype(np.float64)
    across = _fit(columns - camera.cx, points[:, 0], points[:, 2], camera.fx)
    return across, _fit(rows - camera.cy, points[:, 1], points[:, 2], camera.fy)


def _fit(pixel: FloatArray, x: FloatArray, z: FloatArray, focal: float) -> _AxisFit:
    """Fit x = (slope pixel + offset) / focal (z + shift) by least squares; shift is the unknown depth offset."""
    unit = float(np.median(z))
    z, x = z / unit, x / unit * focal
    reach = float(np.abs(pixel).max())
    u = pixel / reach
    design = np.stack([u * z, z, u, np.ones_like(z)], axis=1)
    found = np.linalg.lstsq(design, x / reach, rcond=None)[0]
    return _AxisFit(float(found[0]), float(found[1]) * reach)


def _depth(pointmap: Pointmap) -> FloatArray:
    """Return the z values (H, W) of a point map, NaN where invalid."""
    z: FloatArray = np.where(pointmap.valid, pointmap.points[..., 2], np.nan)
    return z


_READ, _CAMERA = "physic_core.types.Pointmap", "physic_core.types.Intrinsics"
_UPRIGHT = ("points_are_not_transposed_or_flipped",)
CHECKS: tuple[Check, ...] = (
    Check(check_points_cover_the_photo, _READ),
    Check(check_points_are_not_transposed_or_flipped, _READ),
    Check(check_depth_grows_with_distance, _READ, after=_UPRIGHT),
    Check(
        check_unknown_names_the_ambiguity,
        "physic_core.types.AffineAmbiguity",
        after=("depth_grows_with_distance", *_UPRIGHT),
    ),
    Check(check_z_is_not_ray_length, _READ, after=("unknown_names_the_ambiguity", "depth_grows_with_distance")),
    Check(check_frame_is_opencv, _READ),
    Check(check_given_camera_is_used, _CAMERA, after=("frame_is_opencv",)),
    Check(check_pixel_centres_are_integers, _CAMERA, after=("given_camera_is_used",)),
    Check(check_intrinsics_fit_the_photo, _CAMERA),
    Check(check_returns_intrinsics_as_promised, _CAMERA, only_with=frozenset({"returns_intrinsics"})),
    Check(check_works_without_intrinsics, "physic_core.types.Hints"),
    Check(check_works_without_hints, "physic_core.types.Hints", after=("works_without_intrinsics",)),
    Check(check_accepts_the_photo_with_people, "physic_core.interfaces.RelativePointmap"),
)
"""Checks of a RelativePointmap, in order of execution."""
