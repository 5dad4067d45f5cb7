"""Self-checks of a reconstruction: measured value, bound, and advice for a failed check.

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
from physic_core.body.posture import is_body_straight, lean_deg
from physic_core.types import CheckResult

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution

__all__ = ["CHECKS", "CheckSpec", "check_warnings", "failed_checks", "run_checks"]


@dataclass(frozen=True)
class CheckSpec:
    """Name, bound, unit and meaning of one self-check.

    Attributes:
        name: as in :class:`physic_core.types.CheckResult`.
        of: "photo" or "person".
        bound: whether the threshold is a minimum ("least") or a maximum ("most").
        threshold: the bound; a setting of the engine may replace it.
        unit: of threshold and value.
        meaning: of the value, a phrase for messages.
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
        "photo_alignment",
        "least",
        0.5,
        _SHARE,
        "of the background on which the point maps of photo and inpainted photo agree",
    ),
    _photo("floor", "least", 0.15, _SHARE, "of the searched pixels that lie on the floor"),
    _photo("floor_mask", "least", 1, _YES, "whether the segmenter's floor pixels lie on a plane"),
    # Soles on a floor give 0.08, sizes of people 0.20 and more.
    _photo("scale_sigma", "most", 0.15, "log", "standard deviation of log(scale), given with the metric depth"),
    # Worlds whose depth is 10 % off need 0.13; photos 0.14 at most.
    _photo("scale_change", "most", 0.25, _SHARE, "by which the joint optimisation rescaled the scene"),
    # Networks estimate people farther than the floor under them: 0 to 0.4 in photos, 0.56 where the depth is wrong.
    _photo(
        "depth_vs_bodies", "most", 0.5, _SHARE, "by which metric depth and sizes of people differ, median over people"
    ),
    _photo("focal_known", "least", 1, _YES, "whether the photo or its file gives the focal length"),
    _photo(
        "principal_point",
        "most",
        0.15,
        _SHARE,
        "of the photo's width or height, by which it differs from the photo's centre",
    ),
    # Straight edges are right to about a tenth; distances are off by the same share as the focal length.
    _photo(
        "focal_agreement", "most", 0.2, _SHARE, "by which backends' focal lengths differ from the used one, at most"
    ),
    _person(
        "missing_outputs", "most", 0, "count", "backends that returned no finite values for this person", warns=True
    ),
    _person("placed", "least", 1, _YES, "whether keypoints and depth placed the body", warns=True),
    _person("optimised", "least", 1, _YES, "whether the joint optimisation included this person", warns=True),
    # Photos 0.004-0.012 where the body is right, 0.017 where most of it is hidden.
    _person("reprojection", "most", 0.03, _SHARE, "reprojection error relative to the body's height in the picture"),
    # Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body is a guess.
    _person("visible", "least", 0.4, _SHARE, "of the camera-facing surface that is visible in the photo"),
    _person("legs_seen", "least", 2, "count", "legs with a visible knee or ankle"),
    # Photos 0.03 at most; a tenth is an entire limb.
    _person(
        "penetration", "most", 0.1, _SHARE, "of the visible surface that lies over 3 cm inside the scene or the floor"
    ),
    # 0 if the feet are visible; 5 cm are a visible gap.
    _person("floating", "most", 0.05, "m", "from the supporting vertices to the nearest surface or floor"),
    # People who stand or walk: up to 4 in photos, 3 in worlds. Sideways tilt is visible in the photo and not checked.
    _person("lean", "most", 12, "deg", "tilt of a person who stands, towards the camera or away from it"),
    # Photos 0-0.32, worlds 0-0.02; 0.58 where the photo's point map was aligned wrongly.
    _person("person_depth", "most", 0.4, _SHARE, "by which the depth at the person's pixels differs from their body's"),
    # Photos 0; a hidden person 0.04.
    _person("depth_order", "most", 0.1, _SHARE, "of the vertices in front of a person who occludes them"),
)

CHECKS: Mapping[str, CheckSpec] = {check.name: check for check in _ALL}
"""Self-checks by name, in the order of the results."""

_KNEES, _ANKLES = joint_pair("knee"), joint_pair("ankle")
_NO_FLOOR = {
    "no_pixels": "too few pixels to search",
    "no_consensus": "no horizontal plane has enough pixels",
    "below_plane": "too many pixels lie below the best plane",
    "through_people": "the only horizontal plane cuts through the people, as tables and seats do",
}


def run_checks(estimates: Estimates, solution: Solution, settings: EngineSettings) -> tuple[CheckResult, ...]:
    """Run all self-checks, first of the photo, then of each person, in the order of ``CHECKS``."""
    found = [*_check_photo(estimates, solution, settings)]
    for person in range(len(solution.people)):
        found += [replace(diagnostic, person=person) for diagnostic in _check_person(estimates, solution, person)]
    return tuple(found)


def failed_checks(diagnostics: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Return the names of the failed self-checks of one person."""
    return tuple(d.name for d in diagnostics if d.person == person and not d.ok)


def check_warnings(diagnostics: Sequence[CheckResult]) -> tuple[str, ...]:
    """Return the messages of the failed self-checks that have ``warns`` set."""
    return tuple(
        d.message if d.person is None else f"person {d.person}: {d.message}"
        for d in diagnostics
        if not d.ok and CHECKS[d.name].warns
    )


def _check(
    name: str, value: float | None, advice: str, *, ok: bool | None = None, threshold: float | None = None
) -> CheckResult:
    """Compare a value with the bound of its check; ``advice`` is the message of a failed check."""
    check = CHECKS[name]
    bound = check.threshold if threshold is None else threshold
    if value is not None and math.isnan(value):
        value = None
    if ok is None:
        ok = value is None or (value >= bound if check.bound == "least" else value <= bound)
    message = advice if not ok else check.meaning if value is not None else f"not measured: {check.meaning}"
    return CheckResult(name, None if value is None else float(value), float(bound), check.unit, ok, message)


def _check_photo(estimates: Estimates, solution: Solution, settings: EngineSettings) -> Iterator[CheckResult]:
    from physic_core.engine.placement import human_points
    from physic_core.engine.scene import build

    report = solution.diagnostics
    share, scene = report["scene"]["alignment"]["inlier_share"], settings.scene
    uses_pointmap = scene.source != "metric_depth"  # else the point map is not used
    yield _check(
        "scene_alignment",
        share if uses_pointmap else None,
        f"the scene's scale is doubtful: point map and metric depth agree on {share:.0%} of the pixels within "
        f"{build.ALIGN_TOLERANCE:.0%}: try another metric_depth or relative_pointmap"
        if share > 0
        else "point map and metric depth agree nowhere: the scene is the metric depth alone",
        ok=not uses_pointmap or (share > 0 and share >= build.MIN_ALIGN_INLIER_SHARE),
        threshold=build.MIN_ALIGN_INLIER_SHARE,
    )
    share = report["placement"]["alignment"]["inlier_share"]
    yield _check(
        "photo_alignment",
        share,
        "people's distance to the scene is doubtful: the photo and its inpainted picture agree on "
        f"{share:.0%} of the background within {human_points.ALIGN_TOLERANCE:.0%}: "
        "try another inpainter or relative_pointmap"
        if share > 0
        else "the photo and its inpainted picture have no background in common: people are placed by size alone",
        ok=share > 0 and share >= human_points.MIN_ALIGN_INLIER_SHARE,
        threshold=human_points.MIN_ALIGN_INLIER_SHARE,
    )
    yield from _check_floor(report["scene"]["floor"], settings)
    yield from _check_scale(estimates, solution)
    yield from _check_focal(estimates, solution)


def _check_floor(report: Mapping[str, Any], settings: EngineSettings) -> Iterator[CheckResult]:
    from physic_core.engine.scene.floor import min_inlier_share

    reason = report["reason"]
    searched = reason != "switched_off"
    instead = "people are not held to the ground, and heights are unknown"
    if report.get("source") == "people":
        instead = "it is assumed at the people's feet, and its height is only as accurate as their pose"
    yield _check(
        "floor",
        (report["inlier_share"] if reason == "found" else 0.0) if searched else None,
        f"no floor was found: {_NO_FLOOR.get(reason, reason)}; {instead}: "
        "use a photo that shows the ground at the feet",
        ok=reason == "found" or not searched,
        threshold=min_inlier_share(settings.scene.floor),
    )
    wrong = report["mask_reason"]
    yield _check(
        "floor_mask",
        None if reason != "found" else float(wrong is None),
        f"the floor mask was not followed, since {_NO_FLOOR.get(str(wrong), wrong)}: the floor was searched in the "
        "lower part of the photo, look whether it is the floor in preview.png",
    )


def _check_scale(estimates: Estimates, solution: Solution) -> Iterator[CheckResult]:
    sigma, scale = estimates.depth.scale_sigma, solution.scene.scale
    yield _check(
        "scale_sigma",
        sigma,
        f"all lengths may be off by {sigma or 0:.0%} (one standard deviation): the photo gives no better scale; "
        "use a metric_depth network, or a photo with feet on the floor",
    )
    yield _check(
        "scale_change",
        _relative_difference(scale),
        f"the people and the metric depth disagree: the scene was rescaled by {scale:.2f}; "
        "look at the people's sizes, children and wrong focal lengths do this",
    )
    # Depth at people's pixels has the final scale; this check compares with the depth before scaling.
    ratios = [ratio / scale for report in solution.people if (ratio := _value(report, "depth_ratio"))]
    median_ratio = median(ratios) if ratios else None
    yield _check(
        "depth_vs_bodies",
        None if median_ratio is None else _relative_difference(median_ratio),
        f"the metric depth puts the people {median_ratio or 1:.2f} times as far away as their sizes do: distances "
        "between people and scene are doubtful; try another metric_depth, or give the focal length",
    )


def _check_focal(estimates: Estimates, solution: Solution) -> Iterator[CheckResult]:
    camera = solution.intrinsics
    yield _check(
        "focal_known",
        float(not camera.guessed),
        "the focal length is a guess, and all distances along the view are off by its error: give it with --focal-px",
    )
    off_x, off_y = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    offset = max(abs(off_x) / camera.width, abs(off_y) / camera.height)
    yield _check(
        "principal_point",
        offset,
        f"the principal point ({camera.cx:.0f}, {camera.cy:.0f}) lies {offset:.0%} of the photo's size off its centre "
        f"({camera.source}), as in a cropped photo only: check --intrinsics",
    )
    witnesses = [estimates.scene.intrinsics, estimates.original.intrinsics, estimates.depth.intrinsics]
    used = math.sqrt(camera.fx * camera.fy)
    ratios = [math.sqrt(w.fx * w.fy) * camera.width / w.width / used for w in witnesses if w is not None]
    ratio = max(ratios, key=_relative_difference) if ratios else 1.0
    yield _check(
        "focal_agreement",
        _relative_difference(ratio) if ratios else None,
        f"a backend sees a focal length of {ratio * used:.0f} px, and {used:.0f} px ({camera.source}) was used: "
        "check the one that was used",
    )


def _check_person(estimates: Estimates, solution: Solution, person: int) -> Iterator[CheckResult]:
    report = solution.people[person]
    missing = estimates.missing_results[person] if estimates.missing_results else ()
    yield _check(
        "missing_outputs",
        float(len(missing)),
        f"no finite values for this person from {', '.join(missing)}: results that need them are left out; "
        "try another backend",
    )
    yield _check("placed", float(not report.get("placement_problem")), str(report.get("placement_problem")))
    failure = solution.failures[person]
    yield _check("optimised", float(not failure), f"pose and position are those of the placement: {failure}")
    yield _check(
        "reprojection",
        _value(report, "reprojection_share"),
        "confident keypoints miss the body: its pose is doubtful, look at it over the photo in preview.png",
    )
    yield _check(
        "visible",
        _value(report, "seen_share"),
        "most of the body is hidden or outside the photo: what is not seen is a guess",
    )
    legs = _visible_legs(estimates, person)
    yield _check(
        "legs_seen",
        None if legs is None else float(legs),
        "neither knee nor ankle of one leg is visible: its pose is a guess, and it gets no contact",
    )
    yield _check(
        "penetration",
        _value(report, "penetration_share"),
        "the body cuts into the scene: its place or the scene behind it is wrong, do not use its contacts",
    )
    # With an invisible leg the support of the person is unknown.
    both_legs = legs is None or legs == 2
    yield _check(
        "floating",
        _value(report, "support_gap_m") if both_legs else None,
        "the body hangs in the air: its distance or the floor is wrong, or what carries it is missing in the scene",
    )
    yield _check_lean(solution, person, both_legs)
    ratio = _value(report, "depth_ratio")
    yield _check(
        "person_depth",
        None if not ratio else _relative_difference(ratio),
        f"the depth at this person's pixels is {ratio or 1:.2f} times that of the body: their distance is doubtful",
    )
    yield _check(
        "depth_order",
        _value(report, "depth_order_share"),
        "the body lies in front of a person who hides it in the photo: who is nearer is doubtful",
    )


def _check_lean(solution: Solution, person: int, both_legs: bool) -> CheckResult:
    joints, floor = solution.joints[person], solution.scene.floor
    part = math.nan
    if both_legs and floor is not None and np.isfinite(joints).all() and is_body_straight(joints):
        _, part = lean_deg(joints, floor)
    direction = "towards the camera" if part > 0 else "away from the camera"
    return _check(
        "lean",
        abs(part),
        f"this person stands and leans {abs(part):.0f} degrees {direction}: one photo hardly shows that, the "
        "pose or the floor is doubtful",
    )


def _visible_legs(estimates: Estimates, person: int) -> int | None:
    """Count the legs with a visible knee or ankle; None if the backend does not report visible joints."""
    observed = estimates.bodies.observed
    return None if observed is None else int((observed[person][_KNEES] | observed[person][_ANKLES]).sum())


def _relative_difference(ratio: float) -> float:
    """Return the share by which the larger of two numbers exceeds the smaller, from their ratio."""
    return math.exp(abs(math.log(ratio))) - 1


def _value(report: Mapping[str, Any], name: str) -> float | None:
    value = report.get(name)
    return None if value is None else float(value)
