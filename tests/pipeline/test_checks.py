"""Self-checks: each number against its bound, in a name that can be filtered by and a sentence that
can be read.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.ground.stance import Stance
from physic_core.geometry.floor import PlaneFit
from physic_core.judge import (
    CHECKS,
    failed_checks,
    person_trust,
    run_checks,
    unknown_checks,
    warning_messages,
)
from physic_core.judge.trust import CAP
from physic_core.pipeline.reconstruction import bent_trunk_warnings
from physic_core.types import (
    CameraTrust,
    CheckState,
    Intrinsics,
    Keypoints,
    Measures,
    Observations,
    Plane,
    UnposedPerson,
    skeleton_named,
)
from physic_core.types.contacts import BodyContact, ContactPartner, Support, SupportState
from physic_core.types.known_sizes import KnownPeople
from physic_core.types.observations import POSTURES
from physic_core.types.results import UNSURE_M
from physic_core.types.skeletons import SIDES
from tests.rooms import tiny_result

CAMERA = Intrinsics.from_focal(500, 640, 480, "EXIF")
GIVEN = replace(CAMERA, trust=CameraTrust.KNOWN)
LEVEL = Plane(np.array([0.0, -1.0, 0.0]), 1.5)
FAR_FOCAL = Intrinsics.from_focal(325, 320, 240)


FAR = dict.fromkeys(("left_foot", "right_foot", "left_hand", "right_hand", "seat"), 0.01)
"""Probability of contact of people who touch nothing."""
FEET = {"left_foot": 0.95, "right_foot": 0.95}


def standing(lean_deg=0.0):
    """(55, 3) joints of one who stands 4 m away; leaning towards the camera by an angle."""
    joints = np.zeros((55, 3))
    for side in (0, 1):
        joints[[1 + side, 4 + side, 7 + side], 1] = [0.9, 0.5, 0.08]  # heights
    joints[[12, 16, 17], 1] = [1.4, 1.35, 1.35]
    tilt = math.radians(lean_deg)
    up = joints[:, 1] - 0.08
    foot = 0.08
    return np.stack([joints[:, 0], 1.5 - foot - up * math.cos(tilt), 4.0 - up * math.sin(tilt)], -1)


def bent(lean_deg=0.0):
    """(55, 3) joints of one whose left knee is bent."""
    joints = standing(lean_deg)
    joints[7] = joints[4] + [0.0, 0.0, 0.4]
    return joints


def with_lower_legs_back():
    """A person with an upright trunk, whose knees are bent by 45 degrees away from the camera."""
    joints = standing()
    joints[[7, 8], 2] += 0.42
    return joints


def with_bent_trunk(degrees):
    """A person on straight legs, whose neck and shoulders are turned towards the camera about the
    hips.
    """
    joints = standing()
    hips = joints[[1, 2]].mean(0)
    c = math.cos(math.radians(degrees))
    s = math.sin(math.radians(degrees))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    above = joints[:, 1] < hips[1]
    joints[above] = hips + (joints[above] - hips) @ turn.T
    return joints


def stranger(height, left=310.0):
    """A box without a body; that of the person is 400 px high."""
    return UnposedPerson((left, 0.0, left + 50, height), 0.5, "no pose fits the box")


def keypoints_at(joints, camera, off_px=0.0, moved=0):
    """COCO keypoints at the projected joints, ``moved`` of the limbs' displaced."""
    skeleton = skeleton_named("coco17")
    points = np.zeros((1, 17, 2))
    limbs = [
        k for k, name in enumerate(skeleton.names) if name in JOINT_INDEX and "eye" not in name
    ]
    for row, k in enumerate(limbs):
        x, y, z = np.nan_to_num(joints[JOINT_INDEX[skeleton.names[k]]], nan=1.0)
        points[0, k] = [
            500 * x / z + camera.cx + (off_px if row < moved else 0.0),
            500 * y / z + camera.cy,
        ]
    return Keypoints(points, np.ones((1, 17)), "coco17")


def observed_as(posture):
    """Observations of one person who surely has a posture."""
    sure = np.array([[name == posture for name in POSTURES]], np.float32)
    return replace(Observations.unknown(1), posture=sure)


def across_the_picture(joints):
    """The joints of one who lies across the picture."""
    return np.stack([joints[:, 1] - 1.0, 1.5 - 0.1 + joints[:, 0], joints[:, 2]], -1)


def plane(source):
    lower = torch.arange(480)[:, None].expand(480, 640) > 300
    return PlaneFit(torch.tensor([0.0, -1.0, 0.0]), 1.5, lower, 0.5, 0.0, source)


def photo_of(colours):
    """(480, 640, 3) photo of so many colours, one beside the other."""
    return np.random.default_rng(0).integers(0, colours, (480, 640, 3), dtype=np.uint8)


SLOPE = np.broadcast_to(np.linspace(2, 4, 640), (480, 640))  # metres, farther to the right


def by_depth(log_ratio):
    """The rows of witnesses with a metric depth whose error is 0.04. It draws the answer away from
    people, of whom one is a child.
    """
    return [
        {"by": "size", "log_ratio": -0.1, "sigma": 0.03, "right": 0.9},
        {"by": "size", "log_ratio": 1.0, "sigma": 0.03, "right": 0.01},
        {"by": "metric depth", "log_ratio": log_ratio - 0.1, "sigma": 0.04, "right": 0.9},
    ]


def map_of(camera):
    points = np.stack([SLOPE] * 3, -1)
    return SimpleNamespace(intrinsics=camera, points=points, valid=points[..., 2] > 0)


def case(
    *,
    report=None,
    failure=None,
    legs=True,
    sigma=0.1,
    camera=CAMERA,
    scene_camera=CAMERA,
    lean=0.0,
    source="soles",
    colours=30,
    joints=None,
    photo_share=0.9,
    floor="found",
    mask=True,
    lost=(),
    off=0.0,
    moved=0,
    unposed=(),
    heads=1,
    stands=(0.9, 0.9),
    score=0.9,
    depth=SLOPE,
    witness=(),
    likely=FEET,
    posture="stand",
    limbs=MappingProxyType({}),
    views=(),
    pitch_deg=0.0,
    **person,
):
    """Estimates and result of one person where all is well, but for what is given; other names
    are fields of the person.
    """
    observed = np.ones((1, 55), bool)
    observed[0, [4, 7]] = legs
    joints = standing(lean) if joints is None else joints
    is_found = floor == "found"
    evidence = SimpleNamespace(
        bodies=SimpleNamespace(observed=observed),
        views=views,
        ground=SimpleNamespace(
            measured=None,
            stance=replace(Stance.unknown(1), stand_probability=np.array([stands])),
            witnesses={"scale": witness},
            search=SimpleNamespace(
                plane=plane(source) if is_found else None, in_mask=is_found and mask
            ),
        ),
        is_given_keypoint=None,
        contradicted_px=None,
        depth=SimpleNamespace(intrinsics=None, depth=depth, scale_sigma=0.03),
        depth_backend="metric_depth 'x'",
        depth_comparison=None,
        missing_results=(lost,),
        image=photo_of(colours),
        photo=SimpleNamespace(
            hole=torch.zeros(480, 640, dtype=torch.bool),
            keypoints=keypoints_at(joints, camera, off, moved),
            observations=observed_as(posture),
            people=SimpleNamespace(
                boxes=np.array([[0.0, 0.0, 300.0, 400.0]]),
                scores=np.array([score]),
                unposed=unposed,
                masks=(np.mgrid[:480, :640] < np.reshape([400, 26], (2, 1, 1))).all(0)[None],
                floor=np.ones((480, 640), bool) if mask else None,
                heads=np.array([heads]),
            ),
            scene_map=map_of(scene_camera),
            photo_map=map_of(None),
        ),
    )
    usual = {
        "measures": Measures(joint_problem=failure, **report or {}),
        "world_contact": likely and FAR | likely,
        "support": None,
        "contacts": (),
        "vertices": joints,
        "has_body": True,
        "stature": None,
        "child_probability": None,
        "unseen": ("right_upper_leg", "right_lower_leg", "right_foot"),
        "posture": posture,
        "posture_probability": 0.9,
        "joints": joints,
        "limb_sigmas": limbs,
        "hides": ("right_leg",).__contains__,
        "unsure": [limb for limb, sigma in limbs.items() if sigma > UNSURE_M],
    }
    person = SimpleNamespace(**usual | person)
    pitch = math.radians(pitch_deg)
    up = np.array([0.0, -math.cos(pitch), math.sin(pitch)])
    floor_plane = Plane(up, 1.5) if is_found else None
    found = {"reason": floor, "inlier_share": 0.62, "in_mask": mask if is_found else None}
    result = SimpleNamespace(
        people=(person,),
        intrinsics=camera,
        scene=SimpleNamespace(
            scale=1.0, scale_sigma=sigma, floor=floor_plane, level=LEVEL if is_found else None
        ),
        diagnostics={
            "scene": {"floor": found},
            "placement": {"alignment": {"inlier_share": photo_share}},
        },
    )
    return evidence, result


def test_nothing_fails_where_all_is_well():
    found = run_checks(*case())
    measured = [name for name, spec in CHECKS.items() if not spec.optional or name == "floor_shown"]
    assert [d.name for d in found] == measured
    assert not any(d.failed for d in found)
    assert [d.person for d in found] == [None if CHECKS[d.name].of == "photo" else 0 for d in found]
    assert failed_checks(found, 0) == ()
    assert warning_messages(found) == ()


@pytest.mark.parametrize(
    ("changes", "name", "value", "word"),
    [
        (
            {"photo_share": 0.3},
            "photo_alignment",
            0.3,
            "30%",
        ),
        ({"floor": "no_consensus"}, "floor", 0.0, "no horizontal plane"),
        ({"mask": False}, "floor", 0.0, "look like floor"),
        ({"pitch_deg": 19.0}, "floor", 0.0, "by 19°"),
        ({"sigma": 0.22}, "scale_sigma", 0.22, "off by 22%"),
        ({"colours": 1, "mask": None}, "floor_shown", 0.0, "the floor is a guess"),
        (
            {"camera": replace(GIVEN, cy=239.5 - 0.16 * 480)},
            "principal_point",
            0.16,
            "",
        ),
        ({"camera": GIVEN, "scene_camera": FAR_FOCAL}, "focal_agreement", 0.3, "650 px"),
        ({"unposed": (stranger(200), stranger(201))}, "unposed_people", 2.0, "2 large people"),
        (
            {"unposed": (replace(stranger(200), reason="more than 20 people: give N"),)},
            "unposed_people",
            1.0,
            "give N",
        ),
        ({"witness": by_depth(math.log(1000))}, "depth_scale", 138.155, "millimeters"),
        ({"witness": by_depth(-0.16)}, "depth_scale", 3.2, "metric_depth 'x'"),
        ({"depth": SLOPE[:, ::-1]}, "depth_order", 0.0, "metric_depth 'x'"),
    ],
)
def test_a_fault_of_a_photo_fails_its_check_and_is_a_warning(changes, name, value, word):
    (failed,) = [d for d in run_checks(*case(**changes)) if d.failed]
    assert (failed.name, failed.person) == (name, None)
    assert failed.value == pytest.approx(value, rel=1e-3, abs=0.01)
    assert warning_messages([failed]) == (failed.message,)
    assert word in failed.message


@pytest.mark.parametrize(
    "changes",
    [
        {"pitch_deg": 12.0},
        {"pitch_deg": -40.0},
        {
            "witness": by_depth(0.14),
            "depth": SLOPE * np.random.default_rng(0).uniform(0.9, 1.1, SLOPE.shape),
        },
        {"unposed": (stranger(199), stranger(400, left=0.0))},  # far, and a box of the person
    ],
)
def test_what_is_within_its_limit_does_not_fail(changes):
    assert not [check for check in run_checks(*case(**changes)) if check.failed]


LIES = across_the_picture(standing())
"""Joints of one who lies, and whom nothing is known to carry."""
FOOT = BodyContact("left_foot", ContactPartner("hidden"), 0.9, 30, distance_m=0.14)
BACK = replace(FOOT, part="back")
IN_THE_AIR = Support(SupportState.AIRBORNE, (), None, (0.0, 0.0, 3.0))
LIMBS = [f"{side}_{part}" for part in ("upper_arm", "lower_arm", "hand", "foot") for side in SIDES]
LEFT_ANKLE = SimpleNamespace(observed=torch.arange(55)[None] == 7)
"""What another photo of the moment shows of the person."""
LIFTED = {"sole_height_m": 0.25}


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"contacts": (FOOT,)}, "unknown_contacts"),
        ({"contacts": (replace(FOOT, assumed=True, distance_m=None),)}, ""),
        ({"contacts": (FOOT, BACK), "joints": LIES}, "contact_sure"),
        ({"unseen": LIMBS}, "hidden_limbs"),
        ({"unseen": LIMBS, "joints": LIES}, "contact_sure"),
        ({"report": {"low_depth_ratio": 0.5}}, "low_depth"),
        ({"score": 0.4}, "detected"),
        ({"heads": 2}, "heads"),
        ({"report": {"body_in_mask_share": 0.6}}, "body_in_mask"),
        ({"report": {"clearance_m": 0.28}}, "support"),
        ({"report": {"clearance_m": 0.28, "assumed_support": True}}, ""),
        ({"report": {"clearance_m": 0.28}, "contacts": (FOOT,)}, "unknown_contacts"),
        ({"report": {"clearance_m": 0.28}, "support": IN_THE_AIR}, ""),
        ({"report": LIFTED}, "support"),
        ({"report": LIFTED, "legs": False}, ""),
        ({"report": LIFTED, "legs": False, "views": (LEFT_ANKLE,)}, "support"),
        ({"report": LIFTED, "joints": bent()}, "support"),
        ({"report": LIFTED, "stands": (0.9, 0.3)}, ""),
        (
            {"report": {"sole_height_m": -2.3}, "stands": (0.3, 0.3), "legs": False},
            "placed support",
        ),
        ({"likely": {"left_foot": 0.55, "right_foot": 0.55}}, "contact_sure"),
        ({"likely": {"left_foot": 0.95, "right_foot": 0.05, "torso": 0.5}}, ""),
        ({"off": 30.0, "moved": 3}, "limb_keypoints"),
        ({"off": 30.0, "moved": 2}, ""),  # both shoulders
        ({"report": {"placement_problem": "2 keypoints have confidence 0.5 or more"}}, "placed"),
        ({"failure": "no start"}, "placed"),
        ({"lost": ("body_estimator",)}, "placed"),
        ({"lean": 14.0}, ""),
        ({"lean": 16.0}, "lean"),
        ({"lean": 16.0, "floor": "no_consensus"}, "lean"),  # against the picture
        ({"joints": with_bent_trunk(-45.0)}, "lean"),
        ({"joints": bent(16.0)}, "lean"),  # by the trunk, which is above the ankle
        ({"joints": with_lower_legs_back()}, ""),
        ({"limbs": {"left_arm": 0.3, "left_leg": math.nan}}, "limb_sigma"),
        ({"limbs": {"left_arm": 0.15, "right_leg": 0.4}}, ""),  # a guess, as nothing shows it
    ],
)
def test_a_fault_of_a_person_fails_its_checks(changes, names):
    assert " ".join(failed_checks(run_checks(*case(**changes)), 0)) == names


def test_a_lean_is_a_doubt_about_the_person_and_no_warning_of_the_photo():
    assert not warning_messages(run_checks(*case(lean=20.0)))


def test_a_mask_with_the_head_of_another_person_is_never_good():
    evidence, result = case()
    photo = evidence.photo
    keypoints = photo.keypoints
    beside = keypoints.points + np.array([150.0, 0.0])
    photo.keypoints = SimpleNamespace(
        points=np.concatenate([keypoints.points, beside]),
        confidence=np.ones((2, 17)),
        skeleton="coco17",
    )
    result.people *= 2
    photo.people.masks = np.repeat(photo.people.masks, 2, axis=0)
    for heads in (1, 2):
        found = [CHECKS["heads"].compare(CHECKS["heads"].measure(evidence, result, 0), 0)]
        assert found[0].value == heads
        trust = person_trust((*run_checks(*case()), *found), 0)
        assert (trust.probability <= CAP) == (heads == 2)
        photo.people.masks[0, :, 100:] = True  # with the head of the other
    assert warning_messages(found) == (f"person 0: {found[0].message}",)


LYING = standing()[:, [0, 2, 1]]


@pytest.mark.parametrize(("below_m", "failed"), [(0.5, True), (0.05, False)])
def test_people_who_lie_do_not_lie_below_the_floor(below_m, failed):
    found = run_checks(*case(joints=LYING, vertices=np.array([[0.0, 1.5 + below_m, 4.0]])))
    assert ("support" in failed_checks(found, 0)) == failed


def test_a_limb_that_moves_between_looks_is_named():
    evidence, result = case()
    keypoints = evidence.photo.keypoints
    names = skeleton_named(keypoints.skeleton).names
    spread = np.zeros(keypoints.confidence.shape)
    spread[0, names.index("right_ankle")] = 0.9  # hidden
    spread[0, names.index("left_wrist")] = 0.35
    evidence.photo.keypoints = replace(keypoints, world_spread=spread)
    found = {check.name: check for check in run_checks(evidence, result)}
    assert found["limb_spread"].value == pytest.approx(0.35)
    assert found["limb_spread"].failed
    assert "left arm" in found["limb_spread"].message


def test_a_value_at_its_bound_holds_and_beyond_it_does_not():
    for name, check in CHECKS.items():
        beyond = check.threshold + (1e-6 if check.direction == "at most" else -1e-6)
        assert check.compare(check.threshold).ok
        assert check.compare(beyond).failed
        unknown = check.compare((math.nan, "no floor"))
        assert (unknown.name, unknown.state, unknown.value) == (name, "unknown", None)
        assert unknown.message == "not measured: no floor"


@pytest.mark.parametrize(
    ("changes", "names", "reason"),
    [
        ({"floor": "no_pixels"}, "placed", "floor"),
        ({"mask": None}, "floor", "look like floor"),
        ({}, "support", "no floor and no surface"),
        (
            {"report": {"clearance_m": 0.0, "assumed_support": True}},
            "support",
            "is assumed",
        ),
        ({"floor": "switched_off"}, "floor", "settings"),
        ({"likely": None}, "contact_sure", "no body, or this preset"),
        ({}, "body_in_mask", "no visible part of this body"),
        ({"joints": np.full((55, 3), np.nan)}, "lean body_in_mask", "no body"),
        ({"lean": 80.0, "source": "people who lie"}, "lean", "lies"),
        ({"joints": across_the_picture(standing())}, "lean", "not upright"),
        ({"joints": with_bent_trunk(-45.0), "posture": "squat"}, "lean", "not upright"),
        ({"sigma": None}, "scale_sigma", "metric_depth"),
    ],
)
def test_an_unmeasured_check_is_unknown_with_its_reason(changes, names, reason):
    checks = run_checks(*case(**changes))
    found = {d.name: d for d in checks}
    assert set(unknown_checks(checks, 0)) == {
        one.name for one in checks if one.person == 0 and one.value is None
    }
    for name in names.split():
        assert (found[name].state, found[name].value) == (CheckState.UNKNOWN, None)
        assert found[name].message.startswith("not measured: ")
        assert reason in found[name].message


SIZES = {"given_stature_m": 1.15, "shown_stature_m": 1.7}
SIX = KnownPeople(np.array([6.0]))
SMALL = KnownPeople(np.array([6.0]), np.array([1.15]))
PLACES = {"given_keypoints_px": {"nose": 9.0, "right_wrist": 124.0}, "stature_px": 500.0}
NEAR = {"given_keypoints_px": {"nose": 9.0, "right_wrist": 24.0}, "stature_px": 500.0}


@pytest.mark.parametrize(
    ("name", "report", "known", "failed", "message"),
    [
        (
            *("given_size", SIZES | {"stature_sigmas": 3.1}, SIX, True),
            "this person is 1.70 m tall in the photo, not 1.15 m, which is usual at 6 years",
        ),
        (
            *("given_size", SIZES | {"stature_sigmas": 3.1}, SMALL, True),
            "this person is 1.70 m tall in the photo, not 1.15 m",
        ),
        (
            *("given_size", SIZES | {"stature_sigmas": 2.9}, SMALL, False),
            "Given size differs from the photo: 2.90 sigma, limit 3 sigma",
        ),
        (
            *("given_keypoints", PLACES, None, True),
            "your right wrist is 186 px away",
        ),
        (
            *("given_keypoints", NEAR, None, False),
            "Given keypoints far from the body: 4.80 sigma, limit 5 sigma",
        ),
    ],
)
def test_what_the_user_gave_and_the_photo_contradicts_makes_a_person_doubtful(
    name, report, known, failed, message
):
    estimates, result = case(report=report)
    estimates.photo.known = known or KnownPeople()
    estimates.file_px_per_px = 1.5
    found = next(d for d in run_checks(estimates, result) if d.name == name)
    assert found.message.startswith(message)
    assert bool(warning_messages([found])) == failed
    trust = person_trust((*run_checks(*case()), found), 0)
    assert (trust.probability <= CAP) == failed


def test_a_metric_depth_that_is_larger_where_the_scene_is_nearer_may_be_a_disparity():
    found = run_checks(*case(witness=by_depth(-1.0), depth=1 / SLOPE))
    (failed,) = (one for one in found if one.name == "depth_scale")
    assert failed.failed
    assert "disparity" in failed.message


@pytest.mark.parametrize(("degrees", "warned"), [(80, False), (105, True), (-70, True)])
def test_a_trunk_that_bends_more_than_a_spine_is_warned_of(degrees, warned):
    result = tiny_result()
    person = result.people[0]
    pose = np.zeros_like(person.parameters.body_pose)
    pose[0, 3 * (JOINT_INDEX["spine1"] - 1)] = math.radians(degrees)
    bent = replace(person, parameters=replace(person.parameters, body_pose=pose))
    sentences = bent_trunk_warnings(replace(result, people=(bent,)))
    assert [f"{degrees}°" in sentence for sentence in sentences] == [True] * warned


UNKNOWN = KnownPeople(None, None)


@pytest.mark.parametrize(
    ("person", "name"),
    [
        ({"stature": 0.6, "child_probability": 0.24}, "stature"),
        ({"stature": 2.4}, "stature"),
        ({"stature": 1.22, "child_probability": 0.9, "posture": "lie"}, "child_size"),
        ({"stature": 1.22, "child_probability": 0.9, "sigma": 0.01, "posture": "lie"}, ""),
        ({"stature": 1.22, "child_probability": 0.9}, ""),
        ({"stature": 1.69, "child_probability": 0.24}, ""),
        ({"stature": 0.9, "child_probability": 0.9}, ""),
    ],
)
def test_a_stature_that_nobody_has_is_not_usable_in_size(person, name):
    estimates, result = case(**person)
    estimates.photo.known = UNKNOWN
    checks = run_checks(estimates, result)
    about_size = [
        one.name for one in checks if one.failed and one.name in ("stature", "child_size")
    ]
    assert about_size == [name] * bool(name)
    assert (person_trust(checks, 0).marks["size"] <= 0.5) == bool(name)


@pytest.mark.parametrize(
    ("years", "stature", "child", "failed"),
    [
        (1.0, 0.7, 0.9, False),
        (3.0, 0.96, 0.004, True),
        (None, 0.6, 0.9, False),
        (None, 1.1, 0.004, True),
        (None, 1.1, 0.24, False),
        (None, 1.5, 0.02, False),
    ],
)
def test_a_given_age_or_stature_of_a_child_fails_where_the_photo_shows_an_adult(
    years, stature, child, failed
):
    estimates, result = case(stature=stature, child_probability=child)
    known = KnownPeople(None, np.array([stature]))
    estimates.photo.known = KnownPeople(np.array([years]), None) if years else known
    (check,) = [one for one in run_checks(estimates, result) if one.name == "stature"]
    assert check.failed == failed


@pytest.mark.parametrize(
    ("years", "stature", "failed"),
    [(2, 1.5, True), (5, 1.9, True), (80, 2.3, True), (2, 0.87, False), (15, 1.7, False)],
)
def test_a_given_stature_that_a_given_age_does_not_have_fails(years, stature, failed):
    estimates, result = case(stature=stature)
    estimates.photo.known = KnownPeople(np.array([float(years)]), np.array([stature]))
    (check,) = [one for one in run_checks(estimates, result) if one.name == "stature"]
    assert check.failed == failed
