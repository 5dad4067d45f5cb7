"""Estimate finger and wrist rotations with WiLoR (Potamias et al. 2025), by the network of WiLoR-mini.

Only its network is used. Boxes come from the people's keypoints and crops are made here, so neither the hand detector
(AGPL) nor its downloads are needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.crops import antialias_sigma, crop_around_box, resample_crop
from physic_core.errors import BackendError
from physic_core.interfaces import HandEstimator, Options, Share
from physic_human.checkout_backend import (
    CheckoutBackend,
    CheckoutOptions,
    CheckoutProject,
    batch_slices,
    inference_context,
    to_numpy,
)
from physic_human.chumpy_free import chumpy_free_copy
from physic_human.hand_boxes import hand_boxes
from physic_human.mano import empty_hands, hands_from_mano

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

_FILES = ("wilor_final.ckpt", "MANO_RIGHT.pkl", "mano_mean_params.npz")
_FOCAL = 5000
_SIDE = 256  # of the network's square input, px


class WilorOptions(CheckoutOptions):
    """Settings of WiLoR."""

    weights: str = Field(
        default="wilor-mini",
        description="a name of `physic weights list`, or a folder with wilor_final.ckpt, MANO_RIGHT.pkl and "
        "mano_mean_params.npz",
    )
    least_confidence: Share = Field(
        default=0.5, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper"
    )
    least_size_px: float = Field(
        default=24.0, ge=0, le=100_000, description="longer side of a hand; fingers below are a guess"
    )
    margin: float = Field(
        default=2.5, ge=1, le=4, description="side of the crop in sizes of the hand; 2.5 in WiLoR-mini, 2.0 in WiLoR"
    )
    swap_channels: bool = Field(
        default=False,
        description="show the network blue as red, as the code of the PhySIC paper does by mistake; worse, to compare",
    )


class Wilor(CheckoutBackend, HandEstimator):
    """Hand estimator: MANO rotations by WiLoR of every hand with keypoints. Left hands are mirrored."""

    Options: ClassVar[type[Options]] = WilorOptions
    options: WilorOptions
    project: ClassVar[CheckoutProject] = CheckoutProject(
        "WiLoR-mini",
        "wilor_mini.models.wilor",
        "https://github.com/warmshao/WiLoR-mini",
        ("smplx", "timm", "torchvision", "roma"),
        "ebec42f94c389070cdd7dda6fd1bf0b4a659c960",
    )

    def _build(self, device: str) -> None:
        """Build the network and load its weights."""
        checkpoint, mano, mean = (self._checkout_network.file(name) for name in _FILES)
        kind = self._checkout_network.checkout.attribute("WiLor")
        with chumpy_free_copy(mano, "mano") as plain, inference_context(self._checkout_network.checkout, device):
            network = kind(mano_model_path=str(plain), mano_mean_path=str(mean), focal_length=_FOCAL, image_size=_SIDE)
            self._checkout_network.set_network(self._load_checkpoint(network, checkpoint), device)

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
        """Crop a hand to (256, 256, 3) grey levels in BGR, which the network reorders itself."""
        crop = crop_around_box(box, _SIDE, _SIDE, padding=self.options.margin, grid="halves", mirrored=mirrored)
        shown = resample_crop(image, crop, sigma=antialias_sigma(crop))
        return np.asarray(shown if self.options.swap_channels else shown[..., ::-1], np.float32)

    def _run(self, network: object, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Run the network: fingers (M, 15, 3) and wrists (M, 1, 3) of right hands."""
        import torch

        with inference_context(self._checkout_network.checkout, self._checkout_network.device, half=self.options.half):
            answer = network(torch.from_numpy(crops).to(self._checkout_network.device))  # type: ignore[operator]
        if not isinstance(answer, dict) or not {"hand_pose", "global_orient"} <= answer.keys():
            raise BackendError(
                f"WiLoR-mini's network returned {type(answer).__name__}, where its releases answer a dictionary with "
                "hand_pose and global_orient: another revision of the checkout is needed"
            )
        return to_numpy(answer["hand_pose"]), to_numpy(answer["global_orient"])
