"""What backends share that show one hand at a time to a network of right hands, from the checkout of its project."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.adapters.crops import antialias_sigma, crop_around_box, resample_crop
from physic_core.adapters.hand_boxes import hand_boxes
from physic_core.adapters.mano import empty_hands, hands_from_mano
from physic_core.interfaces import HandEstimator
from physic_human.hosting import CheckoutOptions, Hosted, batches

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

__all__ = ["SIDE", "ManoHands", "ManoOptions"]

SIDE = 256
"""px of the square input of these networks."""


class ManoOptions(CheckoutOptions):
    """Base of their settings."""

    least_confidence: float = Field(
        default=0.5, ge=0, le=1, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper"
    )
    least_size_px: float = Field(default=24.0, ge=0, description="longer side of a hand; fingers below are a guess")
    margin: float = Field(default=2.0, ge=1, le=4, description="side of the crop in sizes of the hand")


class ManoHands(Hosted, HandEstimator):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    options: ManoOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Image (H, W, 3) and N people with keypoints -> finger rotations; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        network, options = self._host.loaded(), self.options
        found = hand_boxes(keypoints, least_confidence=options.least_confidence, least_size_px=options.least_size_px)
        if not len(found):
            return empty_hands(len(people))
        fingers, wrists = [], []
        for rows in batches(len(found), options.batch):
            shown = zip(found.boxes[rows], found.right[rows], strict=True)
            answer = self._run(network, np.stack([self._seen(image, box, mirrored=not right) for box, right in shown]))
            fingers.append(answer[0])
            wrists.append(answer[1])
        return hands_from_mano(
            len(people), found.person, found.right, np.concatenate(fingers), found.confidence, np.concatenate(wrists)
        )

    def _seen(self, image: UInt8Array, box: FloatArray, *, mirrored: bool) -> FloatArray:
        crop = crop_around_box(
            self._region(box), SIDE, SIDE, padding=self.options.margin, grid="halves", mirrored=mirrored
        )
        return self._fed(resample_crop(image, crop, sigma=antialias_sigma(crop)))

    def _region(self, box: FloatArray) -> FloatArray:
        """The box (4,) that grows by the margin."""
        return box

    @abstractmethod
    def _fed(self, crop: UInt8Array) -> FloatArray:
        """A cut-out (256, 256, 3), RGB, as the network takes it, without the axis of a batch."""

    @abstractmethod
    def _run(self, network: Any, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fingers (M, 15, 3) or (M, 15, 3, 3) and wrists (M, 1, 3) or (M, 1, 3, 3), as of right hands."""
