"""How outputs of MetricDepth and RelativePointmap are compared: z, its scale, rays, the camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from physic_core.body import angle_deg
from physic_core.types import AffineAmbiguity, DepthMap
from physic_testing.conformance.accuracy import fit_ambiguity, inner_pixels
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect, warn_unless
from physic_testing.conformance.output_checks import COLOURS, WITHOUT_HINTS
from physic_testing.conformance.readings import (
    Group,
    Reading,
    Table,
    expect_within_sigmas,
    flipped,
    plus,
    shifted,
    times,
    values_of,
)
from physic_testing.worlds.world import pixel_rays

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Pointmap
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIN_COVERAGE = 0.3
"""Minimum share of pixels with known depth."""

MAX_SKY = 0.5
"""Share of the sky that may have a depth: its border does, in networks."""

MAX_SIGMA = 1.5
"""Standard deviation of log(scale) that no estimate of depth needs: a factor of 4.5."""

EXPLAINED = {"metric_depth": 0.05, "relative_pointmap": 0.4}
"""Share of the error that is left after a fit of another ambiguity; metric depth has other errors
of the kind.
"""

MIN_LEVELS = 300
"""Different depths below which a depth map is of 8 bits."""

MAX_REPEATED = 0.2
"""Share of rows or columns that may repeat the one before, beyond those of the truth."""

MAX_UP_SIGMAS = 3.0
"""Stated standard deviations from which on the direction for a mirrored photo is wrong."""

MIN_POINTS = 64
"""Pixels without which depths are not compared."""

_SAME = 0.98  # share of the pixels of a row that repeats another
_COMPARED = 20000  # pixels of a photo
_BLUR_PX = 1.2
_IN_FRONT = 0.1  # log of the depth behind a person over the person's
_CENTRES = "Use u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centered principal point."
_ASPECT = "Was the photo resized to another aspect ratio?"
_UPRIGHT = ("depth_is_along_z_and_upright",)


def aligned_depth_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Return the median relative depth error after a fit of the unknown scale and shift; NaN
    without pixels.
    """
    both = _both_known(z, truth)
    if both.sum() < MIN_POINTS:
        return float("nan")
    return float(np.median(np.abs(fit_ambiguity(z[both], truth[both], unknown) - 1)))


def _both_known(z: FloatArray, truth: FloatArray) -> BoolArray:
    both: BoolArray = np.isfinite(z) & np.isfinite(truth) & (np.nan_to_num(z) > 0) & (truth > 0)
    return both


def _values(answer: DepthMap | Pointmap, case: Case) -> tuple[Values, Truth]:
    """Return z (H, W), NaN where unknown, numbers of the camera, and of a point map the pixels
    (1, M, 2) on which points lie, from the principal point.
    """
    camera = case.intrinsics
    truth = {
        "z": _finite(case.truth.empty_depth),
        "camera": _camera_numbers(camera),
        "unknown": getattr(answer, "unknown", "scale"),
    }
    own = {"z": _known_z(answer), "camera": _camera_numbers(answer.intrinsics)}
    if not isinstance(answer, DepthMap):
        step = max(1, own["z"].size // _COMPARED)
        focal = np.array([camera.fx, camera.fy])
        with np.errstate(all="ignore"):
            pixels = answer.points[..., :2] / own["z"][..., None] * focal
        if answer.unknown == "scale_shift":  # which moves points off their rays
            pixels = np.full_like(pixels, np.nan)
        grid = pixel_rays(camera)[..., :2] * focal
        grid[~np.isfinite(truth["z"])] = np.nan
        own["pixels"], truth["pixels"] = (p.reshape(1, -1, 2)[:, ::step] for p in (pixels, grid))
    return own, truth


def _known_z(answer: DepthMap | Pointmap) -> FloatArray:
    if isinstance(answer, DepthMap):
        return _finite(answer.depth)
    return np.where(answer.valid, _finite(answer.points[..., 2]), np.nan)


def _finite(z: FloatArray) -> FloatArray:
    known: FloatArray = np.where(np.isfinite(z) & (np.nan_to_num(z) > 0), z, np.nan)
    return known.astype(np.float64)


def _camera_numbers(camera: Intrinsics | None) -> FloatArray:
    """Return cx, cy, 100 log(fx / fy), 100 log(focal length) as a row, NaN without a camera."""
    if camera is None:
        return np.full((1, 4), np.nan)
    aspect = 100 * np.log(camera.fx / camera.fy)
    return np.array([[camera.cx, camera.cy, aspect, 50 * np.log(camera.fx * camera.fy)]])


def _logs(z: FloatArray, truth: Truth, step: int = 1) -> FloatArray:
    """Return log z of every step-th pixel after a fit of what the output leaves open, NaN where
    unknown.
    """
    own, true = (side[::step, ::step] for side in (z, truth["z"]))
    logs = np.full(true.shape, np.nan)
    both = _both_known(own, true)
    if both.sum() >= MIN_POINTS:
        fitted = fit_ambiguity(own[both], true[both], truth["unknown"])
        logs[both] = np.log(np.maximum(fitted, 1e-3) * true[both])
    return logs


def _fitted_log_depths(z: FloatArray, truth: Truth) -> list[FloatArray]:
    return [_logs(z, truth, max(1, round((z.size / _COMPARED) ** 0.5))).ravel()]


def _edges(z: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the slopes of log z outside of the hole, which errors of low frequency leave alone."""
    import cv2

    logs = np.where(truth["case"].hole, np.nan, _logs(z, truth))
    known = np.isfinite(logs).astype(np.float64)
    weight = cv2.GaussianBlur(known, (0, 0), _BLUR_PX)
    smooth = cv2.GaussianBlur(np.nan_to_num(logs), (0, 0), _BLUR_PX) / np.maximum(weight, 1e-6)
    inner = cv2.erode(known, np.ones((5, 5), np.uint8), borderValue=0) > 0
    smooth = np.where(inner, smooth, np.nan)
    return [np.concatenate([np.diff(smooth, axis=axis)[::2, ::2].ravel() for axis in (0, 1)])]


def _scale(z: FloatArray, truth: Truth) -> list[FloatArray]:
    both = _both_known(z, truth["z"])
    return [np.array([np.median(np.log(z[both] / truth["z"][both])) if both.any() else np.nan])]


def _transposed(z: FloatArray, truth: Truth) -> FloatArray:
    height, width = z.shape
    rows = np.arange(height) * width // height
    taken: FloatArray = z.T[np.ix_(rows, np.arange(width) * height // width)]
    return taken


def _along_rays(z: FloatArray, truth: Truth) -> FloatArray:
    distance: FloatArray = z * np.linalg.norm(pixel_rays(truth["case"].intrinsics), axis=2)
    return distance


def _times_focal(z: FloatArray, truth: Truth) -> FloatArray:
    scaled: FloatArray = z * truth["case"].intrinsics.fx
    return scaled


def _of_a_square(pixels: FloatArray, truth: Truth) -> FloatArray:
    sides = np.array(truth["case"].photo.shape[1::-1])
    scaled: FloatArray = pixels * (sides / sides.max())
    return scaled


_TURNED = "Is the shape (H, W), and is the output turned back as the photo was for the network?"
_RAYS = "Divide by sqrt(1 + ((u - cx) / fx)^2 + ((v - cy) / fy)^2)."
_RESIZED = "Is the padding of the network's input subtracted, and the output resized by centers?"
_FLIPPED = "Mirror the output for the mirrored photo back before you average."
_INPUT = "Is it in px of the network's input, or of another camera?"
_BOTH = (
    Group(
        "depth_is_along_z_and_upright",
        "depth along the optical axis, in the rows and columns of the photo",
        "z",
        "of log z",
        (
            Reading("transposed", _transposed, _TURNED),
            Reading("mirrored", flipped(1), _TURNED),
            Reading("upside down", flipped(0), _TURNED),
            Reading(
                "disparity", lambda z, _: 1 / z, "Is it disparity, 1 / z?", shows_when_blind=True
            ),
            Reading("along the ray of each pixel", _along_rays, _RAYS),
            Reading("a mean with the mirrored photo", lambda z, _: (z + z[:, ::-1]) / 2, _FLIPPED),
        ),
        _fitted_log_depths,
    ),
    Group(
        "depth_is_not_shifted",
        "edges in place",
        "z",
        "of log z",
        (
            Reading("to the right", shifted(1), _RESIZED, 1, " px", 0.5),
            Reading("down", shifted(0), _RESIZED, 1, " px", 0.5),
        ),
        _edges,
        after=_UPRIGHT,
    ),
    Group(
        "intrinsics_are_not_biased",
        "the camera of the photo, in px of the photo",
        "camera",
        "px or %",
        (
            Reading("right of the center", plus(0.5, 0, 0, 0), _CENTRES, 0.5, " px", 0.3),
            Reading("below the center", plus(0, 0.5, 0, 0), _CENTRES, 0.5, " px", 0.3),
            Reading("fx over fy", plus(0, 0, 25, 0), _ASPECT, 25, " %", 2),
            Reading("too long a focal length", plus(0, 0, 0, 70), _INPUT, 70, " %", 30),
        ),
        rough=150,
    ),
)


def check_depth_is_where_it_can_be_known(subject: BackendUnderTest) -> None:
    """At least 30 % of the pixels have a depth of their own, finer than 8 bits; no sky has one."""
    for values, truth in values_of(subject, _values):
        z = values["z"]
        known = np.isfinite(z)
        where = f"in the photo '{truth['case'].name}'"
        expect(
            known.mean() >= MIN_COVERAGE,
            "known depth in at least 30 % of the pixels",
            f"{known.mean():.0%} {where}",
        )
        levels, true = (
            len(np.unique(side[_both_known(z, truth["z"])])) for side in (z, truth["z"])
        )
        expect(
            not 2 < levels < MIN_LEVELS < true / 10,
            "depths of more than 8 bits",
            f"{levels} different ones {where}",
            "Is it an image of 8 bit?",
        )
        repeated = _repeated_share(z)
        expect(
            repeated < MAX_REPEATED + _repeated_share(truth["z"]),
            "a depth for each pixel",
            f"{repeated:.0%} of the rows or columns as the one before {where}",
            "Is the output of a smaller grid repeated? Resize it by interpolation.",
        )
        sky = known[inner_pixels(~np.isfinite(truth["z"]))]
        warn_unless(
            sky.size < MIN_POINTS or sky.mean() < MAX_SKY,
            "no depth in the sky, which is infinitely far",
            f"a depth in {sky.mean() if sky.size else 0:.0%} of the sky {where}",
            "Is what the network says of the sky used for NaN or `valid`?",
        )


def _repeated_share(z: FloatArray) -> float:
    """Return which share of rows or of columns, the larger, repeats the one before, to the
    precision of 16 bits.
    """
    shares = []
    for lines in (z.astype(np.float16), z.T.astype(np.float16)):
        known = np.isfinite(lines[1:]) & np.isfinite(lines[:-1])
        same = (known & (lines[1:] == lines[:-1])).sum(axis=1) > _SAME * known.sum(axis=1)
        varies = np.nanmax(lines[1:], axis=1) > np.nanmin(lines[1:], axis=1)  # not clipped
        shares.append(float((same & varies).mean()))
    return max(shares)


def check_unknown_names_the_ambiguity(subject: BackendUnderTest) -> None:
    """No other scale and shift than the stated one explains nearly all of the error of depth."""
    evidence = values_of(subject, _values)
    stated = evidence[0][1]["unknown"]
    errors = {
        kind: np.array([aligned_depth_error(v["z"], t["z"], kind) for v, t in evidence])
        for kind in get_args(AffineAmbiguity)
    }
    own = errors.pop(stated)
    for kind, left in errors.items():
        differ = np.abs(own - left) > 1e-4
        share = float(np.median((left / own)[differ])) if differ.sum() > 2 else 1.0
        expect(
            share > EXPLAINED[subject.interface],
            f"agreement with the truth after a fit of {stated!r}",
            f"an error of which {share:.1%} is left after a fit of {kind!r}",
            f"Return unknown={kind!r}, or remove the offset.",
        )


def check_states_what_it_promises(subject: BackendUnderTest) -> None:
    """A backend that declares 'returns_intrinsics' returns them; `scale_sigma` is plausible."""
    answer = subject.result()
    if "returns_intrinsics" in subject.capabilities:
        expect(answer.intrinsics is not None, "intrinsics, as its capability declares", "None")
    sigma = getattr(answer, "scale_sigma", None)
    expect(
        sigma is None or 0 < float(sigma) < MAX_SIGMA,
        f"a standard deviation of log(scale) below {MAX_SIGMA}: 0.1 is ten percent; or None",
        f"{sigma!r}",
        "Is it in percent, or in meters?",
    )


def check_stated_error_of_the_scale_holds(subject: BackendUnderTest) -> None:
    """The error of the scale of depth is plausible for ``scale_sigma``."""
    evidence = values_of(subject, _values)
    apart = [
        float(np.abs(_scale(values["z"], truth)[0][0])) / answer.scale_sigma
        for (values, truth), (_, answer) in zip(evidence, subject.evidence(), strict=True)
        if answer.scale_sigma
    ]
    if not apart:
        raise CheckSkipped("it states no error of its scale")
    expect_within_sigmas(apart, "logarithms of the scale", "Is it of log(scale)?", 10)


def check_works_without_intrinsics(subject: BackendUnderTest) -> None:
    """Without `hints.intrinsics`, the output is valid: the camera of most photos is unknown."""
    case, request = subject.valid_request()
    bare = replace(request, hints=replace(request.hints, intrinsics=None))
    subject.call("valid output for a photo without known intrinsics", case, bare)


def check_accepts_the_photo_with_people(subject: BackendUnderTest) -> None:
    """For the photo with people and `hints.scene`, as in the pipeline's second call, the output is
    valid, and shows the people.
    """
    case, request = subject.valid_request()
    hints = replace(request.hints, hole=None, photo=None, scene=case.scene)
    wanted = "valid output for the photo with people, with hints.scene, and hints.hole None"
    answer = subject.call(wanted, case, replace(request, image=case.photo.copy(), hints=hints))
    if BLIND & subject.capabilities:
        return
    z = _known_z(answer)
    with np.errstate(all="ignore"):
        people = np.log(z / case.truth.depth)
        scene = np.log(z / case.truth.empty_depth)
    known = np.isfinite(people) & np.isfinite(scene)
    inside = known & case.truth.masks.any(axis=0) & (np.abs(people - scene) > _IN_FRONT)
    outside = known & ~case.hole
    if min(inside.sum(), outside.sum()) < MIN_POINTS:
        raise CheckSkipped("too few points of people")
    off, off_scene = (
        float(np.median(np.abs(logs[inside] - np.median(logs[outside]))))
        for logs in (people, scene)
    )
    expect(
        off_scene > 0.25 * off,
        "people in the points of the photo with people",
        f"depths {off_scene:.0%} from those of the scene behind them, and {off:.0%} from theirs",
        "Is it the result of the first call, or of hints.scene?",
    )


def check_up_is_against_gravity(subject: BackendUnderTest) -> None:
    """``up`` is within 3 stated sigmas of the floor's normal in half of the photos, and is
    mirrored in a mirrored photo.
    """
    stated = [(case, answer) for case, answer in subject.evidence() if answer.up is not None]
    if not stated:
        raise CheckSkipped("of no photo it tells which way is up")
    apart = [
        float(angle_deg(answer.up, case.truth.floor.normal)) / answer.up_sigma
        for case, answer in stated
    ]
    expect_within_sigmas(
        apart,
        "the floor's normal, which has y < 0,",
        "Is it down, or in a camera frame with y up? Is up_sigma in degrees?",
    )
    for case, answer in stated:
        again = _of_mirrored(subject, case)
        if again is not None and again.up is not None:
            off = float(angle_deg(again.up * [-1, 1, 1], answer.up))
            expect(
                off < MAX_UP_SIGMAS * answer.up_sigma,
                "up with the other sign of x for a mirrored photo",
                f"an angle of {off:.3g} degrees to it, up_sigma {answer.up_sigma:g}",
            )


def _of_mirrored(subject: BackendUnderTest, case: Case) -> Any:
    """Return the output for the mirrored photo, without the hints that are not mirrored; None if
    it is refused.
    """
    request = subject.request(case)
    of_pixels = dict.fromkeys(("people", "keypoints", "hole", "photo", "intrinsics"))
    given = replace(
        request,
        image=np.ascontiguousarray(request.image[:, ::-1]),
        hints=replace(request.hints, **of_pixels),
    )
    wanted = "valid output for a mirrored photo, or a PhysicError"
    return subject.call(wanted, case, given, may_refuse=True)


_OF_BOTH = (
    Check(check_depth_is_where_it_can_be_known, unless=BLIND),
    Check(check_unknown_names_the_ambiguity, after=_UPRIGHT, unless=BLIND),
    Check(check_states_what_it_promises),
)
_FOCAL = "Is the depth of a network for one focal length rescaled to that of the photo, once?"
_UNIT = "Is it centimeters, or is a factor missing that the network's authors state?"
_LARGE = float(np.log(1.2))

_SCALE = (
    Group(
        "depth_is_in_metres",
        "meters",
        "z",
        "of log(depth / true depth)",
        (Reading("too large", times(np.e), _UNIT, 1, " of the logarithm", _LARGE),),
        _scale,
        rough=float(np.log(3)),
    ),
    Group(
        "depth_does_not_depend_on_the_focal_length",
        "a scale that does not depend on the camera",
        "z",
        "of log(depth / true depth)",
        (Reading("times the focal length", _times_focal, _FOCAL, 1, "", 0.5),),
        _scale,
        centred=True,
        after=("depth_is_in_metres",),
    ),
)

METRIC_DEPTH = Table(
    _values,
    (
        WITHOUT_HINTS,
        *_OF_BOTH,
        Check(check_stated_error_of_the_scale_holds, after=("depth_is_in_metres",), unless=BLIND),
        COLOURS,
    ),
    (*_BOTH, *_SCALE),
)
_OPENGL = "Multiply points of an OpenGL camera (x right, y up, z back) by (1, -1, -1)."
_GIVEN = "Use hints.intrinsics if they are given."

_ON_RAYS = Group(
    "points_lie_on_the_rays_of_the_camera",
    "points that project to the centers of their pixels by the given camera (x right, y down)",
    "pixels",
    "px",
    (
        Reading("with x to the left", times(-1, 1), _OPENGL),
        Reading("with y upwards", times(1, -1), _OPENGL),
        Reading("of the aspect ratio of a square", _of_a_square, _ASPECT),
        Reading("to the right", plus(1, 0), _CENTRES, 1, " px", 0.25),
        Reading("down", plus(0, 1), _CENTRES, 1, " px", 0.25),
        Reading("farther out", times(1.01), _GIVEN, 1, " %", 0.6),
    ),
)

RELATIVE_POINTMAP = Table(
    _values,
    (
        *_OF_BOTH,
        Check(check_works_without_intrinsics),
        replace(WITHOUT_HINTS, after=("works_without_intrinsics",)),
        Check(check_accepts_the_photo_with_people, after=("points_lie_on_the_rays_of_the_camera",)),
        Check(check_up_is_against_gravity, unless=BLIND),
        COLOURS,
    ),
    (*_BOTH, _ON_RAYS),
)
