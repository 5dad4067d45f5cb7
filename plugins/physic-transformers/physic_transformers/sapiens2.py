"""Detect keypoints with Sapiens2 (Khirodkar et al. 2026): 308 of body, hands, feet and face, one person at a time.

Its first 63 keypoints are body, feet and hands, in the order of MHR's; they are returned as those of COCO whole-body.
Its points of elbows, neck, face and ears have no counterpart there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.networks import picture_tensor, run_in_batches
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD
from physic_core.adapters.top_down import crop_around_box, resample_crop, scores_to_confidence, subpixel_peaks
from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector, Options
from physic_core.types import Keypoints
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, PretrainedBackend

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import People, UInt8Array

NUM_KEYPOINTS = 308
_SKELETON, _SKELETON_SIZE = "coco_wholebody133", 133
_BLUR_SIGMA = 2.0
"""Cells; OpenCV's for the kernel of 11 cells with which Sapiens2 refines peaks."""
_BODY = (0, 1, 2, 3, 4, 5, 6, 7, 8, 62, 41, 9, 10, 11, 12, 13, 14)
"""Keypoint of each of the 17 of COCO: the wrists come after their hands."""
_FEET = (15, 16, 17, 18, 19, 20)
_FIRST_OF_HAND = {91: (62, 42), 112: (41, 21)}
"""First index of each hand of COCO whole-body, left then right -> keypoint of its wrist, and its first keypoint."""


def _table() -> dict[int, int]:
    """Return the keypoint of Sapiens2 by the index in COCO whole-body.

    Each finger of Sapiens2 begins at its tip, each of COCO at its knuckle.
    """
    table = dict(enumerate((*_BODY, *_FEET)))
    for first, (wrist, hand) in _FIRST_OF_HAND.items():
        table[first] = wrist
        for finger in range(5):
            table |= {first + 1 + 4 * finger + k: hand + 4 * finger + 3 - k for k in range(4)}
    return table


KEYPOINT_OF_WHOLEBODY = _table()
"""Keypoint of Sapiens2 by the index in COCO whole-body; points of the face have none."""


class Sapiens2Options(ModelOptions):
    """Settings of :class:`Sapiens2`."""

    weights: str = Field(default="sapiens2-pose-0.4b-hf", description=f"Sapiens2 for poses: {WEIGHTS_HELP}.")
    batch: int = Field(default=4, ge=1, le=1024, description="People that are shown to the network at once.")


class Sapiens2(PretrainedBackend, KeypointDetector):
    """Keypoint detector by Sapiens2, in the boxes of the segmenter; points of the face have a confidence of 0."""

    written_for = 1
    Options: ClassVar[type[Options]] = Sapiens2Options
    options: Sapiens2Options
    specs: ClassVar[tuple[ModelSpec, ...]] = (ModelSpec("weights", "Sapiens2ForPoseEstimation", ("sapiens2",)),)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return (N, 133) keypoints of N people, px.

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called, or the network has other keypoints.
        """
        config = self.model().config
        if config.num_labels != NUM_KEYPOINTS:
            raise BackendError(
                f"these weights have {config.num_labels} keypoints, expected {NUM_KEYPOINTS} of Sapiens2"
            )
        points = np.zeros((len(people), _SKELETON_SIZE, 2))
        confidence = np.zeros((len(people), _SKELETON_SIZE))
        if not len(people):
            return Keypoints(points, confidence, _SKELETON)
        side = config.image_size
        height, width = (side, side) if isinstance(side, int) else side
        crops = [crop_around_box(box, width, height, grid="corners") for box in people.boxes]
        shown = np.stack([resample_crop(image, crop) for crop in crops])
        (heatmaps,) = run_in_batches(self._heatmaps, {"shown": shown}, self.options.batch)
        cells, scores = subpixel_peaks(heatmaps, sigma=_BLUR_SIGMA)
        rows, columns = heatmaps.shape[2:]
        grids = [crop_around_box(box, columns, rows, grid="corners") for box in people.boxes]
        placed = np.stack([grid.to_photo(cell) for grid, cell in zip(grids, cells, strict=True)])
        wholebody, own = list(KEYPOINT_OF_WHOLEBODY), list(KEYPOINT_OF_WHOLEBODY.values())
        points[:, wholebody] = placed[:, own]
        confidence[:, wholebody] = scores_to_confidence(scores)[:, own]
        return Keypoints(points, confidence, _SKELETON)

    def _heatmaps(self, part: dict[str, NDArray[Any]]) -> list[Any]:
        """Return the heat maps (n, 63, h, w) of the keypoints that the table needs, of crops."""
        pixels = picture_tensor(part["shown"], IMAGENET_MEAN, IMAGENET_STD, device=self.device)
        found = self.model().run(pixel_values=pixels).heatmaps
        return [found[:, : max(KEYPOINT_OF_WHOLEBODY.values()) + 1]]
