"""Base class of hand estimators whose network takes one right hand at a time."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.adapters.crops import antialias_sigma, crop_around_box, resample_crop
from physic_core.interfaces import HandEstimator, Share
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions, batch_slices
from physic_human.hand_boxes import hand_boxes
from physic_human.mano import empty_hands, hands_from_mano

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

SIDE = 256
"""Side of the networks' square input, px."""


class ManoOptions(CheckoutOptions):
    """Base class of the settings of MANO hand estimators."""

    least_confidence: Share = Field(
        default=0.5, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper"
    )
    least_size_px: float = Field(
        default=24.0, ge=0, le=100_000, description="longer side of a hand; fingers below are a guess"
    )
    margin: float = Field(default=2.0, ge=1, le=4, description="side of the crop in sizes of the hand")


class ManoHandEstimator(CheckoutBackend, HandEstimator):
    """Base class of estimators of MANO rotations of every hand with keypoints. Left hands are mirrored."""

    options: ManoOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the finger rotations of N people; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        network, options = self._checkout_network.loaded(), self.options
        found = hand_boxes(keypoints, least_confidence=options.least_confidence, least_size_px=options.least_size_px)
        if not len(found):
            return empty_hands(len(people))
        fingers, wrists = [], []
        for rows in batch_slices(len(found), options.batch):
            shown = zip(found.boxes[rows], found.right[rows], strict=True)
            answer = self._run(
                network, np.stack([self._hand_input(image, box, mirrored=not right) for box, right in shown])
            )
            fingers.append(answer[0])
            wrists.append(answer[1])
        return hands_from_mano(
            len(people), found.person, found.right, np.concatenate(fingers), found.confidence, np.concatenate(wrists)
        )

    def _hand_input(self, image: UInt8Array, box: FloatArray, *, mirrored: bool) -> FloatArray:
        """Crop and preprocess a hand."""
        crop = crop_around_box(
            self._expand_box(box), SIDE, SIDE, padding=self.options.margin, grid="halves", mirrored=mirrored
        )
        return self._preprocess(resample_crop(image, crop, sigma=antialias_sigma(crop)))

    def _expand_box(self, box: FloatArray) -> FloatArray:
        """Return the box (4,) that grows by the margin."""
        return box

    @abstractmethod
    def _preprocess(self, crop: UInt8Array) -> FloatArray:
        """Convert an RGB crop (256, 256, 3) to the network's input without a batch axis."""

    @abstractmethod
    def _run(self, network: Any, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Run the network: fingers (M, 15, 3) or (M, 15, 3, 3) and wrists (M, 1, 3) or (M, 1, 3, 3) of right hands."""
