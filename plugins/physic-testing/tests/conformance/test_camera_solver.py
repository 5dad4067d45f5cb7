"""The kit passes a camera solver that knows the truth, and catches each of its planted faults."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physic_core.errors import InputError
from physic_core.interfaces import CameraSolver
from physic_core.types import SolvedCameras
from physic_testing import check_backend, world_of


class TrueCameras(CameraSolver):
    """Returns the true cameras of worlds, and the middle of the joints as points."""

    def infer(self, photos: Any) -> SolvedCameras:
        worlds = [world_of(photo.image) for photo in photos]
        if None in worlds:
            raise InputError("these photos show no world: give photos of worlds")
        cameras = [world.camera for world in worlds]
        base = cameras[0]
        points = np.full((len(photos[0].people), photos[0].keypoints.points.shape[1], 3), np.nan)
        names = list(photos[0].keypoints.joint_set.names)
        for side in ("left_knee", "right_knee"):
            points[:, names.index(side)] = worlds[0].joints[:, 4 + side.startswith("right")]
        return SolvedCameras(
            reference=0,
            rotation=np.stack([camera.rotation @ base.rotation.T for camera in cameras]),
            translation=np.stack([camera.rotation @ (base.position - camera.position) for camera in cameras]),
            intrinsics=tuple(world.intrinsics for world in worlds),
            rotation_sigma=np.zeros(len(photos)),
            position_sigma=np.zeros(len(photos)),
            people=np.repeat(np.arange(len(photos[0].people))[:, None], len(photos), axis=1),
            points=points,
        )


class Inverse(TrueCameras):
    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        return replace(found, rotation=found.rotation.transpose(0, 2, 1).copy())


class Centimetres(TrueCameras):
    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        return replace(found, translation=100 * found.translation, points=100 * found.points)


class Exchanged(TrueCameras):
    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        people = found.people.copy()
        people[:, 1] = people[::-1, 1]
        return replace(found, people=people)


class Elsewhere(TrueCameras):
    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        return replace(found, points=found.points + np.array([1.0, 0.0, 0.0]))


class NearlyKnown(TrueCameras):
    """Moves the last camera by a hand's width."""

    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        return replace(found, translation=found.translation + 0.1 * (np.arange(len(photos)) == 2)[:, None])


class Turned(TrueCameras):
    def infer(self, photos: Any) -> SolvedCameras:
        found = super().infer(photos)
        return replace(found, rotation=found.rotation[:, ::-1].copy())


def test_true_cameras_pass():
    report = check_backend(TrueCameras)
    assert report.ok, report.text


@pytest.mark.parametrize(
    ("kind", "check"),
    [
        (Inverse, "rotations_are_from_the_reference"),
        (Centimetres, "camera_distances_are_metres"),
        (Exchanged, "people_are_who_they_are"),
        (Elsewhere, "points_are_the_keypoints"),
        (NearlyKnown, "known_poses_are_kept"),
        (Turned, "returns_valid_output"),
    ],
)
def test_a_fault_is_caught_by_its_own_check(kind: type[CameraSolver], check: str):
    report = check_backend(kind)
    assert check in {failure.check for failure in report.failures}, report.text
