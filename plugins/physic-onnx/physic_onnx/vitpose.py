"""Detect 133 whole-body or 17 body keypoints with ViTPose heatmaps, one person at a time.

Two forms exist: the exports of easy_ViTPose (``input_0`` -> ``output_0``), and those of the class in transformers
(``pixel_values`` -> ``heatmaps``), whose "plus" models also take the index of a data set's expert.

Only the networks of COCO's 17 joints were trained with unbiased data processing. Those of 133 joints were trained with
MMPose's plain affine; with the other convention, a person's feet are off by 1.2 % of the crop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.top_down import PixelAlignment
    from physic_core.types import FloatArray, Keypoints, People, UInt8Array

    from .one_graph import LoadedGraph
    from .sessions import Network

HEIGHT, WIDTH = 256, 192
COCO = 0
EXPERT_BY_JOINTS = {17: COCO, 133: 5}
"""Number of joints -> index of the data set whose expert a "plus" model uses."""
EASY, HUB, PLUS = "easy_ViTPose", "transformers", "transformers, plus"
_PICTURE = (None, 3, None, None)
_MAPS = (None, None, None, None)


class VitPoseOptions(OnnxBackendOptions):
    """Settings of ViTPose."""

    weights: str = Field("vitpose-b-wholebody", description=WEIGHTS_HELP)
    padding: float = Field(1.25, ge=1, le=3, description="how much larger than the person's box the crop is")
    batch: int = Field(8, ge=1, le=1024, description="people a run, where the file leaves that free")


class VitPose(OnnxBackend, KeypointDetector):
    """Keypoint detector by ViTPose, as in the PhySIC paper (133 joints). Its input is RGB."""

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = VitPoseOptions
    options: VitPoseOptions
    _joints: int
    signatures: ClassVar = {
        PLUS: GraphSignature(
            (
                PortSpec("pixel_values", shape=_PICTURE),
                PortSpec("dataset_index", dtype=("int64", "int32"), shape=(None,)),
            ),
            (PortSpec("heatmaps", shape=_MAPS),),
        ),
        HUB: GraphSignature((PortSpec("pixel_values", shape=_PICTURE),), (PortSpec("heatmaps", shape=_MAPS),)),
        EASY: GraphSignature(
            (PortSpec("input_0", ("input", "images"), shape=_PICTURE),),
            (PortSpec("output_0", ("output", "heatmaps"), shape=_MAPS),),
            by_position=True,
        ),
    }

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network and find its number of joints.

        A file that does not state the number is run once.
        """
        from .top_down import skeleton_name

        loaded = self._network = super().match(network)
        shape = loaded.ports.outputs[self._maps()].shape
        stated = shape[1] if len(shape) == 4 else ""
        self._joints = stated if isinstance(stated, int) else self._count()
        skeleton_name(self._joints, network.name)
        return loaded

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return keypoints of N people; the confidence of a joint is the peak of its heatmap."""

        from physic_core.adapters.top_down import crop_around_box, scores_to_confidence, subpixel_peaks
        from physic_core.types import Keypoints

        from .top_down import crop_batch, skeleton_name

        network = self.network.network
        joints, skeleton = self._joints, skeleton_name(self._joints, network.name)
        if not len(people):
            return Keypoints(np.zeros((0, joints, 2)), np.zeros((0, joints)), skeleton)
        height, width = self._size()
        padding, grid = self.options.padding, training_alignment(joints)
        crops = [crop_around_box(box, width, height, padding=padding, grid=grid) for box in people.boxes]
        heatmaps = self._heatmaps(crop_batch(image, crops), EXPERT_BY_JOINTS.get(joints, COCO))
        if heatmaps.shape[1] != joints:
            raise BackendError(f"{network.name} states {joints} joints and returned {heatmaps.shape[1]} heat maps")
        cells, height_of_peak = subpixel_peaks(heatmaps)
        rows, columns = heatmaps.shape[2:]
        grids = [crop_around_box(box, columns, rows, padding=padding, grid=grid) for box in people.boxes]
        points = np.stack([own.to_photo(peaks) for own, peaks in zip(grids, cells, strict=True)])
        return Keypoints(points, scores_to_confidence(height_of_peak), skeleton)

    def _count(self) -> int:
        """Count the joints of a file that does not state them by running one black crop."""

        return int(self._heatmaps(np.zeros((1, 3, *self._size()), np.float32), COCO).shape[1])

    def _size(self) -> tuple[int, int]:
        """Return height and width of a crop, px."""
        from .top_down import size_or_default

        shape = self.network.input_shape(self._picture())
        return size_or_default(shape[2], HEIGHT), size_or_default(shape[3], WIDTH)

    def _heatmaps(self, pictures: FloatArray, expert: int) -> FloatArray:
        """Return heatmaps (N, J, rows, columns) of crops (N, 3, h, w)."""

        from .top_down import run_batches

        loaded, maps = self.network, self._maps()
        feed: dict[str, NDArray[Any]] = {self._picture(): pictures}
        if loaded.signature == PLUS:
            feed["dataset_index"] = np.full(len(pictures), expert, np.int64)
        (heatmaps,) = run_batches(loaded, feed, [maps], self.options.batch)
        if heatmaps.ndim != 4:
            raise BackendError(
                f"{loaded.network.name} returned {maps} {heatmaps.shape}: heat maps (N, joints, rows, columns) "
                "were expected"
            )
        return heatmaps

    def _picture(self) -> str:
        return str(next(iter(self.network.ports.inputs)))

    def _maps(self) -> str:
        return str(next(iter(self.network.ports.outputs)))


def training_alignment(joints: int) -> PixelAlignment:
    """Return the pixel alignment of crops and heatmaps in the training of a network with this number of joints."""
    return "corners" if joints == 17 else "halves"
