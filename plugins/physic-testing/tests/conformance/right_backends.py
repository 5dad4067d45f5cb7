"""Backends that know the answers: what every wrong backend is made from, and the proof that a right
one passes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.body.joints import JOINT_INDEX
from physic_core.errors import BackendError
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Hands,
    Keypoints,
    Observations,
    People,
    Pointmap,
)
from physic_testing.conformance.cases import CASES, SCENE_UNIT, build_case
from physic_testing.conformance.truth import true_flexion, true_touch

SIZE = (160, 120)
POOR = 0.2  # how far answers are off for a photo in strange colours


class RightOptions(interfaces.Options):
    """Settings of a backend that is right."""

    level: float = Field(1.0, ge=0, description="Does nothing; any number works.")


class Knowing:
    """Looks the photo up."""

    Options: ClassVar[type[interfaces.Options]] = RightOptions
    loaded = False

    def load(self, device="cpu"):
        self.loaded = True

    def close(self):
        self.loaded = False

    def look_up(self, image):
        """The case, whether its people are in the image, and whether red and blue are exchanged."""
        if not self.loaded:
            raise BackendError("not loaded: call load() first")
        for exchanged in (False, True):
            seen = image[..., ::-1] if exchanged else image
            for name in CASES:
                case = build_case(name, SIZE)
                for people, picture in ((True, case.photo), (False, case.empty)):
                    if np.array_equal(picture, seen):
                        return case, people, exchanged
        raise BackendError("no photo of a world")

    def rows(self, case, people):
        """Which person of the case each given one is."""
        every = build_case(case.name, SIZE).people.masks
        return [int(np.argmax([(mask & own).sum() for own in every])) for mask in people.masks]


class RightSegmenter(Knowing, interfaces.Segmenter):
    def infer(self, image):
        case, there, poor = self.look_up(image)
        masks = case.people.masks.copy() if there else np.zeros((0, *image.shape[:2]), bool)
        if poor:
            masks[:, ::2] = False
        boxes = case.people.boxes[: len(masks)].copy()
        floor = case.world.empty_floor_mask & ~masks.any(axis=0) if case.world is not None else None
        return People(masks, boxes, case.people.scores[: len(masks)].copy(), floor)


class RightInpainter(Knowing, interfaces.Inpainter):
    def infer(self, image, mask):
        case, _, _ = self.look_up(image)
        return np.where(mask[..., None], case.empty, image)


def bent(shape):
    return 1 + POOR * np.sin(np.arange(shape[1]) / 5)[None, :] * np.ones(shape[:2])


class RightMetricDepth(Knowing, interfaces.MetricDepth):
    def infer(self, image, hints):
        case, there, poor = self.look_up(image)
        points = (case.original if there else case.scene).points
        depth = points[..., 2] * np.float32(SCENE_UNIT) * (bent(image.shape) if poor else 1)
        return DepthMap(depth.astype(np.float32), hints.intrinsics, 0.1, ("the truth",))


class RightPointmap(Knowing, interfaces.RelativePointmap):
    def infer(self, image, hints):
        side = 1
        try:
            case, there, poor = self.look_up(image)
        except BackendError:  # mirrored
            case, there, poor = self.look_up(image[:, ::-1])
            side = -1
        points = (case.original if there else case.scene).points[:, ::side] * [side, 1, 1]
        points = (points * (bent(image.shape)[..., None] if poor else 1)).astype(np.float32)
        valid = np.isfinite(points).all(axis=2)
        camera = hints.intrinsics or case.intrinsics
        up = case.floor.normal * [side, 1, 1]
        return Pointmap(points, valid, "scale", camera, up=up, up_sigma=1.0)


class RightKeypoints(Knowing, interfaces.KeypointDetector):
    def infer(self, image, people):
        case, _, poor = self.look_up(image)
        rows = self.rows(case, people)
        points = case.keypoints.points[rows].copy()
        tall = (people.boxes[:, 3] - people.boxes[:, 1]).reshape(-1, 1, 1)
        flat = (points - points[:, 23:25].mean(axis=1, keepdims=True)) * 1.7 / np.maximum(tall, 1)
        world = np.concatenate([flat, np.zeros_like(flat[..., :1])], axis=2)
        return Keypoints(
            points + POOR / 2 * tall * poor,
            case.keypoints.confidence[rows],
            case.keypoints.skeleton,
            world,
        )


class RightBodies(Knowing, interfaces.BodyEstimator):
    def infer(self, image, people, intrinsics, keypoints, hints):
        case, _, _ = self.look_up(image)
        rows = self.rows(case, people)
        every = case.bodies.parameters
        own = {name: value[rows] for name, value in vars(every).items()}
        return Bodies(replace(every, **own), "embedded", case.bodies.observed[rows])


class RightHands(Knowing, interfaces.HandEstimator):
    def infer(self, image, people, keypoints):
        case, _, _ = self.look_up(image)
        rows = self.rows(case, people)
        truth = case.bodies.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1)[rows]
        wrists = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
        seen = case.bodies.observed[np.ix_(rows, wrists)]
        return Hands(both.reshape(-1, 2, 15, 3), np.where(seen, 0.9, 0.2))


class RightObserver(Knowing, interfaces.PersonObserver):
    def infer(self, image, people, keypoints):
        try:
            case, _, _ = self.look_up(image)
            masks, parts, bones = people.masks, range(5), range(4)
        except BackendError:  # mirrored
            case, _, _ = self.look_up(image[:, ::-1])
            masks, parts, bones = people.masks[..., ::-1], (1, 0, 3, 2, 4), (1, 0, 3, 2)
        rows = self.rows(case, replace(people, masks=masks))
        world = build_case(case.name, SIZE).world if len(people) else None
        unknown = Observations.unknown(len(people))
        if world is None:
            return unknown
        touch = 0.1 + 0.8 * true_touch(world)[np.ix_(rows, parts)]
        return replace(
            unknown,
            touch=touch,
            touch_share=np.full(5, 0.5),
            flexion=true_flexion(world)[np.ix_(rows, bones)],
            flexion_sigma=np.full((len(rows), 4), 5.0),
        )


class RightContact(Knowing, interfaces.ContactPrior):
    def infer(self, image, people, bodies):
        case, _, _ = self.look_up(image)
        world = build_case(
            "several people" if case.name == "several people" else "one person", SIZE
        ).truth
        touching = world.contact if case.world is None else case.world.contact
        return ContactProbability(0.1 + 0.8 * touching[self.rows(case, people)], world.topology)


RIGHT = (
    RightSegmenter,
    RightInpainter,
    RightMetricDepth,
    RightPointmap,
    RightKeypoints,
    RightBodies,
    RightHands,
    RightObserver,
    RightContact,
)
