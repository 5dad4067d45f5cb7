"""The 17 keypoints of COCO from ViTPose and ViTPose+."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.adapters.crops import crop_of, cut
from physic_core.adapters.heatmaps import as_confidence, refined_peaks
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, check_photo, planes
from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector, Options
from physic_core.types import Keypoints
from physic_transformers.models import WHERE, ModelOptions, Part, Pretrained, array

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People, UInt8Array

__all__ = ["VitPose", "VitPoseOptions"]

_SKELETONS = {17: "coco17", 133: "coco_wholebody133"}


class VitPoseOptions(ModelOptions):
    """Settings of :class:`VitPose`."""

    weights: str = Field(default="vitpose-plus-base-hf", description=f"ViTPose or ViTPose+: {WHERE}.")
    dataset_index: int = Field(
        default=0,
        ge=0,
        description="Which of its experts a ViTPose+ asks: 0 COCO, 1 AI Challenger, 2 MPII, 3 AP-10K, 4 APT-36K, "
        "5 COCO whole-body; the published heads are for 0. Others than ViTPose+ have no experts.",
    )
    batch: int = Field(default=8, ge=1, description="People that are shown to the network at once.")


class VitPose(Pretrained, KeypointDetector):
    """ViTPose, one person at a time, from the boxes of the segmenter."""

    Options: ClassVar[type[Options]] = VitPoseOptions
    options: VitPoseOptions
    parts: ClassVar[tuple[Part, ...]] = (Part("weights", "VitPoseForPoseEstimation", ("vitpose",)),)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> (N, 17) points, px of the photo.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called, or the network has other joints.
        """
        import numpy as np

        check_photo(image)
        network = self.network()
        if not len(people):
            return Keypoints(np.zeros((0, 17, 2)), np.zeros((0, 17)), "coco17")
        height, width = (int(side) for side in network.config.backbone_config.image_size)
        answers = [
            self._heatmaps(image, people.boxes[i : i + self.options.batch], height, width)
            for i in range(0, len(people), self.options.batch)
        ]
        heatmaps = np.concatenate(answers)
        joints, rows, columns = heatmaps.shape[1:]
        if joints not in _SKELETONS:
            raise BackendError(f"these weights of ViTPose tell {joints} joints, expected 17 of COCO: take others")
        cells, scores = refined_peaks(heatmaps)
        crops = [crop_of(box, columns, rows, grid="corners") for box in people.boxes]
        points = np.stack([crop.to_photo(cell) for crop, cell in zip(crops, cells, strict=True)])
        return Keypoints(points, as_confidence(scores), _SKELETONS[joints])

    def _heatmaps(self, image: UInt8Array, boxes: FloatArray, height: int, width: int) -> FloatArray:
        """(n, J, h, w) of the people in these boxes."""
        import numpy as np

        network = self.network()
        cuts = [cut(image, crop_of(box, width, height, grid="corners")) for box in boxes]
        inputs: dict[str, Any] = {
            "pixel_values": np.concatenate([planes(one, IMAGENET_MEAN, IMAGENET_STD) for one in cuts])
        }
        experts = int(getattr(network.config.backbone_config, "num_experts", 1))
        if experts > 1:
            if self.options.dataset_index >= experts:
                raise BackendError(
                    f"dataset_index {self.options.dataset_index} is not there: these weights have {experts} experts, "
                    f"0 to {experts - 1}"
                )
            inputs["dataset_index"] = np.full(len(boxes), self.options.dataset_index, np.int64)
        return array(network.run(**inputs).heatmaps)
