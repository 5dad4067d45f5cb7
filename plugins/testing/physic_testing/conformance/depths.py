"""How outputs of MetricDepth and RelativePointmap are compared: z, its scale, rays, the camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from physic_core.body import angle_deg
from physic_core.types import AffineAmbiguity, DepthMap
from physic_testing.conformance.accuracy import fit_ambiguity, inner_pixels
from physic_testing.conformance.changes import WITHOUT_HINTS, Change, without
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import expect, expect_or_warn
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    check_stated_errors_hold,
    flipped,
    plus,
    shifted,
    times,
    values_of,
)
from physic_testing.conformance.output_checks import COLOURS
from physic_testing.conformance.requests import mirrored
from physic_testing.worlds.world import pixel_rays

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics, Pointmap
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIN_COVERAGE = 0.3
"""Minimum share of pixels with known depth."""

MAX_SKY = 0.5
"""Share of the sky that may have a depth: its border does, in networks."""

MAX_SIGMA = 1.5
"""Standard deviation of log(scale) that no estimate of depth needs: a factor of 4.5."""

SCALE_SIGMAS = 10 / 3
"""Factor of stated deviations of log(scale): worlds are no photos on which these were fitted."""

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

_COMPARED = 20000  # pixels of a photo
_SAME = 0.98  # share of the pixels of a row that repeats another
_BLUR_PX = 1.2
_IN_FRONT = 0.1  # log of the depth behind a person over the person's
_CENTRES = "Use u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centered principal point."
_ASPECT = "Was the photo resized to another aspect ratio?"
_UPRIGHT = ("depth_is_along_z_and_upright",)


def aligned_depth_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Return the median relative depth error after a fit of the unknown scale and shift; NaN
    without pixels.
    """
    return float(np.nanmedian(np.abs(_fitted_ratio(z, truth, unknown) - 1)))


def _fitted_ratio(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> FloatArray:
    """Return the depths, after a fit of what they leave open, over the true ones, NaN where one is
    unknown.
    """
    ratio = np.full(truth.shape, np.nan)
    both = (z > 0) & (truth > 0)
    if both.sum() >= MIN_POINTS:
        ratio[both] = fit_ambiguity(z[both], truth[both], unknown)
    return ratio


def _values(answer: DepthMap | Pointmap, case: Case) -> tuple[Values, Truth]:
    """Return z (H, W), NaN where unknown, numbers of the camera, and of a point map the pixels
    (1, M, 2) on which points lie, from the principal point.
    """
    camera = case.intrinsics
    z, true = _known_z(answer), _finite(case.truth.empty_depth)
    values: Values = {"z": z, "camera": _camera_numbers(answer.intrinsics)}
    truth: Truth = {"z": true, "camera": _camera_numbers(camera), "unknown": "scale"}
    if isinstance(answer, DepthMap):
        sigma = SCALE_SIGMAS * (answer.scale_sigma or np.nan)
        values["sigmas"] = np.abs(np.nanmedian(np.log(z / true))) / sigma
        return values, truth
    truth["unknown"] = answer.unknown
    if answer.up is not None:
        values["sigmas"] = float(angle_deg(answer.up, case.truth.floor.normal)) / float(
            answer.up_sigma or np.nan
        )
    on_rays = answer.points / z[..., None] + (0 if answer.unknown != "scale_shift" else np.nan)
    rays = np.where(np.isfinite(true)[..., None], pixel_rays(camera), np.nan)
    for side, directions in ((values, on_rays), (truth, rays)):
        pixels = directions[..., :2].reshape(1, -1, 2) * [camera.fx, camera.fy]
        side["pixels"] = pixels[:, :: max(1, z.size // _COMPARED)]
    return values, truth


def _known_z(answer: DepthMap | Pointmap) -> FloatArray:
    if isinstance(answer, DepthMap):
        return _finite(answer.depth)
    return np.where(answer.valid, _finite(answer.points[..., 2]), np.nan)


def _finite(z: FloatArray) -> FloatArray:
    return np.where((z > 0) & (z < np.inf), z, np.nan).astype(np.float64)


def _camera_numbers(camera: Intrinsics | None) -> FloatArray:
    """Return cx, cy, 100 log(fx / fy), 100 log(focal length) as a row, NaN without a camera."""
    if camera is None:
        return np.full((1, 4), np.nan)
    x, y = 100 * np.log([camera.fx, camera.fy])
    return np.array([[camera.cx, camera.cy, x - y, (x + y) / 2]])


def _metric_errors(values: Values, truth: Truth) -> dict[str, Any]:
    ratio = _inner_ratio(values, truth)
    fitted = ratio / np.nanmedian(ratio)
    return {"abs-rel, scale fitted": np.abs(fitted - 1), "abs-rel": np.abs(ratio - 1)}


def _aligned_errors(values: Values, truth: Truth) -> dict[str, Any]:
    ratio = _fitted_ratio(_inner_ratio(values, truth) * truth["z"], truth["z"], truth["unknown"])
    return {"abs-rel, aligned": np.abs(ratio - 1)}


def _inner_ratio(values: Values, truth: Truth) -> FloatArray:
    """Return estimated over true depths (H, W), NaN near the sky."""
    true = truth["z"]
    return np.where(inner_pixels(np.isfinite(true)), values["z"] / true, np.nan)


def _logs(z: FloatArray, truth: Truth) -> FloatArray:
    """Return log z after a fit of what the output leaves open, NaN where unknown."""
    ratio = _fitted_ratio(z, truth["z"], truth["unknown"])
    return np.asarray(np.log(np.maximum(ratio, 1e-3) * truth["z"]))


def _fitted_log_depths(z: FloatArray, truth: Truth) -> list[FloatArray]:
    step = max(1, round((z.size / _COMPARED) ** 0.5))
    answered, true = (side[::step, ::step] for side in (z, truth["z"]))
    return [_logs(answered, truth | {"z": true}).ravel()]


def _edge_slopes(z: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the slopes of log z outside of the hole, which errors of low frequency leave alone."""
    import cv2

    logs = np.where(truth["case"].hole, np.nan, _logs(z, truth))
    finite = np.isfinite(logs) * 1.0
    sums, weight = (cv2.GaussianBlur(a, (0, 0), _BLUR_PX) for a in (np.nan_to_num(logs), finite))
    inner = cv2.erode(finite, np.ones((5, 5), np.uint8), borderValue=0) > 0
    smooth = np.where(inner, sums / np.maximum(weight, 1e-6), np.nan)
    return [np.array(np.gradient(smooth))[:, ::2, ::2].ravel()]


def _scale(z: FloatArray, truth: Truth) -> list[FloatArray]:
    return [np.array([np.nanmedian(np.log(z / truth["z"]))])]


def _transposed(z: FloatArray, truth: Truth) -> FloatArray:
    height, width = z.shape
    rows = np.arange(height) * width // height
    return z.T[np.ix_(rows, np.arange(width) * height // width)]


def _of_middle_square(z: FloatArray, truth: Truth) -> FloatArray:
    side = min(z.shape)
    rows, columns = ((n - side) // 2 + np.arange(n) * side // n for n in z.shape)
    return z[np.ix_(rows, columns)]


def _along_rays(z: FloatArray, truth: Truth) -> FloatArray:
    distance: FloatArray = z * np.linalg.norm(pixel_rays(truth["case"].intrinsics), axis=2)
    return distance


def _of_a_square(pixels: FloatArray, truth: Truth) -> FloatArray:
    sides = np.array(truth["case"].photo.shape[1::-1])
    scaled: FloatArray = pixels * (sides / sides.max())
    return scaled


def check_depth_is_where_it_can_be_known(subject: BackendUnderTest) -> None:
    """At least 30 % of the pixels have a depth of their own, finer than 8 bits; no sky has one."""
    for values, truth in values_of(subject):
        z = values["z"]
        is_known = np.isfinite(z)
        where = f"in the photo '{truth['case'].name}'"
        expect(
            is_known.mean() >= MIN_COVERAGE,
            "known depth in at least 30 % of the pixels",
            f"{is_known.mean():.0%} {where}",
        )
        levels, true = (len(np.unique(side[is_known])) for side in (z, truth["z"]))
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
            f"{repeated:.0%} of the rows or columns equal the one before {where}",
            "Is the output of a smaller grid repeated? Resize it by interpolation.",
        )
        sky = is_known[inner_pixels(~np.isfinite(truth["z"]))]
        expect_or_warn(
            sky.size < MIN_POINTS or sky.mean() < MAX_SKY,
            "no depth in the sky, which is infinitely far",
            f"a depth in most of the sky {where}",
            "Is what the network says of the sky used for NaN or `valid`?",
        )


def _repeated_share(z: FloatArray) -> float:
    """Return which share of rows or of columns, the larger, repeats the one before, to the
    precision of 16 bits; those of one depth, such as clipped ones, do not count.
    """
    shares = []
    for lines in (z.astype(np.float16), z.T.astype(np.float16)):
        is_known = np.isfinite(lines[1:] + lines[:-1])
        same = (lines[1:] == lines[:-1]).sum(axis=1) > _SAME * is_known.sum(axis=1)
        varies = np.nanmax(lines[1:], axis=1) > np.nanmin(lines[1:], axis=1)
        shares.append((same & varies).mean())
    return float(max(shares))


def check_unknown_names_the_ambiguity(subject: BackendUnderTest) -> None:
    """No other scale and shift than the stated one explains nearly all of the error of depth."""
    evidence = values_of(subject)
    stated = evidence[0][1]["unknown"]
    errors = {
        kind: np.array([aligned_depth_error(v["z"], t["z"], kind) for v, t in evidence])
        for kind in get_args(AffineAmbiguity)
    }
    for kind, left in errors.items():
        differ = np.abs(errors[stated] - left) > 1e-4
        share = np.median((left / errors[stated])[differ]) if differ.sum() > 2 else 1.0
        expect(
            bool(share > EXPLAINED[subject.interface]),
            f"agreement with the truth after a fit of {stated!r}",
            f"a fit of {kind!r} leaves only {share:.1%} of the error",
            f"Return unknown={kind!r}, or remove the offset.",
        )


def check_states_what_it_promises(subject: BackendUnderTest) -> None:
    """A backend that declares 'returns_intrinsics' returns them; `scale_sigma` is plausible."""
    answer = subject.result()
    if "returns_intrinsics" in subject.declared:
        expect(answer.intrinsics is not None, "intrinsics, as its capability declares", "None")
    sigma = getattr(answer, "scale_sigma", None)
    expect(
        sigma is None or 0 < float(sigma) < MAX_SIGMA,
        f"a standard deviation of log(scale) below {MAX_SIGMA}: 0.1 is ten percent; or None",
        f"{sigma!r}",
        "Is it in percent, or in meters?",
    )


def check_accepts_the_photo_with_people(subject: BackendUnderTest) -> None:
    """For the photo with people and `hints.scene`, as in the pipeline's second call, the output is
    valid, and shows the people.
    """
    case, request = subject.valid_request()
    hints = replace(request.hints, hole=None, photo=None, scene=case.scene)
    wanted = "valid output for the photo with people, with hints.scene, and hints.hole None"
    answer = subject.call(wanted, case, replace(request, image=case.photo.copy(), hints=hints))
    if BLIND & subject.declared:
        return
    both = [_finite(z) for z in (case.truth.depth, case.truth.empty_depth)]
    inside = case.truth.masks.any(axis=0) & (np.log(both[1] / both[0]) > _IN_FRONT)
    logs = [np.log(_known_z(answer) / true) for true in both]
    people, scene = (
        np.nanmedian(np.abs(log[inside] - np.nanmedian(log[~case.hole]))) for log in logs
    )
    expect(
        not scene <= 0.25 * people,
        "people in the points of the photo with people",
        f"depths {scene:.0%} from those of the scene behind them, and {people:.0%} from theirs",
        "Is it the result of the first call, or of hints.scene?",
    )


def check_up_is_mirrored_in_a_mirrored_photo(subject: BackendUnderTest) -> None:
    """For a mirrored photo, ``up`` is mirrored, within 3 stated sigmas."""
    for case, answer in subject.evidence():
        if answer.up is None:
            continue
        wanted = "valid output for a mirrored photo, or a PhysicError"
        request = mirrored(subject.request(case))
        again = subject.call(wanted, case, request, may_refuse=True)
        if again is not None and again.up is not None:
            off = float(angle_deg(again.up * [-1, 1, 1], answer.up))
            expect(
                off < MAX_UP_SIGMAS * answer.up_sigma,
                "up with the other sign of x for a mirrored photo",
                f"an angle of {off:.3g} degrees to it, up_sigma {answer.up_sigma:g}",
            )


_WITHOUT_INTRINSICS = Change(
    "works_without_intrinsics",
    "valid output for a photo without known intrinsics, as of most photos",
    without("intrinsics"),
).as_check()

_TURNED = "Is the shape (H, W), and is the output turned back as the photo was for the network?"
_RAYS = "Divide by sqrt(1 + ((u - cx) / fx)^2 + ((v - cy) / fy)^2)."
_RESIZED = "Is the padding of the network's input subtracted, and the output resized by centers?"
_FLIPPED = "Mirror the output for the mirrored photo back before you average."
_INPUT = "Is it in px of the network's input, or of another camera?"
_FOCAL = "Is the depth of a network for one focal length rescaled to that of the photo, once?"
_UNIT = "Is it centimeters, or is a factor missing that the network's authors state?"
_OPENGL = "Multiply points of an OpenGL camera (x right, y up, z back) by (1, -1, -1)."
_GIVEN = "Use hints.intrinsics if they are given."
_LARGE = float(np.log(1.2))

_BOTH = (
    Group(
        "depth_is_along_z_and_upright",
        "depth along the optical axis, in the rows and columns of the photo",
        "z",
        "of log z",
        (
            KnownMistake("transposed", _transposed, _TURNED),
            KnownMistake("mirrored", flipped(1), _TURNED),
            KnownMistake("upside down", flipped(0), _TURNED),
            KnownMistake("of the middle square, stretched", _of_middle_square, _ASPECT),
            KnownMistake(
                "disparity", lambda z, _: 1 / z, "Is it disparity, 1 / z?", shows_when_blind=True
            ),
            KnownMistake("along the ray of each pixel", _along_rays, _RAYS),
            KnownMistake(
                "a mean with the mirrored photo", lambda z, _: (z + z[:, ::-1]) / 2, _FLIPPED
            ),
        ),
        _fitted_log_depths,
    ),
    Group(
        "depth_is_not_shifted",
        "edges in place",
        "z",
        "of log z",
        (
            KnownMistake("to the right", shifted(1), _RESIZED, 1, " px", 0.5),
            KnownMistake("down", shifted(0), _RESIZED, 1, " px", 0.5),
        ),
        _edge_slopes,
        after=_UPRIGHT,
    ),
    Group(
        "intrinsics_are_not_biased",
        "the camera of the photo, in px of the photo",
        "camera",
        "px or %",
        (
            KnownMistake("right of the center", plus(0.5, 0, 0, 0), _CENTRES, 0.5, " px", 0.3),
            KnownMistake("below the center", plus(0, 0.5, 0, 0), _CENTRES, 0.5, " px", 0.3),
            KnownMistake("fx over fy", plus(0, 0, 25, 0), _ASPECT, 25, " %", 2),
            KnownMistake("too long a focal length", plus(0, 0, 0, 70), _INPUT, 70, " %", 30),
        ),
        rough=150,
    ),
)
_CHECKS_OF_BOTH = (
    Check(check_depth_is_where_it_can_be_known, unless=BLIND),
    Check(check_unknown_names_the_ambiguity, after=_UPRIGHT, unless=BLIND),
    Check(check_states_what_it_promises),
)

METRIC_DEPTH = Table(
    _values,
    _metric_errors,
    (
        WITHOUT_HINTS,
        *_CHECKS_OF_BOTH,
        Check(check_stated_errors_hold, after=("depth_is_in_metres",), unless=BLIND),
        COLOURS,
    ),
    (
        *_BOTH,
        Group(
            "depth_is_in_metres",
            "meters",
            "z",
            "of log(depth / true depth)",
            (KnownMistake("too large", times(np.e), _UNIT, 1, " of the logarithm", _LARGE),),
            _scale,
            rough=float(np.log(3)),
        ),
        Group(
            "depth_does_not_depend_on_the_focal_length",
            "a scale that does not depend on the camera",
            "z",
            "of log(depth / true depth)",
            (
                KnownMistake(
                    "times the focal length",
                    lambda z, truth: z * truth["case"].intrinsics.fx,
                    _FOCAL,
                    1,
                    "",
                    0.5,
                ),
            ),
            _scale,
            centred=True,
            after=("depth_is_in_metres",),
        ),
    ),
)

RELATIVE_POINTMAP = Table(
    _values,
    _aligned_errors,
    (
        *_CHECKS_OF_BOTH,
        _WITHOUT_INTRINSICS,
        replace(WITHOUT_HINTS, after=("works_without_intrinsics",)),
        Check(check_accepts_the_photo_with_people, after=("points_lie_on_the_rays_of_the_camera",)),
        Check(check_stated_errors_hold, unless=BLIND),
        Check(check_up_is_mirrored_in_a_mirrored_photo, unless=BLIND),
        COLOURS,
    ),
    (
        *_BOTH,
        Group(
            "points_lie_on_the_rays_of_the_camera",
            "points that project to their pixels' centers by the given camera (x right, y down)",
            "pixels",
            "px",
            (
                KnownMistake("with x to the left", times(-1, 1), _OPENGL),
                KnownMistake("with y upwards", times(1, -1), _OPENGL),
                KnownMistake("of the aspect ratio of a square", _of_a_square, _ASPECT),
                KnownMistake("to the right", plus(1, 0), _CENTRES, 1, " px", 0.25),
                KnownMistake("down", plus(0, 1), _CENTRES, 1, " px", 0.25),
                KnownMistake("farther out", times(1.01), _GIVEN, 1, " %", 0.6),
            ),
        ),
    ),
)
