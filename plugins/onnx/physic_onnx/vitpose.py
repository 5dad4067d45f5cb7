"""Detect 133 whole-body or 17 body keypoints with ViTPose heatmaps, one person at a time.

Two forms exist: the exports of easy_ViTPose (``input_0`` -> ``output_0``), and those of the class
in transformers (``pixel_values`` -> ``heatmaps``), whose "plus" models also take the index of a
data set's expert.

Only the networks of COCO's 17 joints were trained with unbiased data processing. Those of 133
joints were trained with MMPose's plain affine; with the other convention, a person's feet are off
by 1.2 % of the crop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_networks.top_down import scores_to_confidence, subpixel_peaks

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackendOptions, PortSpec
from .top_down import TopDownBackend, TopDownOptions, run_batches

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray
    from physic_networks.top_down import PixelAlignment

COCO = 0
EXPERT_BY_JOINTS = {17: COCO, 133: 5}
"""Number of joints -> index of the data set whose expert a "plus" model uses."""
EASY = "easy_ViTPose"
HUB = "transformers"
PLUS = "transformers, plus"
_PICTURE = (None, 3, None, None)
_MAPS = (None, None, None, None)


class VitPoseOptions(TopDownOptions):
    """Settings of ViTPose."""

    weights: str = Field("vitpose-b-wholebody", description=WEIGHTS_HELP)


class VitPose(TopDownBackend):
    """Keypoint detector by ViTPose, as in the PhySIC paper (133 joints). Its input is RGB.

    The confidence of a joint is the peak of its heatmap.
    """

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = VitPoseOptions
    options: VitPoseOptions
    signatures: ClassVar = {
        PLUS: GraphSignature(
            (
                PortSpec("pixel_values", shape=_PICTURE),
                PortSpec("dataset_index", dtype=("int64", "int32"), shape=(None,)),
            ),
            (PortSpec("heatmaps", shape=_MAPS),),
        ),
        HUB: GraphSignature(
            (PortSpec("pixel_values", shape=_PICTURE),), (PortSpec("heatmaps", shape=_MAPS),)
        ),
        EASY: GraphSignature(
            (PortSpec("input_0", ("input", "images"), shape=_PICTURE),),
            (PortSpec("output_0", ("output", "heatmaps"), shape=_MAPS),),
            by_position=True,
        ),
    }

    def alignment(self) -> PixelAlignment:
        """Return the alignment of unbiased data processing for COCO's 17 joints, else that of
        MMPose's affine.
        """
        return "corners" if self._joints == 17 else "halves"

    def decode(self, crops: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
        """Return the peaks in cells of the heatmaps."""
        loaded = self.network
        picture = next(iter(loaded.inputs))
        feed: dict[str, NDArray[Any]] = {picture: crops}
        if loaded.signature == PLUS:
            feed["dataset_index"] = np.full(
                len(crops), EXPERT_BY_JOINTS.get(self._joints, COCO), np.int64
            )
        (heatmaps,) = run_batches(loaded, feed, self.options.batch)
        if heatmaps.ndim != 4:
            raise BackendError(
                f"{loaded.network.name} returned {next(iter(loaded.outputs))} {heatmaps.shape}: "
                "heat maps (N, joints, rows, columns) were expected"
            )
        cells, peaks = subpixel_peaks(heatmaps)
        rows, columns = heatmaps.shape[2:]
        return cells, scores_to_confidence(peaks), (rows, columns)
