"""Results of several photos of one moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types import ShortRepr
from physic_scene.rigid import CameraPose

if TYPE_CHECKING:
    from physic_core.types import Intrinsics, Reconstruction


@dataclass(frozen=True)
class SceneCamera(CameraPose):
    """Camera of one photo, in the frame of the reference camera.

    Attributes:
        intrinsics: of the image of the photo's result, px.
        rotation_sigma: standard deviation of the rotation, radians; 0 for the reference.
        position_sigma: standard deviation of the camera centre, metres; 0 for the reference.
    """

    intrinsics: Intrinsics
    rotation_sigma: float
    position_sigma: float


@dataclass(frozen=True)
class SkippedPhoto:
    """A photo that is not part of the solution.

    Attributes:
        photo: name of the photo.
        index: of the photo, as it was given.
        reason: short, for programs, such as "same photo" or "does not fit".
        message: the same as a sentence for the user.
    """

    photo: str
    index: int
    reason: str
    message: str


@dataclass(frozen=True)
class SolvedPhoto(ShortRepr):
    """A photo of a moment with its solved camera.

    Attributes:
        index: of the photo, as it was given.
        name: of the photo.
        camera: of the photo, in the frame of the reference camera.
        shown: index in ``SceneResult.reconstruction.people`` -> index in ``result.people``, of the
            people whose bodies this photo shows.
        reprojection: median distance of the solved keypoints from those of the photo, as a share of
            the stature in px.
        scene_scale: factor from the scene of the single photo to that of the solution.
        result: reconstruction of the single photo, in the frame of its camera.
    """

    index: int
    name: str
    camera: SceneCamera
    shown: Mapping[int, int]
    reprojection: float
    scene_scale: float
    result: Reconstruction


@dataclass(frozen=True)
class SceneResult(ShortRepr):
    """Reconstruction of one moment from several photos, in the frame of the reference camera.

    Attributes:
        reconstruction: people, scene and contact as the reference photo shows them, solved with all
            photos.
        reference: index of its photo, as it was given.
        photos: in the solution, in the order in which they were given.
        left_out: photos that are not part of the solution.
    """

    reconstruction: Reconstruction
    reference: int
    photos: tuple[SolvedPhoto, ...]
    left_out: tuple[SkippedPhoto, ...]

    @property
    def reference_photo(self) -> SolvedPhoto:
        """The photo whose camera gives the frame."""
        return next(photo for photo in self.photos if photo.index == self.reference)
