"""Base class of keypoint detectors that see one person at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector
from physic_networks.networks import run_in_batches

from .one_graph import OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Keypoints, People, UInt8Array
    from physic_networks.top_down import Crop, PixelAlignment

    from .one_graph import LoadedGraph
    from .sessions import Network

SKELETON_BY_JOINTS: dict[int, str] = {
    17: "coco17",
    23: "coco23",
    26: "halpe26",
    133: "coco_wholebody133",
}
"""Number of joints -> skeleton name."""
_PADDING = 1.25  # size of the crop relative to the box of the person


class TopDownOptions(OnnxBackendOptions):
    """Base class of the settings of a keypoint detector that sees one person at a time."""

    batch: int = Field(8, ge=1, le=1024, description="people per run, if the file does not fix it")


class TopDownBackend(OnnxBackend, KeypointDetector):
    """Base class of a keypoint detector that crops the people's boxes and decodes a batch of
    outputs.

    Attributes:
        crop_size: height and width of a crop, px, where the file leaves them free.
    """

    options: TopDownOptions
    crop_size: ClassVar[tuple[int, int]] = (256, 192)
    _joints: int = 0

    @abstractmethod
    def decode(self, crops: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Run the network on crops, and decode its outputs.

        Args:
            crops: (N, 3, h, w) float32, normalised; N > 0.

        Returns:
            Points (N, J, 2) on a grid that covers the crop, scores (N, J), and rows and columns of
            the grid. Further columns hold the input of :meth:`complete`.
        """

    def complete(self, found: Keypoints, decoded: FloatArray, crops: Sequence[Crop]) -> Keypoints:
        """Add the other decoded values to keypoints of N > 0 people."""
        return found

    def is_bgr(self) -> bool:
        """Return whether the network gets the channels in the order BGR."""
        return False

    def alignment(self) -> PixelAlignment:
        """Return the pixel alignment of crops and grids in the training of the network."""
        return "halves"

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network and find its number of joints; a file that does not state it is run
        once.

        Raises:
            BackendError: its form or its skeleton is unknown.
        """
        loaded = self._network = super().match(network)
        stated = (*next(iter(loaded.outputs.values())).shape, "", "")[1]
        if not isinstance(stated, int):
            stated = self.decode(np.zeros((1, 3, *self._crop_size()), np.float32))[0].shape[1]
        if stated not in SKELETON_BY_JOINTS:
            known = ", ".join(f"{number} ({name})" for number, name in SKELETON_BY_JOINTS.items())
            hint = "; 21 joints are those of one hand" if stated == 21 else ""
            raise BackendError(
                f"{network.name} returns {stated} keypoints a person, and known are "
                f"{known}{hint}: choose another file"
            )
        self._joints = stated
        return loaded

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return keypoints of N people, px of the image (H, W, 3)."""
        from physic_core.types import Keypoints
        from physic_networks.top_down import crop_around_box

        file = self.network.network.name
        joints = self._joints
        grid = self.alignment()
        skeleton = SKELETON_BY_JOINTS[joints]
        if not len(people):
            return Keypoints(np.zeros((0, joints, 2)), np.zeros((0, joints)), skeleton)
        height, width = self._crop_size()
        crops = [
            crop_around_box(box, width, height, padding=_PADDING, grid=grid) for box in people.boxes
        ]
        cells, confidence, (rows, columns) = self.decode(
            crop_batch(image, crops, is_bgr=self.is_bgr())
        )
        if cells.shape[1] != joints:
            raise BackendError(f"{file} states {joints} joints and returned {cells.shape[1]}")
        grids = [
            crop_around_box(box, columns, rows, padding=_PADDING, grid=grid) for box in people.boxes
        ]
        points = np.stack(
            [own.to_photo(peaks[:, :2]) for own, peaks in zip(grids, cells, strict=True)]
        )
        return self.complete(Keypoints(points, confidence, skeleton), cells, crops)

    def _crop_size(self) -> tuple[int, int]:
        """Return height and width of a crop, px."""
        shape = next(iter(self.network.inputs.values())).shape[2:]
        rows, columns = (
            n if isinstance(n, int) else own for n, own in zip(shape, self.crop_size, strict=True)
        )
        return rows, columns


def crop_batch(image: UInt8Array, crops: Sequence[Crop], *, is_bgr: bool = False) -> FloatArray:
    """Crop network inputs (N, 3, h, w) float32, normalised with ImageNet's mean and standard
    deviation.

    Args:
        image: (H, W, 3) uint8 RGB.
        crops: N of one size.
        is_bgr: exchange red and blue first; mean and deviation stay where they are.
    """
    from physic_networks.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
    from physic_networks.top_down import resample_crop

    cuts = [resample_crop(image, crop) for crop in crops]
    return np.concatenate(
        [normalized_nchw(c[..., ::-1] if is_bgr else c, IMAGENET_MEAN, IMAGENET_STD) for c in cuts]
    )


def run_batches(
    loaded: LoadedGraph, feed: Mapping[str, NDArray[Any]], most: int
) -> list[NDArray[Any]]:
    """Run a network over N rows in batches, and return all outputs of its signature.

    Args:
        loaded: the network; a file that fixes its batch gets batches of that size. One that
            quantises a batch with one range gets one row at a time, repeated where it fixes its
            batch.
        feed: input, by the adapter's name -> (N, ...), N > 0.
        most: rows at a time where the file leaves the batch free.

    Raises:
        BackendError: it fails, or answers another number of rows.
    """
    firsts = [shape[0] for name in feed if (shape := loaded.inputs[name].shape)]
    fixed = [first for first in firsts if isinstance(first, int) and first > 0]

    def call(part: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        return loaded.run(part, loaded.outputs)

    def call_alone(part: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        return run_in_batches(call, part, fixed[0] if fixed else 1, full=bool(fixed))

    if loaded.network.shares_ranges:
        return run_in_batches(call_alone, feed, 1)
    return run_in_batches(call, feed, fixed[0] if fixed else most, full=bool(fixed))
