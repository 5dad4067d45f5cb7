"""Cameras and points are recovered from keypoints of a known arrangement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from physic_scene.bundle import Bundle, MomentObservations, adjust, camera_sigmas
from physic_scene.rigid import CameraPose, rotation_angle_deg

from .photos import photo

K = np.array([[900.0, 0, 500], [0, 900.0, 500], [0, 0, 1]])


def moment():
    """Joints (3, 55, 3) of three people, and the poses of three cameras."""
    rng = np.random.default_rng(3)
    middles = np.array([[-0.8, 0, 4], [0.7, 0, 4.4], [0.1, 0, 3.6]])
    joints = rng.normal(0, [0.25, 0.5, 0.25], (3, 55, 3)) + middles[:, None]
    poses = [CameraPose.identity()]
    for angle in (40.0, -70.0):
        rotation = Rotation.from_euler("y", angle, degrees=True).as_matrix()
        poses.append(CameraPose(rotation, np.array([0.0, 0.1, 4.0]) - rotation @ [0, 0, 4.0]))
    return joints, poses


JOINTS, POSES = moment()
POINTS = photo(JOINTS).landmarks


def observations(rng, noise_px=0.0):
    """Three photos of these people, each with bodies of an own error of 3 cm."""
    photos = [photo(pose.to_camera(JOINTS), K, 0.005, 400.0) for pose in POSES]
    noisy = [
        replace(
            one,
            landmarks=one.landmarks + rng.normal(0, 0.03, one.landmarks.shape),
            points=one.points + noise_px * rng.normal(size=one.points.shape),
        )
        for one in photos
    ]
    return MomentObservations.of(noisy, np.tile(np.arange(3)[:, None], 3))


def rough(rng):
    """The poses, all but the first turned and moved by some errors."""
    errors = [(Rotation.from_rotvec(rng.normal(0, 0.15, 3)), rng.normal(0, 0.3, 3)) for _ in "bc"]
    return [POSES[0]] + [
        CameraPose(turn.as_matrix() @ pose.rotation, pose.translation + step)
        for (turn, step), pose in zip(errors, POSES[1:], strict=True)
    ]


def adjusted(seen, start):
    return adjust(seen, Bundle.start(seen, start), 0)


def off_deg(found, view):
    return rotation_angle_deg(found.rotation[view], POSES[view].rotation)


def test_cameras_and_points_are_recovered_from_a_rough_start():
    rng = np.random.default_rng(0)
    found = adjusted(observations(rng), rough(rng))
    for view, pose in enumerate(POSES):
        assert off_deg(found, view) < 0.5
        assert np.linalg.norm(found.pose(view).centre - pose.centre) < 0.06
    assert np.linalg.norm(found.points - POINTS, axis=-1).max() < 0.08


def test_one_limb_of_wrong_keypoints_changes_little():
    rng = np.random.default_rng(1)
    seen = observations(rng, noise_px=1.0)
    seen.points[1, 0, seen.limb == 1] += 120
    assert off_deg(adjusted(seen, rough(rng)), 1) < 1.5


def test_the_reference_camera_stays_and_others_have_an_uncertainty():
    seen = observations(np.random.default_rng(2), noise_px=2.0)
    found = adjusted(seen, POSES)
    assert np.allclose(found.rotation[0], np.eye(3), atol=1e-6)
    first, *others = camera_sigmas(seen, found, 0)
    assert first[0] < np.radians(0.1)
    assert all(0 < rotation < np.radians(5) and 0 < centre < 0.5 for rotation, centre, _ in others)
