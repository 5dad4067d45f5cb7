"""HaMeR (Pavlakos et al. 2024): finger poses and how hands are turned, from its checkout.

Boxes come from the keypoints of people and crops are made here, so neither detectron2 nor mmpose is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.checkouts import Checkout
from physic_core.adapters.crops import crop_of, cut
from physic_core.adapters.hand_boxes import hand_boxes
from physic_core.adapters.mano import hands_from_mano, no_hands
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, check_photo, planes
from physic_core.devices import check_device
from physic_core.errors import BackendError
from physic_core.interfaces import HandEstimator, Options
from physic_human.hosting import CheckoutOptions, Host, batches, computing, fill, read_checkpoint, to_numpy

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

__all__ = ["Hamer", "HamerOptions"]

SIDE = 256
"""px of the network's square input."""
ASPECT = 192 / 256
"""Width over height of the part of its input that the network looks at: boxes are widened to it before they grow."""
_CHECKPOINT, _CONFIG = "hamer_ckpts/checkpoints/hamer.ckpt", "hamer_ckpts/model_config.yaml"
_MANO, _MEAN = "data/mano/MANO_RIGHT.pkl", "data/mano_mean_params.npz"


class HamerOptions(CheckoutOptions):
    """Settings of HaMeR."""

    weights: str = Field(
        default="hamer",
        description="a name of `physic weights list`, or the folder _DATA of hamer_demo_data.tar.gz and MANO",
    )
    least_confidence: float = Field(default=0.5, ge=0, le=1, description="of a hand's keypoints")
    least_size_px: float = Field(default=24.0, ge=0, description="longer side of a hand; fingers below are a guess")
    margin: float = Field(default=2.0, ge=1, le=4, description="side of the crop in sizes of the hand; 2.0 is HaMeR's")


class Hamer(HandEstimator):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    Options: ClassVar[type[Options]] = HamerOptions
    options: HamerOptions

    def __init__(self, options: HamerOptions | None = None) -> None:
        super().__init__(options)
        self._host = Host(
            Checkout(
                self.options.checkout,
                name="HaMeR",
                package="hamer.models",
                homepage="https://github.com/geopavlakos/hamer",
                needs=("pytorch_lightning", "yacs", "smplx", "timm", "einops"),
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
            BackendError: they are not HaMeR's.
        """
        check_device(device)
        checkpoint, config, mano, mean = (self._host.file(name) for name in (_CHECKPOINT, _CONFIG, _MANO, _MEAN))
        read = self._host.checkout.attribute("get_config", "hamer.configs")
        kind = self._host.checkout.attribute("HAMER")
        with computing(self._host.checkout, device):
            settings = read(str(config))
            settings.defrost()
            # Its own paths begin at the folder that Python was started in.
            settings.MANO.MODEL_PATH, settings.MANO.MEAN_PARAMS = str(mano.parent), str(mean)
            settings.MODEL.BBOX_SHAPE = [192, 256]
            settings.freeze()
            network = kind(settings, init_renderer=False)
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
            crops = np.concatenate(
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
        """(1, 3, 256, 256), red, green, blue."""
        taller = max((box[2] - box[0]) / ASPECT - (box[3] - box[1]), 0.0)
        grown = box + np.array([0.0, -taller / 2, 0.0, taller / 2])
        crop = crop_of(grown, SIDE, SIDE, padding=self.options.margin, grid="halves", mirrored=mirrored)
        return planes(cut(image, crop), IMAGENET_MEAN, IMAGENET_STD)

    def _run(self, network: object, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fingers (M, 15, 3, 3) and wrists (M, 1, 3, 3), as of right hands."""
        import torch

        with computing(self._host.checkout, self._host.device, half=self.options.half):
            answer = network({"img": torch.from_numpy(crops).to(self._host.device)})  # type: ignore[operator]
        try:
            hands = answer["pred_mano_params"]
            fingers, wrists = to_numpy(hands["hand_pose"]), to_numpy(hands["global_orient"])
        except (KeyError, TypeError) as error:
            raise BackendError(
                f"HaMeR's network answered {type(answer).__name__} without pred_mano_params: "
                "take the checkout of https://github.com/geopavlakos/hamer"
            ) from error
        return fingers.reshape(len(crops), 15, 3, 3), wrists.reshape(len(crops), 1, 3, 3)
