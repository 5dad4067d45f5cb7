"""Mock of a keypoint detector: true keypoints with noise, larger at hidden points, and left-right
swaps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.backends.people import box_iou
from physic_core.types import Keypoints, mirrored_order, skeleton_named
from physic_mock.noise import (
    HIDDEN_CONFIDENCE,
    HIDDEN_POINT_SIGMA,
    LIMB_SHARE,
    POINT_FREEDOM,
    POINT_SIGMA,
    Noise,
)
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world
from physic_testing.worlds import SKELETONS

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People, UInt8Array

_LEG = ("knee", "ankle", "heel", "big_toe", "small_toe", "foot_tip")
_ARM = (
    *("elbow", "wrist", "hand_root"),
    *(
        f"{finger}{k}"
        for finger in ("thumb", "index", "middle", "ring", "pinky")
        for k in (1, 2, 3, "_tip")
    ),
)


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
        recognised = recognise_world(image)
        rows = match_masks_to_world(recognised, people)
        noise = Noise(recognised.world, self.options)
        rng = noise.rng("keypoints")
        skeleton = SKELETONS.get(self.options.skeleton) or skeleton_named(self.options.skeleton)
        names = skeleton.names
        # the kit imports torch, which a check of a configuration does not need
        from physic_testing.conformance.true_keypoints import true_keypoints_px

        truth, visible = true_keypoints_px(recognised.world, skeleton)
        boxes = recognised.world.boxes
        size = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)[:, None]
        sigma = noise.factor * np.where(visible, POINT_SIGMA, HIDDEN_POINT_SIGMA) * size
        points = truth + sigma[..., None] * _limb_errors(rng.normal(size=truth.shape), noise, names)
        high_confidence = rng.uniform(0.85, 0.98, visible.shape)
        low_confidence = rng.uniform(0.5, 1.5, visible.shape)
        missed = noise.draw_is_below("unsure", noise.rng("unsure keypoints").random(visible.shape))
        bold = noise.draw_is_below("overconfident", rng.random(visible.shape))
        looks_sure = np.where(visible, ~missed, bold)
        confidence = np.where(
            looks_sure, high_confidence, np.minimum(low_confidence * HIDDEN_CONFIDENCE, 1.0)
        )
        swaps = noise.draw_is_below("swapped sides", rng.random((len(truth), 2)))
        for person, k in np.argwhere(swaps):
            order = _swap_sides_order(names, (_ARM, _LEG)[k])
            points[person] = points[person, order]
            confidence[person] = confidence[person, order]
        points = _with_neighbours_limbs(points, noise, names)
        return Keypoints(points=points[rows], confidence=confidence[rows], skeleton=skeleton)


def _limb_errors(of_point: FloatArray, noise: Noise, names: tuple[str, ...]) -> FloatArray:
    """Return normal errors (N, J, 2) with a part in common and one scale for each arm, each leg and
    the rest.
    """
    limbs = sorted({_limb_of(name) for name in names})
    limb = [limbs.index(_limb_of(name)) for name in names]
    rng = noise.rng("keypoints of limbs")
    common = rng.normal(size=(len(of_point), len(limbs), 2))[:, limb]
    scale = np.sqrt(POINT_FREEDOM / rng.chisquare(POINT_FREEDOM, (len(of_point), len(limbs))))
    errors: FloatArray = np.sqrt(LIMB_SHARE) * common + np.sqrt(1 - LIMB_SHARE) * of_point
    return errors * scale[:, limb, None]


def _with_neighbours_limbs(points: FloatArray, noise: Noise, names: tuple[str, ...]) -> FloatArray:
    """Return points (N, J, 2) where some limbs are those of the person whose box overlaps the own
    one most.
    """
    limbs = sorted({_limb_of(name) for name in names} - {"rest"})
    limb = np.array([_limb_of(name) for name in names])
    draws = noise.rng("limbs of neighbours").random((len(points), len(limbs)))
    taken = noise.draw_is_below("limbs of neighbours", draws)
    overlap = box_iou(noise.world.boxes, noise.world.boxes)
    np.fill_diagonal(overlap, 0)
    changed: FloatArray = points.copy()
    for person, other in enumerate(overlap.argmax(1)):
        if overlap[person, other] > 0:
            moved = np.isin(limb, np.array(limbs)[taken[person]])
            changed[person, moved] = points[other, moved]
    return changed


def _limb_of(name: str) -> str:
    """Return "left arm", "right leg" and so on for a keypoint; "rest" for head and trunk."""
    side, _, point = name.partition("_")
    if side not in ("left", "right") or point not in (*_ARM, *_LEG):
        return "rest"
    return f"{side} {'arm' if point in _ARM else 'leg'}"


def _swap_sides_order(names: tuple[str, ...], limb: tuple[str, ...]) -> list[int]:
    """Return the order of keypoints after a left-right swap of the arms or the legs."""
    others = mirrored_order(names)
    return [others[i] if n.partition("_")[2] in limb else i for i, n in enumerate(names)]
