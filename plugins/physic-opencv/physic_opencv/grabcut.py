"""Segment people by GrabCut in boxes or around keypoints that the user gives.

OpenCV 5 has no classical person detector (HOG left the main modules), so this backend detects nobody: it segments the
people to which the options point.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import BackendError, ConfigError
from physic_core.types import Keypoints, People

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, UInt8Array

__all__ = ["GrabCut", "GrabCutOptions"]

_LIMBS = {
    "points": (),
    "coco17": (
        (0, 5), (0, 6), (5, 6), (5, 7), (7, 9), (6, 8), (8, 10), (5, 11), (6, 12), (5, 12), (6, 11), (11, 12),
        (11, 13), (13, 15), (12, 14), (14, 16),
    ),
}  # fmt: skip
# Shares of the larger side of a person's box.
_CORE_WIDTH, _HALO_WIDTH, _REACH_WIDTH, _BOX_MARGIN, _CONTEXT = 0.03, 0.10, 0.22, 0.10, 0.25


Pixel = Annotated[float, Field(ge=-1e6, le=1e6)]


class GrabCutOptions(interfaces.Options):
    """Settings of :class:`GrabCut`: give ``boxes`` or ``keypoints``."""

    boxes: tuple[tuple[Pixel, Pixel, Pixel, Pixel], ...] = Field(
        (), max_length=1000, description="One box a person, x0 y0 x1 y1 px, half open, loosely round the whole person."
    )
    keypoints: tuple[Annotated[tuple[tuple[Pixel, Pixel], ...], Field(max_length=1000)], ...] = Field(
        (),
        max_length=1000,
        description="One list of x y px a person: points that lie on the person. Used where no boxes are given.",
    )
    skeleton: Literal["points", "coco17"] = Field(
        "points", description='How keypoints hang together: "coco17" draws the limbs, "points" uses the points alone.'
    )
    working_px: int = Field(
        360,
        ge=64,
        le=10_000,
        description="Longest side of the crop that GrabCut works on, px; 256-512 works, time grows squared.",
    )
    iterations: int = Field(5, ge=1, le=50, description="Rounds of colour models and graph cut; 3-8 works.")
    cleanup: float = Field(
        0.01,
        ge=0,
        le=0.2,
        description="Radius of the morphological clean-up as a share of the box's larger side; 0 leaves the cut alone.",
    )
    seed: int = Field(0, ge=0, le=2**32 - 1, description="Seed of the colour clusters.")


class GrabCut(interfaces.Segmenter):
    """Segmenter by colour models and graph cuts (C. Rother et al., 2004) in given boxes or around given keypoints."""

    Options = GrabCutOptions
    options: GrabCutOptions

    @staticmethod
    def conformance_options(world: Any) -> dict[str, object]:
        """Return options with the people's boxes of a world, for the conformance kit."""
        return {"boxes": world.boxes.tolist()}

    def infer(self, image: UInt8Array) -> People:
        """Segment the people at the boxes or keypoints in the options, best score first; the floor is not segmented.

        The score is the overlap (IoU) of the box that was asked for and the box of the mask that was found. Where two
        people claim a pixel, the one whose box reaches lower in the photo has it.

        Raises:
            InputError: the image has another shape or dtype.
            ConfigError: the options give neither boxes nor keypoints, or a box that holds no pixels of the image.
            BackendError: nothing stands out in one of the boxes.
        """
        options = self.options
        height, width = image.shape[:2]
        seeds = [np.asarray(points, np.float64) for points in options.keypoints]
        boxes = [np.asarray(box, np.float64) for box in options.boxes] or [_box_of(points) for points in seeds]
        if not boxes:
            raise ConfigError(
                "GrabCut finds nobody by itself: give options.boxes = [[x0, y0, x1, y1]] or options.keypoints = "
                "[[[x, y], ...]] for each person, or choose a segmenter with a detector."
            )
        if options.boxes:
            seeds = [np.zeros((0, 2))] * len(boxes)
        boxes = [np.array([*np.maximum(box[:2], 0), *np.minimum(box[2:], [width, height])]) for box in boxes]
        for box in boxes:
            if box[2] - box[0] < 4 or box[3] - box[1] < 4:
                raise ConfigError(
                    f"A box of GrabCut holds too little of the {width} x {height} px image: {box.round(1).tolist()} px "
                    "after clipping. Give x0 y0 x1 y1 in px of the upright image, at least 4 px wide and high."
                )

        taken = np.zeros((height, width), bool)
        masks: dict[int, BoolArray] = {}
        for i in sorted(range(len(boxes)), key=lambda i: -boxes[i][3]):
            others = [box for j, box in enumerate(boxes) if j != i]
            masks[i] = _cut(image, boxes[i], seeds[i], others, options) & ~taken
            if not masks[i].any():
                raise _empty_cut_error(boxes[i])
            taken |= masks[i]
        tight = {i: _tight(mask) for i, mask in masks.items()}
        scores = {i: _overlap(boxes[i], tight[i]) for i in masks}
        order = sorted(masks, key=lambda i: -scores[i])
        return People(
            masks=np.stack([masks[i] for i in order]),
            boxes=np.stack([tight[i] for i in order]),
            scores=np.array([scores[i] for i in order]),
            keypoints=_given_keypoints([seeds[i] for i in order], options.skeleton),
        )


def _given_keypoints(seeds: list[NDArray[np.float64]], skeleton: str) -> Keypoints | None:
    """Return the user's keypoints if all are COCO-17."""
    if skeleton != "coco17" or any(len(points) != 17 for points in seeds):
        return None
    points = np.stack(seeds)
    return Keypoints(points=points, confidence=np.ones(points.shape[:2]), skeleton=skeleton)


def _box_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a box around points, with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _BOX_MARGIN * max(high - low)
    return np.concatenate([low - margin, high + margin])


def _cut(
    image: UInt8Array,
    box: NDArray[np.float64],
    points: NDArray[np.float64],
    others: list[NDArray[np.float64]],
    options: GrabCutOptions,
) -> BoolArray:
    """Segment one person on a crop around the box, and return the mask (H, W)."""
    import cv2

    height, width = image.shape[:2]
    side = max(box[2] - box[0], box[3] - box[1])
    x0, y0 = np.maximum(np.floor(box[:2] - _CONTEXT * side), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(box[2:] + _CONTEXT * side), [width, height]).astype(int)
    scale = min(1.0, options.working_px / max(x1 - x0, y1 - y0))
    size = (max(2, round((x1 - x0) * scale)), max(2, round((y1 - y0) * scale)))
    crop = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    factor = np.array([size[0] / (x1 - x0), size[1] / (y1 - y0)])

    labels = np.full(crop.shape[:2], cv2.GC_BGD, np.uint8)

    def slices(box: NDArray[np.float64]) -> tuple[slice, slice]:
        corners = np.round((box.reshape(2, 2) - [x0, y0]) * factor).astype(int)
        (left, top), (right, bottom) = np.clip(corners, 0, size)
        return slice(top, bottom), slice(left, right)

    inside = slices(box)
    if len(points):
        _draw_seeds(labels, inside, ((points - [x0, y0] + 0.5) * factor - 0.5), side * factor.mean(), options.skeleton)
    else:
        labels[inside] = cv2.GC_PR_FGD
    foreground = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    if not foreground.any():
        raise _empty_cut_error(box)
    if foreground.all():
        raise BackendError(
            f"GrabCut needs some background, but the box {box.round(1).tolist()} px covers the whole image: "
            "give a smaller box, or keypoints."
        )
    allowed = labels != cv2.GC_BGD
    for other in others:
        # A neighbour counted as background would teach the colour models that clothes and skin are background.
        view = labels[slices(other)]
        view[view == cv2.GC_BGD] = cv2.GC_PR_FGD
    cv2.setRNGSeed(options.seed)
    models = np.zeros((2, 1, 65))
    cv2.grabCut(crop, labels, None, models[0], models[1], options.iterations, cv2.GC_INIT_WITH_MASK)
    cut = _clean(allowed & ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)), options.cleanup * side * scale)
    mask = np.zeros((height, width), bool)
    mask[y0:y1, x0:x1] = cv2.resize(cut.astype(np.float32), (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR) > 0.5
    return mask


def _empty_cut_error(box: NDArray[np.float64]) -> BackendError:
    """Return the error for a box without a segmented person."""
    return BackendError(
        f"GrabCut found nothing that stands out in the box {box.round(1).tolist()} px: "
        "draw the box round the whole person, with some background inside, or give keypoints."
    )


def _draw_seeds(
    labels: UInt8Array, inside: tuple[slice, slice], points: NDArray[np.float64], side: float, skeleton: str
) -> None:
    """Label pixels near the limbs as sure or likely foreground, then likely background; the rest is background.

    Points without limbs do not show how far the body reaches, so the rest of the box stays undecided.
    """
    import cv2

    limbs = [(a, b) for a, b in _LIMBS[skeleton] if max(a, b) < len(points)]
    if not limbs:
        labels[inside] = cv2.GC_PR_BGD
    brushes = ((_REACH_WIDTH, cv2.GC_PR_BGD), (_HALO_WIDTH, cv2.GC_PR_FGD), (_CORE_WIDTH, cv2.GC_FGD))
    for share, value in brushes if limbs else brushes[1:]:
        thickness = max(1, round(share * side))
        for x, y in points:
            cv2.circle(labels, (round(x), round(y)), max(1, thickness // 2), value, -1)
        for a, b in limbs:
            start, end = (tuple(int(c) for c in points[i].round()) for i in (a, b))
            cv2.line(labels, start, end, value, thickness)


def _clean(mask: BoolArray, radius: float) -> BoolArray:
    """Open and close a mask by ``radius`` px, drop parts below a tenth of the largest, and fill small holes."""
    import cv2

    if round(radius) < 1:
        return mask
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(radius) + 1,) * 2)
    cleaned = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, brush)
    cleaned = cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, brush)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(cleaned, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2:
        return np.zeros_like(mask)
    kept = np.isin(parts, 1 + np.flatnonzero(areas >= 0.1 * areas.max()))
    # A hole is background that the border of the crop cannot reach; only small ones are filled: an arm akimbo stays.
    _, parts, stats, _ = cv2.connectedComponentsWithStats((~kept).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < 0.01 * np.count_nonzero(kept)
    filled: BoolArray = kept | (small[parts] & ~kept)
    return filled


def _tight(mask: BoolArray) -> NDArray[np.float64]:
    """Return the tight box of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the intersection over union of two boxes."""
    sides = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0, None)
    both = float(sides.prod())
    return both / (float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod()) - both)
