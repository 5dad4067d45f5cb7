"""Changes of a photo for which it is known how a right output changes: mirror, size, border, and
camera.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types import Bodies, BodyParameters, Keypoints, People, Plane, Pointmap
from physic_testing.conformance.truth import mirrored_order

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics
    from physic_testing.conformance.cases import Case

CHANGES = ("mirrored", "enlarged twice", "cropped", "seen by a turned camera")
"""Changes of a photo: about its vertical axis, in size, of the border beside its people, of where
the camera looks.
"""

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Factors of a point whose mirror is the plane x = 0."""

# shares of the photo, at the left, top, right and bottom, at most
_CROPPED = np.array([0.12, 0.08, 0.28, 0.04])
_BESIDE_PEOPLE_PX = 6
_TURN = np.radians(12.0)


@dataclass(frozen=True)
class Change:
    """A change of one photo.

    Attributes:
        name: one of CHANGES.
        pixels: (3, 3) homography of the pixels of the photo to those of the changed one.
        axes: (3, 3) map of the axes of the camera's frame, which may mirror.
        camera: of the changed photo.
    """

    name: str
    pixels: FloatArray
    axes: FloatArray
    camera: Intrinsics

    @property
    def mirrors(self) -> bool:
        """Whether left and right change places."""
        return self.name == "mirrored"

    def of_pixels(self, points: FloatArray) -> FloatArray:
        """Return where pixels (..., 2) of the photo are in the changed one."""
        moved = points @ self.pixels[:, :2].T + self.pixels[:, 2]
        return np.asarray(moved[..., :2] / moved[..., 2:])

    def of_picture(self, picture: Any, *, nearest: bool = False) -> Any:
        """Return a picture (H, W) or (H, W, C) as it is in the changed photo; NaN or False beyond
        its border.
        """
        import cv2

        is_photo = picture.dtype == np.uint8
        whole = picture.dtype == bool
        flags = cv2.INTER_NEAREST if nearest or whole else cv2.INTER_LINEAR
        moved = cv2.warpPerspective(
            picture if is_photo else picture.astype(np.float32 if not whole else np.uint8),
            self.pixels,
            (self.camera.width, self.camera.height),
            flags=flags,
            borderMode=cv2.BORDER_REFLECT_101 if is_photo else cv2.BORDER_CONSTANT,
            borderValue=(0.0 if is_photo or whole else float("nan"),) * 4,
        )
        return moved > 0 if whole else moved

    def of_rotations(self, rotations: FloatArray, *, local: bool = False) -> FloatArray:
        """Return rotations (..., 3, 3) of bodies in the camera's frame, or ``local`` ones of a
        joint to its parent.
        """
        turn = np.diag(MIRROR) if self.mirrors else np.eye(3) if local else self.axes
        turned: FloatArray = turn @ rotations @ (np.diag(MIRROR) if self.mirrors else np.eye(3))
        return turned


def change_of(case: Case, name: str) -> Change:
    """Return a change of a photo."""
    camera = case.intrinsics
    axes = np.eye(3)
    pixels = np.eye(3)
    width = camera.width
    height = camera.height
    if name == CHANGES[0]:
        pixels[0] = -1, 0, width - 1
        return Change(name, pixels, np.diag(MIRROR), replace(camera, cx=width - 1 - camera.cx))
    if name == CHANGES[1]:
        pixels[:2] = [[2, 0, 0.5], [0, 2, 0.5]]
        return Change(name, pixels, axes, camera.resized(2 * width, 2 * height))
    boxes = case.people.boxes
    if name == CHANGES[2]:
        size = np.array([width, height])
        beside = (
            np.concatenate([boxes[:, :2].min(0), size - boxes[:, 2:].max(0)]) - _BESIDE_PEOPLE_PX
        )
        left, top, right, bottom = (
            int(cut) for cut in np.minimum(_CROPPED * np.tile(size, 2), beside).clip(0)
        )
        pixels[:2, 2] = -left, -top
        moved = replace(camera, cx=camera.cx - left, cy=camera.cy - top)
        return Change(
            name,
            pixels,
            axes,
            replace(moved, width=width - left - right, height=height - top - bottom),
        )
    angle = _TURN if boxes[:, ::2].mean() > camera.cx else -_TURN  # towards the people
    axes[::2, ::2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return Change(name, camera.matrix @ axes @ np.linalg.inv(camera.matrix), axes, camera)


def changed_case(case: Case, change: Change) -> Case:
    """Return the inputs of all interfaces for the changed photo, which has no world."""
    masks = np.array([change.of_picture(mask) for mask in case.people.masks], bool).reshape(
        len(case.people), change.camera.height, change.camera.width
    )
    boxes = np.array([_box(mask) for mask in masks], np.float64).reshape(-1, 4)
    order = mirrored_order(case.keypoints.joint_set.names) if change.mirrors else slice(None)
    keypoints = case.keypoints
    return replace(
        case,
        name=f"{case.name}, {change.name}",
        photo=change.of_picture(case.photo),
        empty=change.of_picture(case.empty),
        hole=change.of_picture(case.hole),
        intrinsics=change.camera,
        people=People(masks, boxes, case.people.scores),
        keypoints=Keypoints(
            change.of_pixels(keypoints.points)[:, order],
            keypoints.confidence[:, order],
            keypoints.skeleton,
        ),
        bodies=_bodies(case, change),
        scene=_pointmap(case.scene, change),
        original=_pointmap(case.original, change),
        floor=Plane(change.axes @ case.floor.normal, case.floor.offset),
        world=None,
    )


def _bodies(case: Case, change: Change) -> Bodies:
    """Return the bodies in the frame of the changed photo's camera."""
    from scipy.spatial.transform import Rotation

    from physic_core.body.joints import JOINT_NAMES

    p = case.bodies.parameters
    at_rest = case.truth.joints[:, 0] - p.transl
    root = change.of_rotations(Rotation.from_rotvec(p.global_orient).as_matrix())
    values = {f.name: getattr(p, f.name) for f in fields(p)} | {
        "global_orient": Rotation.from_matrix(root).as_rotvec(),
        "transl": (p.transl + at_rest) @ change.axes.T - at_rest,
    }
    observed = case.bodies.observed
    if change.mirrors:
        pose = p.body_pose.reshape(len(p), 21, 3)[:, mirrored_order(JOINT_NAMES[1:22])]
        values["body_pose"] = _mirrored(pose.reshape(len(p), 63))
        for left, right in (("left_hand_pose", "right_hand_pose"), ("leye_pose", "reye_pose")):
            values[left], values[right] = (_mirrored(getattr(p, name)) for name in (right, left))
        observed = None if observed is None else observed[:, mirrored_order(JOINT_NAMES)]
    kept = {name: np.asarray(value, np.float32) for name, value in values.items()}
    return Bodies(BodyParameters(**kept), case.bodies.body_model, observed)


def _mirrored(rotvecs: FloatArray) -> FloatArray:
    """Return rotation vectors (N, 3 J) of the mirrored joints."""
    turned: FloatArray = (rotvecs.reshape(len(rotvecs), -1, 3) * [1, -1, -1]).reshape(rotvecs.shape)
    return turned


def _pointmap(pointmap: Pointmap, change: Change) -> Pointmap:
    """Return a point map of the changed photo."""
    points = change.of_picture(
        np.where(np.isfinite(pointmap.points), pointmap.points, np.nan), nearest=True
    )
    points = (points @ change.axes.T).astype(np.float32)
    return Pointmap(points, np.isfinite(points).all(axis=2), pointmap.unknown, change.camera)


def _box(mask: Any) -> list[float]:
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    return [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1] if len(rows) else [0, 0, 1, 1]
