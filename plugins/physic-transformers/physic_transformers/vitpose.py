"""Detect keypoints with ViTPose and ViTPose+: 17 of COCO, or 133 of the whole body.

Only COCO and MPII were trained with unbiased data processing. The other data sets use MMPose's plain affine, whose
crops and heatmaps are on another pixel grid.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.crops import crop_around_box, resample_crop
from physic_core.adapters.heatmaps import scores_to_confidence, subpixel_peaks
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector, Options
from physic_core.types import Keypoints
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, PretrainedBackend, to_numpy

if TYPE_CHECKING:
    from physic_core.adapters.crops import Crop, PixelAlignment
    from physic_core.types import FloatArray, People, UInt8Array

__all__ = ["VitPose", "VitPoseOptions"]

_SKELETONS = {17: "coco17", 133: "coco_wholebody133"}
_EXPERTS = {17: 0, 133: 5}
"""Number of joints -> index of the ViTPose+ data set with these joints."""
_UNBIASED = (0, 2)
"""Data sets with unbiased data processing: COCO and MPII."""


class VitPoseOptions(ModelOptions):
    """Settings of :class:`VitPose`."""

    weights: str = Field(default="vitpose-plus-base-hf", description=f"ViTPose or ViTPose+: {WEIGHTS_HELP}.")
    dataset_index: int | None = Field(
        default=None,
        ge=0,
        le=1000,
        description="Which of its experts a ViTPose+ asks: 0 COCO, 1 AI Challenger, 2 MPII, 3 AP-10K, 4 APT-36K, "
        "5 COCO whole-body. By default the one of its joints: 0 with 17, as the published heads have, 5 with 133. "
        "Others than ViTPose+ have no experts.",
    )
    batch: int = Field(default=8, ge=1, le=1024, description="People that are shown to the network at once.")


class VitPose(PretrainedBackend, KeypointDetector):
    """Keypoint detector by ViTPose, one person at a time, in the boxes of the segmenter."""

    Options: ClassVar[type[Options]] = VitPoseOptions
    options: VitPoseOptions
    specs: ClassVar[tuple[ModelSpec, ...]] = (ModelSpec("weights", "VitPoseForPoseEstimation", ("vitpose",)),)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return (N, 17) or (N, 133) keypoints of N people, px.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called, or the network has other joints or experts.
        """

        config = self.network().config
        joints = int(config.num_labels)
        if joints not in _SKELETONS:
            raise BackendError(f"these weights of ViTPose have {joints} joints, expected 17 or 133 of COCO")
        if not len(people):
            return Keypoints(np.zeros((0, joints, 2)), np.zeros((0, joints)), _SKELETONS[joints])
        expert = self._expert(int(getattr(config.backbone_config, "num_experts", 1)), joints)
        unbiased = joints == 17 if expert is None else expert in _UNBIASED
        grid: PixelAlignment = "corners" if unbiased else "halves"
        height, width = (int(side) for side in config.backbone_config.image_size)
        crops = [crop_around_box(box, width, height, grid=grid) for box in people.boxes]
        heatmaps = np.concatenate(
            [
                self._heatmaps(image, crops[i : i + self.options.batch], expert)
                for i in range(0, len(crops), self.options.batch)
            ]
        )
        rows, columns = heatmaps.shape[2:]
        cells, scores = subpixel_peaks(heatmaps)
        grids = [crop_around_box(box, columns, rows, grid=grid) for box in people.boxes]
        points = np.stack([own.to_photo(cell) for own, cell in zip(grids, cells, strict=True)])
        return Keypoints(points, scores_to_confidence(scores), _SKELETONS[joints])

    def _expert(self, experts: int, joints: int) -> int | None:
        """Return the index of the data set's expert; None if the network has no experts."""
        if experts <= 1:
            return None
        chosen = _EXPERTS[joints] if self.options.dataset_index is None else self.options.dataset_index
        if chosen >= experts:
            raise BackendError(
                f"dataset_index {chosen} is not there: these weights have {experts} experts, 0 to {experts - 1}"
            )
        return chosen

    def _heatmaps(self, image: UInt8Array, crops: list[Crop], expert: int | None) -> FloatArray:
        """Return the heatmaps (n, J, h, w) of crops."""

        inputs: dict[str, Any] = {
            "pixel_values": np.concatenate(
                [normalized_nchw(resample_crop(image, crop), IMAGENET_MEAN, IMAGENET_STD) for crop in crops]
            )
        }
        if expert is not None:
            inputs["dataset_index"] = np.full(len(crops), expert, np.int64)
        return to_numpy(self.network().run(**inputs).heatmaps)
