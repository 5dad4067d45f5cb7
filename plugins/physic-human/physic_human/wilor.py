"""WiLoR (Potamias et al. 2025) by the network of WiLoR-mini: finger poses and how hands are turned.

Only its network is used: boxes come from the keypoints of people and crops are made here, so neither the detector of
hands (AGPL) nor its downloads are needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.chumpy_free import chumpy_free_copy
from physic_core.adapters.devices import check_device
from physic_core.errors import BackendError
from physic_core.interfaces import Options
from physic_human.hosting import Project, computing, to_numpy
from physic_human.mano_hands import SIDE, ManoHands, ManoOptions

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

__all__ = ["Wilor", "WilorOptions"]

_FILES = ("wilor_final.ckpt", "MANO_RIGHT.pkl", "mano_mean_params.npz")
_FOCAL = 5000


class WilorOptions(ManoOptions):
    """Settings of WiLoR."""

    weights: str = Field(
        default="wilor-mini",
        description="a name of `physic weights list`, or a folder with wilor_final.ckpt, MANO_RIGHT.pkl and "
        "mano_mean_params.npz",
    )
    margin: float = Field(
        default=2.5, ge=1, le=4, description="side of the crop in sizes of the hand; 2.5 in WiLoR-mini, 2.0 in WiLoR"
    )
    swap_channels: bool = Field(
        default=False,
        description="show the network blue as red, as the code of the PhySIC paper does by mistake; worse, to compare",
    )


class Wilor(ManoHands):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    Options: ClassVar[type[Options]] = WilorOptions
    options: WilorOptions
    project: ClassVar[Project] = Project(
        "WiLoR-mini",
        "wilor_mini.models.wilor",
        "https://github.com/warmshao/WiLoR-mini",
        ("smplx", "timm", "torchvision", "roma"),
    )

    def load(self, device: str = "cpu") -> None:
        """Build the network and fill it.

        Raises:
            DeviceError: the device is not there.
            WeightsMissingError: code or weights are missing.
            BackendError: they are not WiLoR-mini's.
            BodyModelError: the MANO file cannot be used.
        """
        check_device(device)
        checkpoint, mano, mean = (self._host.file(name) for name in _FILES)
        kind = self._host.checkout.attribute("WiLor")
        with chumpy_free_copy(mano, "mano") as plain, computing(self._host.checkout, device):
            network = kind(mano_model_path=str(plain), mano_mean_path=str(mean), focal_length=_FOCAL, image_size=SIDE)
            self._host.keep(self._filled(network, checkpoint), device)

    def _fed(self, crop: UInt8Array) -> FloatArray:
        """(256, 256, 3) grey levels in the order blue, green, red: the network exchanges them itself."""
        return np.asarray(crop if self.options.swap_channels else crop[..., ::-1], np.float32)

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
