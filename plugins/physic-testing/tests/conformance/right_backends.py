"""Mocks without errors that must be loaded and that answer poorly for a photo in strange colours:
what every wrong backend is made from, and the proof that a right one passes.
"""

from __future__ import annotations

import inspect
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace

import numpy as np
from pydantic import Field
from stand_ins import answer_of

from physic_core.errors import BackendError
from physic_mock import backends as mocks

SIZE = (160, 120)
POOR = 0.2  # how far answers are off for a photo in strange colours


class Loaded:
    """Has to be loaded before it is asked."""

    loaded = False

    def load(self, device="cpu"):
        self.loaded = True

    def close(self):
        self.loaded = False


def right(mock, poor=lambda answer: answer, mirrored=None):
    """A mock that answers ``poor(answer)`` with red and blue exchanged, and for a mirrored photo
    ``mirrored(infer, image, *arguments)``, where ``infer`` knows the photo.
    """

    def infer(self, image, *rest):
        if not self.loaded:
            raise BackendError("not loaded: call load() first")

        def ask(*arguments):
            return deepcopy(answer_of(mock, self, arguments))

        with suppress(BackendError):
            return ask(image, *rest)
        try:
            return poor(ask(np.ascontiguousarray(image[..., ::-1]), *rest))
        except BackendError:
            if mirrored is None:
                raise
        return mirrored(ask, np.ascontiguousarray(image[:, ::-1]), *rest)

    infer.__signature__ = inspect.signature(mock.infer)
    name = f"Right{mock.__name__.removeprefix('Mock')}"
    return type(name, (Loaded, mock), {"infer": infer, "__module__": __name__})


def with_holes(people):
    masks = people.masks.copy()
    masks[:, :, ::2] = False
    return replace(people, masks=masks)


def bent(shape):
    return 1 + POOR * np.sin(np.arange(shape[1]) / 5)[None, :] * np.ones(shape[:2])


def bent_points(pointmap):
    points = pointmap.points * bent(pointmap.points.shape)[..., None]
    return replace(pointmap, points=points.astype(np.float32))


def mirrored_points(ask, image, hints):
    found = ask(image, hints)
    side = np.float32([-1, 1, 1])
    return replace(
        found, points=found.points[:, ::-1] * side, valid=found.valid[:, ::-1], up=found.up * side
    )


def moved_points(keypoints):
    return replace(keypoints, points=keypoints.points + 10.0)


def mirrored_people(ask, image, people, keypoints, intrinsics):
    found = ask(image, replace(people, masks=people.masks[..., ::-1]), keypoints, intrinsics)
    return replace(
        found,
        touch=found.touch[:, [1, 0, 3, 2, 4]],
        head=found.head * [-1, 1, 1],
    )


RightSegmenter = right(mocks.MockSegmenter, with_holes)
RightInpainter = right(mocks.MockInpainter)
RightMetricDepth = right(
    mocks.MockMetricDepth, lambda a: replace(a, depth=a.depth * np.float32(bent(a.depth.shape)))
)
RightPointmap = right(mocks.MockRelativePointmap, bent_points, mirrored_points)
RightKeypoints = right(mocks.MockKeypointDetector, moved_points)
RightBodies = right(mocks.MockBodyEstimator)
RightHands = right(mocks.MockHandEstimator)
RightObserver = right(mocks.MockPersonObserver, mirrored=mirrored_people)
RightContact = right(mocks.MockContactPrior)


class PointmapOptions(RightPointmap.Options):
    """Settings of a point map up to scale."""

    unknown: str = Field("scale", description="Ambiguity of the returned point map.")


RightPointmap.Options = PointmapOptions

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
