"""HaMeR (Pavlakos et al. 2024): finger poses and how hands are turned, from its checkout.

Boxes come from the keypoints of people and crops are made here, so neither detectron2 nor mmpose is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.chumpy_free import chumpy_free_copy
from physic_core.adapters.devices import check_device
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
from physic_core.errors import BackendError
from physic_core.interfaces import Options
from physic_human.hosting import Project, computing, to_numpy
from physic_human.mano_hands import ManoHands, ManoOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

__all__ = ["Hamer", "HamerOptions"]

ASPECT = 192 / 256
"""Width over height of the part of its input that the network looks at: boxes are widened to it before they grow."""
_CHECKPOINT, _CONFIG = "hamer_ckpts/checkpoints/hamer.ckpt", "hamer_ckpts/model_config.yaml"
_TRAINING = "discriminator."
"""Parameters that only its training uses; not every checkpoint holds them."""
_MANO, _MEAN = "data/mano/MANO_RIGHT.pkl", "data/mano_mean_params.npz"


class HamerOptions(ManoOptions):
    """Settings of HaMeR."""

    weights: str = Field(
        default="hamer",
        description="a name of `physic weights list`, or the folder _DATA of hamer_demo_data.tar.gz and MANO",
    )
    margin: float = Field(default=2.0, ge=1, le=4, description="side of the crop in sizes of the hand; 2.0 is HaMeR's")


class Hamer(ManoHands):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    Options: ClassVar[type[Options]] = HamerOptions
    options: HamerOptions
    project: ClassVar[Project] = Project(
        "HaMeR",
        "hamer.models",
        "https://github.com/geopavlakos/hamer",
        ("pytorch_lightning", "yacs", "smplx", "timm", "einops", "torchvision", "pyrender", "trimesh"),
    )

    def load(self, device: str = "cpu") -> None:
        """Build the network and fill it.

        Raises:
            DeviceError: the device is not there.
            WeightsMissingError: code or weights are missing.
            BackendError: they are not HaMeR's.
            BodyModelError: the MANO file cannot be used.
        """
        check_device(device)
        checkpoint, config, mano, mean = (self._host.file(name) for name in (_CHECKPOINT, _CONFIG, _MANO, _MEAN))
        read = self._host.checkout.attribute("get_config", "hamer.configs")
        kind = self._host.checkout.attribute("HAMER")
        with chumpy_free_copy(mano, "mano") as plain, computing(self._host.checkout, device):
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
            self._host.keep(self._filled(network, checkpoint, besides=_TRAINING), device)

    def _region(self, box: FloatArray) -> FloatArray:
        taller = max((box[2] - box[0]) / ASPECT - (box[3] - box[1]), 0.0)
        region: FloatArray = box + np.array([0.0, -taller / 2, 0.0, taller / 2])
        return region

    def _fed(self, crop: UInt8Array) -> FloatArray:
        """(3, 256, 256), red, green, blue."""
        plane: FloatArray = normalized_nchw(crop, IMAGENET_MEAN, IMAGENET_STD)[0]
        return plane

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
