"""Point map, depth map and plane, and the hints: results of earlier backends for later ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from physic_core.types.arrays import shape
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, FloatArray, UInt8Array
    from physic_core.types.bodies import Bodies
    from physic_core.types.camera import Intrinsics
    from physic_core.types.observations import Observations
    from physic_core.types.people import Keypoints, People

AffineAmbiguity = Literal["scale", "scale_shift", "inverse_scale_shift"]
"""Unknown transformation from a relative depth Z' to a metric depth Z:
``Z = s Z'`` | ``Z = s Z' + t`` | ``1 / Z = s / Z' + t``."""


@dataclass(frozen=True)
class Plane(ShortRepr):
    """Oriented plane; the height of a point X above it is ``normal . X + offset``.

    Attributes:
        normal: (3,) unit vector that points up, out of the floor, to the camera's side.
        offset: height of the camera above the plane, in the units of the points (meters once
            scaled).
    """

    normal: FloatArray = field(metadata=shape(3))
    offset: float


@dataclass(frozen=True)
class Pointmap(ShortRepr):
    """3D point of each pixel in the camera frame, metric up to the transformation ``unknown``.

    Attributes:
        points: (H, W, 3) float32; z > 0 where valid.
        valid: (H, W) bool.
        unknown: unknown transformation from these points to metric ones.
        intrinsics: the camera of the points, or None if the backend does not know it.
        notes: plain sentences for the user ("focal length is a default").
        shift_sigma: standard deviation of the unknown shift of 1 / z, in 1 / unit of the points;
            None if not estimated.
        people_farther: mean and standard deviation of log(depth of people / depth of the floor that
            they stand on) in maps of the backend, which are 0 and small for a perfect map. None if
            not known: then nothing is concluded from this ratio.
        warnings: reasons why the map may be wrong, as sentences for the user.
        up: (3,) unit vector against gravity in the camera frame, by evidence of the photo; None if
            the backend does not know it.
        up_sigma: standard deviation of its angle to the truth in each direction, degrees; given
            with ``up``.
        up_source: what tells it, in words ("lines of a room").
    """

    points: FloatArray = field(metadata=shape("H", "W", 3))
    valid: BoolArray = field(metadata=shape("H", "W"))
    unknown: AffineAmbiguity
    intrinsics: Intrinsics | None = None
    notes: tuple[str, ...] = ()
    shift_sigma: float | None = None
    people_farther: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()
    up: FloatArray | None = field(default=None, metadata=shape(3))
    up_sigma: float | None = None
    up_source: str = ""


@dataclass(frozen=True)
class DepthMap(ShortRepr):
    """Metric depth map of an image.

    Attributes:
        depth: (H, W) float32 meters along z (not along the ray), NaN where unknown.
        intrinsics: the camera that the backend estimated or knows, or None. It is used unchanged if
            its ``trust`` is "known" and that of the point map is not. Two estimated cameras are
            averaged, and depths are rescaled with the focal length.
        scale_sigma: standard deviation of log(scale) that the backend estimates, or None.
        notes: plain sentences for the user ("scale from the soles of 2 people").
    """

    depth: FloatArray = field(metadata=shape("H", "W"))
    intrinsics: Intrinsics | None = None
    scale_sigma: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SceneScale(ShortRepr):
    """Conversion of a relative depth Z' to meters: 1 / Z = (1 / Z' + shift) / scale.

    Attributes:
        scale: meters per unit of the relative scene.
        shift: of the inverse depth, 1 / unit; 0 unless the scene's shift is unknown.
        sigma: standard deviation of log(scale) at the depth of the people; None for a guess.
        notes: plain sentences for the user ("all sizes depend mainly on ...").
    """

    scale: float
    shift: float = 0.0
    sigma: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Hints(ShortRepr):
    """Known facts about the photo when a backend is called, all optional; a backend may ignore
    them.

    Attributes:
        intrinsics: camera, if the user, the file or an earlier backend gave it.
        people: of the original photo.
        keypoints: of the original photo.
        hole: (H, W) bool, inpainted pixels of the given image.
        scene: relative point map of the inpainted photo.
        original: relative point map of the original photo, aligned to ``scene`` outside the people.
        floor: floor plane in the units of ``scene``.
        scale: of ``scene``, by everything of known size that the photo shows; for a metric depth
            that reads it.
        bodies: in meters, not yet placed in the scene, of the configured body model. ``joints`` are
            given if that model is a file of the user's, which no backend can load.
        photo: (H, W, 3) uint8 RGB, the original photo, if the given image is inpainted.
        observations: what the people do.
        up: (3,) unit vector against gravity, by the surest of the floor and other evidence; None
            without a floor if only the camera's axis tells it.
    """

    intrinsics: Intrinsics | None = None
    people: People | None = None
    keypoints: Keypoints | None = None
    hole: BoolArray | None = None
    scene: Pointmap | None = None
    original: Pointmap | None = None
    floor: Plane | None = None
    scale: SceneScale | None = None
    bodies: Bodies | None = None
    photo: UInt8Array | None = None
    observations: Observations | None = None
    up: FloatArray | None = None
