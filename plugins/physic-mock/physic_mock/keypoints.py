"""Mock of a keypoint detector: true keypoints with noise, larger at hidden points, and left-right
swaps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.adapters.people import box_iou
from physic_core.types import Keypoints, skeleton_named
from physic_mock.noise import bernoulli, seeded_rng
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world
from physic_testing.conformance.true_keypoints import world_keypoints
from physic_testing.worlds import SKELETONS

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People, UInt8Array
    from physic_mock.recognition import RecognisedWorld

_LEG = ("knee", "ankle", "heel", "big_toe", "small_toe", "foot_tip")
_ARM = (
    *("elbow", "wrist", "hand_root"),
    *(
        f"{finger}{k}"
        for finger in ("thumb", "index", "middle", "ring", "pinky")
        for k in (1, 2, 3, "_tip")
    ),
)


_POINT_SIGMA = 0.016  # along x and along y, over the larger side of the person's box
_HIDDEN_SIGMA = 0.065  # the same of hidden points
_LIMB_SHARE = 0.5  # of the variance, in common for all points of an arm, a leg or the rest
# Degrees of Student's t distribution of the errors, with one scale for each arm, each leg and the
# rest.
_FREEDOM = 1.5
_HIDDEN_CONFIDENCE = 0.3  # mean of hidden points, give or take half of it; others have about .9
_OVERCONFIDENT = 0.5  # share of hidden points that look sure
_UNSURE = 0.15  # share of points in sight that do not
# Share of the limbs of people whose boxes overlap that are found at the other person's.
_NEIGHBOURS_LIMBS = 0.05
_SWAPPED = 0.02  # share of people's pairs of arms, and of legs, whose left and right are swapped


class KeypointOptions(MockOptions):
    """Options of :class:`MockKeypointDetector`."""

    skeleton: Literal["coco17", "coco23", "blazepose33", "coco_wholebody133", "halpe26"] = Field(
        "blazepose33", description="Joint set to answer."
    )


class MockKeypointDetector(interfaces.KeypointDetector):
    """Keypoint detector that returns a world's keypoints with noise and left-right swaps."""

    written_for = 1
    Options = KeypointOptions
    options: KeypointOptions

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return the keypoints of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is not in it.
        """
        options = self.options
        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        rng = seeded_rng(found.world, options.noise_seed, "keypoints")
        skeleton = SKELETONS.get(options.skeleton) or skeleton_named(options.skeleton)
        truth, visible = world_keypoints(found.world, skeleton)
        size = (found.world.boxes[:, 2:] - found.world.boxes[:, :2]).max(axis=1)
        sigma = options.noise * np.where(visible, _POINT_SIGMA, _HIDDEN_SIGMA) * size[:, None]
        errors = _limb_errors(rng.normal(size=truth.shape), found, skeleton.names, options)
        points = truth + sigma[..., None] * errors
        sure = rng.uniform(0.85, 0.98, visible.shape)
        unsure = rng.uniform(0.5, 1.5, visible.shape)
        unsure_rng = seeded_rng(found.world, options.noise_seed, "unsure keypoints")
        missed = bernoulli(_UNSURE, options.noise, unsure_rng.random(visible.shape))
        bold = bernoulli(_OVERCONFIDENT, options.noise, rng.random(visible.shape))
        looks_sure = np.where(visible, ~missed, bold)
        confidence = np.where(looks_sure, sure, np.minimum(unsure * _HIDDEN_CONFIDENCE, 1.0))
        for person, swaps in enumerate(
            bernoulli(_SWAPPED, options.noise, rng.random((len(truth), 2)))
        ):
            for limb, swap in zip((_ARM, _LEG), swaps, strict=True):
                if swap:
                    order = _swap_sides_order(skeleton.names, limb)
                    points[person], confidence[person] = (
                        points[person, order],
                        confidence[person, order],
                    )
        points = _with_neighbours_limbs(points, found, skeleton.names, options)
        return Keypoints(points=points[rows], confidence=confidence[rows], skeleton=skeleton)


def _limb_errors(
    own: FloatArray, found: RecognisedWorld, names: tuple[str, ...], options: KeypointOptions
) -> FloatArray:
    """Return normal errors (N, J, 2) with a part in common and one scale for each arm, each leg and
    the rest.
    """
    limbs = sorted({_limb_of(name) for name in names})
    limb = [limbs.index(_limb_of(name)) for name in names]
    rng = seeded_rng(found.world, options.noise_seed, "keypoints of limbs")
    common = rng.normal(size=(len(own), len(limbs), 2))[:, limb]
    scale = np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, (len(own), len(limbs))))
    errors: FloatArray = np.sqrt(_LIMB_SHARE) * common + np.sqrt(1 - _LIMB_SHARE) * own
    return errors * scale[:, limb, None]


def _with_neighbours_limbs(
    points: FloatArray, found: RecognisedWorld, names: tuple[str, ...], options: KeypointOptions
) -> FloatArray:
    """Return points (N, J, 2) where some limbs are those of the person whose box overlaps the own
    one most.
    """
    rng = seeded_rng(found.world, options.noise_seed, "limbs of neighbours")
    limbs = sorted({_limb_of(name) for name in names} - {"rest"})
    limb = np.array([_limb_of(name) for name in names])
    taken = bernoulli(_NEIGHBOURS_LIMBS, options.noise, rng.random((len(points), len(limbs))))
    overlap = box_iou(found.world.boxes, found.world.boxes)
    np.fill_diagonal(overlap, 0)
    changed: FloatArray = points.copy()
    for person, other in enumerate(overlap.argmax(1)):
        if overlap[person, other] > 0:
            rows = np.isin(limb, np.array(limbs)[taken[person]])
            changed[person, rows] = points[other, rows]
    return changed


def _limb_of(name: str) -> str:
    """Return "left arm", "right leg" and so on for a keypoint; "rest" for head and trunk."""
    side, _, point = name.partition("_")
    if side not in ("left", "right") or point not in (*_ARM, *_LEG):
        return "rest"
    return f"{side} {'arm' if point in _ARM else 'leg'}"


def _swap_sides_order(names: tuple[str, ...], limb: tuple[str, ...]) -> list[int]:
    """Return the order of keypoints after a left-right swap of the arms or the legs."""
    order = list(range(len(names)))
    for i, name in enumerate(names):
        side, _, point = name.partition("_")
        if point in limb and side in ("left", "right"):
            order[i] = names.index(f"{'right' if side == 'left' else 'left'}_{point}")
    return order
