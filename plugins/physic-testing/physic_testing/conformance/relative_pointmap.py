"""Checks of a RelativePointmap: OpenCV camera frame, pixel centres, given intrinsics, and stated ambiguity."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.bias import expect_no_bias, pixel_shift
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.depth_checks import (
    expect_along_z,
    expect_ambiguity,
    expect_coverage,
    expect_depth_grows_with_distance,
    expect_not_flipped,
    expect_not_shifted,
)
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.metric_depth import (
    check_intrinsics_are_not_biased,
    check_intrinsics_fit_the_photo,
    check_returns_intrinsics_as_promised,
)
from physic_testing.conformance.output_checks import check_works_without_hints
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Pointmap
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MAX_OFFSET_PX, MAX_STRETCH = 0.25, 0.006
"""Mean offset of the pixel centres, px, and mean relative error of the rays' spread, that are treated as zero."""

MUCH = 0.43
"""As of ``expect_no_better``: another ambiguity leaves less than two fifths of the error."""

MAX_SECOND_STRETCH, MAX_SECOND_OFFSET_PX, MAX_SECOND_SHIFT_PX = 0.03, 1.0, 1.0
"""The same of one photo with people, and its shift against the photo without."""

MAX_SHARP_SHIFT_PX = 0.1
"""Shift of the first result against the truth up to which its edges are sharp enough for that comparison."""

MIN_POINTS = 64
_IN_FRONT = 0.1  # log of the depth behind a person over the person's
_SHIFT_PENALTY = 1e-3  # of the mean square residual; a true shift is off by 1e-5 of itself where depths vary by a tenth


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
    for axis, way, fits in zip("xy", ("to the right", "downwards"), _projection_fits(subject), strict=True):
        expect(
            fits[0][0] > 0,
            f"{axis} to grow {way} in the photo (OpenCV camera: x right, y down, z forward)",
            f"{axis} grows the other way",
            "Multiply points of an OpenGL camera (x right, y up, z back) by (1, -1, -1).",
        )


def check_given_camera_is_used(subject: BackendUnderTest) -> None:
    """The points lie on the pixel rays of `hints.intrinsics`."""
    for axis, fits in zip("xy", _projection_fits(subject), strict=True):
        expect_no_bias(
            100 * (fits[:, 0] - 1),
            100 * MAX_STRETCH,
            f"points on the rays of the given camera along {axis}",
            " % farther out",
            "Use hints.intrinsics if they are given.",
        )


def check_pixel_centres_are_integers(subject: BackendUnderTest) -> None:
    """Each point projects to the centre of its pixel; pixel centres have integer coordinates."""
    for axis, fits in zip("xy", _projection_fits(subject), strict=True):
        expect_no_bias(
            fits[:, 1],
            MAX_OFFSET_PX,
            f"points that project to pixel centres along {axis}, which have integer coordinates",
            " px",
            "Use u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centred principal point.",
        )


def check_depth_is_not_shifted(subject: BackendUnderTest) -> None:
    """Edges of z are where they are in the photo: their mean shift is below half a pixel."""
    expect_not_shifted([(case, _depth(answer), answer.unknown) for case, answer in subject.evidence()])


def check_unknown_names_the_ambiguity(subject: BackendUnderTest) -> None:
    """After a fit of the scale and shift that `unknown` names, the points agree with the truth."""
    answers = [(case, _depth(answer), answer.unknown) for case, answer in subject.evidence()]
    expect_ambiguity(answers, MUCH)


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
    faults = case_violations(subject.interface, answer, case)
    expect(not faults, "valid output for a photo without known intrinsics", "; ".join(faults))


def check_accepts_the_photo_with_people(subject: BackendUnderTest) -> None:
    """For the photo with people and with `hints.scene`, as in the pipeline's second call, the output is valid."""
    subject.result()
    case = subject.case("one person")
    _, hints = infer_arguments(subject.interface, case)
    try:
        answer = subject.infer(
            subject.loaded(case), case, (case.photo.copy(), replace(hints, hole=None, photo=None, scene=case.scene))
        )
    except PhysicError as error:
        raise CheckFailed("valid output for the photo with people", describe_error(error, subject.kind)) from error
    except Exception as error:
        raise CheckFailed(
            "valid output for the photo with people, with hints.scene set, and hints.hole and hints.photo None",
            describe_error(error, subject.kind),
        ) from error
    faults = case_violations(subject.interface, answer, case)
    expect(not faults, "valid output for the photo with people", "; ".join(faults))
    _expect_like_the_first_call(case, subject.result(), answer)
    if not BLIND & subject.capabilities:
        _expect_people(case, _depth(answer))


def _expect_like_the_first_call(case: Case, first: Pointmap, second: Pointmap) -> None:
    """Raise CheckFailed if the points of the photo with people are not where they are, outside of the people."""
    truth, z = case.truth.depth, _depth(second)
    expect_not_flipped(z, truth)
    expect_depth_grows_with_distance(z, truth)
    camera, (rows, columns) = case.intrinsics, np.nonzero(second.valid)
    points = second.points[rows, columns].astype(np.float64)
    for axis, pixel, focal, name in ((0, columns - camera.cx, camera.fx, "x"), (1, rows - camera.cy, camera.fy, "y")):
        slope, offset = _fit(pixel, points[:, axis], points[:, 2], focal)
        expect(
            abs(slope - 1) < MAX_SECOND_STRETCH and abs(offset) < MAX_SECOND_OFFSET_PX,
            f"points of the photo with people on the rays of the given camera along {name} (x right, y down)",
            f"{slope:.3f} times as far out, and {offset:+.2f} px off",
            "Is the second call, with hints.scene, handled like the first?",
        )
    outside = ~case.hole & np.isfinite(z) & np.isfinite(_depth(first))
    own, before = (np.log(np.where(outside, depth, 1.0)) for depth in (z, _depth(first)))
    true = np.log(np.where(outside & np.isfinite(case.truth.empty_depth), case.truth.empty_depth, 1.0))
    shift, sharp = pixel_shift(own, before, outside), np.abs(pixel_shift(before, true, outside)) < MAX_SHARP_SHIFT_PX
    expect(
        not (np.abs(shift) > MAX_SECOND_SHIFT_PX)[sharp].any(),
        "edges of the photo with people where they are in the photo without",
        f"a shift of {np.round(shift, 2).tolist()} px",
        "Is the padding of the network's input subtracted in both calls?",
    )


def _expect_people(case: Case, z: FloatArray) -> None:
    """Raise CheckFailed if depths (H, W) of the photo with people are those of the scene without them."""
    with np.errstate(all="ignore"):
        people, scene = (np.log(z / depth) for depth in (case.truth.depth, case.truth.empty_depth))
    known = np.isfinite(people) & np.isfinite(scene)
    inside = known & case.truth.masks.any(axis=0) & (np.abs(people - scene) > _IN_FRONT)
    outside = known & ~case.hole
    if min(inside.sum(), outside.sum()) < MIN_POINTS:
        return
    errors = [float(np.median(np.abs(logs[inside] - np.median(logs[outside])))) for logs in (people, scene)]
    expect(
        errors[1] > 0.25 * errors[0],
        "people in the points of the photo with people",
        f"depths {errors[1]:.0%} from those of the scene behind them, and {errors[0]:.0%} from theirs",
        "Is it the result of the first call, or of hints.scene?",
    )


def _projection_fits(subject: BackendUnderTest) -> tuple[FloatArray, FloatArray]:
    """Fit the projections of each photo's points along x and y: slope (1 is right) and offset in px, (K, 2) each."""
    fits: tuple[list[tuple[float, float]], ...] = ([], [])
    for case, answer in subject.evidence():
        rows, columns = np.nonzero(answer.valid)
        if len(rows) >= MIN_POINTS:
            camera, points = case.intrinsics, answer.points[rows, columns].astype(np.float64)
            fits[0].append(_fit(columns - camera.cx, points[:, 0], points[:, 2], camera.fx))
            fits[1].append(_fit(rows - camera.cy, points[:, 1], points[:, 2], camera.fy))
    if not fits[0]:
        raise CheckSkipped("too few points are valid")
    return np.array(fits[0]), np.array(fits[1])


def _fit(pixel: FloatArray, x: FloatArray, z: FloatArray, focal: float) -> tuple[float, float]:
    """Fit x = (slope pixel + offset) / focal (z + shift) by least squares; shift is the unknown depth offset.

    A small penalty makes the shift 0 where all depths are the same and any shift would fit.
    """
    unit = float(np.median(z))
    z, x = z / unit, x / unit * focal
    reach = float(np.abs(pixel).max())
    u = pixel / reach
    design = np.stack([u * z, z, u, np.ones_like(z)], axis=1)
    penalty = _SHIFT_PENALTY * np.sqrt(len(z)) * np.eye(4)[2:]
    fitted = np.linalg.lstsq(np.vstack([design, penalty]), np.append(x / reach, np.zeros(2)), rcond=None)[0]
    slope, offset = fitted[:2]
    return float(slope), float(offset) * reach


def _depth(pointmap: Pointmap) -> FloatArray:
    """Return the z values (H, W) of a point map, NaN where invalid."""
    z: FloatArray = np.where(pointmap.valid, pointmap.points[..., 2], np.nan)
    return z


_READ, _CAMERA = "physic_core.types.Pointmap", "physic_core.types.Intrinsics"
_ALONG_Z = ("unknown_names_the_ambiguity", "z_is_not_ray_length")
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
    Check(check_depth_is_not_shifted, _READ, after=_ALONG_Z, unless=BLIND),
    Check(check_intrinsics_fit_the_photo, _CAMERA),
    Check(check_intrinsics_are_not_biased, _CAMERA, after=("intrinsics_fit_the_photo",)),
    Check(check_returns_intrinsics_as_promised, _CAMERA, only_with=frozenset({"returns_intrinsics"})),
    Check(check_works_without_intrinsics, "physic_core.types.Hints"),
    Check(check_works_without_hints, "physic_core.types.Hints", after=("works_without_intrinsics",)),
    Check(
        check_accepts_the_photo_with_people,
        "physic_core.interfaces.RelativePointmap",
        after=("frame_is_opencv", "given_camera_is_used", "depth_grows_with_distance"),
    ),
)
"""Checks of a RelativePointmap, in order of execution."""
