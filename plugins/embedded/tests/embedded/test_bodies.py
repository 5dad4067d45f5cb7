from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.bones import rotations_from_parameters
from physic_core.engine.sizes.stature import ADULT_STATURE_M, mean_adult_betas
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.types import (
    SKELETONS,
    Hints,
    Intrinsics,
    Keypoints,
    Observations,
    People,
    Plane,
    skeleton_named,
)
from physic_core.types.observations import POSTURES
from physic_core.types.skeletons import SIDES
from physic_embedded.body_estimator import EmbeddedBodies
from physic_embedded.body_fit.observations import rotation_to_ray
from physic_embedded.body_fit.pose_prior import pose_prior, relaxed_finger_pose
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON

CAMERA = Intrinsics.from_focal(900.0, 1000, 800)
IMAGE = np.zeros((800, 1000, 3), np.uint8)
UPRIGHT = np.diag([1.0, -1.0, -1.0])
FLOOR = Plane(np.array([0.0, -1.0, 0.0]), 0.4)
MODEL = load_body("embedded")
ZERO = torch.zeros(1, MODEL.num_betas)
SLOPE = (MODEL.stature(torch.eye(MODEL.num_betas)) - MODEL.stature(-torch.eye(MODEL.num_betas))) / 2
# a photo shows no other stature than that of the prior
ADULT = mean_adult_betas(float(MODEL.stature(ZERO)), SLOPE)


@dataclass(frozen=True)
class Truth:
    """Synthetic people: what a perfect network would see of them, and where they are."""

    keypoints: Keypoints
    people: People
    joints: np.ndarray
    vertices: np.ndarray


def pose(**angles):
    """Rotation vectors (55, 3) of a relaxed stance with some joints given in degrees."""
    vectors = np.zeros((55, 3))
    vectors[1:22] = pose_prior()[0]
    vectors[22:] = relaxed_finger_pose()
    for name, degrees in angles.items():
        vectors[JOINT_INDEX[name]] = np.radians(degrees)
    return vectors


STANDS = pose(left_hip=(-5, 0, 4), right_hip=(8, 0, -4), left_knee=(8, 0, 0), right_knee=(12, 0, 0))
WALKS = pose(
    left_hip=(-35, 0, 3),
    right_hip=(20, 0, -3),
    left_knee=(30, 0, 0),
    right_knee=(25, 0, 0),
    left_shoulder=(0, 0, -65),
    right_shoulder=(0, 40, 60),
    right_elbow=(0, 60, 0),
)
SITS = pose(
    left_hip=(-85, 5, 5), right_hip=(-80, 0, -8), left_knee=(80, 0, 0), right_knee=(90, 0, 0)
)


def pixels_of(points):
    """Pixels (..., 2) of points (..., 3) of the camera frame."""
    seen = points @ CAMERA.matrix.T
    return seen[..., :2] / seen[..., 2:]


def rows_of(skeleton, *names):
    return [skeleton_named(skeleton).names.index(name) for name in names]


def joints_of(*names):
    """Rows of joints; a name without a side stands for both sides."""
    both = [name if name in JOINT_INDEX else f"{side}_{name}" for name in names for side in SIDES]
    return [JOINT_INDEX[name] for name in dict.fromkeys(both)]


def truth(
    poses,
    places,
    yaw_deg=25.0,
    skeleton=BLAZEPOSE_SKELETON,
    lean_deg=0.0,
    noise_px=0.0,
):
    count = len(poses)
    rotations = rotvec_to_rotmat(torch.as_tensor(np.array(poses), dtype=torch.float32))
    turn = rotvec_to_rotmat(torch.tensor([0.0, float(np.radians(yaw_deg)), 0.0]))
    rotations[:, 0] = torch.as_tensor(UPRIGHT, dtype=torch.float32) @ turn
    transl = torch.tensor(places)
    out = MODEL(rotations, ADULT.reshape(1, -1).expand(count, -1), transl)
    points = MODEL.landmarks(out, skeleton).double().numpy()
    skeleton = skeleton_named(skeleton)
    hips = rows_of(skeleton, "left_hip", "right_hip")
    middle = points[:, hips].mean(1, keepdims=True)
    seen = pixels_of(points)
    seen = seen + np.random.default_rng(0).normal(0, noise_px, seen.shape)
    # positive tips the head towards the camera
    lean = Rotation.from_euler("x", lean_deg, degrees=True).as_matrix()
    turns = np.stack([rotation_to_ray(ray) for ray in middle[:, 0]])
    world = (points - middle) @ turns @ lean.T
    # The network puts its origin between its own hips.
    world -= world[:, hips].mean(1, keepdims=True)
    boxes = np.concatenate([seen.min(1), seen.max(1)], 1)
    people = People(np.zeros((count, 800, 1000), bool), boxes, np.ones(count))
    keypoints = Keypoints(seen, np.full(seen.shape[:2], 0.95), skeleton, world)
    return Truth(keypoints, people, out.joints.double().numpy(), out.vertices.double().numpy())


def posed(bodies):
    p = bodies.parameters
    out = MODEL(rotations_from_parameters(p), torch.as_tensor(p.betas), torch.as_tensor(p.transl))
    return out.joints.double().numpy(), out.vertices.double().numpy()


@cache
def loaded():
    backend = EmbeddedBodies()
    backend.load()
    return backend


def fit(seen, floor=None, posture=None, photo=None):
    """Fitted bodies on a floor, of people whom the observer is sure to have a posture."""
    said = None
    if posture is not None:
        rows = np.full((len(seen.joints), len(POSTURES)), 0.01, np.float32)
        rows[:, POSTURES.index(posture)] = 0.92
        said = replace(Observations.unknown(len(rows)), posture=rows)
    hints = Hints(floor=floor, observations=said, original=photo)
    return loaded().infer(IMAGE, seen.people, CAMERA, seen.keypoints, hints)


def joints_of_fit(*given):
    return posed(fit(*given))[0]


def miss_mm(fitted, truth):
    """Mean distance per person of the 22 body joints, or of the vertices."""
    points = slice(22) if fitted.shape[1] == 55 else slice(None)
    return 1000 * np.linalg.norm(fitted - truth, axis=-1)[:, points].mean(1)


PLACES = [(-0.9, 0.2, 3.4), (0.3, 0.1, 4.2), (1.0, 0.3, 3.6)]


def with_keypoints(seen, **changes):
    return replace(seen, keypoints=replace(seen.keypoints, **changes))


def stating(seen, depth_sigma=0.07):
    """The same keypoints, of a detector that states its errors: 3 px, and metres of depth."""
    shape = seen.keypoints.confidence.shape
    depth_sigma = np.broadcast_to(depth_sigma, shape)
    return with_keypoints(seen, sigma=np.full(shape, 3.0), depth_sigma=depth_sigma)


def test_joints_without_a_3d_landmark_follow_the_picture():
    seen = truth([WALKS], [(0.2, 0.3, 4.0)])
    names = ("left_wrist", "right_ankle", "left_hip")
    world = seen.keypoints.world.copy()
    world[:, rows_of(BLAZEPOSE_SKELETON, *names)] = np.nan
    joints = joints_of_fit(with_keypoints(seen, world=world))
    off = pixels_of(joints) - pixels_of(seen.joints)
    assert np.abs(off[:, joints_of(*names)]).max() < 8
    assert miss_mm(joints, seen.joints).mean() < 40


def test_a_depth_counts_as_far_as_its_own_error_says():
    """An ankle that is .3 m too near: the less the detector vouches for it, the less the leg
    follows.
    """
    seen = truth([STANDS], [(0.3, 0.1, 4.2)], skeleton="coco23")
    world = seen.keypoints.world.copy()
    ankle = rows_of("coco23", "left_ankle")
    world[:, ankle, 2] -= 0.3
    wrong = with_keypoints(seen, world=world)
    sigma = np.full(world.shape[1], 0.07)
    misses = []
    for sigma[ankle] in (0.02, 0.07, 0.5):
        joints = joints_of_fit(stating(wrong, sigma.copy()))
        misses.append(1000 * np.linalg.norm((joints - seen.joints)[0, joints_of("left_ankle")]))
    assert misses[0] > misses[1] > misses[2]
    assert misses[2] < 40


@pytest.mark.parametrize(("noise_px", "most_mm"), [(0.0, 18), (2.0, 20)])
def test_bodies_are_recovered_from_synthetic_landmarks(noise_px, most_mm):
    seen = truth([STANDS, WALKS, SITS], PLACES, noise_px=noise_px)
    answer = fit(seen)
    assert answer.body_model == "embedded"
    joints, vertices = posed(answer)
    assert miss_mm(joints, seen.joints).max() < 60
    for found, true in ((joints, seen.joints), (vertices, seen.vertices)):
        assert miss_mm(found - joints[:, :1], true - seen.joints[:, :1]).max() < most_mm
    assert answer.observed.all()
    assert np.nanmax(answer.rotation_sigma) < 1.0


def test_arms_whose_landmarks_turn_in_the_mirror_image_follow_the_lifter():
    seen = truth([WALKS], PLACES[:1])
    spread = np.zeros(seen.keypoints.confidence.shape)
    steady = joints_of_fit(with_keypoints(seen, world_spread=spread))
    np.testing.assert_array_equal(joints_of_fit(seen), steady)
    spread[:, rows_of(BLAZEPOSE_SKELETON, "left_elbow", "left_wrist")] = 0.2
    turned = joints_of_fit(with_keypoints(seen, world_spread=spread))
    moved = np.linalg.norm(turned - turned[:, :1] - steady + steady[:, :1], axis=-1)[0]
    assert moved[joints_of("left_elbow", "left_wrist")].min() > 0.02
    assert moved[joints_of("right_wrist", "knee", "ankle")].max() < 0.008


@pytest.mark.parametrize("skeleton", ["coco17", "coco23"])
def test_keypoints_without_landmarks_give_the_pose_in_the_picture(skeleton):
    seen = truth([STANDS, WALKS], PLACES[:2], skeleton=skeleton)
    answer = fit(with_keypoints(seen, world=None))
    assert answer.rotation_sigma is None  # depths of limbs are guesses
    joints, _ = posed(answer)
    error = np.linalg.norm(pixels_of(joints) - pixels_of(seen.joints), axis=-1)[:, :22]
    assert error.mean() < 10
    assert joints[:, 0, 2] == pytest.approx(seen.joints[:, 0, 2], rel=0.15)
    # People who face the camera are not fitted from behind.
    left, right = joints[:, joints_of("shoulder"), 0].T
    assert (left > right).all()


@pytest.mark.parametrize("degrees", [10.0, 20.0])
def test_people_who_stand_on_a_floor_lose_the_lean_of_their_landmarks(degrees):
    seen = truth([STANDS, SITS], PLACES[:2], lean_deg=degrees)
    before, after, true = map(
        lean_deg, (joints_of_fit(seen), joints_of_fit(seen, FLOOR), seen.joints)
    )
    assert before[0] > true[0] + 0.6 * degrees
    assert after[0] == pytest.approx(true[0], abs=4)


def test_the_lean_is_stated_of_those_whom_the_floor_sets_upright_or_whose_legs_are_hidden():
    seen = truth([STANDS, SITS], PLACES[:2])
    answer = fit(seen, FLOOR)
    assert np.isfinite(answer.lean_sigma).tolist() == [True, False]
    straight, bent = answer.rotation_sigma[:, joints_of("knee")]
    assert straight.max() < 0.2 < bent.min()
    assert np.isnan(fit(seen).lean_sigma).all()
    sure, unsure = (fit_behind_table(STANDS, word).lean_sigma[0] for word in ("stand", "squat"))
    assert 0 < sure < unsure


def test_a_floor_that_tilts_by_three_degrees_turns_who_walks_by_that_much():
    """Though the landmarks lean so far that the picture contradicts an upright body."""
    seen = truth([WALKS], PLACES[:1], yaw_deg=0.0)
    world = np.array(seen.keypoints.world)
    world[..., 2] += 0.55 * world[..., 1]
    seen = with_keypoints(seen, world=world)
    tilted = Rotation.from_euler("x", [[-9], [-12]], degrees=True).apply(FLOOR.normal)
    first, second = (joints_of_fit(seen, replace(FLOOR, normal=up))[0, :22] for up in tilted)
    moved = np.linalg.norm(second - second[0] - first + first[0], axis=-1)
    assert moved.max() < 0.08


def trunk_tilt_deg(joints, low="hip", high="shoulder"):
    """Angle of each trunk (N, 55, 3), or from other joints to others, from the vertical, towards
    the camera, seen from the side.
    """
    foot, head = (joints[:, joints_of(name)].mean(1) for name in (low, high))
    trunk = head - foot
    return np.degrees(np.arctan2(-trunk[:, 2], -trunk[:, 1]))


def lean_deg(joints):
    """How far each body (N, 55, 3) leans towards the camera, from ankles to neck."""
    return trunk_tilt_deg(joints, "ankle", "neck")


@pytest.mark.parametrize("lean_deg", [10.0, -15.0])
def test_trunks_of_sitters_lose_the_lean_of_their_landmarks(lean_deg):
    """Nothing says that their necks are over their ankles, but trunks of who sits are as vertical
    as of who stands.
    """
    seen = truth([SITS], PLACES[:1], lean_deg=lean_deg)
    before, after = (
        abs(trunk_tilt_deg(joints_of_fit(seen, floor)) - trunk_tilt_deg(seen.joints))
        for floor in (None, FLOOR)
    )
    assert before > 0.5 * abs(lean_deg)
    assert after < 0.6 * before


def test_a_trunk_that_bends_is_not_pulled_upright():
    bends = dict.fromkeys(("spine1", "spine2", "spine3"), (28.0, 0.0, 0.0))
    seen = truth([pose(left_hip=(-15, 0, 4), right_hip=(-15, 0, -4), **bends)], PLACES[:1])
    before, after = (trunk_tilt_deg(joints_of_fit(seen, floor)) for floor in (None, FLOOR))
    assert trunk_tilt_deg(seen.joints)[0] > 45
    assert after == pytest.approx(before, abs=4)


def test_rounding_errors_of_the_input_are_not_amplified():
    # Eighty iterations of L-BFGS alone made millimetres of them, and turned limbs by degrees in
    # float32.
    seen = truth([STANDS, SITS], PLACES[:2], lean_deg=10.0, noise_px=3.0)
    rng = np.random.default_rng(1)

    def noisy(values):
        return values * (1 + 1e-8 * rng.standard_normal(values.shape))

    given = seen.keypoints
    other = with_keypoints(seen, points=noisy(given.points), world=noisy(given.world))
    one = joints_of_fit(seen, FLOOR)
    two = joints_of_fit(other, Plane(noisy(FLOOR.normal), FLOOR.offset))
    # float32 of five metres is half a micrometre
    np.testing.assert_allclose(two, one, rtol=0, atol=2e-6)


def test_feet_that_are_both_seen_come_out_level():
    seen = truth([STANDS], PLACES[:1], noise_px=3.0)
    _, vertices = posed(fit(seen, FLOOR))
    left, right = (
        vertices[0, MODEL.contact_sets[f"{side}_sole"].numpy(), 1].max() for side in SIDES
    )
    assert abs(left - right) < 0.03


def test_joints_out_of_the_picture_or_unsure_are_not_observed():
    seen = truth([STANDS], [(-0.4, 0.9, 2.6)])  # cut off under the hips
    (observed,) = fit(unsure_of(seen, 0.2, "left_wrist")).observed
    assert not observed[joints_of("ankle", "foot", "left_wrist", "left_index1")].any()
    upper = ("pelvis", "spine2", "left_shoulder", "head", "right_wrist", "right_thumb3")
    assert observed[joints_of(*upper)].all()


LEGS = [f"{side}_{j}" for side in SIDES for j in ("knee", "ankle", "heel", "foot_tip")]


def unsure_of(seen, confidence, *names):
    changed = seen.keypoints.confidence.copy()
    changed[0, rows_of(BLAZEPOSE_SKELETON, *names)] = confidence
    return with_keypoints(seen, confidence=changed)


def fit_behind_table(pose, posture, lean_deg=0.0):
    """Somebody whose legs are hidden, before a camera without a floor."""
    seen = truth([pose], [(-0.2, 0.75, 1.8)], lean_deg=lean_deg)
    return fit(unsure_of(seen, 0.02, *LEGS), None, posture)


def thighs_deg(bodies):
    """Angles of the thighs of one person from the vertical, degrees."""
    joints = posed(bodies)[0]
    thighs = joints[0, joints_of("knee")] - joints[0, joints_of("hip")]
    return np.degrees(np.arccos(thighs[:, 1] / np.linalg.norm(thighs, axis=1)))


@pytest.mark.parametrize("pose", [STANDS, SITS], ids=["as if standing", "as if sitting"])
def test_hidden_legs_hang_or_are_seated_by_the_posture(pose):
    assert thighs_deg(fit_behind_table(pose, "stand")).max() < 15
    assert thighs_deg(fit_behind_table(pose, "sit")) == pytest.approx(80, abs=8)


@pytest.mark.parametrize("lean_deg", [20.0, 40.0])
def test_a_trunk_without_legs_is_upright_unless_the_person_lies(lean_deg):
    stands, lies = (
        trunk_tilt_deg(posed(fit_behind_table(STANDS, posture, lean_deg=lean_deg))[0])[0]
        for posture in ("stand", "lie")
    )
    assert abs(stands) < 0.4 * lean_deg
    assert lies > 0.6 * lean_deg


def knees_deg(bodies):
    """Bends of both knees of one person, degrees."""
    joints = posed(bodies)[0][0]
    hip, knee, ankle = (joints[joints_of(name)] for name in ("hip", "knee", "ankle"))
    thigh, shank = knee - hip, ankle - knee
    lengths = np.linalg.norm(thigh, axis=1) * np.linalg.norm(shank, axis=1)
    return np.degrees(np.arccos((thigh * shank).sum(1) / lengths))


def test_legs_that_landmarks_fold_in_depth_are_straight_if_the_person_stands():
    crouches = pose(
        left_hip=(-45, 0, 4), right_hip=(-45, 0, -4), left_knee=(90, 0, 0), right_knee=(90, 0, 0)
    )
    stands, folded = (truth([one], PLACES[:1], yaw_deg=0.0) for one in (STANDS, crouches))
    seen = with_keypoints(stands, world=folded.keypoints.world)
    assert knees_deg(fit(seen, FLOOR)).min() > 40
    assert knees_deg(fit(seen, FLOOR, "stand")).max() < 20


def test_knees_that_are_bent_in_the_picture_stay_bent_though_the_person_stands():
    squats = pose(
        left_hip=(-50, 0, 4), right_hip=(-50, 0, -4), left_knee=(80, 0, 0), right_knee=(80, 0, 0)
    )
    seen = truth([squats], PLACES[:1], yaw_deg=80.0)
    assert knees_deg(fit(seen, FLOOR, "stand")) == pytest.approx(80, abs=12)


def test_thighs_of_who_sits_are_level_though_the_landmarks_half_stand():
    half_stands = pose(
        left_hip=(-45, 0, 5), right_hip=(-45, 0, -8), left_knee=(60, 0, 0), right_knee=(60, 0, 0)
    )
    seen = unsure_of(truth([half_stands], PLACES[:1]), 0.4, *LEGS)
    assert thighs_deg(fit(seen, FLOOR)).max() < 55
    assert thighs_deg(fit(seen, FLOOR, "sit")) == pytest.approx(80, abs=12)


@pytest.fixture(scope="module")
def coco():
    """One person who stands, without 3D landmarks, and the fit."""
    seen = with_keypoints(truth([STANDS], PLACES[:1], skeleton="coco23"), world=None)
    return seen, fit(seen)


@pytest.mark.parametrize("skeleton", ["coco_wholebody133", "halpe26", "wholebody69"])
def test_larger_joint_sets_are_fitted_by_their_body_and_feet(coco, skeleton):
    seen, first = coco
    columns = rows_of(skeleton, *SKELETONS["coco23"].names)
    points = np.full((1, len(SKELETONS[skeleton].names), 2), -99.0)
    confidence = np.ones(points.shape[:2])
    points[:, columns] = seen.keypoints.points
    confidence[:, columns] = seen.keypoints.confidence
    second = fit(replace(seen, keypoints=Keypoints(points, confidence, skeleton)))
    # Sums over points in another order are rounded differently.
    for name in ("body_pose", "transl"):
        one, other = (getattr(answer.parameters, name) for answer in (first, second))
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-9)
    assert miss_mm(posed(first)[0], seen.joints)[0] < 250


def test_a_person_of_unknown_stature_gets_that_of_the_mean_adult():
    answer = fit(truth([STANDS, WALKS], PLACES[:2]))
    stature = MODEL.stature(torch.as_tensor(np.array(answer.parameters.betas), dtype=torch.float32))
    assert stature.tolist() == pytest.approx([ADULT_STATURE_M] * 2, abs=0.02)
