"""Convert the mask logits of SAM 2 and SAM 3 to person masks and a floor mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import NoPersonError
from physic_networks.people import mask_nms, people_from_masks
from physic_networks.pictures import resize_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, People, PeoplePrompt

_GIVEN = 1e9  # logit of a mask of the user's, which takes pixels of all others


def best_rows(scores: FloatArray, threshold: float, max_rows: int) -> NDArray[np.intp]:
    """Return at most ``max_rows`` rows with a score above the threshold, best first."""

    order = np.argsort(-scores, kind="stable")
    return order[scores[order] > threshold][:max_rows]


def people_from_sam(
    logits: FloatArray,
    boxes: FloatArray,
    scores: FloatArray,
    floor: BoolArray | None,
    size: tuple[int, int],
    *,
    same: float,
) -> People:
    """Build people from masks (N, h, w), one mask per person, and remove duplicates.

    Args:
        logits: (N, h, w) over the whole photo, above 0 inside.
        boxes: (N, 4) x0 y0 x1 y1 px of the photo, the prompts of the masks.
        scores: (N,) in [0, 1].
        floor: (H, W) or None.
        size: H and W of the photo.
        same: masks that share more of their union than this are one person, seen twice.
    """

    rows = mask_nms(logits > 0, scores, same) if len(logits) else np.zeros(0, np.intp)
    masks = (resize_map(logits[i], *size) for i in rows)
    return people_from_masks(masks, boxes[rows], scores[rows], floor, size=size)


def people_of_prompt(
    logits: FloatArray, prompt: PeoplePrompt, floor: BoolArray | None, size: tuple[int, int]
) -> People:
    """Build exactly the people whom the user chose, in the order of the prompts.

    Args:
        logits: (P, h, w) over the whole photo, of the P points and boxes of the prompt.
        prompt: whose masks are kept as they are.
        floor: (H, W) or None.
        size: H and W of the photo.

    Raises:
        NoPersonError: no pixel of a person is left.
    """
    for i, one in enumerate(logits):
        if not (one > 0).any():
            raise NoPersonError(
                f"no person was found at {prompt.describe(i)}: mark the person with a mask"
            )
    masks = [resize_map(one, *size) for one in logits]
    masks += [
        np.where(mask, _GIVEN, -1.0) for mask in (() if prompt.masks is None else prompt.masks)
    ]
    people = people_from_masks(masks, None, np.ones(len(masks)), floor, size=size)
    if len(people) != len(prompt):
        raise NoPersonError(
            "a chosen person is hidden by the others: leave one out, or give a mask of each person"
        )
    return people


def union_of_masks(logits: FloatArray, size: tuple[int, int]) -> BoolArray:
    """Return the union (H, W) at photo size of masks (N, h, w) given as logits."""

    union: BoolArray = np.zeros(size, bool)
    for one in logits:
        union |= resize_map(one, *size) > 0
    return union
