"""Checks of a RelativePointmap: the OpenCV frame, pixel centres, the given camera, and what it says is unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from physic_core.discovery.error_text import describe
from physic_core.errors import PhysicError
from physic_core.types import AffineAmbiguity
from physic_testing.conformance.answering import check_needs_no_hints
from physic_testing.conformance.asking import form_faults, inputs
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.metric_depth import check_camera_is_the_photos, check_returns_its_camera
from physic_testing.conformance.surfaces import (
    aligned_error,
    expect_along_z,
    expect_cover,
    expect_farther_is_larger,
    expect_lies_like_photo,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Pointmap
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

MOST_OFFSET_PX, MOST_STRETCH = 0.25, 0.03


def check_points_cover_the_photo(subject: Subject) -> None:
    """Something is known of a good part of the photo."""
    expect_cover(subject.answer().valid)


def check_points_lie_like_the_photo(subject: Subject) -> None:
    """The depth of the points is neither transposed, nor mirrored, nor upside down."""
    expect_lies_like_photo(_depth(subject.answer()), subject.case("one person").truth.empty_depth)


def check_farther_is_larger(subject: Subject) -> None:
    """What is farther away has the larger z."""
    expect_farther_is_larger(_depth(subject.answer()), subject.case("one person").truth.empty_depth)


def check_z_is_not_the_length_of_the_ray(subject: Subject) -> None:
    """z is measured along the optical axis."""
    truth, answer = subject.case("one person").truth, subject.answer()
    expect_along_z(_depth(answer), truth.empty_depth, truth.intrinsics, answer.unknown)


def check_frame_is_opencv(subject: Subject) -> None:
    """x grows to the right and y grows downwards in the photo."""
    for axis, way, seen in zip("xy", ("to the right", "downwards"), _seen(subject), strict=True):
        expect(
            seen.slope > 0,
            f"{axis} to grow {way} in the photo (OpenCV camera: x right, y down, z forward)",
            f"{axis} grows the other way",
            "Multiply the axes of an OpenGL camera (x right, y up, z back) by (1, -1, -1).",
        )


def check_given_camera_is_used(subject: Subject) -> None:
    """The points lie on the rays of `hints.intrinsics`."""
    camera = subject.case("one person").intrinsics
    for axis, focal, seen in zip("xy", (camera.fx, camera.fy), _seen(subject), strict=True):
        expect(
            abs(seen.slope - 1) < MOST_STRETCH,
            f"points on the rays of the given camera, focal length {focal:.1f} px along {axis}",
            f"points on those of a focal length of {focal / seen.slope if seen.slope else float('inf'):.1f} px",
            "hints.intrinsics, where given, are the camera to use.",
        )


def check_pixels_are_counted_from_their_centres(subject: Subject) -> None:
    """Each point is seen at its own pixel's centre, and centres have integer coordinates."""
    for axis, seen in zip("xy", _seen(subject), strict=True):
        expect(
            abs(seen.offset) < MOST_OFFSET_PX,
            "points seen at the centres of their pixels: integer coordinates are centres",
            f"points seen {seen.offset:+.2f} px off along {axis}",
            "Take u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centred principal point.",
        )


def check_unknown_suffices(subject: Subject) -> None:
    """Fitting what `unknown` names brings the points to the truth about as well as anything could."""
    answer, truth = subject.answer(), subject.case("one person").truth.empty_depth
    errors = {kind: aligned_error(_depth(answer), truth, kind) for kind in get_args(AffineAmbiguity)}
    best = min(errors, key=lambda kind: errors[kind])
    own = errors[answer.unknown]
    expect(
        own < 0.02 or errors[best] > 0.4 * own,
        f"points that come to the truth by fitting {answer.unknown!r}",
        f"{own:.1%} off the true depth after that, but {errors[best]:.1%} after fitting {best!r}",
        f"Answer unknown={best!r}.",
    )


def check_works_without_intrinsics(subject: Subject) -> None:
    """Without `hints.intrinsics`, which most photos lack, the output is valid."""
    subject.answer()
    case = subject.case("one person")
    image, hints = inputs(subject.interface, case)
    try:
        answer = subject.ask(subject.loaded(case), case, (image, replace(hints, intrinsics=None)))
    except Exception as error:
        raise CheckFailed("points for a photo whose camera is not known", describe(error, subject.kind)) from error
    faults = form_faults(subject.interface, answer, case)
    expect(not faults, "points for a photo whose camera is not known", "; ".join(faults))


def check_accepts_the_photo_after_the_scene(subject: Subject) -> None:
    """In the pipeline's second call, with the photo of the people and `hints.scene`, the output is valid."""
    subject.answer()
    case = subject.case("one person")
    _, hints = inputs(subject.interface, case)
    try:
        answer = subject.ask(
            subject.loaded(case), case, (case.photo.copy(), replace(hints, hole=None, scene=case.scene))
        )
    except PhysicError as error:
        raise CheckFailed("points of the photo with its people", describe(error, subject.kind)) from error
    except Exception as error:
        raise CheckFailed(
            "points of the photo with its people, hints.scene given and hints.hole None",
            describe(error, subject.kind),
        ) from error
    faults = form_faults(subject.interface, answer, case)
    expect(not faults, "points of the photo with its people", "; ".join(faults))


@dataclass(frozen=True)
class _Axis:
    """Where points are seen along one axis: (u - c) becomes ``slope`` (u - c) + ``offset`` px."""

    slope: float
    offset: float


def _seen(subject: Subject) -> tuple[_Axis, _Axis]:
    answer, camera = subject.answer(), subject.case("one person").intrinsics
    rows, columns = np.nonzero(answer.valid)
    if len(rows) < 64:
        raise CheckSkipped("too few points are valid")
    points = answer.points[rows, columns].astype(np.float64)
    across = _fit(columns - camera.cx, points[:, 0], points[:, 2], camera.fx)
    return across, _fit(rows - camera.cy, points[:, 1], points[:, 2], camera.fy)


def _fit(pixel: FloatArray, x: FloatArray, z: FloatArray, focal: float) -> _Axis:
    """x = (slope pixel + offset) / focal (z + shift), linear in four products; the shift is whatever is unknown."""
    unit = float(np.median(z))
    z, x = z / unit, x / unit * focal
    reach = float(np.abs(pixel).max())
    u = pixel / reach
    design = np.stack([u * z, z, u, np.ones_like(z)], axis=1)
    found = np.linalg.lstsq(design, x / reach, rcond=None)[0]
    return _Axis(float(found[0]), float(found[1]) * reach)


def _depth(pointmap: Pointmap) -> FloatArray:
    z: FloatArray = np.where(pointmap.valid, pointmap.points[..., 2], np.nan)
    return z


_READ, _CAMERA = "physic_core.types.Pointmap", "physic_core.types.Intrinsics"
_UPRIGHT = ("points_lie_like_the_photo",)
CHECKS: tuple[Check, ...] = (
    Check(check_points_cover_the_photo, _READ),
    Check(check_points_lie_like_the_photo, _READ),
    Check(check_farther_is_larger, _READ, after=_UPRIGHT),
    Check(check_unknown_suffices, "physic_core.types.AffineAmbiguity", after=("farther_is_larger", *_UPRIGHT)),
    Check(check_z_is_not_the_length_of_the_ray, _READ, after=("unknown_suffices", "farther_is_larger")),
    Check(check_frame_is_opencv, _READ),
    Check(check_given_camera_is_used, _CAMERA, after=("frame_is_opencv",)),
    Check(check_pixels_are_counted_from_their_centres, _CAMERA, after=("given_camera_is_used",)),
    Check(check_camera_is_the_photos, _CAMERA),
    Check(check_returns_its_camera, _CAMERA, only_with=frozenset({"returns_intrinsics"})),
    Check(check_works_without_intrinsics, "physic_core.types.Hints"),
    Check(check_needs_no_hints, "physic_core.types.Hints", after=("works_without_intrinsics",)),
    Check(check_accepts_the_photo_after_the_scene, "physic_core.interfaces.RelativePointmap"),
)
"""In the order in which they make sense."""
