from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.body.convert.bodies import replace_mesh_with_joints
from physic_core.errors import BackendError
from physic_core.types import Bodies, People
from physic_embedded.contact_prior import StaticContact, StaticContactOptions

IMAGE = np.zeros((40, 30, 3), np.uint8)
UPRIGHT = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
"""The body's y axis points up, the camera's down."""


def bent(axis, degrees):
    matrix = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return torch.tensor(matrix, dtype=torch.float32)


def bodies(*poses, observed=None, hips=-85):
    rotations, betas, transl = load_body("embedded").zero_pose(len(poses))
    rotations[:, 0] = UPRIGHT
    for i, pose in enumerate(poses):
        if pose == "sits":
            rotations[i, joints_of("hip")] = bent("x", hips)
            rotations[i, joints_of("knee")] = bent("x", 85)
        elif pose == "lies":
            rotations[i, 0] = bent("z", 90) @ UPRIGHT
    return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded", observed)


def joints_of(name):
    return [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right")]


def people(count):
    return People(np.zeros((count, 40, 30), bool), np.zeros((count, 4)), np.ones(count))


def contact(made, **options):
    """The prior's answer for bodies."""
    prior = StaticContact(StaticContactOptions(**options))
    prior.load()
    return prior.infer(IMAGE, people(len(made.parameters)), made)


def at(name):
    return load_body("embedded").contact_sets[name].numpy()


def test_a_standing_person_touches_with_feet_and_hands_alone():
    answer = contact(bodies("stands"))
    assert answer.topology == "physic-embedded-1"
    (row,) = answer.probability
    assert row.dtype == np.float32
    wanted = np.zeros(len(row))
    for name, worth in (("foot", 0.5), ("hand", 0.5), ("sole", 1)):
        for side in ("left", "right"):
            wanted[at(f"{side}_{name}")] = worth
    np.testing.assert_array_equal(row, wanted)


@pytest.mark.parametrize("pose", ["sits", "lies"])
def test_a_person_who_sits_or_lies_touches_with_seat_and_back_too(pose):
    standing, other = contact(bodies("stands", pose), seat=0.4, back=0.3).probability
    for name, worth in (("thighs", 0.4), ("gluteus", 0.4), ("back", 0.3)):
        assert (standing[at(name)] == 0).all()
        assert other[at(name)] == pytest.approx(worth)


def test_parts_of_unseen_joints_touch_nothing():
    observed = np.ones((1, 55), bool)
    for name in ("left_ankle", "left_foot", "right_wrist", "left_hip", "right_hip"):
        observed[0, JOINT_INDEX[name]] = False
    (row,) = contact(bodies("sits", observed=observed)).probability
    for name in ("left_sole", "left_foot", "right_hand", "gluteus"):
        assert (row[at(name)] == 0).all()
    for name in ("right_sole", "left_hand", "thighs", "back"):
        assert (row[at(name)] > 0).all()


def test_sitting_is_recognised_by_the_hips():
    for pose, hips, seated in (("stands", 0, False), ("sits", -60, True), ("sits", -20, False)):
        (row,) = contact(bodies(pose, hips=hips)).probability
        assert row[at("gluteus")].any() == seated


def test_contact_of_bodies_of_another_model_comes_from_their_joints():
    made = bodies("sits")
    embedded = contact(made)
    other = replace(replace_mesh_with_joints(made, load_body("embedded")), body_model="smplx")
    found = contact(other)
    np.testing.assert_array_equal(found.probability, embedded.probability)
    assert (embedded.rest, found.topology) == (None, embedded.topology)
    assert (found.rest.topology, len(found.rest.vertices)) == (
        found.topology,
        found.probability.shape[1],
    )


def test_bodies_of_another_model_without_joints_are_refused():
    made = bodies("stands")
    with pytest.raises(BackendError, match=r"^the static contact prior needs"):
        contact(Bodies(made.parameters, "smplx"))
    with pytest.raises(BackendError, match="is not loaded"):
        StaticContact().infer(IMAGE, people(1), made)
