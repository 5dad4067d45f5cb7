"""Boxes of people without a pose: segment them, omit those of people who have one, and find masks
of two people.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import boxes_from_masks
from physic_core.types import FOUND_TWICE, HARDLY_VISIBLE
from physic_embedded.networks.mobile_sam import predict_masks
from physic_embedded.segmentation.hidden_hips import HEAD
from physic_embedded.segmentation.people import share_inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import BoolArray, IntArray, SurfaceLabels, UnposedPerson
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession

SURE_SCORE = 0.65
"""A box of lower score may be of a chair or a tree, unless its pixels are labelled as a person."""
MIN_PERSON_SHARE = 0.1
"""Least share of the middle of such a box that is labelled as a person."""
MIN_OWN_SHARE = 0.5
"""A box is of a person with a pose unless this share of its mask lies outside the masks of posed
people.
"""

LIMB_ENDS = slice(15, 33)
"""Landmarks of hands, knees and feet, and of the hips."""
HEAD_SCORE = 0.5
"""A box of lower score does not show that there is a second person."""
MIN_MASK_SHARE = 0.35
MIN_TOP_SHARE = 0.3
MAX_ABOVE_SHARE = 0.35
"""Least share of such a box, and of its upper fifth, in the mask; largest share of the strip above
it.
"""


def segment_unposed(
    decoder: OnnxSession,
    embedding: ImageEmbedding,
    boxes: Sequence[UnposedPerson],
    poses: Sequence[Pose],
    people: BoolArray,
    surfaces: SurfaceLabels | None,
) -> tuple[tuple[UnposedPerson, ...], BoolArray]:
    """Segment boxes without a pose by MobileSAM, best score first.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        boxes: of people without a pose.
        poses: of the people with a pose.
        people: (H, W) bool, pixels of the same people.
        surfaces: semantic labels, or None to trust only the scores of the boxes.

    Returns:
        The boxes but those of chairs and trees. One with a mask that mostly covers no other person
        becomes the box of these pixels; others are found twice; those hardly visible are left out
        if they show a part of a person with a pose.
        And the pixels (H, W) of the people who are missing.
    """
    masks = []
    taken = np.zeros_like(people)
    missing = np.zeros_like(people)
    for box in sorted(boxes, key=lambda one: -one.score):
        if box.reason == FOUND_TWICE:
            masks.append(box)
            continue
        if (
            surfaces is not None
            and box.score < SURE_SCORE
            and _person_share(surfaces, box) < MIN_PERSON_SHARE
        ):
            continue
        mask = people
        if box.score >= SURE_SCORE or not any(_is_limb(box, pose) for pose in poses):
            none = np.zeros((0, 2))
            answer = predict_masks(decoder, embedding, none, none, np.asarray(box.box, float))
            mask = embedding.to_photo(answer.logits[int(answer.iou.argmax())]) > 0
        least = MIN_OWN_SHARE * max(mask.sum(), 1)
        box_mask = mask & ~people & ~taken
        if box_mask.sum() < least:
            if box.reason != HARDLY_VISIBLE or (mask & people).sum() < least:
                masks.append(replace(box, reason=FOUND_TWICE))
            continue
        x0, y0, x1, y1 = (float(edge) for edge in boxes_from_masks(box_mask[None])[0])
        masks.append(replace(box, box=(x0, y0, x1, y1)))
        taken |= box_mask
        if box.is_missing:
            missing |= box_mask
    return tuple(masks), missing


def _is_limb(unposed: UnposedPerson, pose: Pose) -> bool:
    """Return whether a box lower than a person's trunk holds a limb's end of this person, and lies
    mostly in the box of the joints: a face beside a raised hand does not.
    """
    low, high = np.array(unposed.box).reshape(2, 2)
    ends = pose.points[LIMB_ENDS]
    inside = ((ends >= low) & (ends <= high)).all(1).any()
    is_low = high[1] - low[1] < pose.torso_length
    return bool(inside and is_low and share_inside(np.array(unposed.box), pose.joints_box) > 0.5)


def _person_share(surfaces: SurfaceLabels, unposed: UnposedPerson) -> float:
    """Return the share of the middle two thirds of a box that is labelled as a person."""
    x0, y0, x1, y1 = np.rint(unposed.box).astype(int)
    across = (x1 - x0) // 6
    down = (y1 - y0) // 6
    middle = surfaces.mask("person")[
        y0 + down : max(y1 - down, y0 + down + 1), x0 + across : max(x1 - across, x0 + across + 1)
    ]
    return float(middle.mean()) if middle.size else 0.0


def count_heads(
    boxes: Sequence[UnposedPerson], poses: Sequence[Pose], masks: BoolArray
) -> IntArray:
    """Return the number of heads (N,) in each of the masks (N, H, W) of people with poses.

    A box without a pose shows another head if the mask begins at its top, and no head of a pose is
    there. Boxes around a part of a person begin within the mask, or at that person's head.
    """
    heads = np.ones(len(masks), int)
    height, width = masks.shape[1:]
    head_centers = np.array([pose.points[HEAD].mean(0) for pose in poses]).reshape(-1, 2)
    for one in boxes if len(masks) else ():
        x0, y0, x1, y1 = (
            np.clip(np.rint(one.box), 0, [width, height, width, height]).astype(int).tolist()
        )
        w = x1 - x0
        h = y1 - y0
        if one.score < HEAD_SCORE or not w or not h:
            continue
        inside = masks[:, y0:y1, x0:x1].mean((1, 2))
        person = int(inside.argmax())
        across = slice(x0 + w // 4, x1 - w // 4)
        above_mask = masks[person, max(y0 - h // 10, 0) : y0, across]
        top = masks[person, y0 : y0 + h // 5 + 1, across]
        begins = not above_mask.size or above_mask.mean() <= MAX_ABOVE_SHARE
        x = (head_centers[:, 0] - x0) / w
        y = (head_centers[:, 1] - y0) / h
        beside = (x > -0.1) & (x < 1.1) & (y > -0.1)
        known = (beside & (y < 0.4)).any() or (beside[person] and y[person] < 1)
        if (
            begins
            and not known
            and inside[person] >= MIN_MASK_SHARE
            and top.size
            and top.mean() >= MIN_TOP_SHARE
        ):
            heads[person] += 1
    return heads
