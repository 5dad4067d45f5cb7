"""Detect people with YOLOX, RT-DETR, RT-DETRv2, D-FINE or RTMO, identified by the ONNX file's
inputs and outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError

from .one_graph import GraphSignature, LoadedGraph, PortSpec, match_signature

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, UInt8Array
    from physic_networks.people import Detections
    from physic_networks.pictures import Letterbox

    from .sessions import Network, OnnxOptions

GREY = 114
"""Grey level around the photo in the training of YOLOX and RTMO."""

DEFAULT_SIDE = 640
"""Input side for files of free size, px."""

PERSON = 0
"""Class index of people in COCO's 80 classes, and in lists of only people."""

_FRAME = (None, 3, None, None)
SIGNATURES: Mapping[str, GraphSignature] = {
    "RTMO": GraphSignature(
        (PortSpec("input", ("images",), shape=_FRAME),),
        (PortSpec("dets", shape=(None, None, 5)), PortSpec("keypoints", shape=(None, None, 17, 3))),
    ),
    "YOLOX with NMS inside": GraphSignature(
        (PortSpec("input", ("images",), shape=_FRAME),), (PortSpec("dets", shape=(None, None, 5)),)
    ),
    "YOLOX": GraphSignature(
        (PortSpec("images", ("input",), shape=_FRAME),),
        (PortSpec("output", ("outputs",), shape=(None, None, None)),),
    ),
    "RT-DETR": GraphSignature(
        (PortSpec("pixel_values", shape=_FRAME),),
        (
            PortSpec("logits", shape=(None, None, None)),
            PortSpec("pred_boxes", shape=(None, None, 4)),
        ),
    ),
}
"""Signatures of the detectors.

YOLOX and RTMO take BGR from 0 to 255 in a letterbox, RT-DETR takes RGB from 0 to 1 in a squashed
square.
"""


class Detector:
    """Loaded person detector, of one of SIGNATURES."""

    def __init__(self, network: Network) -> None:
        self._graph = match_signature(network, SIGNATURES)
        (port,) = self._graph.inputs.values()
        self._size = tuple(
            side if isinstance(side, int) else DEFAULT_SIDE for side in port.shape[2:]
        )

    def infer(self, image: UInt8Array, score: float, overlap: float) -> Detections:
        """Detect people in a photo (H, W, 3), best score first.

        Args:
            image: RGB.
            score: threshold of a person.
            overlap: boxes with a larger intersection over union are one person; unused by networks
                that merge boxes themselves.

        Raises:
            BackendError: the output does not match the signature, or has no finite score.
        """
        from physic_core.types import Keypoints
        from physic_networks.networks import check_answer
        from physic_networks.people import Detections, clip_boxes, nms

        boxes, scores, joints = _DECODERS[self._graph.signature](self._graph, image, self._size)
        check_answer(scores, self._graph.network.name)
        height, width = image.shape[:2]
        boxes, stay = clip_boxes(boxes, height, width)
        stay &= scores >= score
        keypoints = None
        if joints is not None:
            own = joints[stay]
            keypoints = Keypoints(own[..., :2], own[..., 2].clip(0, 1), "coco17")
        found = Detections(boxes[stay], scores[stay].clip(0, 1), keypoints)
        return found[nms(found.boxes, found.scores, overlap)]


def open_detector(path: Path, options: OnnxOptions, device: str) -> Detector:
    """Open the ONNX file of a detector.

    Raises:
        BackendError: it cannot be opened, or is not one of SIGNATURES.
        DeviceError: the device is not there.
    """
    from .sessions import open_network

    return Detector(open_network(path, options, device))


Answer = tuple["FloatArray", "FloatArray", "NDArray[Any] | None"]
"""Boxes (N, 4) px, scores (N,), and for RTMO joints (N, 17, 3) with confidence."""


def _letterbox_bgr(image: UInt8Array, size: tuple[int, ...]) -> tuple[FloatArray, Letterbox]:
    """Return the photo in a grey letterbox at the top left corner, BGR 0 to 255."""
    from physic_networks.pictures import letterbox, normalized_nchw

    canvas, box = letterbox(image, size[0], size[1], GREY, "top-left")
    return normalized_nchw(canvas[..., ::-1], scale=1.0), box


def _decode_yolox(graph: LoadedGraph, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """Run YOLOX and decode its head: per cell an offset, a log size, an objectness and 80 class
    scores.
    """

    from physic_networks.people import xyxy_from_cxcywh

    frame, box = _letterbox_bgr(image, size)
    (raw,) = graph.run({"images": frame}, ["output"])
    rows = raw[0].astype(np.float64)
    cells, strides = _yolox_cells(size)
    if rows.ndim != 2 or rows.shape[0] != len(cells) or rows.shape[1] < 6:
        raise BackendError(
            f"a YOLOX file for {size[1]} x {size[0]} px must return (1, {len(cells)}, 85), got "
            f"{raw.shape}: is it of another size, or cut?"
        )
    # Some exports hold the decoding. Offsets are a cell or two, decoded centres lie all over the
    # picture.
    if np.median(np.abs(rows[:, :2])) < 8:
        centres = (rows[:, :2] + cells) * strides[:, None]
        sides = np.exp(np.clip(rows[:, 2:4], None, 20.0)) * strides[:, None]
        rows = np.concatenate([centres, sides, rows[:, 4:]], axis=1)
    score = rows[:, 4] * rows[:, 5 + PERSON]
    return box.edges_to_photo(xyxy_from_cxcywh(rows[:, :4])), score, None


def _yolox_cells(size: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return column and row (N, 2) and side (N,) px of each output cell."""

    cells = []
    strides = []
    for stride in (8, 16, 32):
        y, x = np.mgrid[: size[0] // stride, : size[1] // stride]
        cells.append(np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64))
        strides.append(np.full(len(cells[-1]), float(stride)))
    return np.concatenate(cells), np.concatenate(strides)


def _decode_nms(graph: LoadedGraph, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """Run a detector with built-in NMS: boxes x0 y0 x1 y1 of the letterbox, scores, and RTMO's
    joints.
    """

    frame, box = _letterbox_bgr(image, size)
    dets, *rest = graph.run({"input": frame}, graph.outputs)
    rows = dets[0].astype(np.float64)
    joints = None
    if rest:
        joints = rest[0][0].astype(np.float64)
        joints[..., :2] = (
            box.edges_to_photo(np.concatenate([joints[..., :2]] * 2, axis=-1))[..., :2] - 0.5
        )
    return box.edges_to_photo(rows[:, :4]), rows[:, 4], joints


def _decode_rt_detr(graph: LoadedGraph, image: UInt8Array, size: tuple[int, ...]) -> Answer:
    """Run RT-DETR: 300 queries with logits of 80 classes, and centred boxes in shares of the
    photo.
    """

    from physic_networks.people import sigmoid, xyxy_from_cxcywh
    from physic_networks.pictures import normalized_nchw, resize_image

    frame = normalized_nchw(resize_image(image, size[0], size[1], "bilinear-antialias"))
    logits, boxes = graph.run({"pixel_values": frame}, ["logits", "pred_boxes"])
    if logits.shape[-1] in (91, 92):
        raise BackendError(
            f"{graph.network.name} returns {logits.shape[-1]} classes, as DETR does, and not 80 as "
            "RT-DETR and D-FINE: choose a file of those"
        )
    score = sigmoid(logits[0, :, PERSON].astype(np.float64))
    height, width = image.shape[:2]
    return (
        xyxy_from_cxcywh(boxes[0].astype(np.float64)) * [width, height, width, height],
        score,
        None,
    )


_DECODERS: Mapping[str, Callable[[LoadedGraph, UInt8Array, tuple[int, ...]], Answer]] = {
    "RTMO": _decode_nms,
    "YOLOX with NMS inside": _decode_nms,
    "YOLOX": _decode_yolox,
    "RT-DETR": _decode_rt_detr,
}
