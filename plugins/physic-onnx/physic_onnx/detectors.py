"""People in boxes: YOLOX, RT-DETR (v2 and D-FINE too) and RTMO, recognised by their files' inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError

from .contract import Dialect, Match, Wanted, choose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.detections import Detections
    from physic_core.adapters.pictures import Letterbox
    from physic_core.types import FloatArray, UInt8Array

    from .options import OnnxOptions
    from .sessions import Network

__all__ = ["DIALECTS", "Detector", "open_detector"]

GREY = 114
"""What YOLOX and RTMO were trained to see round a photo."""

USUAL_SIDE = 640
"""Side of the picture for files that leave it free, px."""

PERSON = 0
"""Class of people in COCO's 80, and in lists that hold nothing else."""

_FRAME = (None, 3, None, None)
DIALECTS: Mapping[str, Dialect] = {
    "RTMO": Dialect(
        (Wanted("input", ("images",), shape=_FRAME),),
        (Wanted("dets", shape=(None, None, 5)), Wanted("keypoints", shape=(None, None, 17, 3))),
    ),
    "YOLOX with NMS inside": Dialect(
        (Wanted("input", ("images",), shape=_FRAME),), (Wanted("dets", shape=(None, None, 5)),)
    ),
    "YOLOX": Dialect(
        (Wanted("images", ("input",), shape=_FRAME),), (Wanted("output", ("outputs",), shape=(None, None, None)),)
    ),
    "RT-DETR": Dialect(
        (Wanted("pixel_values", shape=_FRAME),),
        (Wanted("logits", shape=(None, None, None)), Wanted("pred_boxes", shape=(None, None, 4))),
    ),
}
"""YOLOX and RTMO see BGR from 0 to 255 in a letterbox, RT-DETR sees RGB from 0 to 1 squashed to a square."""


class Detector:
    """An open network that finds people.

    Attributes:
        dialect: one of DIALECTS.
    """

    def __init__(self, network: Network) -> None:
        self.network = network
        self.dialect, self._match = choose(network, DIALECTS)
        (port,) = self._match.inputs.values()
        self._size = tuple(side if isinstance(side, int) else USUAL_SIDE for side in port.shape[2:])

    def infer(self, image: UInt8Array, score: float, overlap: float) -> Detections:
        """People in a photo (H, W, 3), best score first.

        Args:
            image: RGB.
            score: below it nobody is believed.
            overlap: boxes that share more (intersection over union) are one person's, where the network itself does
                not choose.

        Raises:
            BackendError: the network answers what this dialect does not know.
        """
        from physic_core.adapters.detections import Detections, clip_boxes, nms

        boxes, scores, joints = _DECODERS[self.dialect](self._match, self.network, image, self._size)
        height, width = image.shape[:2]
        boxes, stay = clip_boxes(boxes, height, width)
        stay &= scores >= score
        found = Detections(boxes[stay], scores[stay].clip(0, 1), None)
        if joints is not None:
            found = Detections(found.boxes, found.scores, _coco17(joints[stay]))
        return found[nms(found.boxes, found.scores, overlap)]


def open_detector(path: Path, options: OnnxOptions, device: str) -> Detector:
    """Open a file of a detector.

    Raises:
        BackendError: it cannot be opened, or is none of DIALECTS.
        DeviceError: the device is not there.
    """
    from .sessions import open_network

    return Detector(open_network(path, options, device))


Answer = tuple["FloatArray", "FloatArray", "NDArray[Any] | None"]
"""Boxes (N, 4) px of the photo, scores (N,), and of RTMO (N, 17, 3) points of the photo and how sure they are."""


def _boxed(image: UInt8Array, size: tuple[int, ...]) -> tuple[FloatArray, Letterbox]:
    """The photo in a grey letterbox from the top left corner, BGR 0..255."""
    from physic_core.adapters.pictures import letterbox, normalized_nchw

    canvas, box = letterbox(image, size[0], size[1], GREY, "top-left")
    return normalized_nchw(canvas[..., ::-1], scale=1.0), box


def _yolox(match: Match, network: Network, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """Raw answers of the head: per cell an offset, the logarithm of a size, "something" and 80 classes."""

    from physic_core.adapters.detections import xyxy_from_cxcywh

    frame, box = _boxed(image, size)
    (raw,) = match.run(network, {"images": frame}, ["output"])
    rows = raw[0].astype(np.float64)
    cells, strides = _yolox_cells(size)
    if rows.ndim != 2 or rows.shape[0] != len(cells) or rows.shape[1] < 6:
        raise BackendError(
            f"a YOLOX file for {size[1]} x {size[0]} px must answer (1, {len(cells)}, 85), got {raw.shape}: "
            "is it of another size, or cut?"
        )
    # Some exports hold the decoding. Offsets are a cell or two, decoded centres lie all over the picture.
    if np.median(np.abs(rows[:, :2])) < 8:
        centres = (rows[:, :2] + cells) * strides[:, None]
        sides = np.exp(np.clip(rows[:, 2:4], None, 20.0)) * strides[:, None]
        rows = np.concatenate([centres, sides, rows[:, 4:]], axis=1)
    score = rows[:, 4] * rows[:, 5 + PERSON]
    return box.edges_to_photo(xyxy_from_cxcywh(rows[:, :4])), score, None


def _yolox_cells(size: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """(N, 2) column and row of each answer's cell, and (N,) its side, px."""

    cells, strides = [], []
    for stride in (8, 16, 32):
        y, x = np.mgrid[: size[0] // stride, : size[1] // stride]
        cells.append(np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64))
        strides.append(np.full(len(cells[-1]), float(stride)))
    return np.concatenate(cells), np.concatenate(strides)


def _chosen(match: Match, network: Network, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """Boxes that the graph itself has chosen: x0 y0 x1 y1 of the letterbox, and a score."""

    frame, box = _boxed(image, size)
    names = ["dets", "keypoints"] if "keypoints" in match.outputs else ["dets"]
    dets, *rest = match.run(network, {"input": frame}, names)
    rows = dets[0].astype(np.float64)
    joints = None
    if rest:
        joints = rest[0][0].astype(np.float64)
        joints[..., :2] = box.edges_to_photo(np.concatenate([joints[..., :2]] * 2, axis=-1))[..., :2] - 0.5
    return box.edges_to_photo(rows[:, :4]), rows[:, 4], joints


def _rt_detr(match: Match, network: Network, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """300 queries: logits of 80 classes, each on its own, and centred boxes in shares of the photo."""

    from physic_core.adapters.detections import xyxy_from_cxcywh
    from physic_core.adapters.pictures import normalized_nchw, resize_image

    frame = normalized_nchw(resize_image(image, size[0], size[1], "bilinear-antialias"))
    logits, boxes = match.run(network, {"pixel_values": frame}, ["logits", "pred_boxes"])
    if logits.shape[-1] in (91, 92):
        raise BackendError(
            f"{network.name} answers {logits.shape[-1]} classes, as DETR does, and not 80 as RT-DETR and D-FINE: "
            "choose a file of those"
        )
    score = 1.0 / (1.0 + np.exp(-np.clip(logits[0, :, PERSON].astype(np.float64), -60.0, 60.0)))
    height, width = image.shape[:2]
    return xyxy_from_cxcywh(boxes[0].astype(np.float64)) * [width, height, width, height], score, None


def _coco17(joints: NDArray[Any]) -> Any:
    from physic_core.types import Keypoints

    return Keypoints(joints[..., :2], joints[..., 2].clip(0, 1), "coco17")


_DECODERS: Mapping[str, Callable[[Match, Network, UInt8Array, tuple[int, ...]], Answer]] = {
    "RTMO": _chosen,
    "YOLOX with NMS inside": _chosen,
    "YOLOX": _yolox,
    "RT-DETR": _rt_detr,
}
