"""The self-checks: name, threshold, direction, unit and meaning of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["CHECKS", "CheckSpec", "Direction"]

Direction = Literal["at most", "at least"]


@dataclass(frozen=True)
class CheckSpec:
    """Name, threshold, unit and meaning of one self-check.

    Attributes:
        name: as in :class:`physic_core.types.CheckResult`.
        of: "photo" or "person".
        direction: whether the value must be "at most" or "at least" the threshold.
        threshold: the bound; a setting of the engine may replace it.
        unit: of threshold and value.
        meaning: of the value, a phrase for messages.
        warns: whether a failed check is also a warning of the result.
    """

    name: str
    of: Literal["photo", "person"]
    direction: Direction
    threshold: float
    unit: str
    meaning: str
    warns: bool


def _photo(name: str, direction: Direction, threshold: float, unit: str, meaning: str) -> CheckSpec:
    return CheckSpec(name, "photo", direction, threshold, unit, meaning, warns=True)


def _person(
    name: str, direction: Direction, threshold: float, unit: str, meaning: str, warns: bool = False
) -> CheckSpec:
    return CheckSpec(name, "person", direction, threshold, unit, meaning, warns)


_SHARE, _YES = "share", "1: yes"

# "Photos" below are of all kinds, run with the embedded backends; "worlds" are those of the mocks.
_ALL = (
    _photo("scene_alignment", "at least", 0.5, _SHARE, "of the pixels, on which point map and metric depth agree"),
    _photo(
        "photo_alignment",
        "at least",
        0.5,
        _SHARE,
        "of the background on which the point maps of photo and inpainted photo agree",
    ),
    _photo("floor", "at least", 0.15, _SHARE, "of the searched pixels that lie on the floor"),
    _photo("floor_mask", "at least", 1, _YES, "whether the segmenter's floor pixels lie on a plane"),
    # Soles on a floor give 0.08, sizes of people 0.20 and more.
    _photo("scale_sigma", "at most", 0.15, "log", "standard deviation of log(scale), given with the metric depth"),
    # Worlds whose depth is 10 % off need 0.13; photos 0.14 at most.
    _photo("scale_change", "at most", 0.25, _SHARE, "by which the joint optimisation rescaled the scene"),
    # Networks estimate people farther than the floor under them: 0 to 0.4 in photos, 0.56 where the depth is wrong.
    _photo(
        "depth_vs_bodies",
        "at most",
        0.5,
        _SHARE,
        "by which metric depth and sizes of people differ, median of people",
    ),
    _photo("focal_known", "at least", 1, _YES, "whether the photo or its file gives the focal length"),
    _photo(
        "principal_point",
        "at most",
        0.15,
        _SHARE,
        "of the photo's width or height, by which it differs from the photo's centre",
    ),
    # Straight edges are right to about a tenth; distances are off by the same share as the focal length.
    _photo(
        "focal_agreement", "at most", 0.2, _SHARE, "by which backends' focal lengths differ from the used one, at most"
    ),
    _person(
        "missing_outputs", "at most", 0, "count", "backends that returned no finite values for this person", warns=True
    ),
    _person("placed", "at least", 1, _YES, "whether keypoints, depth and floor placed the body", warns=True),
    _person("optimised", "at least", 1, _YES, "whether the joint optimisation included this person", warns=True),
    # Photos 0.004-0.012 where the body is right, 0.017 where most of it is hidden.
    _person("reprojection", "at most", 0.03, _SHARE, "reprojection error relative to the body's height in the picture"),
    # Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body is a guess.
    _person("visible", "at least", 0.4, _SHARE, "of the camera-facing surface that is visible in the photo"),
    _person("legs_seen", "at least", 2, "count", "legs with a visible knee or ankle"),
    # Photos 0.03 at most; a tenth is an entire limb.
    _person(
        "penetration",
        "at most",
        0.1,
        _SHARE,
        "of the visible surface that lies over 3 cm inside scene or floor",
    ),
    # 0 if the feet are visible; 5 cm are a visible gap.
    _person("floating", "at most", 0.05, "m", "from the supporting vertices to the nearest surface or floor"),
    # People who stand or walk: up to 4 in photos, 3 in worlds. Sideways tilt is visible in the photo and not checked.
    _person("lean", "at most", 12, "deg", "tilt of a person who stands, towards the camera or away from it"),
    # Photos 0-0.32, worlds 0-0.02; 0.58 where the photo's point map was aligned wrongly.
    _person("person_depth", "at most", 0.4, _SHARE, "by which the depth at a person's pixels differs from the body's"),
    # Photos 0; a hidden person 0.04.
    _person("depth_order", "at most", 0.1, _SHARE, "of the vertices in front of a person who occludes them"),
)

CHECKS: Mapping[str, CheckSpec] = {check.name: check for check in _ALL}
"""Self-checks by name, in the order of the results."""
