"""Base class of keypoint detectors that see one person at a time, and return 133 joints."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector
from physic_core.types import Keypoints
from physic_networks.networks import run_in_batches
from physic_networks.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
from physic_networks.top_down import crop_around_box, resample_crop

from .sessions import OnnxBackend

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People, UInt8Array
    from physic_networks.top_down import Crop

SKELETON = "coco_wholebody133"
JOINTS = 133
_PADDING = 1.25  # size of the crop relative to the box of the person
_BATCH = 8  # people per run, if the file does not fix it


class TopDownBackend(OnnxBackend, KeypointDetector):
    """Base class of a keypoint detector that crops the people's boxes and decodes a batch of
    outputs.

    Attributes:
        crop_size: height and width of a crop, px.
    """

    crop_size: ClassVar[tuple[int, int]]

    @abstractmethod
    def decode(self, outputs: list[FloatArray]) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Decode the outputs of the network for N > 0 people.

        Returns:
            Points (N, J, 2) on a grid that covers the crop, scores (N, J), and rows and columns of
            the grid. Further columns hold the input of :meth:`complete`.
        """

    def complete(
        self, keypoints: Keypoints, decoded: FloatArray, crops: Sequence[Crop]
    ) -> Keypoints:
        """Add the other decoded values to keypoints of N > 0 people."""
        return keypoints

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return keypoints of N people, px of the image (H, W, 3)."""
        network = self.network
        if not len(people):
            return Keypoints(np.zeros((0, JOINTS, 2)), np.zeros((0, JOINTS)), SKELETON)
        crops = _crops(people, *self.crop_size)
        cuts = [resample_crop(image, crop) for crop in crops]
        frames = [normalized_nchw(cut, IMAGENET_MEAN, IMAGENET_STD) for cut in cuts]
        first = next(iter(network.inputs.values())).shape[0]
        fixed = isinstance(first, int)
        outputs = run_in_batches(
            lambda part: network.answer(part["crops"]),
            {"crops": np.concatenate(frames)},
            first if fixed else _BATCH,
            full=fixed,
        )
        cells, confidence, (rows, columns) = self.decode(outputs)
        if cells.shape[1] != JOINTS:
            raise BackendError(f"{network.name} returned {cells.shape[1]} joints, not {JOINTS}")
        grids = _crops(people, rows, columns)
        points = [grid.to_photo(peaks[:, :2]) for grid, peaks in zip(grids, cells, strict=True)]
        return self.complete(Keypoints(np.stack(points), confidence, SKELETON), cells, crops)


def _crops(people: People, rows: int, columns: int) -> list[Crop]:
    """Return the grids of these rows and columns over the people's boxes."""
    return [crop_around_box(box, columns, rows, padding=_PADDING) for box in people.boxes]
