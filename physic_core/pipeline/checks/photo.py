"""Self-checks per photo: alignments, floor, scale and camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.posture import trunk_tilt_deg
from physic_core.pipeline.checks.result import Measurement, relative_difference

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution

_NO_PEOPLE = "there is no person in the result"
_FEWEST_TRUNKS = 2  # a single person may bend

_NO_FLOOR = {
    "no_pixels": "too few pixels to search",
    "no_consensus": "no horizontal plane explains enough pixels",
}


def check_photo(estimates: Estimates, solution: Solution, settings: EngineSettings) -> Iterator[Measurement]:
    """Run the self-checks of the photo."""
    from physic_core.engine.placement.human_points import MIN_POINTMAP_INLIER_SHARE
    from physic_core.engine.scene.solve import MIN_SCENE_INLIER_SHARE

    report = solution.diagnostics
    share, scene = report["scene"]["alignment"]["inlier_share"], settings.scene
    yield Measurement(
        "scene_alignment",
        share if scene.uses_pointmap else None,
        f"the scene's scale is doubtful: point map and metric depth agree on {share:.0%} of the pixels within "
        f"{scene.alignment.tolerance:.0%}: try another backend for metric depth or point map"
        if share > 0
        else "point map and metric depth agree nowhere: the scene uses only the metric depth",
        unmeasured="the engine settings use only the metric depth",
        threshold=MIN_SCENE_INLIER_SHARE,
    )
    share = report["placement"]["alignment"]["inlier_share"] if "placement" in report else None
    yield Measurement(
        "photo_alignment",
        share,
        "people's distance to the scene is doubtful: the photo and the inpainted photo agree on "
        f"{share:.0%} of the background within {settings.placement.alignment.tolerance:.0%}: "
        "try another backend for inpainting or point map"
        if share
        else "the photo and the inpainted photo have no background in common: people are placed by size alone",
        unmeasured=_NO_PEOPLE,
        threshold=MIN_POINTMAP_INLIER_SHARE,
    )
    yield from _check_floor(report["scene"]["floor"], settings)
    yield _check_tilt(solution)
    yield from _check_scale(solution)
    yield from _check_focal(estimates, solution)
    unposed = len(estimates.people.unposed)
    yield Measurement(
        "unposed_people",
        float(unposed),
        f"{unposed} of the people in the photo have no body: dashed boxes in preview and page show them",
    )


def _check_floor(report: Mapping[str, Any], settings: EngineSettings) -> Iterator[Measurement]:
    reason = report["reason"]
    share = report["inlier_share"] if reason == "found" else 0.0
    yield Measurement(
        "floor",
        None if reason == "switched_off" else share,
        f"no floor was found: {_NO_FLOOR.get(reason, reason)}; people are not constrained to the ground, "
        "and heights are unknown: use a photo that shows the ground at the feet",
        unmeasured="the engine settings disable the floor search",
        failed=reason != "found",
        threshold=settings.scene.min_floor_share,
    )
    in_mask = report["in_mask"]
    yield Measurement(
        "floor_mask",
        None if in_mask is None else float(in_mask),
        "the floor mask was not followed, since another plane of the lower part of the photo is more likely: check it "
        "in preview.png",
        unmeasured="no floor was found" if reason != "found" else "the segmenter returned no floor pixels",
    )


def _check_tilt(solution: Solution) -> Measurement:
    """Compare the floor with the trunks of several people, who do not all lean."""
    floor, joints = solution.scene.floor, [j for j in solution.joints if np.isfinite(j).all()]
    tilts = [] if floor is None else [float(trunk_tilt_deg(j, floor.normal)) for j in joints]
    tilt = median(tilts) if len(tilts) >= _FEWEST_TRUNKS else None
    return Measurement(
        "trunk_tilt",
        tilt,
        f"half of the people lean by {tilt or 0:.0f} degrees or more from the floor's normal: the floor is doubtful",
        unmeasured="no floor was found" if floor is None else "fewer than two people have a body",
    )


def _check_scale(solution: Solution) -> Iterator[Measurement]:
    sigma, scale = solution.scene.scale_sigma, solution.scene.scale
    yield Measurement(
        "scale_sigma",
        sigma,
        f"all lengths may be off by {sigma or 0:.0%} (one standard deviation): the photo gives no better scale; "
        "use a metric depth network, or a photo with feet on the floor",
        unmeasured="the metric depth backend does not estimate its scale error",
    )
    yield Measurement(
        "scale_change",
        relative_difference(scale) if solution.people else None,
        f"the people and the metric depth disagree: the scene was rescaled by {scale:.2f}; "
        "check the people's sizes; children and wrong focal lengths cause this",
        unmeasured=_NO_PEOPLE,
    )
    # Depth at people's pixels has the final scale; this check compares with the depth before scaling.
    ratios = [ratio / scale for report in solution.people if (ratio := report.get("depth_ratio"))]
    median_ratio = median(ratios) if ratios else None
    yield Measurement(
        "depth_vs_bodies",
        None if median_ratio is None else relative_difference(median_ratio),
        f"the metric depth puts the people {median_ratio or 1:.2f} times as far away as their sizes do: distances "
        "between people and scene are doubtful; try another metric_depth, or give the focal length",
        unmeasured="no person has enough visible vertices with depth",
    )


def _check_focal(estimates: Estimates, solution: Solution) -> Iterator[Measurement]:
    camera = solution.intrinsics
    yield Measurement(
        "focal_known",
        None if camera.guessed and camera.focal_sigma is not None else float(not camera.guessed),
        "the focal length is a guess, and all distances along the view are off by its error: give it, for "
        "example with --set photo.focal_px=900",
        unmeasured="the focal length is a guess with a stated uncertainty, see focal_sigma",
    )
    off_x, off_y = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    offset = max(abs(off_x) / camera.width, abs(off_y) / camera.height)
    yield Measurement(
        "principal_point",
        offset,
        f"the principal point ({camera.cx:.0f}, {camera.cy:.0f}) lies {offset:.0%} of the photo's size off its centre "
        f"({camera.source}), which is normal only in a cropped photo: check --intrinsics",
    )
    witnesses = [estimates.scene.intrinsics, estimates.original.intrinsics, estimates.depth.intrinsics]
    used = math.sqrt(camera.fx * camera.fy)
    ratios = [math.sqrt(w.fx * w.fy) * camera.width / w.width / used for w in witnesses if w is not None]
    ratio = max(ratios, key=relative_difference) if ratios else 1.0
    yield Measurement(
        "focal_agreement",
        relative_difference(ratio) if ratios else None,
        f"a backend estimates a focal length of {ratio * used:.0f} px, but {used:.0f} px ({camera.source}) was "
        f"used: check the value used",
        unmeasured="no backend estimates a focal length",
    )
