"""How outputs of MetricDepth and RelativePointmap are compared: z, its scale, the rays of the
points, the camera.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from physic_core.types import AffineAmbiguity
from physic_testing.conformance.changes import CHANGES
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import HINT_CHECKS, check_works_without_hints
from physic_testing.conformance.readings import Group, Reading, Table, between, changed, values_of
from physic_testing.conformance.requests import infer_arguments

if TYPE_CHECKING:
    from physic_core.types import BoolArray, DepthMap, FloatArray, Intrinsics, Pointmap
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.changes import Change
    from physic_testing.conformance.readings import Make, Values

MIN_COVERAGE = 0.3
"""Minimum share of pixels with known depth."""

MAX_SKY = 0.5
"""Share of the sky that may have a depth: its border does, in networks."""

MAX_SIGMA = 1.5
"""Standard deviation of log(scale) that no estimate of depth needs: a factor of 4.5."""

EXPLAINED = {"metric_depth": 0.05, "relative_pointmap": 0.4}
"""Share of the error that is left after a fit of another ambiguity; a metric depth has other errors
of the kind.
"""

MIN_LEVELS = 300
"""Different depths below which a depth map is of 8 bits."""

MAX_REPEATED = 0.2
"""Share of rows or columns of a depth map that may repeat the one before, beyond those of the
truth.
"""

_SAME = 0.98  # share of the pixels of a row that repeats another
_ROUNDS = 8
_FITTED = 2000
_COMPARED = 20000
_BLUR_PX = 1.2
# of the mean square residual; a true shift is off by 1e-5 of itself where depths vary by a tenth
_SHIFT_PENALTY = 1e-3
_BORDER_PX = 3
_IN_FRONT = 0.1  # log of the depth behind a person over the person's
MIN_POINTS = 64


def aligned_depth_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Return the median relative depth error after a robust fit of the unknown scale and shift; NaN
    without pixels.
    """
    both = _both(z, truth)
    return (
        float(np.median(_fit(z[both], truth[both], unknown)[1]))
        if both.sum() >= 16
        else float("nan")
    )


def _both(z: FloatArray, truth: FloatArray) -> BoolArray:
    both: BoolArray = np.isfinite(z) & np.isfinite(truth) & (np.nan_to_num(z) > 0) & (truth > 0)
    return both


def _fit(
    own: FloatArray, true: FloatArray, unknown: AffineAmbiguity
) -> tuple[FloatArray, FloatArray]:
    """Fit the unknown scale and shift of depths (M,) robustly; return fitted over true depth, and
    the residual.
    """
    own = own.astype(np.float64)
    true = true.astype(np.float64)
    # Each row: fitted depth / true depth = 1, in the space in which the unknowns are linear.
    columns: dict[str, list[FloatArray]] = {
        "scale": [own / true],
        "scale_shift": [own / true, 1 / true],
        "inverse_scale_shift": [true / own, true],
    }
    every = np.stack(columns[unknown], axis=1)
    design = every[:: max(1, len(own) // _FITTED)]
    weight: FloatArray = np.ones(len(design))
    found: FloatArray = np.zeros(every.shape[1])
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0]
        residual = np.abs(design @ found - 1)
        weight = 1 / np.sqrt(1 + (residual / (2 * np.median(residual) + 1e-9)) ** 2)
    fitted = every @ found
    residual = np.abs(fitted - 1)
    return 1 / np.maximum(fitted, 1e-3) if unknown == "inverse_scale_shift" else fitted, residual


# ---- values
# --------------------------------------------------------------------------------------------------


def _depth_values(answer: DepthMap, case: Case, truth: Values) -> Values:
    return {
        "z": _finite(answer.depth),
        "unknown": "scale",
        "camera": _camera_values(answer.intrinsics, case),
    }


def _true_depth(answer: DepthMap, case: Case) -> Values:
    z = _finite(case.truth.empty_depth)
    return {"z": z, "unknown": "scale", "camera": _camera_values(case.intrinsics, case)}


def _finite(z: FloatArray) -> FloatArray:
    known: FloatArray = np.where(np.isfinite(z) & (np.nan_to_num(z) > 0), z, np.nan).astype(
        np.float64
    )
    return known


def _points_values(answer: Pointmap, case: Case, truth: Values) -> Values:
    z = np.where(answer.valid, _finite(answer.points[..., 2]), np.nan)
    values = {"z": z, "unknown": answer.unknown, "camera": _camera_values(answer.intrinsics, case)}
    rows, columns = np.nonzero(np.isfinite(z))
    uv = np.full((*z.shape, 2), np.nan)
    camera = case.intrinsics
    if len(rows) >= MIN_POINTS:
        points = answer.points[rows, columns].astype(np.float64)
        shift = (
            _unknown_shift(columns - camera.cx, rows - camera.cy, points)
            if answer.unknown == "scale_shift"
            else 0.0
        )
        with np.errstate(all="ignore"):
            uv[rows, columns] = points[:, :2] / (points[:, 2:] + shift) * [camera.fx, camera.fy] + [
                camera.cx,
                camera.cy,
            ]
    return values | {"uv": uv}


def _unknown_shift(u: FloatArray, v: FloatArray, points: FloatArray) -> float:
    """Return the offset of z with which points (M, 3) lie on rays through their pixels, of whatever
    focal length.

    A small penalty makes it 0 where all depths are the same and any shift would fit.
    """
    unit = float(np.median(points[:, 2]))
    x, y, z = (points / unit).T
    reach = float(max(np.abs(u).max(), np.abs(v).max()))
    a = u / reach
    b = v / reach
    zero = np.zeros_like(z)
    rows = [[a * z, zero, z, zero, a, zero], [zero, b * z, zero, z, zero, b]]
    design = np.concatenate([np.stack(row, axis=1) for row in rows])
    penalty = _SHIFT_PENALTY * np.sqrt(len(z)) * np.eye(6)[4:]
    target = np.concatenate([x, y, np.zeros(2)])
    slope, other, _, _, right, down = np.linalg.lstsq(
        np.vstack([design, penalty]), target, rcond=None
    )[0]
    return unit * float((right * slope + down * other) / max(slope**2 + other**2, 1e-12))


def _true_points(answer: Pointmap, case: Case) -> Values:
    height, width = case.photo.shape[:2]
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    z = _finite(case.truth.empty_depth)
    uv = np.where(np.isfinite(z)[..., None], grid, np.nan)
    return {
        "z": z,
        "uv": uv,
        "unknown": answer.unknown,
        "camera": _camera_values(case.intrinsics, case),
    }


def _camera_values(camera: Intrinsics | None, case: Case) -> FloatArray:
    """Return cx, cy, 100 log(fx / fy), 100 log(focal length), NaN without a camera."""
    if camera is None or min(camera.fx, camera.fy) <= 0:
        return np.full(4, np.nan)
    focal = 50 * np.log(camera.fx * camera.fy)
    return np.array([camera.cx, camera.cy, 100 * np.log(camera.fx / camera.fy), focal])


def _act(values: Values, change: Change, case: Case) -> Values:
    camera = np.array(values["camera"])
    nothing = np.full(4, np.nan)
    centre = change.of_pixels(camera[:2])
    factor = 100 * np.log(change.camera.fx / case.intrinsics.fx)
    is_same_lens = change.name in CHANGES[:2]
    camera = np.array([*centre, camera[2], camera[3] + factor]) if is_same_lens else nothing
    # Along the new axis, the depth of a pixel is another one.
    along = rays_of(case.intrinsics) @ change.axes[2]
    moved = values | {
        "z": change.of_picture(np.where(along > 0.1, values["z"] * along, np.nan)),
        "camera": camera,
    }
    if "uv" in values:
        moved["uv"] = change.of_pixels(change.of_picture(values["uv"]))
    return moved


# ---- groups
# --------------------------------------------------------------------------------------------------


def _logs(values: Values, truth: Values, step: int = 1) -> FloatArray:
    """Return log z of every step-th pixel after a fit of what the output leaves open, NaN where
    unknown.
    """
    own, true = (side["z"][::step, ::step] for side in (values, truth))
    logs = np.full(true.shape, np.nan)
    both = _both(own, true)
    if both.sum() >= MIN_POINTS:
        logs[both] = np.log(
            np.maximum(_fit(own[both], true[both], truth["unknown"])[0], 1e-3) * true[both]
        )
    return logs


def _shape(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return [_logs(values, truth, max(1, round((truth["z"].size / _COMPARED) ** 0.5))).ravel()]


def _edges(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the slopes of log z outside of the hole; errors of low frequency leave them as they
    are.
    """
    import cv2

    logs = np.where(case.hole, np.nan, _logs(values, truth))
    known = np.isfinite(logs).astype(np.float64)
    weight = cv2.GaussianBlur(known, (0, 0), _BLUR_PX)
    smooth = cv2.GaussianBlur(np.nan_to_num(logs), (0, 0), _BLUR_PX) / np.maximum(weight, 1e-6)
    inner = cv2.erode(known, np.ones((5, 5), np.uint8), borderValue=0) > 0
    smooth = np.where(inner, smooth, np.nan)
    return [np.concatenate([np.diff(smooth, axis=axis)[::2, ::2].ravel() for axis in (0, 1)])]


def _scale(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    both = _both(values["z"], truth["z"])
    found = np.median(np.log(values["z"][both] / truth["z"][both])) if both.any() else np.nan
    return [np.array([found])]


def _camera(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return [values["camera"]]


def _rays(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    step = max(1, truth["z"].size // _COMPARED)
    return [values["uv"].reshape(-1, 2)[::step].ravel()]


def _warped(z: FloatArray, matrix: FloatArray) -> FloatArray:
    import cv2

    size = (z.shape[1], z.shape[0])
    warped = cv2.warpAffine(z.astype(np.float32), matrix, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped, np.float64)


def _shifted(right: float, down: float) -> Make:
    return changed(z=lambda z: _warped(z, np.array([[1.0, 0, right], [0, 1, down]])))


def _stretched(axis: int, sign: int) -> Make:
    """Return z that was resized by the corners of the picture: right in the middle, half a pixel
    off at the borders.
    """

    def stretched(z: FloatArray) -> FloatArray:
        size = z.shape[1 - axis]
        matrix = np.column_stack([np.eye(2), np.zeros(2)])
        matrix[axis, axis], matrix[axis, 2] = 1 + sign / size, -sign * (size - 1) / 2 / size
        return _warped(z, matrix)

    return changed(z=stretched)


def rays_of(camera: Intrinsics) -> FloatArray:
    """Return the rays (H, W, 3) of the pixels with a depth of 1."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)]
    return np.stack(rays, axis=-1)


def _transposed(z: FloatArray) -> FloatArray:
    rows, columns = (
        (np.arange(n) + 0.5) * m // n for n, m in zip(z.shape, z.shape[::-1], strict=True)
    )
    taken: FloatArray = z.T[np.ix_(rows.astype(int), columns.astype(int))]
    return taken


_TURNED = (
    "Is the shape (H, W), and is the output turned back as the photo was turned for the network?"
)
_RAYS = "Divide by sqrt(1 + ((u - cx) / fx)^2 + ((v - cy) / fy)^2)."
_RESIZED = (
    "Is the padding of the network's input subtracted, and the output resized by pixel centres?"
)
_FLIPPED = "Mirror the output for the mirrored photo back before you average."
_FOCAL = (
    "Is the depth of a network for one focal length rescaled to the focal length of the "
    "photo, once?"
)
_UNIT = "Is it a unit, or a factor that the network's authors state?"
_OPENGL = "Multiply points of an OpenGL camera (x right, y up, z back) by (1, -1, -1)."
_CENTRES = "Use u = 0, 1, ... W - 1, not u + 0.5, and (W - 1) / 2 for a centred principal point."
_GIVEN = "Use hints.intrinsics if they are given."
_ASPECT = "Was the photo resized to another aspect ratio?"
_INPUT = "Is it in px of the network's input, or of another camera?"


def _along_rays(values: Values, case: Case) -> Values:
    return values | {"z": values["z"] * np.linalg.norm(rays_of(case.intrinsics), axis=2)}


def _times_focal(per: Callable[[Intrinsics], float]) -> Make:
    return lambda values, case: (
        values | {"z": values["z"] * case.intrinsics.fx / per(case.intrinsics)}
    )


def _other_camera(part: int, by: float) -> Make:
    return changed(camera=lambda camera: camera + by * np.eye(4)[part])


def _of_rays(change: Callable[[FloatArray, Intrinsics], FloatArray | list[float]]) -> Make:
    """Return pixels of which those from the principal point are multiplied."""

    def make(values: Values, case: Case) -> Values:
        centre = np.array([case.intrinsics.cx, case.intrinsics.cy])
        beside = values["uv"] - centre
        return values | {"uv": centre + beside * change(beside, case.intrinsics)}

    return make


def _square(beside: FloatArray, camera: Intrinsics) -> FloatArray:
    return np.array([camera.width, camera.height]) / max(camera.width, camera.height)


def _distortion(beside: FloatArray, camera: Intrinsics) -> FloatArray:
    return np.asarray(
        1 + 0.05 * ((beside / [camera.fx, camera.fy]) ** 2).sum(axis=-1, keepdims=True)
    )


_SHAPE = (
    Reading("transposed", changed(z=_transposed), _TURNED),
    Reading("mirrored", changed(z=lambda z: z[:, ::-1]), _TURNED),
    Reading("upside down", changed(z=lambda z: z[::-1]), _TURNED),
    Reading("turned by 180 degrees", changed(z=lambda z: z[::-1, ::-1]), _TURNED),
    Reading("disparity", changed(z=lambda z: 1 / z), "Is it disparity, 1 / z?"),
    Reading("along the ray of each pixel", _along_rays, _RAYS),
    Reading("a mean with the mirrored photo", changed(z=lambda z: (z + z[:, ::-1]) / 2), _FLIPPED),
)
_PLACE = (
    Reading(
        "to the right", between("z", _shifted(1, 0), _shifted(-1, 0)), _RESIZED, 1.0, " px", 0.5
    ),
    Reading("down", between("z", _shifted(0, 1), _shifted(0, -1)), _RESIZED, 1.0, " px", 0.5),
    Reading(
        "wider at the borders",
        between("z", _stretched(0, 1), _stretched(0, -1)),
        _RESIZED,
        0.5,
        " px",
        0.25,
    ),
    Reading(
        "higher at the borders",
        between("z", _stretched(1, 1), _stretched(1, -1)),
        _RESIZED,
        0.5,
        " px",
        0.25,
    ),
)
_LARGE = float(np.log(1.2))
_METRES = (
    Reading("centimetres", changed(z=lambda z: 100 * z), "Is it centimetres?", in_pairs=False),
    Reading("millimetres", changed(z=lambda z: 1000 * z), "Is it millimetres?", in_pairs=False),
    Reading(
        "too large",
        changed(z=lambda z: z * np.e),
        _UNIT,
        1.0,
        " of the logarithm",
        _LARGE,
        in_pairs=False,
    ),
)
_FOCALS = {
    "px": lambda camera: 1.0,
    "widths of the photo": lambda camera: camera.width,
    "larger sides of the photo": lambda camera: max(camera.width, camera.height),
}
_LENS = tuple(
    Reading(f"times the focal length in {unit}", _times_focal(per), _FOCAL, 1.0, "", 0.5)
    for unit, per in _FOCALS.items()
)
_CAMERA = (
    Reading("right of the centre", _other_camera(0, 0.5), _CENTRES, 0.5, " px", 0.3),
    Reading("below the centre", _other_camera(1, 0.5), _CENTRES, 0.5, " px", 0.3),
    Reading("fx over fy", _other_camera(2, 25.0), _ASPECT, 25.0, " %", 2.0),
    Reading("too long a focal length", _other_camera(3, 70.0), _INPUT, 70.0, " %", 30.0),
)
_RAY = (
    Reading("with x to the left", _of_rays(lambda *_: [-1.0, 1.0]), _OPENGL),
    Reading("with y upwards", _of_rays(lambda *_: [1.0, -1.0]), _OPENGL),
    Reading("of the aspect ratio of a square", _of_rays(_square), _ASPECT),
    Reading(
        "to the right", changed(uv=lambda uv: uv + np.array([1.0, 0])), _CENTRES, 1.0, " px", 0.25
    ),
    Reading("down", changed(uv=lambda uv: uv + np.array([0, 1.0])), _CENTRES, 1.0, " px", 0.25),
    Reading("farther out along x", _of_rays(lambda *_: [1.01, 1.0]), _GIVEN, 1.0, " %", 0.6),
    Reading("farther out along y", _of_rays(lambda *_: [1.0, 1.01]), _GIVEN, 1.0, " %", 0.6),
    Reading(
        "distorted as by a lens of k1",
        _of_rays(_distortion),
        "Is the lens distortion undone?",
        0.05,
        "",
        0.025,
    ),
)
_UPRIGHT = ("depth_is_along_z_and_upright",)
_FITS = ("intrinsics_fit_the_photo",)
_OF_SCALE = "of log(depth / true depth)"
_OF_Z = "of log z"
_BOTH = (
    Group(
        _UPRIGHT[0],
        "depth along the optical axis, in the rows and columns of the photo",
        _OF_Z,
        _shape,
        _SHAPE,
    ),
    Group("depth_is_not_shifted", "edges of depth in place", _OF_Z, _edges, _PLACE, after=_UPRIGHT),
    Group(
        "intrinsics_are_not_biased",
        "the camera of the photo",
        "px or %",
        _camera,
        _CAMERA,
        after=_FITS,
    ),
)
_SCALE = Group("depth_is_in_metres", "metres", _OF_SCALE, _scale, _METRES, rough=float(np.log(3)))
_CAMERA_SCALE = Group(
    "depth_does_not_depend_on_the_focal_length",
    "a scale that does not depend on the camera",
    _OF_SCALE,
    _scale,
    _LENS,
    centred=True,
    after=("depth_is_in_metres",),
)
_ON_RAYS = Group(
    "points_lie_on_the_rays_of_the_camera",
    "points that project to the centres of their pixels by the given camera (x right, y down)",
    "px",
    _rays,
    _RAY,
)
DEPTH = Table(
    _depth_values,
    _true_depth,
    _act,
    (_SCALE, _CAMERA_SCALE, *_BOTH),
    "physic_core.types.DepthMap",
    lambda values, truth: (np.log(values["z"]), np.log(truth["z"]), 2e-5),
    CHANGES,
)
POINTS = Table(
    _points_values,
    _true_points,
    _act,
    (*_BOTH, _ON_RAYS),
    "physic_core.types.Pointmap",
    lambda values, truth: (_logs(values, truth), np.log(truth["z"]), 1e-4),
    CHANGES,
)


# ---- further checks
# --------------------------------------------------------------------------------------------------


def _table(subject: BackendUnderTest) -> Table:
    return DEPTH if subject.interface == "metric_depth" else POINTS


def check_depth_is_where_it_can_be_known(subject: BackendUnderTest) -> None:
    """At least 30 % of the pixels have a depth of their own, and depths are finer than 8 bits."""
    for case, values, truth in values_of(subject, _table(subject)):
        known = float(np.isfinite(values["z"]).mean())
        expect(known >= MIN_COVERAGE, "known depth in at least 30 % of the pixels", f"{known:.0%}")
        levels, true = (len(np.unique(z[_both(z, truth["z"])])) for z in (values["z"], truth["z"]))
        expect(
            not 2 < levels < MIN_LEVELS < true / 10,
            "depths of more than 8 bits",
            f"{levels} different ones in the photo '{case.name}'",
            "Is it an image of 8 bit?",
        )
        repeated = _repeated(values["z"])
        expect(
            repeated < MAX_REPEATED + _repeated(truth["z"]),
            "a depth for each pixel",
            f"{repeated:.0%} of the rows or columns as the one before in the photo '{case.name}'",
            "Is the output of a smaller grid repeated? Resize it by interpolation.",
        )


def _repeated(z: FloatArray) -> float:
    """Return which share of rows or of columns, the larger, repeats the one before, to the
    precision of 16 bits.
    """
    shares = []
    for lines in (z.astype(np.float16), z.T.astype(np.float16)):
        known = np.isfinite(lines[1:]) & np.isfinite(lines[:-1])
        same = (known & (lines[1:] == lines[:-1])).sum(axis=1) > _SAME * known.sum(axis=1)
        # a clipped depth does not
        varies = np.nanmax(lines[1:], axis=1) > np.nanmin(lines[1:], axis=1)
        shares.append(float((same & varies).mean()))
    return max(shares)


def check_sky_has_no_depth(subject: BackendUnderTest) -> None:
    """Most of the sky has no depth: it is infinitely far."""
    for case, values, truth in values_of(subject, _table(subject)):
        known = np.isfinite(values["z"])
        sky = _inside(~np.isfinite(truth["z"]))
        if sky.sum() >= MIN_POINTS:
            share = float(known[sky].mean())
            far = float(np.median(values["z"][known & sky])) if known[sky].any() else 0.0
            expect(
                share < MAX_SKY,
                "no depth in the sky, which is infinitely far",
                f"{share:.0%} of the sky in the photo '{case.name}' has one, of {far:.3g} in the "
                f"median",
                "Is what the network says of the sky, or its largest depth, used for NaN or "
                "`valid`?",
            )


def _inside(mask: BoolArray) -> BoolArray:
    import cv2

    brush = np.ones((2 * _BORDER_PX + 1,) * 2, np.uint8)
    inner: BoolArray = cv2.erode(mask.astype(np.uint8), brush, borderValue=1) > 0
    return inner


def check_unknown_names_the_ambiguity(subject: BackendUnderTest) -> None:
    """No other scale and shift than the stated one explains nearly all of the error of depth."""
    table = _table(subject)
    stated = values_of(subject, table)[0][2]["unknown"]
    errors = {
        kind: [aligned_depth_error(v["z"], t["z"], kind) for _, v, t in values_of(subject, table)]
        for kind in get_args(AffineAmbiguity)
    }
    for kind, found in errors.items():
        left = np.array(found)
        own = np.array(errors[stated])
        differ = np.abs(own - left) > 1e-4
        if kind != stated and differ.sum() > 2:
            share = float(np.median((left / own)[differ]))
            expect(
                share > EXPLAINED[subject.interface],
                f"agreement with the truth after a fit of {stated!r}",
                f"an error of which {share:.1%} is left after a fit of {kind!r}",
                f"Return unknown={kind!r}, or remove the offset.",
            )


def check_intrinsics_fit_the_photo(subject: BackendUnderTest) -> None:
    """Returned intrinsics are in pixels of the photo: plausible focal length, principal point
    inside.
    """
    camera = subject.result().intrinsics
    truth = subject.case("one person").intrinsics
    if camera is None:
        raise CheckSkipped("it returns no intrinsics")
    low = truth.fx / 4
    high = 4 * truth.fx
    expect(
        low < camera.fx < high and low < camera.fy < high,
        f"a focal length in px, within a factor 4 of the true {truth.fx:.0f} px",
        f"{camera.fx:.4g} and {camera.fy:.4g}",
        "Is it a share of the width, in mm, or an angle?",
    )
    inside = 0 < camera.cx < truth.width and 0 < camera.cy < truth.height
    expect(inside, "a principal point inside the photo, px", f"({camera.cx:.4g}, {camera.cy:.4g})")


def check_returns_intrinsics_as_promised(subject: BackendUnderTest) -> None:
    """A backend with the capability 'returns_intrinsics' returns intrinsics."""
    is_there = subject.result().intrinsics is not None
    expect(is_there, "intrinsics, as its capability 'returns_intrinsics' declares", "None")


def check_scale_sigma_is_a_standard_deviation(subject: BackendUnderTest) -> None:
    """`scale_sigma` is None or a plausible standard deviation of log(scale)."""
    sigma = subject.result().scale_sigma
    if sigma is None:
        raise CheckSkipped("it returns no scale_sigma")
    expect(
        0 < float(sigma) < MAX_SIGMA,
        f"a standard deviation of log(scale) above 0 and below {MAX_SIGMA}: 0.1 is ten percent; "
        f"or None",
        f"{sigma!r}",
        "Is it in percent, or in metres?",
    )


def check_works_without_intrinsics(subject: BackendUnderTest) -> None:
    """Without `hints.intrinsics`, the output is valid: the camera of most photos is unknown."""
    subject.result()
    case = subject.case("one person")
    image, hints = infer_arguments(subject.interface, case)
    given = replace(hints, intrinsics=None)
    subject.call("valid output for a photo without known intrinsics", case, (image, given))


def check_accepts_the_photo_with_people(subject: BackendUnderTest) -> None:
    """For the photo with people and with `hints.scene`, as in the pipeline's second call, the
    output is valid.

    The people are in it, and the points beside them lie on their rays.
    """
    subject.result()
    case = subject.case("one person")
    _, hints = infer_arguments(subject.interface, case)
    given = replace(hints, hole=None, photo=None, scene=case.scene)
    wanted = "valid output for the photo with people, with hints.scene, and hints.hole None"
    answer = subject.call(wanted, case, (case.photo.copy(), given))
    values = _points_values(answer, case, {})
    z = values["z"]
    grid = _true_points(answer, case)["uv"]
    outside = np.isfinite(z) & ~case.hole & np.isfinite(grid[..., 0])
    if outside.sum() >= MIN_POINTS:
        for axis, name in enumerate("xy"):
            slope, offset = np.polyfit(
                grid[outside][:, axis], values["uv"][outside][:, axis] - grid[outside][:, axis], 1
            )
            centre = offset + slope * (case.intrinsics.cx, case.intrinsics.cy)[axis]
            expect(
                abs(slope) < 0.03 and abs(centre) < 1,
                f"points of the photo with people on the rays of the given camera along {name} (x "
                f"right, y down)",
                f"{1 + slope:.3f} times as far out, and {centre:+.2f} px off",
                "Is the second call, with hints.scene, handled like the first?",
            )
    if not BLIND & subject.capabilities:
        _expect_people(case, z)


def _expect_people(case: Case, z: FloatArray) -> None:
    """Raise CheckFailed if depths (H, W) of the photo with people are those of the scene without
    them.
    """
    with np.errstate(all="ignore"):
        people, scene = (np.log(z / depth) for depth in (case.truth.depth, case.truth.empty_depth))
    known = np.isfinite(people) & np.isfinite(scene)
    inside = known & case.truth.masks.any(axis=0) & (np.abs(people - scene) > _IN_FRONT)
    outside = known & ~case.hole
    if min(inside.sum(), outside.sum()) < MIN_POINTS:
        return
    errors = [
        float(np.median(np.abs(logs[inside] - np.median(logs[outside]))))
        for logs in (people, scene)
    ]
    expect(
        errors[1] > 0.25 * errors[0],
        "people in the points of the photo with people",
        f"depths {errors[1]:.0%} from those of the scene behind them, and {errors[0]:.0%} from "
        f"theirs",
        "Is it the result of the first call, or of hints.scene?",
    )


_CALLED = frozenset({"returns_intrinsics"})


def _both_checks(read: str) -> tuple[Check, ...]:
    return (
        Check(check_depth_is_where_it_can_be_known, read, unless=BLIND),
        Check(check_sky_has_no_depth, read, unless=BLIND, warns=True),
        Check(check_unknown_names_the_ambiguity, read, after=_UPRIGHT, unless=BLIND),
        Check(check_intrinsics_fit_the_photo, read),
        Check(check_returns_intrinsics_as_promised, read, only_with=_CALLED),
    )


DEPTH_CHECKS: tuple[Check, ...] = (
    *HINT_CHECKS,
    *_both_checks(DEPTH.read),
    Check(check_scale_sigma_is_a_standard_deviation, DEPTH.read),
)
"""Further checks of a MetricDepth."""

POINTS_CHECKS: tuple[Check, ...] = (
    *_both_checks(POINTS.read),
    Check(check_works_without_intrinsics, "physic_core.types.Hints"),
    Check(
        check_works_without_hints, "physic_core.types.Hints", after=("works_without_intrinsics",)
    ),
    Check(
        check_accepts_the_photo_with_people,
        "physic_core.interfaces.RelativePointmap",
        after=("points_lie_on_the_rays_of_the_camera",),
    ),
)
"""Further checks of a RelativePointmap."""
