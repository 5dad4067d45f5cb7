"""Find the poses of the people whom the user chose by points, boxes or masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import box_iou, boxes_from_masks
from physic_core.errors import NoPersonError
from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.mobile_sam import predict_masks
from physic_embedded.networks.pose import predict_pose
from physic_embedded.segmentation.hidden_people import grey_out, without_covered_joints
from physic_embedded.segmentation.people import DetectedPose, box_fit, pose_in_box
from physic_embedded.segmentation.rotated_people import square_around
from physic_embedded.segmentation.upper_bodies import square_from_upper_half

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.types import BoolArray, FloatArray, PeoplePrompt, UInt8Array
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession

MIN_BOX_IOU = 0.5
"""A detected person whose box has less overlap with the user's box is another person, or only a
part.
"""
WHOLE = 1
"""Index of MobileSAM's proposal of the whole object."""


@dataclass(frozen=True)
class DetectedPeople:
    """Detected people of a photo among whom the user chooses, and the networks that look again.

    Attributes:
        image: (H, W, 3) RGB.
        landmarker: session of ``pose_landmark_heavy``.
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        poses: detected people.
        masks: (N, H, W) of the detected people.
    """

    image: UInt8Array
    landmarker: OnnxSession
    decoder: OnnxSession
    embedding: ImageEmbedding
    poses: Sequence[DetectedPose]
    masks: BoolArray


def choose_poses(detected: DetectedPeople, prompt: PeoplePrompt) -> list[DetectedPose]:
    """Return one person for each prompt: a detected one whom it hits, else the pose in the prompt's
    box.

    Raises:
        NoPersonError: no pose is found for a prompt, or two prompts hit the same person.
    """
    chosen: list[DetectedPose] = []
    masks = [] if prompt.masks is None else list(prompt.masks)
    finders: list[Callable[[], DetectedPose | None]] = [
        *(lambda p=p: _at_point(detected, np.array(p, float)) for p in prompt.points),
        *(lambda b=b: _in_box(detected, np.array(b, float)) for b in prompt.boxes),
        *(lambda m=m: _in_mask(detected, m) for m in masks),
    ]
    for i, find in enumerate(finders):
        person = find()
        if person is None:
            height, width = detected.image.shape[:2]
            raise NoPersonError(
                f"no pose of a person was found at {prompt.describe(i)}, in px of the photo at "
                f"{width} x {height} px: choose a place that shows head and torso, or a box around "
                "the person"
            )
        same = [k for k, other in enumerate(chosen) if other.pose is person.pose]
        if same:
            raise NoPersonError(
                f"{prompt.describe(same[0])} and {prompt.describe(i)} hit the same person: give "
                "one prompt for each person, or a box or mask where people overlap"
            )
        chosen.append(person)
    return chosen


def _at_point(detected: DetectedPeople, point: FloatArray) -> DetectedPose | None:
    """Return the detected person whose mask, else whose box contains a pixel; else the one of the
    mask at the pixel.
    """
    x, y = np.rint(point).astype(int)
    on_mask = np.flatnonzero(detected.masks[:, y, x])
    if len(on_mask):
        return detected.poses[int(on_mask[0])]
    boxes = [person.extent for person in detected.poses]
    around = [i for i, (x0, y0, x1, y1) in enumerate(boxes) if x0 <= x < x1 and y0 <= y < y1]
    if around:
        return detected.poses[
            min(around, key=lambda i: float(np.prod(boxes[i][2:] - boxes[i][:2])))
        ]
    answer = predict_masks(detected.decoder, detected.embedding, point[None], np.zeros((0, 2)))
    mask = detected.embedding.to_photo(answer.logits[WHOLE]) > 0
    person = _in_box(detected, boxes_from_masks(mask[None])[0]) if mask.any() else None
    # The mask of a wall or a table has a box that contains other people.
    return person if person is not None and person.pose.mask_at(point[None])[0] > 0 else None


def _in_box(detected: DetectedPeople, box: FloatArray) -> DetectedPose | None:
    """Return the detected person of a box (4,), else the pose in it."""
    if detected.poses:
        overlap = box_iou(box[None], np.stack([person.extent for person in detected.poses]))[0]
        if overlap.max() >= MIN_BOX_IOU:
            return detected.poses[int(overlap.argmax())]
    others = [person.pose for person in detected.poses]
    pose = max(
        _poses_in_box(detected, box, others), key=lambda pose: pose.score * box_fit(pose, box)
    )
    if pose.score <= 0.5:
        return None
    return DetectedPose(pose, float(pose.score * np.sqrt(box_fit(pose, box))), box)


def _in_mask(detected: DetectedPeople, mask: BoolArray) -> DetectedPose | None:
    """Return the detected or predicted pose whose own mask overlaps most with a mask (H, W)."""
    box = boxes_from_masks(mask[None])[0]
    neighbours = [
        person.pose
        for person, pose_mask in zip(detected.poses, detected.masks, strict=True)
        if not (pose_mask & mask).any()
    ]
    poses = [person.pose for person in detected.poses] + _poses_in_box(detected, box, neighbours)

    def overlap(pose: Pose) -> float:
        x, y = detected.embedding.grid_axes()
        pose_mask = pose.mask_on_grid(x, y) > 0
        rows, columns = (
            np.clip(np.rint(at).astype(int), 0, size - 1)
            for at, size in zip((y, x), mask.shape, strict=True)
        )
        prompt_mask = mask[np.ix_(rows, columns)]
        return float((pose_mask & prompt_mask).sum() / max((pose_mask | prompt_mask).sum(), 1))

    best = max(poses, key=lambda pose: pose.score * overlap(pose))
    return DetectedPose(best, float(best.score), box) if best.score > 0.5 else None


def _poses_in_box(detected: DetectedPeople, box: FloatArray, others: Sequence[Pose]) -> list[Pose]:
    """Return poses in a box (4,): with and without the other people, of a whole person and of an
    upper half.
    """
    clear = ImagePyramid.from_image(detected.image)
    grey = ImagePyramid.from_image(grey_out(detected.image, others))
    return [
        pose_in_box(detected.landmarker, clear, box),
        *(
            without_covered_joints(
                predict_pose(detected.landmarker, grey, square, passes=1), others
            )
            for square in (square_around(box), square_from_upper_half(box))
        ),
    ]
