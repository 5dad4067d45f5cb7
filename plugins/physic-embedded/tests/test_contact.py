from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.body.convert.bodies import replace_mesh_with_joints
from physic_core.errors import BackendError
from physic_core.types import Bodies, People
from physic_embedded.contact_prior import StaticContact, StaticContactOptions, is_sitting

IMAGE = np.zeros((40, 30, 3), np.uint8)
UPRIGHT = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
"""The body's y axis points up, the camera's down."""


def bent(axis, degrees):
    import roma

    return roma.rotvec_to_rotmat(torch.tensor(axis) * float(np.radians(degrees)))


def bodies(*poses, observed=None):
    model = load_body("embedded")
    rotations, betas, transl = model.zero_pose(len(poses))
    rotations[:, 0] = UPRIGHT
    for i, pose in enumerate(poses):
        if pose == "is_sitting":
            for side in ("left", "right"):
                rotations[i, JOINT_INDEX[f"{side}_hip"]] = bent((1, 0, 0), -85)
                rotations[i, JOINT_INDEX[f"{side}_knee"]] = bent((1, 0, 0), 85)
        elif pose == "lies":
            rotations[i, 0] = bent((0, 0, 1), 90) @ UPRIGHT
    return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded", observed)


def people(count):
    return People(np.zeros((count, 40, 30), bool), np.zeros((count, 4)), np.ones(count))


def prior(**options):
    made = StaticContact(StaticContactOptions(**options))
    made.load()
    return made


def at(name):
    return load_body("embedded").contact_sets[name].numpy()


def test_a_standing_person_touches_with_feet_and_hands_alone():
    answer = prior().infer(IMAGE, people(1), bodies("stands"))
    assert answer.topology == "physic-embedded-1"
    (row,) = answer.probability
    assert row.dtype == np.float32
    assert (row[at("left_sole")] == 1).all()
    assert (row[at("right_sole")] == 1).all()
    touched = np.zeros(len(row), bool)
    for name in ("left_foot", "right_foot", "left_sole", "right_sole", "left_hand", "right_hand"):
        touched[at(name)] = True
    assert set(np.unique(row[touched])) == {np.float32(0.5), np.float32(1)}
    assert (row[~touched] == 0).all()


@pytest.mark.parametrize("pose", ["is_sitting", "lies"])
def test_a_person_who_sits_or_lies_touches_with_seat_and_back_too(pose):
    standing, other = (
        prior(seat=0.4, back=0.3).infer(IMAGE, people(2), bodies("stands", pose)).probability
    )
    for name, worth in (("thighs", 0.4), ("gluteus", 0.4), ("back", 0.3)):
        assert (standing[at(name)] == 0).all()
        assert other[at(name)] == pytest.approx(worth)


def test_parts_of_unseen_joints_touch_nothing():
    observed = np.ones((1, 55), bool)
    observed[
        0,
        [
            JOINT_INDEX[n]
            for n in ("left_ankle", "left_foot", "right_wrist", "left_hip", "right_hip")
        ],
    ] = False
    (row,) = prior().infer(IMAGE, people(1), bodies("is_sitting", observed=observed)).probability
    for name in ("left_sole", "left_foot", "right_hand", "gluteus"):
        assert (row[at(name)] == 0).all()
    for name in ("right_sole", "left_hand", "thighs", "back"):
        assert (row[at(name)] > 0).all()


def test_sitting_is_recognised_by_the_hips():
    model = load_body("embedded")
    rotations, betas, transl = model.zero_pose(3)
    for row, angle in ((1, -60), (2, -20)):
        for side in ("left", "right"):
            rotations[row, JOINT_INDEX[f"{side}_hip"]] = bent((1, 0, 0), angle)
    joints = model(rotations, betas, transl, joints_only=True).joints.double().numpy()
    assert is_sitting(joints).tolist() == [False, True, False]


def test_contact_of_bodies_of_another_model_comes_from_their_joints():
    made = bodies("is_sitting")
    embedded = prior().infer(IMAGE, people(1), made)
    other = replace(replace_mesh_with_joints(made, load_body("embedded")), body_model="smplx")
    found = prior().infer(IMAGE, people(1), other)
    np.testing.assert_array_equal(found.probability, embedded.probability)
    assert (embedded.rest, found.topology) == (None, embedded.topology)
    assert (found.rest.topology, len(found.rest.vertices)) == (
        found.topology,
        found.probability.shape[1],
    )


def test_bodies_of_another_model_without_joints_are_refused():
    made = bodies("stands")
    with pytest.raises(BackendError, match=r"^the static contact prior needs"):
        prior().infer(IMAGE, people(1), Bodies(made.parameters, "smplx"))
    with pytest.raises(BackendError, match="is not loaded"):
        StaticContact().infer(IMAGE, people(1), made)
