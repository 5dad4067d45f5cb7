"""Random cameras that see all people: focal length, height, tilt and distance as in everyday
photos.

The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.rays import RayCaster
from physic_core.types import Intrinsics
from physic_testing.worlds.rendering import pixel_rays
from physic_testing.worlds.reproducible_math import apply, arctan2, norm, sin_cos
from physic_testing.worlds.solids import blocks_mesh, signed_distance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds.solids import Block, Ground

__all__ = ["CameraShot", "PhotoSubjects", "RoomCamera", "find_camera"]

_FIELD = (35.0, 80.0)  # degrees, horizontal; the larger side never sees more than the second
_HEIGHT = (0.6, 2.2)  # m over the ground
_FILL = (0.40, 0.90)  # share of the frame that the people fill, along the side that is full first
_CUT_FILL = (0.95, 1.35)
_CUT = 0.9  # share of the photos that cut people at the border, where the action allows it
_TILT = np.radians(32.0)
_ROLL = np.radians(2.0)  # standard deviation
# m, to the nearest point of a person; to their middle
_NEAREST = 0.7
_FARTHEST_INDOORS = 7.0
_FARTHEST = 11.0
_CLEARANCE = 0.3  # m round the camera
_MIN_VISIBLE = 0.25  # least share of a person's own silhouette that must be seen
_MIN_AREA = 0.008  # least share of the photo that each person covers
_IN_FRAME = 0.5  # least share of each person's vertices inside the frame
_TRUNK = (3, 6, 9, 12, 15)  # spine, neck and head
_TRIES = 80
_COARSE = 72  # px of the longer side of a trial photo


@dataclass(frozen=True)
class RoomCamera:
    """Camera pose in the room.

    Attributes:
        rotation: (3, 3), room axes to camera axes (OpenCV: x right, y down, z forward).
        position: (3,) camera centre in the room frame, m.
    """

    rotation: FloatArray
    position: FloatArray

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) from the room frame to the camera frame."""
        return apply(self.rotation, points - self.position)

    def to_room(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) from the camera frame to the room frame."""
        return apply(self.rotation.T, points) + self.position


@dataclass(frozen=True)
class CameraShot:
    """Camera pose and intrinsics; ``cut`` allows people to be cropped by the image border."""

    camera: RoomCamera
    intrinsics: Intrinsics
    cut: bool


class PhotoSubjects:
    """People and furniture of an action, for visibility tests.

    Args:
        vertices: (N, V, 3) metres.
        joints: (N, 55, 3) metres.
        faces: (F, 3) of each person.
        blocks: furniture of the action.
        ground: ground plane.
    """

    def __init__(
        self,
        vertices: FloatArray,
        joints: FloatArray,
        faces: NDArray[np.int64],
        blocks: Sequence[Block],
        ground: Ground,
    ) -> None:
        self.vertices, self.joints, self.blocks, self.ground = (
            vertices,
            joints,
            tuple(blocks),
            ground,
        )
        self.sparse = vertices[:, ::7]
        people, count, _ = vertices.shape
        solid, solid_faces, _ = blocks_mesh(self.blocks)
        self._owner = np.concatenate(
            [np.full(len(solid_faces), -1), np.repeat(np.arange(people), len(faces))]
        )
        self._everything = RayCaster(
            np.concatenate([solid, vertices.reshape(-1, 3)]),
            np.concatenate([solid_faces, *(faces + len(solid) + count * i for i in range(people))]),
        )
        self._person_casters = [RayCaster(person, faces) for person in vertices]

    def visible_shares(self, shot: CameraShot) -> tuple[FloatArray, FloatArray]:
        """Return the visible share of each person's silhouette, and the share of the photo that
        each person covers.
        """
        scale = _COARSE / max(shot.intrinsics.width, shot.intrinsics.height)
        small = shot.intrinsics.resized(
            max(8, round(scale * shot.intrinsics.width)),
            max(8, round(scale * shot.intrinsics.height)),
        )
        rays = apply(shot.camera.rotation.T, pixel_rays(small))
        face = self._everything.first_faces(shot.camera.position, rays)
        owner = np.where(face >= 0, self._owner[np.maximum(face, 0)], -1)
        whole = [
            caster.first_faces(shot.camera.position, rays) >= 0 for caster in self._person_casters
        ]
        seen = np.array([(owner == i).sum() for i in range(len(whole))])
        return seen / np.maximum([mask.sum() for mask in whole], 1), seen / len(rays)

    def trunk_in_sight(self, shot: CameraShot) -> BoolArray:
        """Return whether (N,) the spine, neck or head of each person is visible in the image."""
        points = self.joints[:, _TRUNK]
        hits = self._everything.first(
            shot.camera.position, (points - shot.camera.position).reshape(-1, 3)
        )
        owner = np.where(hits.face >= 0, self._owner[np.maximum(hits.face, 0)], -1).reshape(
            points.shape[:2]
        )
        inside = in_frame(points, shot)
        seen: BoolArray = ((owner == np.arange(len(points))[:, None]) & inside).any(axis=1)
        return seen


def find_camera(
    subject: PhotoSubjects,
    rng: np.random.Generator,
    size: tuple[int, int],
    azimuth: tuple[float, float],
    *,
    may_cut: bool,
    outdoors: bool,
) -> CameraShot | None:
    """Draw random cameras until one shows everybody.

    Args:
        subject: people and furniture.
        rng: random generator.
        size: width and height of the photo, px.
        azimuth: range of camera directions about the vertical, degrees from +z towards +x.
        may_cut: whether people may be cropped by the image border.
        outdoors: whether larger distances are allowed.

    Returns:
        The camera; None if none of the drawn cameras shows everybody.
    """
    for _ in range(_TRIES):
        shot = _drawn(
            subject,
            rng,
            size,
            azimuth,
            may_cut=may_cut,
            farthest=_FARTHEST if outdoors else _FARTHEST_INDOORS,
        )
        if shot is not None and _shows_everybody(subject, shot):
            return shot
    return None


def in_frame(points: FloatArray, shot: CameraShot, margin: float = 0.0) -> BoolArray:
    """Return whether points (..., 3) of the room project into the image, at least ``margin`` px
    from its border.
    """
    local = shot.camera.to_camera(points)
    uv = _projected(local, shot.intrinsics)
    size = np.array([shot.intrinsics.width, shot.intrinsics.height])
    inside: BoolArray = (local[..., 2] > 0) & ((uv >= margin) & (uv <= size - 1 - margin)).all(
        axis=-1
    )
    return inside


def _drawn(
    subject: PhotoSubjects,
    rng: np.random.Generator,
    size: tuple[int, int],
    azimuth: tuple[float, float],
    *,
    may_cut: bool,
    farthest: float,
) -> CameraShot | None:
    """Draw one random camera; None if the people do not fill the intended share of the image."""
    width, height = size
    field = np.radians(rng.uniform(*_FIELD))
    focal = max(
        width / 2 / _tangent(field / 2), max(size) / 2 / _tangent(np.radians(_FIELD[1]) / 2)
    )
    intrinsics = Intrinsics.from_focal(float(focal), width, height, source="world")
    cut = bool(may_cut and rng.random() < _CUT)
    fill = rng.uniform(*(_CUT_FILL if cut else _FILL))
    side = np.radians(rng.uniform(*azimuth))
    over = rng.triangular(_HEIGHT[0], 1.5, _HEIGHT[1])
    roll = float(np.clip(rng.normal(0, _ROLL), -3 * _ROLL, 3 * _ROLL))
    # Where the middle of the people comes to lie: anywhere that keeps them in, as a share of the
    # free border.
    place = np.clip(rng.normal(0, 0.5, 2), -0.9, 0.9)
    if cut:
        place[1] = rng.uniform(0.2, 1.0)  # heads stay in, legs go out at the bottom
    points = subject.sparse.reshape(-1, 3)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    near = 0.5
    far = farthest
    found = None
    sine, cosine = sin_cos(side)
    for _ in range(14):
        distance = (near + far) / 2
        x = middle[0] + distance * sine
        z = middle[2] + distance * cosine
        position = np.array([x, subject.ground.height_at(x, z) + over, z])
        shot = CameraShot(
            _camera_towards(points, position, middle, roll, intrinsics, place, cut=cut),
            intrinsics,
            cut,
        )
        filled = _frame_share(points, shot)
        found = shot
        near, far = (distance, far) if filled > fill else (near, distance)
    return None if found is None or abs(_frame_share(points, found) - fill) > 0.05 else found


def _shows_everybody(subject: PhotoSubjects, shot: CameraShot) -> bool:
    """Return whether a camera has a valid pose and shows all people."""
    position = shot.camera.position
    if abs(shot.camera.rotation[2, 1]) > sin_cos(_TILT)[0]:
        return False
    if signed_distance(position[None], subject.blocks, subject.ground)[0] < _CLEARANCE:
        return False
    if norm(subject.sparse - position).min() < _NEAREST:
        return False
    inside = in_frame(subject.sparse, shot).mean(axis=1)
    whole = in_frame(
        subject.vertices, shot, margin=0.01 * max(shot.intrinsics.width, shot.intrinsics.height)
    ).all()
    if not (whole or (shot.cut and (inside > _IN_FRAME).all())):
        return False
    share, area = subject.visible_shares(shot)
    return bool(
        (share >= _MIN_VISIBLE + 0.05).all()
        and (area >= _MIN_AREA).all()
        and subject.trunk_in_sight(shot).all()
    )


def _camera_towards(
    points: FloatArray,
    position: FloatArray,
    target: FloatArray,
    roll: float,
    intrinsics: Intrinsics,
    place: FloatArray,
    *,
    cut: bool,
) -> RoomCamera:
    """Return a camera that sees the points' bounding box at its place in the image."""
    away = target - position
    level = np.sqrt(away[0] * away[0] + away[2] * away[2])
    pan = float(arctan2(-away[0], -away[2]))
    tilt = float(arctan2(away[1], level))
    size = np.array([intrinsics.width, intrinsics.height], np.float64)
    camera = RoomCamera(_rotation(pan, tilt, roll), position)
    for _ in range(4):
        local = camera.to_camera(points)
        if (local[:, 2] < 0.2).any():
            return camera
        uv = _projected(local, intrinsics)
        low = uv.min(axis=0)
        high = uv.max(axis=0)
        # With much tilt a person's lowest points take more room than their highest, so the box
        # alone says where.
        free = (size - (high - low)) / 2 - 0.02 * size
        wanted = (size - 1) / 2 + place * (
            np.where(free > 0, free, [0, 0]) if not cut else np.abs(free)
        )
        shift = (low + high) / 2 - wanted
        pan -= float(arctan2(shift[0], intrinsics.fx))
        tilt -= float(arctan2(shift[1], intrinsics.fy))
        camera = RoomCamera(_rotation(pan, tilt, roll), position)
    return camera


def _tangent(angle: float) -> float:
    """Return the tangent of an angle in radians."""
    sine, cosine = sin_cos(angle)
    return float(sine / cosine)


def _rotation(pan: float, tilt: float, roll: float) -> FloatArray:
    """Return the room-to-camera rotation for pan (from -z, about the vertical), tilt (up) and roll,
    in radians.
    """
    (sine, cosine), (s_pan, c_pan), (s, c) = (sin_cos(angle) for angle in (tilt, pan, roll))
    forward = np.array([-s_pan * cosine, sine, -c_pan * cosine])
    right = np.array([c_pan, np.float64(0.0), -s_pan])
    down = np.cross(forward, right)
    return np.stack([c * right + s * down, c * down - s * right, forward])


def _frame_share(points: FloatArray, shot: CameraShot) -> float:
    """Return the larger share of image width or height that the points span; inf behind the
    camera.
    """
    local = shot.camera.to_camera(points)
    if (local[:, 2] < 0.2).any():
        return np.inf
    uv = _projected(local, shot.intrinsics)
    extent = (uv.max(axis=0) - uv.min(axis=0)) / [shot.intrinsics.width, shot.intrinsics.height]
    return float(extent.max())


def _projected(local: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Project camera-frame points to pixels."""
    focal = np.array([intrinsics.fx, intrinsics.fy])
    centre = np.array([intrinsics.cx, intrinsics.cy])
    uv: FloatArray = local[..., :2] / np.maximum(local[..., 2:], 1e-3) * focal + centre
    return uv
