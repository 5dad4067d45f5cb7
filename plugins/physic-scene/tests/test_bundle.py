"""Cameras and points are recovered from keypoints of a known arrangement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_scene.bundle import Bundle, MomentObservations, adjust, uncertainties
from physic_scene.rigid import CameraPose, fit_rotation, mean_rotation, rotation_angle_deg

WIDTH = 1000
FOCAL = 900.0
NAMES = tuple(
    f"{s}_{n}"
    for s in ("left", "right")
    for n in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
JOINTS = len(NAMES)


@pytest.fixture
def moment():
    rng = np.random.default_rng(3)
    middles = np.array([[-0.8, 0, 4], [0.7, 0, 4.4], [0.1, 0, 3.6]])
    points = rng.normal(0, [0.25, 0.5, 0.25], (3, JOINTS, 3)) + middles[:, None]
    poses = [CameraPose.identity()]
    for angle in (40.0, -70.0):
        rotation = Rotation.from_euler("y", angle, degrees=True).as_matrix()
        middle = np.array([0.0, 0.0, 4.0])
        poses.append(CameraPose(rotation, np.array([0.0, 0.1, 4.0]) - rotation @ middle))
    return points, poses


def observations(points, poses, rng, noise_px=0.0):
    K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, WIDTH / 2], [0, 0, 1]])
    local = np.stack([pose.to_camera(points) for pose in poses])
    pixels = local[..., :2] / local[..., 2:] * FOCAL + WIDTH / 2
    bones = np.array([(0, 1), (1, 2), (3, 4), (4, 5)])
    turned = local + rng.normal(0, 0.03, local.shape)
    return MomentObservations(
        K=np.stack([K] * len(poses)),
        focal_sigma=np.full(len(poses), 0.005),
        names=NAMES,
        points=pixels + noise_px * rng.normal(size=pixels.shape),
        confidence=np.ones(pixels.shape[:3]),
        landmarks=turned,
        shown=np.ones(pixels.shape[:2], bool),
        size_px=np.full(pixels.shape[:2], 400.0),
        limb=np.repeat(np.arange(4), 3),
        bones=bones,
        bone_m=np.linalg.norm(points[:, bones[:, 0]] - points[:, bones[:, 1]], axis=-1),
        bone_sigma=np.full(len(points), np.nan),
        up=np.full((len(poses), 3), np.nan),
        known=np.zeros(len(poses), bool),
    )


def rough(poses, rng):
    return [poses[0]] + [
        CameraPose(
            Rotation.from_rotvec(rng.normal(0, 0.15, 3)).as_matrix() @ p.rotation,
            p.translation + rng.normal(0, 0.3, 3),
        )
        for p in poses[1:]
    ]


def test_cameras_and_points_are_recovered_from_a_rough_start(moment):
    points, poses = moment
    rng = np.random.default_rng(0)
    seen = observations(points, poses, rng)
    found = adjust(seen, Bundle.start(seen, rough(poses, rng)), 0)
    for v, pose in enumerate(poses):
        assert rotation_angle_deg(found.rotation[v], pose.rotation) < 0.5
        assert np.linalg.norm(found.pose(v).centre - pose.centre) < 0.06
    assert np.linalg.norm(found.points - points, axis=-1).max() < 0.08


def test_known_cameras_stay_and_points_have_their_scale(moment):
    points, poses = moment
    rng = np.random.default_rng(6)
    seen = observations(points, poses, rng, noise_px=3.0)
    known = replace(seen, known=np.array([True, False, True]))
    start = [poses[0], rough(poses, rng)[1], poses[2]]
    found = adjust(known, Bundle.start(known, start), 0)
    for v in (0, 2):
        assert np.allclose(found.rotation[v], poses[v].rotation, atol=1e-5)
        assert np.allclose(found.translation[v], poses[v].translation, atol=1e-5)
        assert abs(found.log_focal[v]) < 1e-5
    assert rotation_angle_deg(found.rotation[1], poses[1].rotation) < 1
    spread = [np.linalg.norm(x - x.mean(1, keepdims=True)) for x in (found.points, points)]
    assert spread[0] == pytest.approx(spread[1], rel=0.01)


def test_one_limb_of_wrong_keypoints_changes_little(moment):
    points, poses = moment
    rng = np.random.default_rng(1)
    seen = observations(points, poses, rng, noise_px=1.0)
    seen.points[1, 0, :3] += 120
    found = adjust(seen, Bundle.start(seen, rough(poses, rng)), 0)
    assert rotation_angle_deg(found.rotation[1], poses[1].rotation) < 1.5


def test_the_reference_camera_stays_and_others_have_an_uncertainty(moment):
    points, poses = moment
    rng = np.random.default_rng(2)
    seen = observations(points, poses, rng, noise_px=2.0)
    found = adjust(seen, Bundle.start(seen, poses), 0)
    assert np.allclose(found.rotation[0], np.eye(3), atol=1e-6)
    first, *others = uncertainties(seen, found, 0)
    assert first[0] < np.radians(0.1)
    assert all(0 < rotation < np.radians(5) and 0 < centre < 0.5 for rotation, centre, _ in others)


def test_the_mean_rotation_ignores_one_of_three():
    base = Rotation.from_euler("xyz", [20, -40, 10], degrees=True)
    near = Rotation.from_rotvec([0.02, 0, 0]) * base
    far = Rotation.from_rotvec([0, 1.5, 0]) * base
    mean = mean_rotation(np.stack([r.as_matrix() for r in (base, near, far)]), np.ones(3))
    assert rotation_angle_deg(mean, base.as_matrix()) < 5


def test_fit_rotation_recovers_a_rotation_and_never_mirrors():
    source = np.random.default_rng(0).normal(size=(6, 3))
    rotation = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    assert np.allclose(fit_rotation(source, source @ rotation.T, np.ones(6)), rotation)
    assert np.linalg.det(fit_rotation(source, source * [-1, 1, 1], np.ones(6))) == pytest.approx(
        1.0
    )
