"""The photos of a result that has several: camera, pixels and detected people of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, FloatArray, UInt8Array
    from physic_core.types.camera import Intrinsics


@dataclass(frozen=True)
class Detection(ShortRepr):
    """Box, mask and keypoints of one person in one photo.

    Attributes:
        box: (4,) px, x0 y0 x1 y1.
        score: in [0, 1].
        mask: (H, W) bool.
        keypoints: (J, 2) px, of the skeleton of the result.
        keypoint_confidence: (J,) in [0, 1].
    """

    box: FloatArray
    score: float
    mask: BoolArray
    keypoints: FloatArray
    keypoint_confidence: FloatArray


@dataclass(frozen=True)
class CameraView(ShortRepr):
    """One photo of a result: its pixels, its camera in the frame of the reference camera, and who is in it.

    Attributes:
        photo: name of the photo.
        image: (H, W, 3) uint8 RGB, upright, as reconstructed.
        intrinsics: of ``image``.
        rotation: (3, 3) float64 from the reference frame to the frame of this camera.
        translation: (3,) float64 metres: a point x of the reference frame is ``rotation @ x + translation`` here.
        rotation_sigma: standard deviation of the rotation, radians; 0 for the reference.
        position_sigma: standard deviation of the camera centre, metres; 0 for the reference.
        people: index into ``Reconstruction.people`` -> the person in this photo. Someone who moved between the photos
            is only in the reference.
    """

    photo: str
    image: UInt8Array
    intrinsics: Intrinsics
    rotation: FloatArray
    translation: FloatArray
    rotation_sigma: float
    position_sigma: float
    people: Mapping[int, Detection]

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the reference frame, metres."""
        centre: FloatArray = -self.rotation.T @ self.translation
        return centre

    @property
    def pose(self) -> FloatArray:
        """Rigid transform (4, 4) from the frame of this camera to the reference frame."""
        import numpy as np

        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation.T, self.centre
        return pose

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) of the reference frame to the frame of this camera, metres."""
        moved: FloatArray = points @ self.rotation.T + self.translation
        return moved
