"""The self-checks: name, label, threshold, direction and unit of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

Direction = Literal["at most", "at least"]

Failure = Literal["ignored", "doubtful", "contradiction", "bad"]
"""What a failed check does to the grade: "doubtful" for a lack of evidence; "contradiction" is doubtful alone, and bad
together with one of another check."""


@dataclass(frozen=True)
class CheckSpec:
    """Name, label, threshold and unit of one self-check.

    Attributes:
        name: as in :class:`physic_core.types.CheckResult`.
        label: the displayed name.
        direction: whether the value must be "at most" or "at least" the threshold.
        threshold: the bound; an engine setting may replace it.
        unit: of threshold and value.
        share_of: what a value of unit "share" is a share of; "" if the label says it.
        of: "photo" or "person".
        warns: whether a failed check is also a warning of the result.
        failure: what a failed check does to the grade.
        needed: whether the grade is doubtful if nothing was measured.
    """

    name: str
    label: str
    direction: Direction
    threshold: float
    unit: str
    share_of: str = ""
    of: Literal["photo", "person"] = field(kw_only=True)
    warns: bool = field(default=False, kw_only=True)
    failure: Failure = field(default="doubtful", kw_only=True)
    needed: bool = field(default=False, kw_only=True)


_SHARE, _YES = "share", "1: yes"
_photo = partial(CheckSpec, of="photo", warns=True)
_person = partial(CheckSpec, of="person", failure="contradiction")


# "Photos" below are of all kinds, run with the embedded backends; "worlds" are those of the mocks.
_ALL = (
    _photo("scene_alignment", "Point map agrees with the depth", "at least", 0.5, _SHARE, "the pixels"),
    _photo("photo_alignment", "Photo agrees with the inpainted photo", "at least", 0.5, _SHARE, "the background"),
    _photo("floor", "Floor", "at least", 0.05, _SHARE, "the searched pixels"),
    # Without the segmenter's floor pixels, half of the floors in photos are walls, tables or wrong by 10 degrees.
    _photo("floor_mask", "Floor is where the segmenter sees it", "at least", 1, _YES, needed=True),
    # Right floors 4-13, several people; those that are off by 26 and 30 degrees 35 and 19; one of 12 degrees 7.
    _photo("trunk_tilt", "Trunks tilted against the floor, median", "at most", 15, "deg"),
    # Soles on a floor give 0.08, sizes of people 0.20 and more.
    _photo("scale_sigma", "Uncertainty of the scale", "at most", 0.15, "log"),
    # Worlds whose depth is 10 % off need 0.13; photos 0.14 at most.
    _photo("scale_change", "Change of the scale in the joint fit", "at most", 0.25, _SHARE),
    # Networks estimate people farther than the floor under them: 0 to 0.4 in photos, 0.56 where the depth is wrong.
    _photo("depth_vs_bodies", "Depth differs from the sizes of people", "at most", 0.5, _SHARE),
    # Most photos have no EXIF data; a guess alone does not make the grade doubtful.
    _photo("focal_known", "Focal length known, estimated or solved", "at least", 1, _YES, failure="ignored"),
    _photo("principal_point", "Camera axis off the photo's centre", "at most", 0.15, _SHARE, "the photo's size"),
    # Straight edges are right to about a tenth; distances are off by the same share as the focal length.
    _photo("focal_agreement", "Backends differ in the focal length", "at most", 0.2, _SHARE),
    _photo("unposed_people", "People without a body", "at most", 0, "count"),
    _person("missing_outputs", "Backends without a result", "at most", 0, "count", failure="bad", warns=True),
    _person("placed", "Placed by keypoints, depth and floor", "at least", 1, _YES, needed=True, warns=True),
    _person("optimised", "Part of the joint fit", "at least", 1, _YES, warns=True),
    # Photos 0.004-0.012 where the body is right, 0.017 where most of it is hidden.
    _person("reprojection", "Body off its keypoints", "at most", 0.03, _SHARE, "its height in the photo"),
    # Right bodies 0.013-0.033; bodies of the wrong person 0.036-0.15.
    _person("limb_keypoints", "Limbs off their keypoints", "at most", 0.035, _SHARE, "the box diagonal", needed=True),
    # Photos: 870 of 888 joints within 0.035; the others are limbs that are wrong or hidden.
    _person(
        "limb_joint", "Worst elbow, wrist or knee", "at most", 0.035, _SHARE, "the box diagonal", failure="doubtful"
    ),
    # Right bodies 0.97-1.00, 0.8 under wide clothes; a body in half of its person 0.78, other wrong poses 0.70-0.86.
    _person("mask_covered", "Person covered by the body", "at least", 0.9, _SHARE, "the mask", needed=True),
    # Right bodies 0.90-1.00; bodies of people who are hardly visible 0.65-0.85.
    _person("body_in_mask", "Body within the person", "at least", 0.85, _SHARE, "the silhouette"),
    # Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body is a guess.
    _person(
        "visible", "Visible in the photo", "at least", 0.4, _SHARE, "the side towards the camera", failure="doubtful"
    ),
    # The pose of a trunk whose shoulders are outside of the photo is a guess, however well the legs fit.
    _person("shoulders_seen", "Visible shoulders", "at least", 1, "count", failure="doubtful"),
    _person("legs_seen", "Visible legs", "at least", 2, "count", failure="doubtful"),
    # Photos 0.03 at most; a tenth is an entire limb.
    _person("penetration", "Inside scene or floor", "at most", 0.1, _SHARE, "the visible surface"),
    # 0 if the feet are visible; 5 cm are a visible gap.
    _person("floating", "Gap under the person", "at most", 0.05, "m"),
    # Bodies that touch 0; placed or posed wrongly, or above a wrong floor, 0.16-2.4.
    _person("support", "Distance to the nearest surface", "at most", 0.1, "m", needed=True),
    # Of people in labelled photos, 94 % of those who sit have a seat or a larger probability, and 14 % of the others.
    _person("seat", "Sits where the scene has no seat, probability", "at most", 0.15, _SHARE, failure="doubtful"),
    # People in motion are beside their support; a wrong pose alone does not put them there.
    _person("balance", "Centre of mass beside the support", "at most", 0.12, "m", failure="ignored"),
    # On floors that are right 0-0.08, and 0.25 on a treadmill; with wrong floors 0.6-1.7 above or below.
    _person("sole_height", "Lower sole off the floor", "at most", 0.1, "m"),
    # People who stand or walk: up to 4 in photos, 3 in worlds. Sideways tilt is visible in the photo and not checked.
    _person("lean", "Leans towards the camera or away", "at most", 12, "deg"),
    # An upright trunk that is an eighth shorter looks like one bent by 30 degrees. Right bodies up to 22, one wrong 34.
    _person("bend", "Trunk bent towards the camera or away", "at most", 30, "deg", failure="doubtful"),
    # Right people on right floors 0-0.2; seats and floors that are wrong 0.26-0.9.
    _person("low_depth", "Depth at feet or seat differs from the body's", "at most", 0.25, _SHARE, needed=True),
    # People whose depths differ by less are beside each other. Not weighed yet against photos with measured truth.
    _person("depth_map_order", "In another order by the depth map", "at most", 0.1, "log", failure="ignored"),
    # Photos 0; a hidden person 0.04.
    _person("depth_order", "In front of a person who hides it", "at most", 0.1, _SHARE, "the vertices"),
    # Of people whose age or stature is given. The errors of their sizes and of the others' are in the unit.
    _person("given_size", "Size against the given one", "at most", 3, "sigma", failure="doubtful", warns=True),
)

CHECKS: Mapping[str, CheckSpec] = {check.name: check for check in _ALL}
"""Self-checks by name, in the order of the results."""
