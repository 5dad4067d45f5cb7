"""Segment people with MobileSAM prompted by poses, and resolve overlapping masks."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import mask_iou
from physic_embedded.networks.mobile_sam import predict_masks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession


PROMPT_JOINTS = [0, 11, 12, 13, 14, 23, 24, 25, 26, 27, 28]
"""Landmark indices of joints well inside the body: nose, shoulders, elbows, hips, knees, ankles."""
WRISTS = [15, 16]
MIN_CONFIDENCE = 0.6
MIN_WRIST_CONFIDENCE = 0.9
"""Confidence from which a joint, or a thin joint, is a prompt."""
_MOST_OUTSIDE = 8  # prompts on other people


def person_masks(
    decoder: OnnxSession, embedding: ImageEmbedding, poses: Sequence[Pose]
) -> list[tuple[FloatArray, FloatArray]]:
    """Segment the people of some poses.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        poses: of all people.

    Returns:
        For each person logits (rows, columns) on the grid of the embedding, above 0 inside, before
        overlaps are resolved; and pixels (P, 2) of the photo that are surely on the person.
    """
    grid = embedding.grid_axes()
    softs = [pose.mask_on_grid(*grid) for pose in poses]
    return [
        _person_mask(
            decoder,
            embedding,
            pose,
            soft,
            [*poses[:i], *poses[i + 1 :]],
            np.max([*softs[:i], *softs[i + 1 :]], axis=0, initial=-np.inf),
        )
        for i, (pose, soft) in enumerate(zip(poses, softs, strict=True))
    ]


def _person_mask(
    decoder: OnnxSession,
    embedding: ImageEmbedding,
    pose: Pose,
    soft: FloatArray,
    others: Sequence[Pose],
    theirs: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Segment one person: select the mask proposal that agrees best with the pose network's mask
    and with the joints.

    Joints of the person are the points inside; noses and trunks of the nearest others the points
    outside. The decoder runs with and without a box, and once more with the best mask as input.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        pose: of the person.
        soft: mask logits (rows, columns) of the pose network.
        others: poses of the other people.
        theirs: the largest mask logits (rows, columns) of the pose network for them.
    """
    rough = soft > 0
    # A joint hidden behind another person would prompt for that person.
    inside = _points_in_mask(_own_points(pose, embedding), rough & (soft > theirs), embedding)
    if not len(inside):
        return soft, inside
    outside = _points_in_mask(_noses_and_trunks(others), ~rough | (theirs > soft), embedding)
    near = np.argsort(np.linalg.norm(outside - inside.mean(axis=0), axis=1), kind="stable")[
        :_MOST_OUTSIDE
    ]
    outside = outside[near]

    joints = pose.points[pose.confidence(embedding.width, embedding.height) > MIN_CONFIDENCE]
    joints = _points_in_mask(joints, soft > theirs, embedding)

    def look(
        box: FloatArray | None, start: FloatArray | None = None
    ) -> tuple[float, FloatArray, FloatArray]:
        answer = predict_masks(decoder, embedding, inside, outside, box, start)
        k, fit = _best(answer.logits, rough, joints, outside, embedding)
        return fit, answer.logits[k], answer.raw[k]

    around = _padded_box(rough, embedding)
    free, boxed = look(None), look(around)
    best, box = (boxed, around) if boxed[0] > free[0] else (free, None)
    refined = look(box, best[2])
    return max(best, refined, key=itemgetter(0))[1], inside


_SPECK = 0.1  # of the whole mask


def resolve_overlaps(
    masks: Sequence[tuple[FloatArray, FloatArray]], embedding: ImageEmbedding
) -> BoolArray:
    """Assign each pixel to the person with the largest logit, and return masks (N, H, W) at photo
    size of people by :func:`person_masks`.

    A piece of a mask that holds none of the person's own points and is a small part
    of the whole mask counts as part of another person.
    """
    shape = (embedding.height, embedding.width)
    if not masks:
        return np.zeros((0, *shape), bool)
    owner = np.full(shape, -1, np.int16)
    strongest = np.zeros(shape, np.float32)
    for i, logits in enumerate(_drop_stray_pieces(masks, embedding)):
        fine = embedding.to_photo(logits)
        wins = fine > strongest
        owner[wins] = i
        strongest = np.maximum(strongest, fine)
    return np.stack([owner == i for i in range(len(masks))])


def _drop_stray_pieces(
    masks: Sequence[tuple[FloatArray, FloatArray]], embedding: ImageEmbedding
) -> FloatArray:
    """Return the mask logits (N, rows, columns), negative on small pieces without a point of the
    person.
    """
    import cv2

    logits = np.stack([person_logits for person_logits, _ in masks])
    is_strongest = (logits > 0) & (logits == logits.max(axis=0))
    for i, (_, points) in enumerate(masks):
        count, pieces, stats, _ = cv2.connectedComponentsWithStats(
            is_strongest[i].astype(np.uint8), connectivity=8
        )
        x, y = _cells(points, embedding)
        held = set(pieces[y, x])
        least = _SPECK * is_strongest[i].sum()
        for piece in range(1, count):
            if piece not in held and stats[piece, cv2.CC_STAT_AREA] < least:
                logits[i][pieces == piece] = -1.0
    return logits


def _own_points(pose: Pose, embedding: ImageEmbedding) -> FloatArray:
    """Return prompt points (P, 2) px on the person: confident joints and three points down the
    trunk.
    """
    confidence = pose.confidence(embedding.width, embedding.height)
    clear = [j for j in PROMPT_JOINTS if confidence[j] > MIN_CONFIDENCE] + [
        j for j in WRISTS if confidence[j] > MIN_WRIST_CONFIDENCE
    ]
    shoulders = pose.points[[11, 12]].mean(axis=0)
    hips = pose.points[[23, 24]].mean(axis=0)
    return np.concatenate([pose.points[clear], [shoulders, (shoulders + hips) / 2, hips]])


def _noses_and_trunks(others: Sequence[Pose]) -> FloatArray:
    """Return nose and trunk centre of each person, (Q, 2) photo px."""
    points = [p for o in others for p in (o.points[0], o.points[[11, 12, 23, 24]].mean(axis=0))]
    return np.array(points, float).reshape(-1, 2)


def _cells(
    points: FloatArray, embedding: ImageEmbedding
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return column and row of the mask cells that contain photo pixels (P, 2)."""
    x, y = ((points + 0.5) / embedding.cell).astype(np.intp).T
    return x, y


def _points_in_mask(points: FloatArray, mask: BoolArray, embedding: ImageEmbedding) -> FloatArray:
    """Select the photo pixels (P, 2) that lie on the photo and in a mask."""
    x, y = points.T
    points = points[(x >= 0) & (y >= 0) & (x <= embedding.width - 1) & (y <= embedding.height - 1)]
    column, row = _cells(points, embedding)
    return points[mask[row, column]]


def _padded_box(mask: BoolArray, embedding: ImageEmbedding, margin: float = 0.04) -> FloatArray:
    """Return the box of a grid mask in photo px, slightly larger than its 0.5th to 99.5th
    percentile.
    """
    y, x = np.nonzero(mask)
    low, high = (np.percentile(np.stack([x, y], axis=1), q, axis=0) for q in (0.5, 99.5))
    grow = margin * (high - low)
    edges = np.stack([low - grow, high + grow + 1]) * embedding.cell - 0.5
    edges = np.clip(edges, 0, [embedding.width - 1, embedding.height - 1])
    return edges.ravel()


def _best(
    logits: FloatArray,
    rough: BoolArray,
    joints: FloatArray,
    outside: FloatArray,
    embedding: ImageEmbedding,
) -> tuple[int, float]:
    """Return index and fit of the best proposal.

    The fit is the intersection over union with the rough mask, plus the share of clear joints
    inside, minus the share of other people's points inside, both at 0.3.
    """
    inside = logits > 0

    def share(points: FloatArray) -> FloatArray:
        x, y = _cells(points, embedding)
        return inside[:, y, x].mean(axis=1) if len(points) else np.zeros(len(inside))

    fit = mask_iou(inside, rough[None])[:, 0] + 0.3 * share(joints) - 0.3 * share(outside)
    k = int(np.argmax(fit))
    return k, float(fit[k])
