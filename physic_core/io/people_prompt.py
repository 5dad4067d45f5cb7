"""Validate and resize the user's choice of people."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from physic_core.errors import InputError
from physic_core.types import PeoplePrompt


def check_prompt(prompt: PeoplePrompt, width: int, height: int) -> PeoplePrompt:
    """Validate the prompts for a photo of ``width`` x ``height`` px, and return them as tuples and a bool array.

    Raises:
        InputError: there is no prompt; a point or box lies outside the photo; masks are of another size, are empty or
            overlap.
    """
    points = tuple(_numbers(point, 2, "a point needs x, y in px") for point in prompt.points)
    boxes = tuple(_numbers(box, 4, "a box needs x0, y0, x1, y1 in px") for box in prompt.boxes)
    masks = None if prompt.masks is None else np.asarray(prompt.masks)
    checked = PeoplePrompt(points, boxes, masks)  # type: ignore[arg-type]
    if not len(checked):
        raise InputError("no person is chosen: give at least one point, box or mask, or omit the prompt for all people")
    size = f"the upright photo of {width} x {height} px"
    for i, (x, y) in enumerate(checked.points):
        if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
            raise InputError(f"{checked.describe(i)} lies outside {size}: give x, y in its px")
    for i, (x0, y0, x1, y1) in enumerate(checked.boxes, len(points)):
        if not (x0 < x1 and y0 < y1):
            raise InputError(f"{checked.describe(i)} is empty: give x0, y0, x1, y1 with x0 < x1 and y0 < y1")
        if not (x1 > 0 and y1 > 0 and x0 < width and y0 < height):
            raise InputError(f"{checked.describe(i)} lies outside {size}: give x0, y0, x1, y1 in its px")
    if masks is not None:
        _check_masks(masks, width, height)
    return checked


def resize_prompt(prompt: PeoplePrompt, size: tuple[int, int], new_size: tuple[int, int]) -> PeoplePrompt:
    """Convert prompts for an image of ``size`` (width, height) to the same image at ``new_size``.

    Points are pixel centres at integers. Edges of boxes are half open. Masks are sampled at the nearest pixel.

    Raises:
        InputError: no pixel of a mask is left.
    """
    if size == new_size:
        return prompt
    import cv2

    sx, sy = new_size[0] / size[0], new_size[1] / size[1]
    masks = prompt.masks
    if masks is not None:
        masks = np.stack([cv2.resize(m.astype(np.uint8), new_size, interpolation=cv2.INTER_NEAREST) > 0 for m in masks])
        if not masks.any((1, 2)).all():
            lost = int((~masks.any((1, 2))).argmax()) + 1
            raise InputError(
                f"mask {lost} has no pixels at {new_size[0]} x {new_size[1]} px: enlarge it, or raise photo.max_side"
            )
    return PeoplePrompt(
        tuple(((x + 0.5) * sx - 0.5, (y + 0.5) * sy - 0.5) for x, y in prompt.points),
        tuple((x0 * sx, y0 * sy, x1 * sx, y1 * sy) for x0, y0, x1, y1 in prompt.boxes),
        masks,
    )


def _numbers(values: Any, count: int, wanted: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{wanted}: give {count} finite numbers (got {values!r})")
    return numbers


def _check_masks(masks: Any, width: int, height: int) -> None:
    if masks.ndim != 3 or masks.dtype != bool:
        raise InputError(f"masks of people must be (M, H, W) bool, got {masks.shape} {masks.dtype}: convert them")
    if masks.shape[1:] != (height, width):
        raise InputError(
            f"the masks have {masks.shape[2]} x {masks.shape[1]} px, but the upright photo has {width} x {height} "
            f"px: give masks of the photo's size"
        )
    empty = [i + 1 for i in range(len(masks)) if not masks[i].any()]
    if empty:
        raise InputError(f"mask {empty[0]} has no pixels: omit it, or mark the person's pixels")
    if len(masks) and masks.sum(0, dtype=np.int64).max() > 1:
        raise InputError("masks of two people overlap: assign each pixel to at most one person")
