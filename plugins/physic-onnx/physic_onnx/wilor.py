"""Estimate finger poses with WiLoR (Potamias et al. 2025) from an ONNX file that a licensed user exported.

``python -m physic_onnx.export wilor`` writes the file. Boxes come from the keypoints, so no hand detector is needed.
WiLoR-mini's network takes BGR from 0 to 255 and normalises it itself. WiLoR's own network takes normalised RGB.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.interfaces import HandEstimator, Share

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.adapters.crops import Crop
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

__all__ = ["Wilor", "WilorOptions"]

SIDE = 256
"""Side of the square crop, px; the network uses its middle 192 columns."""
MINI, ORIGINAL = "WiLoR-mini: grey levels, BGR", "WiLoR: normalised RGB"


class WilorOptions(OnnxBackendOptions):
    """Settings of WiLoR."""

    weights: str = Field("wilor-onnx", description=WEIGHTS_HELP)
    least_confidence: Share = Field(0.5, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper")
    least_size_px: float = Field(24.0, ge=0, le=100_000, description="longer side of a hand; fingers below are a guess")
    margin: float = Field(
        2.5, ge=1, le=4, description="side of the crop in sizes of the hand; 2.5 in WiLoR-mini, 2.0 in WiLoR"
    )
    swap_channels: bool = Field(
        False,
        description="show the network blue as red, as the code of the PhySIC paper does by mistake; worse, to compare",
    )
    batch: int = Field(4, ge=1, le=1024, description="hands a run, where the file leaves that free")


class Wilor(OnnxBackend, HandEstimator):
    """Hand estimator: MANO rotations by WiLoR of every hand with keypoints. Left hands are mirrored."""

    Options: ClassVar[type[OnnxBackendOptions]] = WilorOptions
    options: WilorOptions
    signatures: ClassVar = {
        MINI: GraphSignature(
            (PortSpec("image", ("x", "input"), shape=(None, SIDE, SIDE, 3)),),
            (PortSpec("hand_pose", shape=None), PortSpec("global_orient", shape=None, optional=True)),
        ),
        ORIGINAL: GraphSignature(
            (PortSpec("image", ("img", "input"), shape=(None, 3, SIDE, SIDE)),),
            (PortSpec("hand_pose", shape=None), PortSpec("global_orient", shape=None, optional=True)),
        ),
    }

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the finger rotations of N people; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        from physic_core.adapters.crops import crop_around_box
        from physic_core.adapters.hand_boxes import hand_boxes
        from physic_core.adapters.mano import JOINTS_PER_HAND, empty_hands, hands_from_mano
        from physic_core.errors import BackendError

        from .top_down import run_batches

        loaded, options = self.loaded(), self.options
        found = hand_boxes(keypoints, least_confidence=options.least_confidence, least_size_px=options.least_size_px)
        if not len(found):
            return empty_hands(len(people))
        crops = [
            crop_around_box(box, SIDE, SIDE, padding=options.margin, grid="halves", mirrored=not right)
            for box, right in zip(found.boxes, found.right, strict=True)
        ]
        names = ["hand_pose", *(["global_orient"] if loaded.has_output("global_orient") else [])]
        fingers, *wrists = run_batches(loaded, {"image": self._pictures(image, crops)}, names, options.batch)
        try:
            return hands_from_mano(
                len(people), found.person, found.right, fingers, found.confidence, wrists[0] if wrists else None
            )
        except ValueError as error:
            raise BackendError(
                f"{loaded.network.name} returned hand_pose {fingers.shape}, where {len(found)} hands have "
                f"{JOINTS_PER_HAND} rotations each, vectors or matrices: {error}"
            ) from error

    def _pictures(self, image: UInt8Array, crops: list[Crop]) -> FloatArray:
        """Crop and preprocess the hands as the network takes them."""
        from physic_core.adapters.crops import antialias_sigma, resample_crop

        from .top_down import crop_batch

        sigmas = [antialias_sigma(crop) for crop in crops]
        if self.loaded().signature == ORIGINAL:
            return crop_batch(image, crops, bgr=self.options.swap_channels, sigmas=sigmas)
        seen = np.stack([resample_crop(image, crop, sigma=sigma) for crop, sigma in zip(crops, sigmas, strict=True)])
        return np.asarray(seen if self.options.swap_channels else seen[..., ::-1], np.float32)
