"""WiLoR (Potamias et al. 2025) by the network of WiLoR-mini: finger poses and how hands are turned.

Only its network is used: boxes come from the keypoints of people and crops are made here, so neither the detector of
hands (AGPL) nor its downloads are needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.checkouts import Checkout
from physic_core.adapters.crops import crop_of, cut
from physic_core.adapters.hand_boxes import hand_boxes
from physic_core.adapters.mano import hands_from_mano, no_hands
from physic_core.adapters.pictures import check_photo
from physic_core.devices import check_device
from physic_core.errors import BackendError
from physic_core.interfaces import HandEstimator, Options
from physic_human.hosting import CheckoutOptions, Host, batches, computing, fill, read_checkpoint, to_numpy

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

__all__ = ["Wilor", "WilorOptions"]

SIDE = 256
"""px of the network's square input."""
_FILES = ("wilor_final.ckpt", "MANO_RIGHT.pkl", "mano_mean_params.npz")
_FOCAL = 5000


class WilorOptions(CheckoutOptions):
    """Settings of WiLoR."""

    weights: str = Field(
        default="wilor-mini",
        description="a name of `physic weights list`, or a folder with wilor_final.ckpt, MANO_RIGHT.pkl and "
        "mano_mean_params.npz",
    )
    least_confidence: float = Field(
        default=0.5, ge=0, le=1, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper"
    )
    least_size_px: float = Field(default=24.0, ge=0, description="longer side of a hand; fingers below are a guess")
    margin: float = Field(
        default=2.5, ge=1, le=4, description="side of the crop in sizes of the hand; 2.5 in WiLoR-mini, 2.0 in WiLoR"
    )
    swap_channels: bool = Field(
        default=False,
        description="show the network blue as red, as the code of the PhySIC paper does by mistake; worse, to compare",
    )


class Wilor(HandEstimator):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    Options: ClassVar[type[Options]] = WilorOptions
    options: WilorOptions

    def __init__(self, options: WilorOptions | None = None) -> None:
        super().__init__(options)
        self._host = Host(
            Checkout(
                self.options.checkout,
                name="WiLoR-mini",
                package="wilor_mini.models.wilor",
                homepage="https://github.com/warmshao/WiLoR-mini",
                needs=("smplx", "timm"),
            ),
            self.options.weights,
        )

    def missing(self) -> tuple[str, ...]:
        """Of checkout, packages and weights."""
        return self._host.missing()

    def fingerprint(self) -> str:
        """Changes with weights and code."""
        return self._host.fingerprint()

    def load(self, device: str = "cpu") -> None:
        """Build the network and fill it.

        Raises:
            DeviceError: the device is not there.
            WeightsMissingError: code or weights are missing.
            BackendError: they are not WiLoR-mini's.
        """
        check_device(device)
        checkpoint, mano, mean = (self._host.file(name) for name in _FILES)
        kind = self._host.checkout.attribute("WiLor")
        with computing(self._host.checkout, device):
            network = kind(mano_model_path=str(mano), mano_mean_path=str(mean), focal_length=_FOCAL, image_size=SIDE)
            state = read_checkpoint(checkpoint, trusted=self.options.trust_checkpoint)
            fill(network, state.get("state_dict", state), checkpoint)
            self._host.network, self._host.device = network.eval().to(device), device

    def close(self) -> None:
        """Let go of the network."""
        self._host.close()

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Image (H, W, 3) and N people with keypoints -> finger rotations; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        check_photo(image)
        network = self._host.loaded()
        options = self.options
        found = hand_boxes(keypoints, least_confidence=options.least_confidence, least_size_px=options.least_size_px)
        if not len(found):
            return no_hands(len(people))
        fingers, wrists = [], []
        for rows in batches(len(found), options.batch):
            crops = np.stack(
                [
                    self._crop(image, box, mirrored=not right)
                    for box, right in zip(found.boxes[rows], found.right[rows], strict=True)
                ]
            )
            answer = self._run(network, crops)
            fingers.append(answer[0])
            wrists.append(answer[1])
        return hands_from_mano(
            len(people), found.person, found.right, np.concatenate(fingers), found.confidence, np.concatenate(wrists)
        )

    def _crop(self, image: UInt8Array, box: FloatArray, *, mirrored: bool) -> FloatArray:
        """(256, 256, 3) grey levels in the order blue, green, red: the network exchanges them itself."""
        crop = crop_of(box, SIDE, SIDE, padding=self.options.margin, grid="halves", mirrored=mirrored)
        shrink = abs(crop.step[0]) / 2
        seen = cut(image, crop, sigma=(shrink - 1) / 2 if shrink > 1.1 else 0.0)
        return np.asarray(seen if self.options.swap_channels else seen[..., ::-1], np.float32)

    def _run(self, network: object, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fingers (M, 15, 3) and wrists (M, 1, 3), as of right hands."""
        import torch

        with computing(self._host.checkout, self._host.device, half=self.options.half):
            answer = network(torch.from_numpy(crops).to(self._host.device))  # type: ignore[operator]
        if not isinstance(answer, dict) or not {"hand_pose", "global_orient"} <= answer.keys():
            raise BackendError(
                f"WiLoR-mini's network answered {type(answer).__name__}, where its releases answer a dictionary with "
                "hand_pose and global_orient: another revision of the checkout is needed"
            )
        return to_numpy(answer["hand_pose"]), to_numpy(answer["global_orient"])
