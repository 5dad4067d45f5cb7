"""Detect people, animals, boards and cycles as boxes with YOLOX-nano, in the full image and in
overlapping tiles.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from physic_core.backends.people import box_iou
from physic_core.types import CARRIER_NAMES, Carrier
from physic_embedded.networks.tiles import tiles
from physic_networks.people import Detections, nms, xyxy_from_cxcywh
from physic_networks.pictures import letterbox

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession


INPUT_SIZE = 416
STRIDES = (8, 16, 32)
PADDING_VALUE = 114
CLASSES = {
    "person": 0,
    "bicycle": 1,
    "motorcycle": 3,
    "bird": 14,
    "cat": 15,
    "dog": 16,
    "horse": 17,
    "sheep": 18,
    "cow": 19,
    "elephant": 20,
    "bear": 21,
    "zebra": 22,
    "giraffe": 23,
    "ski": 30,
    "snowboard": 31,
    "skateboard": 36,
    "surfboard": 37,
}
"""Classes of COCO that are read, and their columns: people, what carries people, and animals and
boards that look like people.
"""
UNLIKE_PEOPLE = ("bicycle", "motorcycle")
"""Classes that no box of a person shows, whatever their score."""
MAX_IOU = 0.6
"""Of two boxes with a larger intersection over union, only the better one is kept."""


_EDGE = 0.02  # of the side of a tile: boxes nearer to its edge touch it
_LEAST = {"skateboard": 0.7}  # boxes with lower scores are mostly shoes


class BoxesByClass(NamedTuple):
    """Boxes in an image, best first.

    Attributes:
        people: boxes of people.
        others: boxes of animals and things.
        names: class of each of ``others``.
    """

    people: Detections
    others: Detections
    names: tuple[str, ...]

    def other_at(self, box: FloatArray, score: float, overlap: float) -> str | None:
        """Return the class of an animal or a board with a higher score at a box (4,); None without
        one.

        Args:
            box: x0 y0 x1 y1 px.
            score: of the person in the box.
            overlap: least intersection over union with the box.
        """
        same = box_iou(box[None], self.others.boxes)[0] > overlap
        alike = np.array([name not in UNLIKE_PEOPLE for name in self.names], bool)
        better = np.flatnonzero(same & alike & (self.others.scores > score))
        return self.names[better[0]] if len(better) else None

    def carriers(self, least: float) -> tuple[Carrier, ...]:
        """Return what may carry a person, from a score on."""
        return tuple(
            Carrier(name, tuple(box), score)
            for name, box, score in zip(
                self.names, self.others.boxes.tolist(), self.others.scores.tolist(), strict=True
            )
            if name in CARRIER_NAMES and score >= _LEAST.get(name, least)
        )


def detect_boxes(
    session: OnnxSession,
    image: UInt8Array,
    *,
    min_score: float,
    min_tile_score: float,
    fractions: Sequence[float] = (),
) -> BoxesByClass:
    """Detect people, animals, boards and cycles in an image (H, W, 3).

    A box that touches an edge of its tile inside the image is dropped: the rest of it is in another
    tile.

    Args:
        session: of ``yolox_nano``.
        image: RGB.
        min_score: lowest score in the full image.
        min_tile_score: lowest score in a tile.
        fractions: sides of the tiles over the image's long side.
    """
    height, width = image.shape[:2]
    detections = [_detect(session, image, min_score)]
    for x, y, side in tiles(width, height, fractions):
        tile = image[y : y + side, x : x + side]
        boxes, scores = _detect(session, tile, min_tile_score)
        boxes = boxes + np.array([x, y, x, y], float)
        keep = ~_touches_inner_edge(
            boxes, (x, y, x + tile.shape[1], y + tile.shape[0]), width, height
        )
        detections.append((boxes[keep], scores[keep]))
    boxes = np.clip(np.concatenate([b for b, _ in detections]), 0, [width, height, width, height])
    scores = np.concatenate([s for _, s in detections])
    people = _best_of_class(boxes, scores[:, 0])
    others = [
        (row, best)
        for row in range(1, len(CLASSES))
        for best in _best_of_class(boxes, scores[:, row])
    ]
    others.sort(key=lambda pair: -scores[pair[1], pair[0]])
    rows, chosen = np.array(others, np.intp).reshape(-1, 2).T
    return BoxesByClass(
        Detections(boxes[people], scores[people, 0]),
        Detections(boxes[chosen], scores[chosen, rows]),
        tuple(list(CLASSES)[row] for row in rows),
    )


def _best_of_class(boxes: FloatArray, scores: FloatArray) -> NDArray[np.intp]:
    """Return the rows of the boxes (N, 4) of one class, best first; its scores (N,) are 0 where
    there is none.
    """
    rows = np.flatnonzero(scores > 0)
    return rows[nms(boxes[rows], scores[rows], MAX_IOU)]


def _detect(
    session: OnnxSession, image: UInt8Array, min_score: float
) -> tuple[FloatArray, FloatArray]:
    """Run the network once: boxes (N, 4) x0 y0 x1 y1, px of ``image``, and scores (N, C), 0 up to
    ``min_score``.
    """
    canvas, placement = letterbox(
        image,
        INPUT_SIZE,
        INPUT_SIZE,
        fill=PADDING_VALUE,
        where="top-left",
        how="area" if max(image.shape[:2]) > INPUT_SIZE else "bilinear",
    )
    blue_first = np.ascontiguousarray(canvas[:, :, ::-1].transpose(2, 0, 1), np.float32)
    (output,) = session.run(["output"], {"images": blue_first[None]})
    rows = output[0].astype(float)
    scores = rows[:, 4:5] * rows[:, [5 + column for column in CLASSES.values()]]
    scores = np.where(scores > min_score, scores, 0.0)
    keep = scores.any(axis=1)
    cells, strides = _grid()
    centers = (rows[keep, :2] + cells[keep]) * strides[keep]
    sizes = np.exp(rows[keep, 2:4]) * strides[keep]
    boxes = placement.edges_to_photo(xyxy_from_cxcywh(np.concatenate([centers, sizes], axis=1)))
    return boxes, scores[keep]


@cache
def _grid() -> tuple[FloatArray, FloatArray]:
    """Return the cells (A, 2) x y of all outputs, and their strides (A, 1) px."""
    cells = []
    strides = []
    for stride in STRIDES:
        count = INPUT_SIZE // stride
        y, x = np.mgrid[:count, :count]
        cells.append(np.stack([x, y], axis=-1).reshape(-1, 2).astype(float))
        strides.append(np.full((count * count, 1), float(stride)))
    return np.concatenate(cells), np.concatenate(strides)


def _touches_inner_edge(
    boxes: FloatArray, tile: tuple[int, int, int, int], width: int, height: int
) -> BoolArray:
    """Return (N,) whether a box touches an edge of its tile x0 y0 x1 y1 that is not an edge of the
    image.
    """
    near = max(4.0, _EDGE * max(tile[2] - tile[0], tile[3] - tile[1]))
    x0, y0, x1, y1 = boxes.T
    touches: BoolArray = (
        ((x0 < tile[0] + near) & (tile[0] > 0))
        | ((y0 < tile[1] + near) & (tile[1] > 0))
        | ((x1 > tile[2] - near) & (tile[2] < width))
        | ((y1 > tile[3] - near) & (tile[3] < height))
    )
    return touches
