"""Estimate finger and wrist rotations with WiLoR (Potamias et al. 2025), by the
network of WiLoR-mini.

Only its network is used. Boxes come from the people's keypoints and crops are made here, so neither
the hand detector (AGPL) nor its downloads are needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import HandEstimator, Share
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions
from physic_human.hands import chumpy_free_copy, empty_hands, hands_from_mano, visible_hand_boxes
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP
from physic_networks.top_down import antialias_sigma, crop_around_box, resample_crop

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

_FILES = ("wilor_final.ckpt", "MANO_RIGHT.pkl", "mano_mean_params.npz")
_FOCAL = 5000
_SIDE = 256  # of the network's square input, px
_MARGIN = 2.5  # side of the crop in sizes of the hand, as in WiLoR-mini
_LEAST_SIZE_PX = 24.0  # longer side of a hand; fingers below are a guess


class WilorOptions(CheckoutOptions):
    """Settings of WiLoR."""

    weights: str = Field("wilor-mini", description=WEIGHTS_HELP)
    least_confidence: Share = Field(
        default=0.5,
        description="minimum confidence of a hand's keypoints; 0.7 in the code of the PhySIC paper",
    )


class Wilor(CheckoutBackend, HandEstimator):
    """Hand estimator: MANO rotations by WiLoR of every hand with keypoints.

    Left hands are mirrored.
    """

    written_for = 1
    Options = WilorOptions
    options: WilorOptions
    project = Checkout(
        name="WiLoR-mini",
        package="wilor_mini.models.wilor",
        homepage="https://github.com/warmshao/WiLoR-mini",
        commit="ebec42f94c389070cdd7dda6fd1bf0b4a659c960",
        needs=("smplx", "timm", "torchvision", "roma"),
    )

    def build(self, device: str) -> Any:
        """Build the network and load its weights."""
        checkpoint, mano, mean = (self.file(name) for name in _FILES)
        kind = self.checkout.attribute("WiLor")
        with chumpy_free_copy(mano) as plain, self.inference():
            network = kind(
                mano_model_path=str(plain),
                mano_mean_path=str(mean),
                focal_length=_FOCAL,
                image_size=_SIDE,
            )
            return self.load_checkpoint_into(network, checkpoint)

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the finger rotations of N people; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the output of the network has another form.
        """
        options = self.options
        boxes = visible_hand_boxes(
            keypoints,
            least_confidence=options.least_confidence,
            least_size_px=_LEAST_SIZE_PX,
        )
        shown = zip(boxes.boxes, boxes.is_right, strict=True)
        crops = [self._hand_input(image, box, mirrored=not right) for box, right in shown]
        outputs = self.run({"img": np.array(crops)})
        if not outputs:
            return empty_hands(len(people))
        fingers, wrists = outputs
        return hands_from_mano(len(people), boxes, fingers, wrists)

    def run_network(self, inputs: dict[str, torch.Tensor]) -> Sequence[Any]:
        """Run the network: fingers (M, 15, 3) and wrists (M, 1, 3) of right hands."""
        answer = self.network(inputs["img"])
        if not isinstance(answer, dict) or not {"hand_pose", "global_orient"} <= answer.keys():
            raise BackendError(
                f"WiLoR-mini's network returned {type(answer).__name__}, where its releases answer "
                "a dictionary with hand_pose and global_orient: another revision of the checkout "
                "is needed"
            )
        return answer["hand_pose"], answer["global_orient"]

    def _hand_input(self, image: UInt8Array, box: FloatArray, *, mirrored: bool) -> FloatArray:
        """Crop a hand to (256, 256, 3) grey levels in BGR, which the network reorders itself."""
        crop = crop_around_box(box, _SIDE, _SIDE, padding=_MARGIN, mirrored=mirrored)
        shown = resample_crop(image, crop, sigma=antialias_sigma(crop))
        return np.asarray(shown[..., ::-1], np.float32)
