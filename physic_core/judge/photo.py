"""Self-checks of the photo: background, floor, scale and given camera.

Each failure is a warning, and makes it doubtful.

"Photos" below are of all kinds, run with the embedded backends; "worlds" are those of the mocks.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.depth_comparison import LIKELY, STRANGER, compare_depth
from physic_core.judge.spec import SIDE_VIEW, YES, check
from physic_core.types.contacts import has_sole_on_floor
from physic_core.types.observations import LEAST_PROBABILITY
from physic_core.types.results import main_people

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates
    from physic_core.judge.spec import Measured
    from physic_core.types import BoolArray, FloatArray, Reconstruction, UInt8Array

NO_FLOOR = "no floor was detected"
_WHY_NO_FLOOR = {
    "no_pixels": "too few pixels may show it",
    "no_consensus": "no horizontal plane fits enough pixels",
}
_NO_PEOPLE = "no person was detected"
_OTHER_INPAINTER = "Try --set inpainter.backend=telea"
_FLOOR_LINE = (
    f"compare the line of the floor in {SIDE_VIEW} with the photo. If the floor is wrong, do not "
    "use heights over it, leans and contacts with it"
)
_LEAST_AGREEMENT = 0.5
_MOST_SCALE_SIGMA = 0.15
_COVERED_SHARE = 0.5  # of a box that holds parts of a person who has a body
_MOST_PITCH_DEG = 15.0  # of a camera that looks up and shows the floor

_check = partial(check, "photo", warns=True)


@_check(
    "Background depth with and without people agrees",
    at_least=_LEAST_AGREEMENT,
    share_of="the background",
    unmeasured=_NO_PEOPLE,
)
def photo_alignment(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the share of the background where the point maps with and without people agree."""
    if "placement" not in result.diagnostics:
        return None
    share = result.diagnostics["placement"]["alignment"]["inlier_share"]
    if share == 0:
        return (
            share,
            "depths with and without people agree nowhere in the background. So only "
            "body size determines people's distance, and gaps to the scene are wrong. "
            f"{_OTHER_INPAINTER}",
        )
    return share, (
        f"depths with and without people agree on only {share:.0%} of the background "
        f"(at least {_LEAST_AGREEMENT:.0%}), so gaps between people and scene may be wrong. "
        f"{_OTHER_INPAINTER}"
    )


# Without the segmenter's floor pixels, half of the floors in photos are walls, tables or wrong by
# 10 degrees.
@_check("Floor where the photo shows floor", at_least=1, unit=YES)
def floor(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return whether a floor is found where the segmenter labels floor."""
    report = result.diagnostics["scene"]["floor"]
    reason = report["reason"]
    in_mask = report["in_mask"]
    if reason == "switched_off":
        return None, "the engine settings disable the floor search"
    if reason != "found":
        advice = (
            "Contacts of feet come from the look of the photo alone"
            if any(has_sole_on_floor(person.contacts) for person in result.people)
            else "Use a photo that shows the ground at the feet"
        )
        return 0.0, (
            f"{NO_FLOOR}: {_WHY_NO_FLOOR.get(reason, reason)}. So no one is placed on the ground, "
            "heights over it are unknown, and depth may be off by a constant: do not use heights "
            f"and gaps. {advice}; --stature METERS makes at least sizes right"
        )
    plane = result.scene.floor
    pitch = 0.0 if plane is None else math.degrees(math.asin(float(plane.normal[2])))
    if pitch > _MOST_PITCH_DEG:
        return (
            0.0,
            f"above this floor the camera would look up by {pitch:.0f}° (limit "
            f"{_MOST_PITCH_DEG:.0f}°): {_FLOOR_LINE}",
        )
    if in_mask is None:
        return None, "no pixels of the photo look like floor"
    return float(in_mask), (
        "the floor is not where pixels look like floor, because another plane fits the people "
        f"better: {_FLOOR_LINE}"
    )


# 0 where people stand on one color; of 147 photos 0.51 and more.
@_check(
    "Visible floor texture",
    at_least=0.05,
    share_of="the floor's pixels",
    advice="the photo has one color where the floor was estimated, so the floor is a guess. Do not "
    "use heights and distances, or run a photo that shows the ground",
    contradicts=("place", "contact", "size"),
    optional=True,
)
def floor_shown(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the share of the floor's visible pixels that have texture, or that the segmenter
    labels as floor.

    A pixel has texture if its neighborhood varies by more than one of 255 levels. The mask counts
    if it has more of them, and the floor is the segmenter's.
    """
    plane = estimates.ground.search.plane
    if result.scene.floor is None or plane is None:
        return None
    from physic_core.geometry.tensors import exact_arrays

    (visible,) = exact_arrays(plane.inliers & ~estimates.photo.hole)
    if not visible.any():
        return None
    textured = float((_texture_strength(estimates.image)[visible] > 1).mean())
    mask = estimates.photo.people.floor
    if mask is None or not estimates.ground.search.in_mask:
        return textured
    return max(textured, float(mask[visible].mean()))


# Soles on a floor give 0.08, sizes of people 0.20 and more.
@_check(
    "Scale uncertain",
    at_most=_MOST_SCALE_SIGMA,
    unit="log",
    unmeasured="the backend of metric_depth does not estimate its scale error",
)
def scale_sigma(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the relative standard deviation of all lengths."""
    sigma = result.scene.scale_sigma
    if sigma is None:
        return None
    return sigma, (
        f"all lengths may be off by {sigma:.0%} (one standard deviation; limit "
        f"{_MOST_SCALE_SIGMA:.0%}). Give one that you know: --stature METERS, or --known-length "
        "X1,Y1,X2,Y2,METERS between two pixels"
    )


@_check(
    "Given depth contradicts people's sizes",
    at_most=3,
    unit="sigma",
    unmeasured="no depth was measured",
    contradicts=("place", "size"),
    optional=True,
)
def given_depth(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the difference between the scale of your depth and that of people's sizes, in
    standard deviations.
    """
    measured = estimates.ground.measured
    if measured is None:
        return None
    from physic_core.engine.sizes.evidence import likely_unit

    times = measured.depth_over_people
    return measured.sigmas, (
        f"with your depth, everything is {times:.3g} times as large as people's sizes suggest. The "
        f"depth was used: {likely_unit(times)} Set another unit with --depth-unit"
    )


@_check(
    "Metric depth contradicts people's sizes",
    at_most=3,
    unit="sigma",
    optional=True,
)
def depth_scale(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the difference between the scale of the metric depth and the scale of all other
    evidence, in standard deviations.
    """
    from physic_core.engine.sizes.evidence import (
        ScaleEvidence,
        combined_scale,
        is_inverse,
        likely_unit,
    )

    rows = estimates.ground.witnesses.get("scale", ())
    depth_row = next((row for row in rows if row["by"] == "metric depth"), None)
    others = combined_scale(
        [
            ScaleEvidence(row["log_ratio"], row["sigma"])
            for row in rows
            if row is not depth_row and row["right"] > LEAST_PROBABILITY
        ]
    )
    if depth_row is None or others is None:
        return None
    away = depth_row["log_ratio"] - others.log_scale
    times = math.exp(away)
    followed = (
        "was used together with them" if depth_row["right"] > LEAST_PROBABILITY else "was not used"
    )
    inverse = is_inverse(estimates.depth, estimates.photo.scene_map)
    question = "is it a disparity, 1 / depth?" if inverse else likely_unit(times)
    return abs(away) / math.hypot(depth_row["sigma"], others.sigma), (
        f"{estimates.depth_backend} makes everything {times:.4g} times as large as people and "
        f"floor suggest, and {followed}: {question}"
    )


# Of correct files 0.85 and more; where the answer is clear, the file is refused.
@_check(
    "Depth fits better if read otherwise",
    at_least=LIKELY,
    share_of="the error of the depth as it is read",
    contradicts=("place", "size"),
    optional=True,
)
def depth_order(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the error of the metric depth if read otherwise, as a share of its error as it is
    read.

    The best other reading counts: mirrored, moved, along the ray, and others. The point map says
    what is right.
    """
    photo = estimates.photo
    comparison = estimates.depth_comparison or compare_depth(
        estimates.depth.depth, (photo.scene_map,), result.intrinsics
    )
    if not comparison.best_reading:
        return None
    source = "that you gave" if estimates.depth_comparison else f"of {estimates.depth_backend}"
    return comparison.ratio, f"the depth {source} was used, but {comparison}"


@_check(
    "Given depth does not fit the photo",
    at_most=STRANGER,
    share_of="what a network sees, unexplained",
    contradicts=("place", "size"),
    optional=True,
    advice="your depth was used, but hardly fits the photo. If it shows another photo or crop, or "
    "is not depth, do not use places and sizes, and run again without it",
)
def depth_fits(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the share of a network's depth that your depth or point map does not explain."""
    return None if estimates.depth_comparison is None else estimates.depth_comparison.error


@_check(
    "Given camera axis far from the center",
    at_most=0.15,
    share_of="the photo's size",
    unmeasured="no camera was given",
    contradicts=("place",),
    optional=True,
)
def principal_point(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the distance of your principal point from the center, as a share of the photo's
    width or height.
    """
    camera = result.intrinsics
    if not camera.known:
        return None
    off_x = camera.cx - (camera.width - 1) / 2
    off_y = camera.cy - (camera.height - 1) / 2
    offset = max(abs(off_x) / camera.width, abs(off_y) / camera.height)
    return offset, (
        f"the principal point ({camera.cx:.0f}, {camera.cy:.0f}) is {offset:.0%} of the photo's "
        f"size away from its center ({camera.source}), which is normal only in a cropped photo. "
        "Check --intrinsics: a wrong one shifts everything to the side"
    )


# Straight edges are right to about a tenth; distances are off by the same share as the focal
# length.
@_check(
    "Given focal length differs from the estimates",
    at_most=0.2,
    unmeasured="no focal length was given, or no backend estimates one",
    contradicts=("place",),
    optional=True,
)
def focal_agreement(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the largest difference between a backend's focal length and yours, as a share."""
    camera = result.intrinsics
    if not camera.known:
        return None
    witnesses = [
        estimates.photo.scene_map.intrinsics,
        estimates.photo.photo_map.intrinsics,
        estimates.depth.intrinsics,
    ]
    used = math.sqrt(camera.fx * camera.fy)
    ratios = [
        math.sqrt(w.fx * w.fy) * camera.width / w.width / used for w in witnesses if w is not None
    ]
    if not ratios:
        return None
    ratio = max(ratios, key=relative_difference)
    return relative_difference(ratio), (
        f"a backend estimates a focal length of {ratio * used:.0f} px, but {used:.0f} px "
        f"({camera.source}) was used. Check it: a wrong one makes all distances wrong by the same "
        "factor"
    )


_BOX_ADVICE = "to try again, give --box X0,Y0,X1,Y1 once for each person to keep"


@_check("Large people without a body", at_most=0, unit="count")
def unposed_people(estimates: Estimates, result: Reconstruction) -> Measured:
    """Return the number of large boxes around people without a body.

    Boxes count if they are as large as main people's, and not of people with a body.
    """
    people = estimates.photo.people
    boxes: list[FloatArray] = list(people.boxes)
    posed: BoolArray = np.any(people.masks, axis=0)
    missing = [one for one in people.unposed if one.is_missing]
    lacking = [
        one.reason
        for one in missing
        if len(boxes) in main_people([*boxes, np.array(one.box)])
        and not _is_covered(one.box, posed)
    ]
    people_text = f"{len(lacking)} large {'person' if len(lacking) == 1 else 'people'}"
    # a reason that the segmenter can cure ends with what to do
    cures = dict.fromkeys(reason.partition(": ")[2] or _BOX_ADVICE for reason in lacking)
    return float(len(lacking)), (
        f"{people_text} {'has' if len(lacking) == 1 else 'have'} no body (dashed in preview.png): "
        f"{', or '.join(cures)}"
    )


def _is_covered(box: tuple[float, float, float, float], mask: BoolArray) -> bool:
    """Return whether a mask (H, W) has most pixels of a box, which then is of the person with the
    mask.
    """
    x0, y0, x1, y1 = (max(0, round(edge)) for edge in box)
    inside = mask[y0:y1, x0:x1]
    return inside.size > 0 and float(inside.mean()) > _COVERED_SHARE


def relative_difference(ratio: float) -> float:
    """Return the share by which the larger of two numbers exceeds the smaller, from their ratio."""
    return math.exp(abs(math.log(ratio))) - 1


def _texture_strength(image: UInt8Array) -> FloatArray:
    """Return the standard deviation (H, W) of brightness around each pixel, within 1 % of the
    longer side.
    """
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    width = max(3, round(0.01 * max(grey.shape)))
    mean = cv2.blur(grey, (width, width))
    square = cv2.blur(grey * grey, (width, width))
    texture: FloatArray = np.sqrt(np.maximum(square - mean * mean, 0))
    return texture
