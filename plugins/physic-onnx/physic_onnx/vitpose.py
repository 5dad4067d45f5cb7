"""ViTPose: heat maps of 133 whole-body joints, or of 17, one person at a time.

Two forms are about: the exports of easy_ViTPose (``input_0`` -> ``output_0``) and those of the class in transformers
(``pixel_values`` -> ``heatmaps``), whose "plus" models ask which of their data sets' experts is to answer.

Only the networks of COCO's 17 joints were trained with unbiased data processing. Those of 133 joints were trained with
MMPose's plain affine; read as the others are, they move a person's feet by 1.2 % of the crop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.crops import PixelAlignment
    from physic_core.types import FloatArray, Keypoints, People, UInt8Array

    from .sessions import Network

__all__ = ["VitPose", "VitPoseOptions"]

HEIGHT, WIDTH = 256, 192
COCO = 0
EXPERT_OF = {17: COCO, 133: 5}
"""Joints -> the data set whose expert a "plus" model is asked for."""
EASY, HUB, PLUS = "easy_ViTPose", "transformers", "transformers, plus"
_PICTURE = (None, 3, None, None)
_MAPS = (None, None, None, None)


class VitPoseOptions(OneGraphOptions):
    """Settings of ViTPose."""

    weights: str = Field("vitpose-b-wholebody", description=WEIGHTS)
    padding: float = Field(1.25, ge=1, le=3, description="how much larger than the person's box the crop is")
    batch: int = Field(8, ge=1, description="people a run, where the file leaves that free")


class VitPose(OneGraph, KeypointDetector):
    """Keypoints by ViTPose (the paper's detector with 133 joints); it is shown RGB."""

    Options: ClassVar[type[OneGraphOptions]] = VitPoseOptions
    options: VitPoseOptions
    _joints: int
    dialects: ClassVar = {
        PLUS: Dialect(
            (Wanted("pixel_values", shape=_PICTURE), Wanted("dataset_index", dtype=("int64", "int32"), shape=(None,))),
            (Wanted("heatmaps", shape=_MAPS),),
        ),
        HUB: Dialect((Wanted("pixel_values", shape=_PICTURE),), (Wanted("heatmaps", shape=_MAPS),)),
        EASY: Dialect(
            (Wanted("input_0", ("input", "images"), shape=_PICTURE),),
            (Wanted("output_0", ("output", "heatmaps"), shape=_MAPS),),
            by_position=True,
        ),
    }

    def attach(self, network: Network) -> None:
        """Take an open network, and find out how many joints it has; a file that does not state it is run once."""
        from .top_down import skeleton_of

        super().attach(network)
        shape = self.speaking().ports.outputs[self._maps()].shape
        stated = shape[1] if len(shape) == 4 else ""
        self._joints = stated if isinstance(stated, int) else self._count()
        skeleton_of(self._joints, network.name)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> keypoints; the confidence of one is the height of its heat map's peak."""

        from physic_core.adapters.crops import crop_around_box
        from physic_core.adapters.heatmaps import scores_to_confidence, subpixel_peaks
        from physic_core.types import Keypoints

        from .top_down import pictures_of, skeleton_of

        network = self.speaking().network
        joints, skeleton = self._joints, skeleton_of(self._joints, network.name)
        if not len(people):
            return Keypoints(np.zeros((0, joints, 2)), np.zeros((0, joints)), skeleton)
        height, width = self._size()
        padding, grid = self.options.padding, grid_of(joints)
        crops = [crop_around_box(box, width, height, padding=padding, grid=grid) for box in people.boxes]
        heatmaps = self._heatmaps(pictures_of(image, crops), EXPERT_OF.get(joints, COCO))
        if heatmaps.shape[1] != joints:
            raise BackendError(f"{network.name} states {joints} joints and returned {heatmaps.shape[1]} heat maps")
        cells, height_of_peak = subpixel_peaks(heatmaps)
        rows, columns = heatmaps.shape[2:]
        grids = [crop_around_box(box, columns, rows, padding=padding, grid=grid) for box in people.boxes]
        points = np.stack([own.to_photo(peaks) for own, peaks in zip(grids, cells, strict=True)])
        return Keypoints(points, scores_to_confidence(height_of_peak), skeleton)

    def _count(self) -> int:
        """Joints of a file that does not state them: it is shown one black crop."""

        return int(self._heatmaps(np.zeros((1, 3, *self._size()), np.float32), COCO).shape[1])

    def _size(self) -> tuple[int, int]:
        """Height and width of a crop, px."""
        from .top_down import fixed_or

        shape = self.speaking().shape(self._picture())
        return fixed_or(shape[2], HEIGHT), fixed_or(shape[3], WIDTH)

    def _heatmaps(self, pictures: FloatArray, expert: int) -> FloatArray:
        """Crops (N, 3, h, w) -> (N, J, rows, columns)."""

        from .top_down import run_rows

        speaking, maps = self.speaking(), self._maps()
        feed: dict[str, NDArray[Any]] = {self._picture(): pictures}
        if speaking.dialect == PLUS:
            feed["dataset_index"] = np.full(len(pictures), expert, np.int64)
        (heatmaps,) = run_rows(speaking, feed, [maps], self.options.batch)
        if heatmaps.ndim != 4:
            raise BackendError(
                f"{speaking.network.name} answered {maps} {heatmaps.shape}: heat maps (N, joints, rows, columns) "
                "were expected"
            )
        return heatmaps

    def _picture(self) -> str:
        return next(iter(self.speaking().ports.inputs))

    def _maps(self) -> str:
        return next(iter(self.speaking().ports.outputs))


def grid_of(joints: int) -> PixelAlignment:
    """Where the network of so many joints has the box, on its crops and on its heat maps."""
    return "corners" if joints == 17 else "halves"
