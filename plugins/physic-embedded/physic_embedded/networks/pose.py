"""The 33 joints of one person with the BlazePose landmark network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.detections import sigmoid
from physic_embedded.networks.crops import Square

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from onnxruntime import InferenceSession

    from physic_embedded.networks.crops import Picture

    Float = NDArray[np.floating[Any]]

__all__ = ["LEFT_RIGHT", "Pose", "landmarks", "person_square"]

LANDMARK_SIZE = 256
LEFT_RIGHT = (
    *((1, 4), (2, 5), (3, 6), (7, 8), (9, 10), (11, 12), (13, 14), (15, 16), (17, 18)),
    *((19, 20), (21, 22), (23, 24), (25, 26), (27, 28), (29, 30), (31, 32)),
)
"""Pairs of BlazePose landmarks that trade places in a mirror, the person's left first."""


@dataclass(frozen=True)
class Pose:
    """One person as the landmark network sees it.

    Attributes:
        points: (33, 2) photo px.
        visibility: (33,) in [0, 1], not hidden by anything.
        presence: (33,) in [0, 1], inside the picture.
        world: (33, 3) metres, x right, y down, z away from the camera, origin between the hips.
        score: in [0, 1], that there is a person at all.
        mask: (256, 256) logits of the person's pixels in ``square``.
        square: the part of the photo that the network saw.
        mirror_gap: mean distance of the joints from those found in the mirror image, over the square's side.
        mirror_mask_iou: overlap of the mask with the one found in the mirror image.
    """

    points: Float
    visibility: Float
    presence: Float
    world: Float
    score: float
    mask: Float
    square: Square
    mirror_gap: float
    mirror_mask_iou: float

    def confidence(self, width: int, height: int) -> Float:
        """(33,) visibility times presence; 0 for a joint outside the photo."""
        x, y = self.points.T
        inside = (x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5)
        return np.where(inside, self.visibility * self.presence, 0.0)

    @property
    def torso_length(self) -> float:
        """Mid shoulders to mid hips, px."""
        return float(np.linalg.norm(self.points[[11, 12]].mean(0) - self.points[[23, 24]].mean(0)))

    def mask_at(self, points: Float) -> Float:
        """Logits of the person's mask at (R, C, 2) photo px -> (R, C); very negative outside ``square``."""
        import cv2

        at = (self.square.from_photo(points, LANDMARK_SIZE) - 0.5).astype(np.float32)
        logits: Float = cv2.remap(
            self.mask.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=-30.0,
        )  # fmt: skip
        return logits


def person_square(hip: Float, end: Float) -> Square:
    """The square that the landmark network wants: about the mid hip, upright along hip -> ``end``, 1.25 x as far."""
    d = np.asarray(end, float) - hip
    return Square(np.asarray(hip, float), 2.5 * float(np.hypot(*d)), float(np.arctan2(d[0], -d[1])))


def landmarks(session: InferenceSession, picture: Picture, square: Square, passes: int = 2) -> Pose:
    """Run the landmark network on ``square``, then again where it says the person is.

    It looks at the last square and at its mirror image: the mean of two looks is steadier, and two looks that disagree
    are a sign that there is nobody.

    Args:
        session: of ``pose_landmark_heavy``.
        picture: the photo.
        square: first place to look, see :func:`person_square`.
        passes: number of runs, at least 1; the second moves joints by a few px, more move nothing.
    """
    for _ in range(passes - 1):
        look = _look(session, picture.cut(square, LANDMARK_SIZE))
        square = person_square(*square.to_photo(look.points[33:35], LANDMARK_SIZE))
    cut = picture.cut(square, LANDMARK_SIZE)
    look = _look(session, cut)
    other = _look(session, cut[:, ::-1]).mirrored()
    return _pose(_mean(look, other), square, _gap(look, other), _mask_iou(look.mask, other.mask))


@dataclass(frozen=True)
class _Look:
    """What the network says about one cut: 39 points in corner coordinates of the cut, 33 of them joints."""

    points: Float
    visibility: Float
    presence: Float
    world: Float
    score: float
    mask: Float

    def mirrored(self) -> _Look:
        """The same about the mirror image of the cut."""
        swap = np.arange(len(self.points))
        for a, b in LEFT_RIGHT:
            swap[a], swap[b] = b, a
        return _Look(
            points=self.points[swap] * [-1.0, 1.0] + [float(LANDMARK_SIZE), 0.0],
            visibility=self.visibility[swap],
            presence=self.presence[swap],
            world=self.world[swap] * [-1.0, 1.0, 1.0],
            score=self.score,
            mask=self.mask[:, ::-1],
        )


def _look(session: InferenceSession, cut: NDArray[np.uint8]) -> _Look:
    """One run of the landmark network on a (256, 256, 3) cut."""
    raw, score, mask, world = session.run(
        ["landmarks", "presence", "mask", "world_landmarks"], {"image": cut[None].astype(np.float32) / 255.0}
    )
    rows = raw[0].reshape(39, 5).astype(float)
    return _Look(
        points=rows[:, :2],
        visibility=sigmoid(rows[:, 3]),
        presence=sigmoid(rows[:, 4]),
        world=world[0].reshape(39, 3).astype(float),
        score=float(score[0, 0]),
        mask=mask[0, :, :, 0],
    )


def _mean(a: _Look, b: _Look, near: float = 0.05 * LANDMARK_SIZE) -> _Look:
    """Mean of two looks; a joint on which they differ by more than ``near`` px stays as the surer look has it."""
    first, second = (a, b) if a.score >= b.score else (b, a)
    agree = np.linalg.norm(a.points - b.points, axis=1) < near

    def mix(x: Float, y: Float) -> Float:
        mean: Float = (x + y) / 2
        return np.where(agree.reshape(-1, *[1] * (x.ndim - 1)), mean, x)

    return _Look(
        points=mix(first.points, second.points),
        visibility=mix(first.visibility, second.visibility),
        presence=mix(first.presence, second.presence),
        world=mix(first.world, second.world),
        score=(a.score + b.score) / 2,
        mask=(a.mask + b.mask) / 2,
    )


def _gap(a: _Look, b: _Look) -> float:
    """Mean distance between the joints of two looks over the side of the cut, weighted by what both see."""
    weight = np.minimum(a.visibility * a.presence, b.visibility * b.presence)[:33]
    apart = np.linalg.norm(a.points - b.points, axis=1)[:33]
    return float((weight * apart).sum() / max(weight.sum(), 1e-6) / LANDMARK_SIZE)


def _mask_iou(a: Float, b: Float) -> float:
    """Intersection over union of two masks given as logits."""
    both, any_ = ((a > 0) & (b > 0)).sum(), ((a > 0) | (b > 0)).sum()
    return float(both / max(any_, 1))


def _pose(look: _Look, square: Square, gap: float, mask_iou: float) -> Pose:
    """A look carried from its cut to the photo."""
    points = square.to_photo(look.points, LANDMARK_SIZE)
    world = look.world[:33]
    return Pose(
        points=points[:33],
        visibility=look.visibility[:33],
        presence=look.presence[:33],
        # The network's x and y follow the turned square; the photo's axes are wanted.
        world=np.concatenate([world[:, :2] @ square.rotation.T, world[:, 2:]], axis=1),
        score=look.score,
        mask=look.mask,
        square=square,
        mirror_gap=gap,
        mirror_mask_iou=mask_iou,
    )
