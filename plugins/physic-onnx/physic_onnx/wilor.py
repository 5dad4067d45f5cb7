"""WiLoR (Potamias et al. 2025) as exported by its licensed user: finger poses, one hand at a time.

``python -m physic_onnx.export wilor`` writes the file. Boxes come from the keypoints, so no detector of hands is
needed. Two forms are known: WiLoR-mini's network, which takes grey levels in the order blue, green, red, and
normalises them itself; and WiLoR's own, which takes normalised RGB.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.interfaces import HandEstimator

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.adapters.crops import Crop
    from physic_core.types import FloatArray, Hands, Keypoints, People, UInt8Array

__all__ = ["Wilor", "WilorOptions"]

SIDE = 256
"""px of the square crop; the network itself looks at its middle 192 columns."""
MINI, WHOLE = "WiLoR-mini: grey levels, BGR", "WiLoR: normalised RGB"


class WilorOptions(OneGraphOptions):
    """Settings of WiLoR."""

    weights: str = Field("wilor-onnx", description=WEIGHTS)
    least_confidence: float = Field(
        0.5, ge=0, le=1, description="of a hand's keypoints; 0.7 in the code of the PhySIC paper"
    )
    least_size_px: float = Field(24.0, ge=0, description="longer side of a hand; fingers below are a guess")
    margin: float = Field(
        2.5, ge=1, le=4, description="side of the crop in sizes of the hand; 2.5 in WiLoR-mini, 2.0 in WiLoR"
    )
    swap_channels: bool = Field(
        False,
        description="show the network blue as red, as the code of the PhySIC paper does by mistake; worse, to compare",
    )
    batch: int = Field(4, ge=1, description="hands a run, where the file leaves that free")


class Wilor(OneGraph, HandEstimator):
    """MANO rotations of every hand that the keypoints show; left hands are shown to the network in a mirror."""

    Options: ClassVar[type[OneGraphOptions]] = WilorOptions
    options: WilorOptions
    dialects: ClassVar = {
        MINI: Dialect(
            (Wanted("image", ("x", "input"), shape=(None, SIDE, SIDE, 3)),),
            (Wanted("hand_pose", shape=None), Wanted("global_orient", shape=None, optional=True)),
        ),
        WHOLE: Dialect(
            (Wanted("image", ("img", "input"), shape=(None, 3, SIDE, SIDE)),),
            (Wanted("hand_pose", shape=None), Wanted("global_orient", shape=None, optional=True)),
        ),
    }

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Image (H, W, 3) and N people with keypoints -> finger rotations; confidence is that of the keypoints.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        from physic_core.adapters.crops import crop_around_box
        from physic_core.adapters.hand_boxes import hand_boxes
        from physic_core.adapters.mano import JOINTS_PER_HAND, empty_hands, hands_from_mano
        from physic_core.errors import BackendError

        from .top_down import run_rows

        speaking, options = self.speaking(), self.options
        found = hand_boxes(keypoints, least_confidence=options.least_confidence, least_size_px=options.least_size_px)
        if not len(found):
            return empty_hands(len(people))
        crops = [
            crop_around_box(box, SIDE, SIDE, padding=options.margin, grid="halves", mirrored=not right)
            for box, right in zip(found.boxes, found.right, strict=True)
        ]
        names = ["hand_pose", *(["global_orient"] if speaking.has("global_orient") else [])]
        fingers, *wrists = run_rows(speaking, {"image": self._pictures(image, crops)}, names, options.batch)
        try:
            return hands_from_mano(
                len(people), found.person, found.right, fingers, found.confidence, wrists[0] if wrists else None
            )
        except ValueError as error:
            raise BackendError(
                f"{speaking.network.name} answered hand_pose {fingers.shape}, where {len(found)} hands have "
                f"{JOINTS_PER_HAND} rotations each, vectors or matrices: {error}"
            ) from error

    def _pictures(self, image: UInt8Array, crops: list[Crop]) -> FloatArray:

        from physic_core.adapters.crops import antialias_sigma, resample_crop

        from .top_down import pictures_of

        sigmas = [antialias_sigma(crop) for crop in crops]
        if self.speaking().dialect == WHOLE:
            return pictures_of(image, crops, bgr=self.options.swap_channels, sigmas=sigmas)
        seen = np.stack([resample_crop(image, crop, sigma=sigma) for crop, sigma in zip(crops, sigmas, strict=True)])
        return np.asarray(seen if self.options.swap_channels else seen[..., ::-1], np.float32)
