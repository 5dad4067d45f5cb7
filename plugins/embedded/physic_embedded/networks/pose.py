"""Predict the 33 joints of one person with the BlazePose landmark network."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import mask_iou
from physic_core.types import mirrored_order
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON
from physic_embedded.networks.crops import RotatedSquare
from physic_networks.people import sigmoid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray, UInt8Array
    from physic_embedded.networks.crops import ImagePyramid
    from physic_networks.onnx_sessions import OnnxSession


LANDMARK_SIZE = 256
_HOPELESS = 0.3
"""Score of a first look from which a second one hardly finds a person: of 50 labelled photos with a
second search, 49 have the same joints if such looks end.
"""


@dataclass(frozen=True)
class Pose:
    """33 joints, mask and scores of one person, predicted by the landmark network.

    Attributes:
        points: (33, 2) photo px.
        visibility: (33,) in [0, 1], not hidden by anything.
        presence: (33,) in [0, 1], inside the picture.
        world: (33, 3) metres, x right, y down, z away from the camera, origin between the hips.
        world_spread: (33,) metres, distance of each joint in ``world`` from the one found in the
            mirror image.
        score: in [0, 1], that there is a person at all.
        mask: (256, 256) logits of the person's pixels in ``square``.
        square: the part of the photo that the network saw.
        mirror_gap: mean distance of the joints from those found in the mirror image, over the
            square's side.
        mirror_mask_iou: overlap of the mask with the one found in the mirror image.
    """

    points: FloatArray
    visibility: FloatArray
    presence: FloatArray
    world: FloatArray
    world_spread: FloatArray
    score: float
    mask: FloatArray
    square: RotatedSquare
    mirror_gap: float
    mirror_mask_iou: float

    def confidence(self, width: int, height: int) -> FloatArray:
        """Return visibility times presence (33,); 0 for a joint outside the photo."""
        x, y = self.points.T
        inside = (x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5)
        return np.where(inside, self.visibility * self.presence, 0.0)

    @property
    def torso_length(self) -> float:
        """Distance from mid shoulders to mid hips, px."""
        return float(np.linalg.norm(self.points[[11, 12]].mean(0) - self.points[[23, 24]].mean(0)))

    @cached_property
    def joints_box(self) -> FloatArray:
        """Bounding box (4,) px of the joints inside the picture; of all joints if these are fewer
        than four.
        """
        inside = self.presence > 0.5
        points = self.points[inside] if inside.sum() > 3 else self.points
        return np.concatenate([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def mask_box(self) -> FloatArray:
        """Box (4,) px that contains 99 % of the mask; of all joints if the mask is empty."""
        y, x = np.nonzero(self.mask > 0)
        if len(x) < 5:
            return np.concatenate([self.points.min(axis=0), self.points.max(axis=0)])
        points = self.square.to_photo(np.stack([x, y], axis=-1) + 0.5, len(self.mask))
        return np.percentile(points, [0.5, 99.5], axis=0).ravel()

    def mask_at(self, points: FloatArray) -> FloatArray:
        """Sample the mask logits at photo pixels (N, 2); (N,), -30 outside ``square``."""
        u, v = (self.square.from_photo(points, LANDMARK_SIZE) - 0.5).T
        logits: FloatArray = self._sample(u[None], v[None])[0]
        return logits

    def mask_on_grid(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Sample the mask logits at columns ``x`` (C,) and rows ``y`` (R,) of the photo, px;
        (R, C), -30 outside ``square``.
        """
        origin, *axes = self.square.from_photo(np.array([[0.0, 0], [1, 0], [0, 1]]), LANDMARK_SIZE)
        along, down = (axis - origin for axis in axes)
        u, v = (
            np.add.outer(y * down[i] + origin[i] - 0.5, x * along[i], dtype=np.float32)
            for i in (0, 1)
        )
        return self._sample(u, v)

    def _sample(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Sample the mask logits at columns ``u`` and rows ``v`` (R, C) of the mask."""
        import cv2

        logits: FloatArray = cv2.remap(
            self.mask.astype(np.float32), u.astype(np.float32), v.astype(np.float32),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-30.0,
        )  # fmt: skip
        return logits


def person_square(hip: FloatArray, end: FloatArray) -> RotatedSquare:
    """Return the landmark network's input square, centred on the mid hip.

    In the square, the direction from ``hip`` to ``end`` points up. Half its side is 1.25 times
    their distance.
    """
    up = np.asarray(end, float) - hip
    return RotatedSquare.upright(np.asarray(hip, float), 2.5 * float(np.hypot(*up)), up)


def predict_pose(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare, passes: int = 2
) -> Pose:
    """Predict the pose of the person in a square. Every pass but the last one refines the square.

    The last pass is averaged with that of the mirror image, which is steadier. Their disagreement
    is large where there is no person.

    Args:
        session: of ``pose_landmark_heavy``.
        picture: the photo.
        square: first place to look, see :func:`person_square`.
        passes: number of runs, at least 1; the second moves joints by a few px, more move nothing.
    """
    for _ in range(passes - 1):
        look = _run_network(session, picture.crop(square, LANDMARK_SIZE))
        square = person_square(*square.to_photo(look.points[33:35], LANDMARK_SIZE))
    cut = picture.crop(square, LANDMARK_SIZE)
    return _with_mirror_image(session, cut, square, _run_network(session, cut))


def predict_pose_if_present(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare, least: float = _HOPELESS
) -> Pose | None:
    """Return :func:`predict_pose` of a square, or None if the first look has a score below
    ``least``.
    """
    look = _run_network(session, picture.crop(square, LANDMARK_SIZE))
    if look.score < least:
        return None
    refined = person_square(*square.to_photo(look.points[33:35], LANDMARK_SIZE))
    return predict_pose(session, picture, refined, passes=1)


def predict_pose_above_score(
    session: OnnxSession, picture: ImagePyramid, square: RotatedSquare, score: float
) -> Pose | None:
    """Predict the pose of the person in a square that is not refined.

    Returns:
        As :func:`predict_pose`; None unless its score exceeds ``score``. The mirror image is not
        looked at where the first look is hopeless, or no score of it could raise the mean so far.
    """
    cut = picture.crop(square, LANDMARK_SIZE)
    look = _run_network(session, cut)
    if look.score < max(_HOPELESS, 2 * score - 1.0):
        return None
    pose = _with_mirror_image(session, cut, square, look)
    return pose if pose.score > score else None


def _with_mirror_image(
    session: OnnxSession, cut: UInt8Array, square: RotatedSquare, look: _RawPose
) -> Pose:
    """Average the output for a crop with that for its mirror image, and convert it to the photo."""
    other = _run_network(session, cut[:, ::-1]).mirrored()
    mean = _mean(look, other)
    world = mean.world[:33]
    return Pose(
        points=square.to_photo(mean.points, LANDMARK_SIZE)[:33],
        visibility=mean.visibility[:33],
        presence=mean.presence[:33],
        # The network's x and y follow the turned square; the photo's axes are wanted.
        world=np.concatenate([world[:, :2] @ square.rotation.T, world[:, 2:]], axis=1),
        world_spread=np.linalg.norm(look.world - other.world, axis=1)[:33],
        score=mean.score,
        mask=mean.mask,
        square=square,
        mirror_gap=_gap(look, other),
        mirror_mask_iou=float(mask_iou(look.mask[None] > 0, other.mask[None] > 0)[0, 0]),
    )


def average_agreeing(pose: Pose, others: Sequence[Pose], near: float) -> Pose:
    """Return a pose with each joint averaged over the poses of the same person that agree about it.

    Args:
        pose: counts at every joint.
        others: poses from other squares; may contain ``pose`` itself.
        near: share of the side of the pose's square by which joints may differ.
    """
    points = pose.points.copy()
    world = pose.world.copy()
    count = np.ones((len(pose.points), 1))
    for other in others:
        if other is pose:
            continue
        agree = (
            np.linalg.norm(other.points - pose.points, axis=1, keepdims=True)
            < near * pose.square.side
        )
        points += np.where(agree, other.points, 0.0)
        world += np.where(agree, other.world, 0.0)
        count += agree
    return replace(pose, points=points / count, world=world / count)


@dataclass(frozen=True)
class _RawPose:
    """Network output for one crop: 39 points in crop coordinates, of which 33 are joints."""

    points: FloatArray
    visibility: FloatArray
    presence: FloatArray
    world: FloatArray
    score: float
    mask: FloatArray

    def mirrored(self) -> _RawPose:
        """Return the output mirrored left to right."""
        swap = np.arange(len(self.points))
        swap[:33] = mirrored_order(BLAZEPOSE_SKELETON.names)
        return _RawPose(
            points=self.points[swap] * [-1.0, 1.0] + [float(LANDMARK_SIZE), 0.0],
            visibility=self.visibility[swap],
            presence=self.presence[swap],
            world=self.world[swap] * [-1.0, 1.0, 1.0],
            score=self.score,
            mask=self.mask[:, ::-1],
        )


def _run_network(session: OnnxSession, cut: UInt8Array) -> _RawPose:
    """Run the landmark network on a (256, 256, 3) crop."""
    raw, score, mask, world = session.run(
        ["landmarks", "presence", "mask", "world_landmarks"],
        {"image": cut[None].astype(np.float32) / 255.0},
    )
    rows = raw[0].reshape(39, 5).astype(float)
    return _RawPose(
        points=rows[:, :2],
        visibility=sigmoid(rows[:, 3]),
        presence=sigmoid(rows[:, 4]),
        world=world[0].reshape(39, 3).astype(float),
        score=float(score[0, 0]),
        mask=mask[0, :, :, 0],
    )


def _mean(a: _RawPose, b: _RawPose, near: float = 0.05 * LANDMARK_SIZE) -> _RawPose:
    """Average two outputs.

    A joint that differs by more than ``near`` px is taken from the output with the higher score.
    """
    first, second = (a, b) if a.score >= b.score else (b, a)
    agree = np.linalg.norm(a.points - b.points, axis=1) < near

    def mix(x: FloatArray, y: FloatArray) -> FloatArray:
        mean: FloatArray = (x + y) / 2
        return np.where(agree.reshape(-1, *[1] * (x.ndim - 1)), mean, x)

    return _RawPose(
        points=mix(first.points, second.points),
        visibility=mix(first.visibility, second.visibility),
        presence=mix(first.presence, second.presence),
        world=mix(first.world, second.world),
        score=(a.score + b.score) / 2,
        mask=(a.mask + b.mask) / 2,
    )


def _gap(a: _RawPose, b: _RawPose) -> float:
    """Return the mean distance between the joints of two outputs over the crop's side, weighted by
    common confidence.
    """
    weight = np.minimum(a.visibility * a.presence, b.visibility * b.presence)[:33]
    apart = np.linalg.norm(a.points - b.points, axis=1)[:33]
    return float((weight * apart).sum() / max(weight.sum(), 1e-6) / LANDMARK_SIZE)
