"""The self-checks: name, threshold, direction, unit and meaning of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["CHECKS", "CheckSpec", "Direction", "Failure"]

Direction = Literal["at most", "at least"]

Failure = Literal["ignored", "doubtful", "contradiction", "bad"]
"""What a failed check does to the grade: "doubtful" for a lack of evidence; "contradiction" is doubtful alone, and bad
together with another one."""


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
        failure: what a failed check does to the grade.
        needed: whether the grade is doubtful if nothing was measured.
    """

    name: str
    of: Literal["photo", "person"]
    direction: Direction
    threshold: float
    unit: str
    meaning: str
    warns: bool
    failure: Failure
    needed: bool = False


_SHARE, _YES = "share", "1: yes"


def _photo(
    name: str,
    direction: Direction,
    threshold: float,
    unit: str,
    meaning: str,
    failure: Failure = "doubtful",
    needed: bool = False,
) -> CheckSpec:
    return CheckSpec(name, "photo", direction, threshold, unit, meaning, True, failure, needed)


def _person(
    name: str,
    direction: Direction,
    threshold: float,
    unit: str,
    meaning: str,
    failure: Failure = "contradiction",
    needed: bool = False,
    warns: bool = False,
) -> CheckSpec:
    return CheckSpec(name, "person", direction, threshold, unit, meaning, warns, failure, needed)


# "Photos" below are of all kinds, run with the embedded backends; "worlds" are those of the mocks.
_ALL = (
    _photo("scene_alignment", "at least", 0.5, _SHARE, "of the pixels, on which point map and metric depth agree"),
    _photo(
        "photo_alignment",
        "at least",
        0.5,
        _SHARE,
        "of the background on which photo and inpainted photo agree in depth",
    ),
    _photo("floor", "at least", 0.15, _SHARE, "of the searched pixels that lie on the floor"),
    # Without the segmenter's floor pixels, half of the floors in photos are walls, tables or wrong by 10 degrees.
    _photo("floor_mask", "at least", 1, _YES, "whether the segmenter's floor pixels lie on a plane", needed=True),
    # Right floors 4-13, several people; those that are off by 26 and 30 degrees 35 and 19; one of 12 degrees 7.
    _photo("trunk_tilt", "at most", 15, "deg", "between the floor's normal and people's trunks, median of people"),
    # Soles on a floor give 0.08, sizes of people 0.20 and more.
    _photo("scale_sigma", "at most", 0.15, "log", "standard deviation of log(scale), given with the metric depth"),
    # Worlds whose depth is 10 % off need 0.13; photos 0.14 at most.
    _photo("scale_change", "at most", 0.25, _SHARE, "by which the joint optimisation rescaled the scene"),
    # Networks estimate people farther than the floor under them: 0 to 0.4 in photos, 0.56 where the depth is wrong.
    _photo(
        "depth_vs_bodies", "at most", 0.5, _SHARE, "by which metric depth and sizes of people differ, median of people"
    ),
    # Most photos have no EXIF data; a guess alone does not make the grade doubtful.
    _photo("focal_known", "at least", 1, _YES, "whether the photo or its file gives the focal length", "ignored"),
    _photo(
        "principal_point", "at most", 0.15, _SHARE, "of width or height, between principal point and photo's centre"
    ),
    # Straight edges are right to about a tenth; distances are off by the same share as the focal length.
    _photo(
        "focal_agreement", "at most", 0.2, _SHARE, "by which backends' focal lengths differ from the used one, at most"
    ),
    _photo("unposed_people", "at most", 0, "count", "person-like boxes without a body"),
    _person(
        "missing_outputs", "at most", 0, "count", "backends without valid values for this person", "bad", warns=True
    ),
    _person(
        "placed", "at least", 1, _YES, "whether keypoints, depth and floor placed the body", needed=True, warns=True
    ),
    _person("optimised", "at least", 1, _YES, "whether the joint optimisation included this person", warns=True),
    # Photos 0.004-0.012 where the body is right, 0.017 where most of it is hidden.
    _person("reprojection", "at most", 0.03, _SHARE, "reprojection error relative to the body's height in the picture"),
    # Right bodies 0.013-0.033; bodies of the wrong person 0.036-0.15.
    _person(
        "limb_keypoints",
        "at most",
        0.035,
        _SHARE,
        "of the box's diagonal, by which limbs miss their keypoints",
        needed=True,
    ),
    # Right bodies 0.97-1.00, 0.8 under wide clothes; a body in half of its person 0.78, other wrong poses 0.70-0.86.
    _person(
        "mask_covered", "at least", 0.9, _SHARE, "of the mask within the silhouette, grown for clothes", needed=True
    ),
    # Right bodies 0.90-1.00; bodies of people who are hardly visible 0.65-0.85.
    _person("body_in_mask", "at least", 0.85, _SHARE, "of the silhouette's visible part within the mask"),
    # Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body is a guess.
    _person(
        "visible", "at least", 0.4, _SHARE, "of the camera-facing surface that is visible in the photo", "doubtful"
    ),
    # The pose of a trunk whose shoulders are outside of the photo is a guess, however well the legs fit.
    _person("shoulders_seen", "at least", 1, "count", "visible shoulders", "doubtful"),
    _person("legs_seen", "at least", 2, "count", "legs with a visible knee or ankle", "doubtful"),
    # Photos 0.03 at most; a tenth is an entire limb.
    _person("penetration", "at most", 0.1, _SHARE, "of the visible surface over 3 cm inside scene or floor"),
    # 0 if the feet are visible; 5 cm are a visible gap.
    _person("floating", "at most", 0.05, "m", "from the supporting vertices to the nearest surface or floor"),
    # Bodies that touch 0; placed or posed wrongly, or above a wrong floor, 0.16-2.4.
    _person("support", "at most", 0.1, "m", "from the body, seen or not, to the nearest surface or floor", needed=True),
    # People in motion are beside their support; a wrong pose alone does not put them there.
    _person("balance", "at most", 0.12, "m", "from the centre of mass to the hull of what carries, level", "ignored"),
    # On floors that are right 0-0.08, and 0.25 on a treadmill; with wrong floors 0.6-1.7 above or below.
    _person("sole_height", "at most", 0.1, "m", "from the lower sole to the floor, if above it of a person who stands"),
    # People who stand or walk: up to 4 in photos, 3 in worlds. Sideways tilt is visible in the photo and not checked.
    _person("lean", "at most", 12, "deg", "tilt of a person who stands, towards the camera or away from it"),
    # Photos 0-0.32, worlds 0-0.02; 0.58 where the photo's point map was aligned wrongly.
    _person("person_depth", "at most", 0.4, _SHARE, "by which the depth at a person's pixels differs from the body's"),
    # Right people on right floors 0-0.2; seats and floors that are wrong 0.26-0.9.
    _person(
        "low_depth", "at most", 0.25, _SHARE, "by which the depth at feet or seat differs from the body's", needed=True
    ),
    # Photos 0; a hidden person 0.04.
    _person("depth_order", "at most", 0.1, _SHARE, "of the vertices in front of a person who occludes them"),
)

CHECKS: Mapping[str, CheckSpec] = {check.name: check for check in _ALL}
"""Self-checks by name, in the order of the results."""
