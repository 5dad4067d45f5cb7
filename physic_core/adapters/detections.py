"""Boxes of detectors: their forms, how much two share, and which of several mean one thing.

Corners are x0 y0 x1 y1 px, half open like a slice: the edges of pixels, so that resizing a photo multiplies them. A
point on a pixel's centre has integer coordinates, and lies half a pixel inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Keypoints

__all__ = ["Detections", "box_iou", "boxes_in_photo", "corners_of_centred", "nms"]


@dataclass(frozen=True)
class Detections:
    """People as a detector sees them, best score first.

    Attributes:
        boxes: (N, 4) x0 y0 x1 y1 px of the photo, half open, inside it.
        scores: (N,) in [0, 1].
        keypoints: N rows, where the detector saw joints on its way.
    """

    boxes: FloatArray
    scores: FloatArray
    keypoints: Keypoints | None = None

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, rows: Any) -> Detections:
        """Those that a slice, indices or a mask picks."""
        from dataclasses import replace

        joints = self.keypoints
        if joints is not None:
            joints = replace(
                joints,
                points=joints.points[rows],
                confidence=joints.confidence[rows],
                world=None if joints.world is None else joints.world[rows],
            )
        return Detections(self.boxes[rows], self.scores[rows], joints)


def corners_of_centred(boxes: FloatArray) -> FloatArray:
    """(..., 4) centre x, centre y, width, height -> x0 y0 x1 y1, in the same unit."""
    import numpy as np

    centre, half = boxes[..., :2], boxes[..., 2:] / 2
    corners: FloatArray = np.concatenate([centre - half, centre + half], axis=-1)
    return corners


def box_iou(boxes: FloatArray, others: FloatArray) -> FloatArray:
    """Intersection over union of each of (N, 4) boxes with each of (M, 4) -> (N, M); 0 for empty ones."""
    import numpy as np

    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=-1)
    sizes = [np.clip(b[:, 2:] - b[:, :2], 0, None).prod(axis=-1) for b in (boxes, others)]
    iou: FloatArray = shared / np.maximum(sizes[0][:, None] + sizes[1][None] - shared, 1e-9)
    return iou


def nms(boxes: FloatArray, scores: FloatArray, overlap: float) -> NDArray[np.intp]:
    """Rows of the boxes that stay, best score first.

    A box goes when one with a better score that stays overlaps it by more than ``overlap`` (intersection over union).

    Args:
        boxes: (N, 4) x0 y0 x1 y1.
        scores: (N,).
        overlap: in [0, 1]; 0.45 for boxes of people, 0.65 keeps more of a crowd.
    """
    import numpy as np

    left = np.argsort(-scores, kind="stable")
    kept = []
    while len(left):
        best, left = left[0], left[1:]
        kept.append(best)
        left = left[box_iou(boxes[best : best + 1], boxes[left])[0] <= overlap]
    return np.array(kept, np.intp)


def boxes_in_photo(
    boxes: FloatArray, height: int, width: int, smallest: float = 1.0
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Boxes cut at the edges of a photo, and which of them are then still ``smallest`` px wide and high.

    Args:
        boxes: (N, 4) x0 y0 x1 y1 px; those that are not finite do not stay.
        height: of the photo, px.
        width: of the photo, px.
        smallest: px.
    """
    import numpy as np

    sound: NDArray[np.bool_] = np.asarray(np.isfinite(boxes).all(axis=1))
    inside: FloatArray = np.clip(np.where(sound[:, None], boxes, 0.0), 0.0, [width, height, width, height])
    large: NDArray[np.bool_] = np.asarray((inside[:, 2:] - inside[:, :2] >= smallest).all(axis=1))
    return inside, sound & large
