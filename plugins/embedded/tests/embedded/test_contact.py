from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.bones import parameters_from_rotations, replace_mesh_with_joints
from physic_core.errors import BackendError
from physic_core.types import Bodies, People
from physic_core.types.skeletons import SIDES
from physic_embedded.contact_prior import StaticContact, StaticContactOptions

IMAGE = np.zeros((40, 30, 3), np.uint8)
LIMBS = {"foot": 0.5, "hand": 0.5, "sole": 1.0}
UPRIGHT = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
"""The body's y axis points up, the camera's down."""


def bodies(*poses, observed=None):
    rotations, betas, transl = load_body("embedded").zero_pose(len(poses))
    rotations[:, 0] = UPRIGHT
    return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded", observed)


def people(count):
    return People(np.zeros((count, 40, 30), bool), np.zeros((count, 4)), np.ones(count))


def contact(made, **options):
    """The prior's answer for bodies."""
    prior = StaticContact(StaticContactOptions(**options))
    prior.load()
    return prior.infer(IMAGE, people(len(made.parameters)), made)


def at(name):
    return load_body("embedded").contact_sets[name].numpy()


def test_the_parts_that_usually_touch_have_their_probability():
    answer = contact(bodies("stands"), seat=0.4, back=0.3)
    assert answer.topology == "physic-embedded-1"
    (row,) = answer.probability
    assert row.dtype == np.float32
    wanted = np.zeros(len(row))
    sides = [(f"{side}_{name}", worth) for side in SIDES for name, worth in LIMBS.items()]
    for name, worth in (*sides, ("thighs", 0.4), ("gluteus", 0.4), ("back", 0.3)):
        wanted[at(name)] = np.maximum(wanted[at(name)], worth)
    np.testing.assert_allclose(row, wanted, rtol=1e-6)


def test_parts_of_unseen_joints_touch_nothing():
    observed = np.ones((1, 55), bool)
    for name in ("left_ankle", "left_foot", "right_wrist", "left_hip", "right_hip"):
        observed[0, JOINT_INDEX[name]] = False
    (row,) = contact(bodies("stands", observed=observed)).probability
    for name in ("left_sole", "left_foot", "right_hand", "gluteus"):
        assert (row[at(name)] == 0).all()
    for name in ("right_sole", "left_hand", "thighs", "back"):
        assert (row[at(name)] > 0).all()


def test_bodies_of_another_model_get_the_contact_on_the_embedded_mesh():
    made = bodies("stands")
    embedded = contact(made)
    other = replace(replace_mesh_with_joints(made, load_body("embedded")), body_model="smplx")
    found = contact(other)
    np.testing.assert_array_equal(found.probability, embedded.probability)
    assert (embedded.rest, found.topology) == (None, embedded.topology)
    assert (found.rest.topology, len(found.rest.vertices)) == (
        found.topology,
        found.probability.shape[1],
    )


def test_a_prior_that_is_not_loaded_is_refused():
    with pytest.raises(BackendError, match="is not loaded"):
        StaticContact().infer(IMAGE, people(1), bodies("stands"))
