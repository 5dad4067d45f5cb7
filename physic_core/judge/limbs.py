"""Self-checks of each person's limbs: against keypoints in the photo, and how sure they are.

Measured on photos of all kinds, run with the embedded backends.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.terms.reprojection_settings import ReprojectionSettings
from physic_core.judge.people import lies
from physic_core.judge.spec import NO_BODY, OTHER_BODY, check
from physic_core.types import skeleton_named
from physic_core.types.contacts import part_words
from physic_core.types.records import in_words
from physic_core.types.results import LIMB_ENDS, UNSURE_M
from physic_core.types.skeletons import SIDES, SURE_CONFIDENCE, keypoint_in_words

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates
    from physic_core.judge.spec import Measured
    from physic_core.types import FloatArray, Intrinsics, Reconstruction, Skeleton

_LIMB_JOINTS = tuple(
    f"{side}_{name}"
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in SIDES
)
_FEWEST = 4
_QUANTILE = 0.9  # two joints of a dozen may be wrong
_COMPARE = f"compare arms and legs in report.html with the photo. {OTHER_BODY}"

_check = partial(check, "person")


# Right bodies 0.013-0.033; bodies of the wrong person 0.036-0.15.
@_check(
    "Limbs far from their keypoints",
    at_most=0.035,
    contradicts=("pose",),
    share_of="the diagonal of the person's box",
    advice="a limb is not where the photo shows it: compare the bodies over the photo in "
    "preview.png. To correct a joint, edit the file that physic export FOLDER --to keypoints "
    "writes, and give it as --keypoints FILE",
    unmeasured="the photo shows fewer than 4 limb joints clearly",
)
def limb_keypoints(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the distance of limb joints from their keypoints (90 % quantile)."""
    return limb_keypoint_error(
        result.people[person].joints,
        estimates.photo.keypoints.points[person],
        estimates.photo.keypoints.confidence[person],
        np.asarray(estimates.photo.people.boxes[person], np.float64),
        estimates.photo.keypoints.skeleton,
        result.intrinsics,
    )


@_check(
    "Arm or leg position uncertain",
    at_most=UNSURE_M,
    unit="m",
    advice=_COMPARE,
    optional=True,
)
def limb_sigma(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the largest stated error of a visible wrist or ankle, relative to the middle of the
    hips.
    """
    who = result.people[person]
    sigmas = {limb: sigma for limb, sigma in who.limb_sigmas.items() if not who.hides(limb)}
    finite = [sigma for sigma in sigmas.values() if math.isfinite(sigma)]
    if not finite:
        return None
    limbs = [f"{part_words(limb)} (± {100 * who.limb_sigmas[limb]:.0f} cm)" for limb in who.unsure]
    uncertain = f"the position of {in_words(limbs)} is uncertain: {_COMPARE}" if limbs else ""
    return max(finite), uncertain


# Of wrists and ankles with measured truth .1 in the median and .3 in nine of ten.
@_check(
    "Arm or leg differs in the mirrored photo",
    at_most=0.3,
    unit="m",
    advice=_COMPARE,
    optional=True,
)
def limb_spread(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the largest change of a visible wrist or ankle in 3D between the photo and its mirror
    image.
    """
    keypoints = estimates.photo.keypoints
    if keypoints.world_spread is None:
        return None
    names = skeleton_named(keypoints.skeleton).names
    moves = {
        limb: float(keypoints.world_spread[person, names.index(joint)])
        for limb, joint in LIMB_ENDS.items()
        if joint in names and not result.people[person].hides(limb)
    }
    finite = {limb: move for limb, move in moves.items() if math.isfinite(move)}
    if not finite:
        return None
    worst = max(finite, key=finite.__getitem__)
    return finite[worst], (
        f"the {part_words(worst)} differs by {100 * finite[worst]:.0f} cm between the photo and "
        f"its mirror image: {_COMPARE}"
    )


# With more than six, readers find the pose of 31 % right, else of 57 %.
@_check(
    "Hidden parts of arms and legs",
    at_most=6,
    unit="count",
    advice="most of the pose is a guess: use only the visible limbs (`unseen` lists the hidden "
    "parts), or run a photo that shows the whole person",
    unmeasured=NO_BODY,
)
def hidden_limbs(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the number of hidden parts of arms and legs (``unseen``); not of people who lie."""
    subject = result.people[person]
    if not subject.has_body:
        return None
    if lies(result, person):
        return None, "this person lies, and one side of the body may hide the other"
    return float(len(subject.unseen))


# In sigmas of the joint fit, and beyond as many as it takes for an outlier. Of 1581 limb joints of
# 147 people who are likely right, whose keypoints were detected, none is farther off than 4.
@_check(
    "Given keypoints far from the body",
    at_most=ReprojectionSettings.outlier_sigmas,
    unit="sigma",
    contradicts=("pose",),
    warns=True,
    optional=True,
)
def given_keypoints(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the distance of your farthest keypoint from the body (sigma: 1 % of the stature)."""
    measured = result.people[person].measures
    off = measured.given_keypoints_px
    stature_px = measured.stature_px
    if not off or stature_px is None:
        return None
    worst = max(off, key=off.__getitem__)
    file_px = off[worst] * estimates.file_px_per_px
    return off[worst] / (ReprojectionSettings.sigma * stature_px), (
        f"your {keypoint_in_words(worst)} is {file_px:.0f} px away from the place that depth, "
        "floor and body suggest: check the file of --keypoints"
    )


# Of 202 visible joints that people marked in 12 photos one is farther, of 155 hidden ones nine.
@_check(
    "Given keypoints far from mask and detection",
    at_most=0.1,
    share_of="the diagonal of the person's box",
    contradicts=("pose",),
    warns=True,
    optional=True,
)
def contradicted_keypoints(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the distance of your farthest keypoint from the mask, or from the detected joint.

    As a share of the diagonal of the box.
    """
    is_given = estimates.is_given_keypoint
    contradicted = estimates.contradicted_px
    if is_given is None or contradicted is None or not is_given[person].any():
        return None
    off = contradicted[person]
    box = estimates.photo.people.boxes[person]
    worst = int(off.argmax())
    name = keypoint_in_words(estimates.photo.keypoints.joint_set.names[worst])
    return float(off[worst] / np.hypot(box[2] - box[0], box[3] - box[1])), (
        f"your {name} is {off[worst] * estimates.file_px_per_px:.0f} px away from the mask, or "
        "from the detected joint: check the file of --keypoints"
    )


def limb_keypoint_error(
    joints: FloatArray,
    points: FloatArray,
    confidence: FloatArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
) -> float | None:
    """Return the 0.9 quantile of the limb joints' distances from their confident keypoints, as a
    share of the box's diagonal.

    Args:
        joints: (55, 3) of the body, in the frame of the camera, meters.
        points: (J, 2) keypoints of the person, px.
        confidence: (J,) of the keypoints.
        box: (4,) of the person, px, x0 y0 x1 y1.
        skeleton: of the keypoints.
        camera: of the photo.

    Returns:
        None with fewer than four such keypoints or without a body.
    """
    names = skeleton_named(skeleton).names
    rows = {name: names.index(name) for name in _LIMB_JOINTS if name in names}
    chosen = [name for name, row in rows.items() if confidence[row] >= SURE_CONFIDENCE]
    diagonal = float(np.hypot(box[2] - box[0], box[3] - box[1]))
    if len(chosen) < _FEWEST or diagonal <= 0:
        return None
    pixels = (
        np.asarray(joints[[JOINT_INDEX[name] for name in chosen]], np.float64) @ camera.matrix.T
    )
    errors = np.linalg.norm(
        points[[rows[name] for name in chosen]] - pixels[:, :2] / pixels[:, 2:], axis=1
    )
    return (
        float(np.quantile(errors, _QUANTILE, method="lower")) / diagonal
        if np.isfinite(errors).all()
        else None
    )
