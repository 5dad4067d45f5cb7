"""Several photos of one moment: what each of them shows alone, and the cameras that follow from all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray, IntArray, UInt8Array
    from physic_core.types.bodies import Bodies
    from physic_core.types.camera import Intrinsics
    from physic_core.types.depth import Plane
    from physic_core.types.people import Keypoints, People


@dataclass(frozen=True)
class MomentView(ShortRepr):
    """One of several photos of a moment: what it shows by itself, in the frame of its camera, metres.

    Row i of people, keypoints, bodies and statures is the same person.

    Attributes:
        name: of the photo, for messages.
        image: (H, W, 3) uint8 RGB, upright and undistorted.
        intrinsics: camera of ``image``; ``trust`` and ``focal_sigma`` say how far its focal length can be off.
        people: N people who have a body; their masks tell the background.
        keypoints: of the N people, J each; all photos of a moment have the same skeleton.
        bodies: of the N people, with ``joints``, as the photo alone shows them: distances from the camera have the
            errors of single photos.
        statures: (N,) known standing heights, metres, NaN where unknown.
        floor: plane under the people, or None.
        pose: (4, 4) rigid transform from the frame of this camera to that of a calibrated rig, metres; None where
            unknown. All poses of a moment are of one rig, and ``intrinsics`` are those of the same calibration.
    """

    name: str
    image: UInt8Array
    intrinsics: Intrinsics
    people: People
    keypoints: Keypoints
    bodies: Bodies
    statures: FloatArray
    floor: Plane | None = None
    pose: FloatArray | None = None


@dataclass(frozen=True)
class SkippedPhoto:
    """A photo that is not part of the solution.

    Attributes:
        photo: name of the photo.
        index: of the photo, as it was given.
        reason: short, for programs, such as "same photo" or "other people".
        message: the same as a sentence for the user.
    """

    photo: str
    index: int
    reason: str
    message: str


@dataclass(frozen=True)
class SolvedCameras(ShortRepr):
    """Result of a CameraSolver: cameras of V photos, and who is who in them, in the frame of the reference camera.

    Values of photos in ``skipped`` are ignored; they can be NaN.

    Attributes:
        reference: index of the photo whose camera gives the frame.
        rotation: (V, 3, 3) from the reference frame to the frame of each camera; identity for the reference.
        translation: (V, 3) metres: a point x of the reference frame is ``rotation @ x + translation`` in a camera.
        intrinsics: solved camera of each photo, with ``focal_sigma``.
        rotation_sigma: (V,) standard deviation of each rotation, radians; 0 for the reference.
        position_sigma: (V,) standard deviation of each camera centre, metres; 0 for the reference.
        people: (P, V) int, row of each person in each photo, -1 where the photo does not show the person. Everybody is
            in at least two photos.
        points: (P, J, 3) metres, the keypoints of each person in the reference frame, NaN where unknown.
        scale_sigma: standard deviation of the logarithm of all lengths, or None if it is not known.
        moved: (M, V) int, the same as ``people`` for people whose places or poses differ between the photos, and who
            have no points; None if there are none.
        skipped: photos that are not part of the solution.
        notes: plain sentences for the user.
        diagnostics: numbers for the record.
    """

    reference: int
    rotation: FloatArray
    translation: FloatArray
    intrinsics: tuple[Intrinsics, ...]
    rotation_sigma: FloatArray
    position_sigma: FloatArray
    people: IntArray
    points: FloatArray
    scale_sigma: float | None = None
    moved: IntArray | None = None
    skipped: tuple[SkippedPhoto, ...] = ()
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
