"""Self-checks of a reconstruction: what is measured, its bound, and what to do if a check fails.

Of the photo (``person`` is None):

===============  =======  ======  ====================================================================================
name             bound    unit    what is measured
===============  =======  ======  ====================================================================================
scene_alignment  >= 0.5   share   of the pixels, on which point map and metric depth agree (stage 1, Eq. 1)
photo_alignment  >= 0.5   share   of the background on which the point maps of photo and inpainted photo agree
floor            >= 0.15  share   of the searched pixels that lie on the floor; 0 where none was found
floor_mask       >= 1     1: yes  whether the segmenter's floor pixels lie on a plane
scale_sigma      <= 0.15  log     standard deviation of log(scale), given with the metric depth
scale_change     <= 0.25  share   by which the joint optimisation rescaled the scene
ruler            <= 0.5   share   by which metric depth and sizes of people differ, median over people
focal_known      >= 1     1: yes  whether the photo or its file gives the focal length
principal_point  <= 0.15  share   of the photo's width or height, by which it differs from the photo's centre
focal_agreement  <= 0.2   share   by which backends' focal lengths differ from the used one, at most
===============  =======  ======  ====================================================================================

Of each person:

===============  =======  ======  ====================================================================================
name             bound    unit    what is measured
===============  =======  ======  ====================================================================================
answered         <= 0     count   backends that returned no finite values for this person
placed           >= 1     1: yes  whether keypoints and depth placed the body (stage 2)
optimised        >= 1     1: yes  whether the joint optimisation included this person (stage 3)
reprojection     <= 0.03  share   reprojection error relative to the body's height in the picture
visible          >= 0.4   share   of the camera-facing surface that is visible in the photo
legs_seen        >= 2     count   legs with a visible knee or ankle; the pose of an invisible leg is a guess
penetration      <= 0.1   share   of the visible surface that lies over 3 cm inside the scene or the floor
floating         <= 0.05  m       from the supporting vertices to the nearest surface or floor
lean             <= 12    deg     tilt of a person who stands, towards the camera or away from it
person_depth     <= 0.4   share   by which the depth at the person's pixels differs from their body's
depth_order      <= 0.1   share   of the vertices in front of a person who occludes them
===============  =======  ======  ====================================================================================

If there is nothing to measure, ``value`` is None and the check passes. Names, units and directions are stable; the
bounds of ``floor``, ``scene_alignment`` and ``photo_alignment`` follow the engine's settings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from physic_core.body.joints import joint_pair
from physic_core.body.posture import lean_deg, stands_straight
from physic_core.types import CheckResult

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution

__all__ = ["CHECKS", "CheckSpec", "check_warnings", "failed_checks", "run_checks"]


@dataclass(frozen=True)
class CheckSpec:
    """One self-check: what it measures, and its bound.

    Attributes:
        name: as in :class:`physic_core.types.CheckResult`.
        of: "photo" or "person".
        bound: whether the threshold is the least or the most that passes.
        threshold: the bound; a setting of the engine may replace it.
        unit: of threshold and value.
        meaning: of the value, one phrase for people.
        warns: whether a failed check is also a warning of the result.
    """

    name: str
    of: Literal["photo", "person"]
    bound: Literal["least", "most"]
    threshold: float
    unit: str
    meaning: str
    warns: bool


def _photo(name: str, bound: Literal["least", "most"], threshold: float, unit: str, meaning: str) -> CheckSpec:
    return CheckSpec(name, "photo", bound, threshold, unit, meaning, warns=True)


def _person(
    name: str, bound: Literal["least", "most"], threshold: float, unit: str, meaning: str, warns: bool = False
) -> CheckSpec:
    return CheckSpec(name, "person", bound, threshold, unit, meaning, warns)


_SHARE, _YES = "share", "1: yes"

# "Photos" below are of all kinds, run with the embedded backends; "worlds" are those of the mocks.
_ALL = (
    _photo("scene_alignment", "least", 0.5, _SHARE, "of the pixels, on which point map and metric depth agree"),
    _photo(
        "photo_alignment", "least", 0.5, _SHARE, "of the background that the photo and its inpainted picture agree on"
    ),
    _photo("floor", "least", 0.15, _SHARE, "of the searched pixels that lie on the floor"),
    _photo("floor_mask", "least", 1, _YES, "whether the floor that the segmenter sees is one"),
    # Soles on a floor give 0.08, sizes of people 0.20 and more.
    _photo("scale_sigma", "most", 0.15, "log", "standard deviation of log(scale) as the metric depth states it"),
    # Worlds whose depth is 10 % off need 0.13; photos 0.14 at most.
    _photo("scale_change", "most", 0.25, _SHARE, "by which the joint optimisation rescaled the scene"),
    # Networks estimate people farther than the floor under them: 0 to 0.4 in photos, 0.56 where the depth is wrong.
    _photo("ruler", "most", 0.5, _SHARE, "by which the metric depth and the sizes of the people differ"),
    _photo("focal_known", "least", 1, _YES, "whether the photo or its file tells the focal length"),
    _photo("principal_point", "most", 0.15, _SHARE, "of the photo's width or height, by which it lies off the centre"),
    # Straight edges are right to about a tenth; distances are off by the same share as the focal length.
    _photo("focal_agreement", "most", 0.2, _SHARE, "by which the backends' focal lengths differ from the one used"),
    _person("answered", "most", 0, "count", "backends that answered no numbers for this person", warns=True),
    _person("placed", "least", 1, _YES, "whether keypoints and depth placed the body", warns=True),
    _person("optimised", "least", 1, _YES, "whether the joint optimisation took this person along", warns=True),
    # Photos 0.004-0.012 where the body is right, 0.017 where most of it is hidden.
    _person("reprojection", "most", 0.03, _SHARE, "of the body's height, by which the keypoints miss the body"),
    # Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body is a guess.
    _person("visible", "least", 0.4, _SHARE, "of the surface turned to the camera that the photo shows"),
    _person("legs_seen", "least", 2, "count", "legs whose knee or ankle the photo shows"),
    # Photos 0.03 at most; a tenth is an entire limb.
    _person("penetration", "most", 0.1, _SHARE, "of the visible surface that lies over 3 cm inside the scene"),
    # 0 if the feet are visible; 5 cm are a visible gap.
    _person("floating", "most", 0.05, "m", "from what could carry the person to the nearest surface or floor"),
    # People who stand or walk: up to 4 in photos, 3 in worlds. Sideways tilt is visible in the photo and not checked.
    _person("lean", "most", 12, "deg", "tilt of a person who stands, towards the camera or away from it"),
    # Photos 0-0.32, worlds 0-0.02; 0.58 where the photo's point map was aligned wrongly.
    _person("person_depth", "most", 0.4, _SHARE, "by which the depth at the person's pixels differs from the body's"),
    # Photos 0; a hidden person 0.04.
    _person("depth_order", "most", 0.1, _SHARE, "of the vertices in front of a person who hides them"),
)

CHECKS: Mapping[str, CheckSpec] = {check.name: check for check in _ALL}
"""Name -> check, in the order of the results."""

_KNEES, _ANKLES = joint_pair("knee"), joint_pair("ankle")
_NO_FLOOR = {
    "no_pixels": "too few pixels to search",
    "no_consensus": "no horizontal plane has enough pixels",
    "below_plane": "too many pixels lie below the best plane",
    "through_people": "the only horizontal plane cuts through the people, as tables and seats do",
}


def run_checks(estimates: Estimates, solution: Solution, settings: EngineSettings) -> tuple[CheckResult, ...]:
    """Run all checks: those of the photo, then those of each person, in the order of ``CHECKS``."""
    found = [*_of_photo(estimates, solution, settings)]
    for person in range(len(solution.people)):
        found += [replace(diagnostic, person=person) for diagnostic in _of_person(estimates, solution, person)]
    return tuple(found)


def failed_checks(diagnostics: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Names of the failed self-checks of one person."""
    return tuple(d.name for d in diagnostics if d.person == person and not d.ok)


def check_warnings(diagnostics: Sequence[CheckResult]) -> tuple[str, ...]:
    """Messages of failed checks of the photo, and of those that left a person without a position or a body."""
    return tuple(
        d.message if d.person is None else f"person {d.person}: {d.message}"
        for d in diagnostics
        if not d.ok and CHECKS[d.name].warns
    )


def _judged(
    name: str, value: float | None, advice: str, *, ok: bool | None = None, threshold: float | None = None
) -> CheckResult:
    """Compare a value with its bound; ``advice`` is the message if the check fails."""
    check = CHECKS[name]
    bound = check.threshold if threshold is None else threshold
    if value is not None and math.isnan(value):
        value = None
    if ok is None:
        ok = value is None or (value >= bound if check.bound == "least" else value <= bound)
    message = advice if not ok else check.meaning if value is not None else f"not measured: {check.meaning}"
    return CheckResult(name, None if value is None else float(value), float(bound), check.unit, ok, message)


def _of_photo(estimates: Estimates, solution: Solution, settings: EngineSettings) -> Iterator[CheckResult]:
    from physic_core.engine.placement import human_points
    from physic_core.engine.scene import build

    report = solution.diagnostics
    share, scene = report["scene"]["alignment"]["inlier_share"], settings.scene
    uses_pointmap = scene.source != "metric_depth"  # else the point map is not used
    yield _judged(
        "scene_alignment",
        share if uses_pointmap else None,
        f"the scene's scale is doubtful: point map and metric depth agree on {share:.0%} of the pixels within "
        f"{build.ALIGN_TOLERANCE:.0%}: try another metric_depth or relative_pointmap"
        if share > 0
        else "point map and metric depth agree nowhere: the scene is the metric depth alone",
        ok=not uses_pointmap or (share > 0 and share >= build.ALIGN_LEAST_SHARE),
        threshold=build.ALIGN_LEAST_SHARE,
    )
    share = report["placement"]["alignment"]["inlier_share"]
    yield _judged(
        "photo_alignment",
        share,
        "people's distance to the scene is doubtful: the photo and its inpainted picture agree on "
        f"{share:.0%} of the background within {human_points.ALIGN_TOLERANCE:.0%}: "
        "try another inpainter or relative_pointmap"
        if share > 0
        else "the photo and its inpainted picture have no background in common: people are placed by size alone",
        ok=share > 0 and share >= human_points.ALIGN_LEAST_SHARE,
        threshold=human_points.ALIGN_LEAST_SHARE,
    )
    yield from _floor(report["scene"]["floor"], settings)
    yield from _scale(estimates, solution)
    yield from _focal(estimates, solution)


def _floor(report: Mapping[str, Any], settings: EngineSettings) -> Iterator[CheckResult]:
    from physic_core.engine.scene.floor import least_share

    reason = report["reason"]
    searched = reason != "switched_off"
    instead = "people are not held to the ground, and heights are unknown"
    if report.get("source") == "people":
        instead = "it is assumed at the people's feet, and its height is only as accurate as their pose"
    yield _judged(
        "floor",
        (report["inlier_share"] if reason == "found" else 0.0) if searched else None,
        f"no floor was found: {_NO_FLOOR.get(reason, reason)}; {instead}: "
        "use a photo that shows the ground at the feet",
        ok=reason == "found" or not searched,
        threshold=least_share(settings.scene.floor),
    )
    wrong = report["mask_reason"]
    yield _judged(
        "floor_mask",
        None if reason != "found" else float(wrong is None),
        f"the floor mask was not followed, since {_NO_FLOOR.get(str(wrong), wrong)}: the floor was searched in the "
        "lower part of the photo, look whether it is the floor in preview.png",
    )


def _scale(estimates: Estimates, solution: Solution) -> Iterator[CheckResult]:
    sigma, scale = estimates.depth.scale_sigma, solution.scene.scale
    yield _judged(
        "scale_sigma",
        sigma,
        f"all lengths may be off by {sigma or 0:.0%} (one standard deviation): the photo gives no better scale; "
        "use a metric_depth network, or a photo with feet on the floor",
    )
    yield _judged(
        "scale_change",
        _factor(scale),
        f"the people and the metric depth disagree: the scene was rescaled by {scale:.2f}; "
        "look at the people's sizes, children and wrong focal lengths do this",
    )
    # Depth at people's pixels has the final scale; this check compares with the depth before scaling.
    ratios = [ratio / scale for report in solution.people if (ratio := _number(report, "depth_ratio"))]
    middle = median(ratios) if ratios else None
    yield _judged(
        "ruler",
        None if middle is None else _factor(middle),
        f"the metric depth sees the people {middle or 1:.2f} times as far as their sizes say: distances between people "
        "and scene are doubtful; try another metric_depth, or give the focal length",
    )


def _focal(estimates: Estimates, solution: Solution) -> Iterator[CheckResult]:
    camera = solution.intrinsics
    yield _judged(
        "focal_known",
        float(not camera.guessed),
        "the focal length is a guess, and all distances along the view are off by its error: give it with --focal-px",
    )
    off_x, off_y = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    offset = max(abs(off_x) / camera.width, abs(off_y) / camera.height)
    yield _judged(
        "principal_point",
        offset,
        f"the principal point ({camera.cx:.0f}, {camera.cy:.0f}) lies {offset:.0%} of the photo's size off its centre "
        f"({camera.source}), as in a cropped photo only: check --intrinsics",
    )
    witnesses = [estimates.scene.intrinsics, estimates.original.intrinsics, estimates.depth.intrinsics]
    used = math.sqrt(camera.fx * camera.fy)
    ratios = [math.sqrt(w.fx * w.fy) * camera.width / w.width / used for w in witnesses if w is not None]
    ratio = max(ratios, key=_factor) if ratios else 1.0
    yield _judged(
        "focal_agreement",
        _factor(ratio) if ratios else None,
        f"a backend sees a focal length of {ratio * used:.0f} px, and {used:.0f} px ({camera.source}) was used: "
        "check the one that was used",
    )


def _of_person(estimates: Estimates, solution: Solution, person: int) -> Iterator[CheckResult]:
    report = solution.people[person]
    lost = estimates.missing_results[person] if estimates.missing_results else ()
    yield _judged(
        "answered",
        float(len(lost)),
        f"no numbers came for this person from {', '.join(lost)}: what builds on them is left out; try another backend",
    )
    yield _judged("placed", float(not report.get("placement_problem")), str(report.get("placement_problem")))
    failure = solution.failures[person]
    yield _judged("optimised", float(not failure), f"stays where the placement left them: {failure}")
    yield _judged(
        "reprojection",
        _number(report, "reprojection_share"),
        "confident keypoints miss the body: its pose is doubtful, look at it over the photo in preview.png",
    )
    yield _judged(
        "visible",
        _number(report, "seen_share"),
        "most of the body is hidden or outside the photo: what is not seen is a guess",
    )
    legs = _legs_seen(estimates, person)
    yield _judged(
        "legs_seen",
        None if legs is None else float(legs),
        "neither knee nor ankle of one leg is visible: its pose is a guess, and it gets no contact",
    )
    yield _judged(
        "penetration",
        _number(report, "penetration_share"),
        "the body cuts into the scene: its place or the scene behind it is wrong, do not use its contacts",
    )
    # With an invisible leg the support of the person is unknown.
    both_legs = legs is None or legs == 2
    yield _judged(
        "floating",
        _number(report, "support_gap_m") if both_legs else None,
        "the body hangs in the air: its distance or the floor is wrong, or what carries it is missing in the scene",
    )
    yield _lean(solution, person, both_legs)
    ratio = _number(report, "depth_ratio")
    yield _judged(
        "person_depth",
        None if not ratio else _factor(ratio),
        f"the depth at this person's pixels is {ratio or 1:.2f} times that of the body: their distance is doubtful",
    )
    yield _judged(
        "depth_order",
        _number(report, "depth_order_share"),
        "the body lies in front of a person who hides it in the photo: who is nearer is doubtful",
    )


def _lean(solution: Solution, person: int, both_legs: bool) -> CheckResult:
    joints, floor = solution.joints[person], solution.scene.floor
    part = math.nan
    if both_legs and floor is not None and np.isfinite(joints).all() and stands_straight(joints):
        _, part = lean_deg(joints, floor)
    way = "towards the camera" if part > 0 else "away from the camera"
    return _judged(
        "lean",
        abs(part),
        f"this person stands and leans {abs(part):.0f} degrees {way}: one photo hardly shows that, the pose or the "
        "floor is doubtful",
    )


def _legs_seen(estimates: Estimates, person: int) -> int | None:
    """Number of legs with a visible knee or ankle; None if the backend does not report visible joints."""
    observed = estimates.bodies.observed
    return None if observed is None else int((observed[person][_KNEES] | observed[person][_ANKLES]).sum())


def _factor(ratio: float) -> float:
    """Share by which the larger of two numbers exceeds the smaller, from their ratio."""
    return math.exp(abs(math.log(ratio))) - 1


def _number(report: Mapping[str, Any], name: str) -> float | None:
    value = report.get(name)
    return None if value is None else float(value)
