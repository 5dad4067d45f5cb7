"""Cameras from the bodies of the photos alone: the rigid motion that lays the people of one photo onto another's."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import InputError
from physic_core.interfaces import CameraSolver, Options
from physic_core.types import SolvedCameras

if TYPE_CHECKING:
    from physic_core.types import FloatArray, MomentView


class TemplateOptions(Options):
    """Settings of Template."""

    same_place_m: float = Field(0.5, gt=0, description="distance of the pelvises of one person in two photos, m; 0.3-1")


class Template(CameraSolver):
    """Lays the joints of people onto those of the first photo."""

    Options: ClassVar[type[Options]] = TemplateOptions
    options: TemplateOptions

    def infer(self, photos: tuple[MomentView, ...]) -> SolvedCameras:
        """V photos -> cameras in the frame of the first."""
        joints = [photo.bodies.joints for photo in photos]
        if any(own is None or not len(own) for own in joints):
            raise InputError("every photo needs a person with the joints of a body: leave the others out")
        motions = [_motion(joints[0], own) for own in joints]  # type: ignore[arg-type]
        people = np.full((len(photos[0].people), len(photos)), -1)
        for v, ((rotation, translation), own) in enumerate(zip(motions, joints, strict=True)):
            moved = joints[0][:, 0] @ rotation.T + translation  # type: ignore[index]
            away = np.linalg.norm(moved[:, None] - own[None, :, 0], axis=2)  # type: ignore[index]
            for i in np.argsort(away.min(1)):
                j = int(np.argmin(away[i]))
                if away[i, j] < self.options.same_place_m and j not in people[:, v]:
                    people[i, v] = j
        people = people[(people >= 0).sum(1) > 1]
        if not len(people):
            raise InputError("no two photos share a person: give photos of one moment")
        views, count = len(photos), photos[0].keypoints.points.shape[1]
        sigma = np.where(np.arange(views) > 0, 0.2, 0.0)
        return SolvedCameras(
            reference=0,
            rotation=np.stack([rotation for rotation, _ in motions]),
            translation=np.stack([translation for _, translation in motions]),
            intrinsics=tuple(photo.intrinsics for photo in photos),
            rotation_sigma=sigma,
            position_sigma=2 * sigma,
            people=people,
            points=np.full((len(people), count, 3), np.nan),
            notes=("cameras from the bodies of single photos",),
        )


def _motion(first: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation and translation of the pair of people (N, 55, 3), (M, 55, 3) who fit each other best."""
    found = []
    for one in first[:, :22]:
        for two in other[:, :22]:
            a, b = one - one.mean(0), two - two.mean(0)
            u, _, vt = np.linalg.svd(b.T @ a)
            rotation = (u * [1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
            error = float(np.abs(a @ rotation.T - b).sum())
            found.append((error, rotation, two.mean(0) - rotation @ one.mean(0)))
    _, rotation, translation = min(found, key=lambda one: one[0])
    return rotation, translation
