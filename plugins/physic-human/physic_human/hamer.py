"""Estimate finger and wrist rotations with a checkout of HaMeR (Pavlakos et al. 2024).

Boxes come from the people's keypoints and crops are made here, so neither detectron2 nor mmpose is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
from physic_core.errors import BackendError
from physic_core.interfaces import Options
from physic_human.checkout_backend import CheckoutProject, inference_context, to_numpy
from physic_human.chumpy_free import chumpy_free_copy
from physic_human.mano_hands import ManoHandEstimator, ManoOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

ASPECT = 192 / 256
"""Width over height of the input region that the network uses; boxes are widened to it before they grow."""
_CHECKPOINT, _CONFIG = "hamer_ckpts/checkpoints/hamer.ckpt", "hamer_ckpts/model_config.yaml"
_TRAINING = "discriminator."
"""Prefix of parameters that only training uses; not every checkpoint contains them."""
_MANO, _MEAN = "data/mano/MANO_RIGHT.pkl", "data/mano_mean_params.npz"


class HamerOptions(ManoOptions):
    """Settings of HaMeR."""

    weights: str = Field(
        default="hamer",
        description="a name of `physic weights list`, or the folder _DATA of hamer_demo_data.tar.gz and MANO",
    )
    margin: float = Field(default=2.0, ge=1, le=4, description="side of the crop in sizes of the hand; 2.0 is HaMeR's")


class Hamer(ManoHandEstimator):
    """Hand estimator: MANO rotations by HaMeR of every hand with keypoints. Left hands are mirrored."""

    Options: ClassVar[type[Options]] = HamerOptions
    options: HamerOptions
    project: ClassVar[CheckoutProject] = CheckoutProject(
        "HaMeR",
        "hamer.models",
        "https://github.com/geopavlakos/hamer",
        ("pytorch_lightning", "yacs", "smplx", "timm", "einops", "torchvision", "pyrender", "trimesh"),
        "3a01849f4148352e9260b69bf28b65d1671a4905",
    )

    def _build(self, device: str) -> None:
        """Build the network and load its weights."""
        checkpoint, config, mano, mean = (
            self._checkout_network.file(name) for name in (_CHECKPOINT, _CONFIG, _MANO, _MEAN)
        )
        read = self._checkout_network.checkout.attribute("get_config", "hamer.configs")
        kind = self._checkout_network.checkout.attribute("HAMER")
        with chumpy_free_copy(mano, "mano") as plain, inference_context(self._checkout_network.checkout, device):
            settings = read(str(config))
            settings.defrost()
            # Its own paths begin at the folder that Python was started in.
            settings.MANO.MODEL_PATH, settings.MANO.MEAN_PARAMS = str(plain), str(mean)
            settings.MODEL.BBOX_SHAPE = [192, 256]
            settings.MODEL.BACKBONE.pop(
                "PRETRAINED_WEIGHTS", None
            )  # of its training; the checkpoint holds the backbone
            settings.freeze()
            network = kind(settings, init_renderer=False)
            self._checkout_network.set_network(
                self._load_checkpoint(network, checkpoint, optional_prefix=_TRAINING), device
            )

    def _expand_box(self, box: FloatArray) -> FloatArray:
        """Widen a box to the aspect of the network's input."""
        taller = max((box[2] - box[0]) / ASPECT - (box[3] - box[1]), 0.0)
        region: FloatArray = box + np.array([0.0, -taller / 2, 0.0, taller / 2])
        return region

    def _preprocess(self, crop: UInt8Array) -> FloatArray:
        """Normalise a crop to (3, 256, 256), RGB."""
        plane: FloatArray = normalized_nchw(crop, IMAGENET_MEAN, IMAGENET_STD)[0]
        return plane

    def _run(self, network: object, crops: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Run the network: fingers (M, 15, 3, 3) and wrists (M, 1, 3, 3) of right hands."""
        import torch

        with inference_context(self._checkout_network.checkout, self._checkout_network.device, half=self.options.half):
            answer = network({"img": torch.from_numpy(crops).to(self._checkout_network.device)})  # type: ignore[operator]
        try:
            hands = answer["pred_mano_params"]
            fingers, wrists = to_numpy(hands["hand_pose"]), to_numpy(hands["global_orient"])
        except (KeyError, TypeError) as error:
            raise BackendError(
                f"HaMeR's network returned {type(answer).__name__} without pred_mano_params: "
                "take the checkout of https://github.com/geopavlakos/hamer"
            ) from error
        return fingers.reshape(len(crops), 15, 3, 3), wrists.reshape(len(crops), 1, 3, 3)
