"""Mocks of what is seen in the image: masks, keypoints, the picture without people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import Keypoints, People
from physic_mock.noise import generator, ragged
from physic_mock.recognition import MockOptions, match_people, recognise

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array

__all__ = ["MockInpainter", "MockKeypointDetector", "MockSegmenter"]


class SegmenterOptions(MockOptions):
    """Settings of :class:`MockSegmenter`."""

    raggedness_px: float = Field(0.7, ge=0, le=20, description="How far the masks' borders stray, px.")
    floor: bool = Field(True, description="Whether the floor is looked for; false answers None.")


class MockSegmenter(interfaces.Segmenter):
    """The world's visible masks with ragged borders, and its floor."""

    Options = SegmenterOptions

    def infer(self, image: UInt8Array) -> People:
        """Image (H, W, 3) of a world -> the people still in it.

        Raises:
            BackendError: the image shows no world that the options name.
        """
        assert isinstance(self.options, SegmenterOptions)
        found = recognise(image, self.options)
        world, rng = found.world, generator(found.world, self.options.noise_seed, "masks")
        taken = np.zeros(image.shape[:2], bool)
        masks: list[BoolArray] = []
        for mask, present in zip(world.masks, found.present, strict=True):
            stray = ragged(mask, self.options.raggedness_px, rng) & ~taken
            if present and stray.any():
                masks.append(stray)
                taken |= stray
        scores = 0.95 - 0.02 * np.arange(len(masks))
        return People(
            masks=np.stack(masks) if masks else np.zeros((0, *image.shape[:2]), bool),
            boxes=np.array([_box(mask) for mask in masks]).reshape(-1, 4),
            scores=scores,
            floor=(world.empty_floor_mask & ~found.people) if self.options.floor else None,
        )


class MockInpainter(interfaces.Inpainter):
    """The world's own picture without people, in the hole."""

    Options = MockOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) of a world, mask (H, W) -> image; unchanged where the mask is False, shadows included.

        Raises:
            BackendError: the image shows no world that the options name.
        """
        assert isinstance(self.options, MockOptions)
        filled: UInt8Array = image.copy()
        filled[mask] = recognise(image, self.options).world.empty_image[mask]
        return filled


class KeypointOptions(MockOptions):
    """Settings of :class:`MockKeypointDetector`."""

    skeleton: Literal["coco17", "coco23", "blazepose33"] = Field("blazepose33", description="Joint set to answer.")
    noise: float = Field(0.006, ge=0, le=0.2, description="Standard deviation, as a share of the box's larger side.")
    hidden_noise: float = Field(0.02, ge=0, le=0.5, description="The same for points that something hides.")
    hidden_confidence: float = Field(0.3, ge=0, le=1, description="Confidence of hidden points; others have about .9.")


class MockKeypointDetector(interfaces.KeypointDetector):
    """The world's keypoints with noise; hidden ones stray more and are less sure."""

    Options = KeypointOptions

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) of a world and people of it -> their keypoints.

        Raises:
            BackendError: the image shows no world that the options name, or a person is nobody of it.
        """
        assert isinstance(self.options, KeypointOptions)
        options = self.options
        found = recognise(image, options)
        rows = match_people(found, people)
        rng = generator(found.world, options.noise_seed, "keypoints")
        truth, visible = found.world.keypoints[options.skeleton], found.world.visible[options.skeleton]
        size = (found.world.boxes[:, 2:] - found.world.boxes[:, :2]).max(axis=1)
        sigma = np.where(visible, options.noise, options.hidden_noise) * size[:, None]
        points = truth + sigma[..., None] * rng.normal(size=truth.shape)
        confidence = np.where(visible, rng.uniform(0.85, 0.98, visible.shape), options.hidden_confidence)
        return Keypoints(points=points[rows], confidence=confidence[rows], skeleton=options.skeleton)


def _box(mask: BoolArray) -> FloatArray:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
