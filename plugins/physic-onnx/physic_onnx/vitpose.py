"""ViTPose: heat maps of 133 whole-body joints, or of 17, one person at a time.

Two forms are about: the exports of easy_ViTPose (``input_0`` -> ``output_0``) and those of the class in transformers
(``pixel_values`` -> ``heatmaps``), whose "plus" models ask which of their data sets' experts is to answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Keypoints, People, UInt8Array

    from .sessions import Network

__all__ = ["VitPose", "VitPoseOptions"]

HEIGHT, WIDTH = 256, 192
COCO = 0  # the expert of COCO's 17 joints in the plus models
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
        """Take an open network; one whose joints are of no person is refused at once if it tells their number."""
        from .top_down import skeleton_of

        super().attach(network)
        speaking = self.speaking()
        told = speaking.ports.outputs[self._maps()].shape
        if len(told) == 4 and isinstance(told[1], int):
            skeleton_of(told[1], network.name)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> keypoints; the confidence of one is the height of its heat map's peak."""
        import numpy as np

        from physic_core.adapters.crops import crop_of
        from physic_core.adapters.heatmaps import as_confidence, refined_peaks
        from physic_core.adapters.pictures import check_photo
        from physic_core.types import Keypoints

        from .top_down import SKELETON_OF, fixed_or, pictures_of, run_rows, skeleton_of

        check_photo(image)
        speaking = self.speaking()
        picture, maps = next(iter(speaking.ports.inputs)), self._maps()
        if not len(people):
            told = speaking.ports.outputs[maps].shape
            count = told[1] if len(told) == 4 and isinstance(told[1], int) else 133
            return Keypoints(np.zeros((0, count, 2)), np.zeros((0, count)), SKELETON_OF[count])
        height, width = (fixed_or(s, d) for s, d in zip(speaking.shape(picture)[2:], (HEIGHT, WIDTH), strict=True))
        padding = self.options.padding
        crops = [crop_of(box, width, height, padding=padding, grid="corners") for box in people.boxes]
        feed: dict[str, NDArray[Any]] = {picture: pictures_of(image, crops)}
        if speaking.dialect == PLUS:
            feed["dataset_index"] = np.full(len(crops), COCO, np.int64)
        (heatmaps,) = run_rows(speaking, feed, [maps], self.options.batch)
        if heatmaps.ndim != 4:
            raise BackendError(
                f"{speaking.network.name} answered {maps} {heatmaps.shape}: heat maps (N, joints, rows, columns) "
                "were expected"
            )
        skeleton = skeleton_of(heatmaps.shape[1], speaking.network.name)
        cells, height_of_peak = refined_peaks(heatmaps)
        rows, columns = heatmaps.shape[2:]
        grids = [crop_of(box, columns, rows, padding=padding, grid="corners") for box in people.boxes]
        points = np.stack([grid.to_photo(own) for grid, own in zip(grids, cells, strict=True)])
        return Keypoints(points, as_confidence(height_of_peak), skeleton)

    def _maps(self) -> str:
        return next(iter(self.speaking().ports.outputs))
