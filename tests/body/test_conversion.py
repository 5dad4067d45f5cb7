"""Bodies of other models carried over: there and back, by surface and by joints, with what is said
of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from other_body import mm, posed, smpl_file_arrays

from physic_core.body import rest_mesh_of_model
from physic_core.body.bones import parameters_from_rotations, rotations_from_parameters
from physic_core.body.files import SmplBody
from physic_core.conversion import can_convert, convert_bodies
from physic_core.errors import BodyModelError
from physic_core.types import Bodies, Mesh


@pytest.fixture(scope="module")
def own(people):
    """Four embedded bodies."""
    tensors = [torch.from_numpy(people[name]) for name in ("rotations", "betas", "transl")]
    return Bodies(
        parameters_from_rotations(tensors[0], tensors[1], None, tensors[2]),
        "embedded",
        np.ones((4, 55), bool),
    )


@pytest.fixture(scope="module")
def smpl(smaller):
    arrays = smpl_file_arrays(smaller)
    arrays.pop("kintree_table")
    return SmplBody(*arrays.values())


def with_mesh(bodies, model):
    rest = rest_mesh_of_model(model)
    return replace(
        bodies,
        mesh=Mesh(rest.topology, posed(model, bodies.parameters)[0], rest.faces, rest.vertices),
    )


def test_a_body_converted_by_its_surface_and_back_is_the_same(own, embedded, other_model, other):
    vertices, joints = posed(embedded, own.parameters)
    there = convert_bodies(own, other_model)
    assert there.bodies.body_model == "smplx"
    assert there.bodies.parameters.betas.shape == (4, 10)
    assert_array_equal(there.bodies.observed, own.observed)
    assert (there.bodies.joints, there.bodies.mesh) == (None, None)
    truth = np.stack([other.from_embedded @ v for v in vertices])
    found = posed(other_model, there.bodies.parameters)[0]
    back = convert_bodies(with_mesh(there.bodies, other_model), embedded)
    again, joints_again = posed(embedded, back.bodies.parameters)
    assert mm(found, truth) < 4
    assert mm(again, vertices) < 3
    assert mm(joints_again[:, :22], joints[:, :22]) < 5
    assert there.surface_m.max() < 4e-3


def test_a_body_converted_by_its_joints_and_back_is_the_same(own, embedded, other_model):
    """The other model has its joints up to 5 cm elsewhere: a surface that follows joints alone is
    off by as much.
    """
    vertices, joints = posed(embedded, own.parameters)
    there = convert_bodies(replace(own, body_model="smpl", joints=joints), other_model)
    joints_there = posed(other_model, there.bodies.parameters)[1]
    back = convert_bodies(replace(there.bodies, joints=joints_there), embedded)
    again, joints_again = posed(embedded, back.bodies.parameters)
    limbs = [4, 5, 7, 8, 18, 19, 20, 21]
    assert mm(joints_there[:, limbs], joints[:, limbs]) < 15
    assert mm(joints_again[:, :22], joints[:, :22]) < 12
    assert mm(again, vertices) < 14


def test_smpl_reaches_the_embedded_body(own, embedded, smpl, smaller):
    """With the user's file: surface and joints are there, hands are flat."""
    p = own.parameters
    rotations = rotations_from_parameters(p).double().numpy()
    local = np.concatenate([rotations[:, :22], np.broadcast_to(np.eye(3), (4, 2, 3, 3))], 1)
    betas = p.betas[:, :10].astype(float)
    transl = p.transl.astype(float)
    vertices = smpl.vertices(local, betas, transl)
    joints = smpl.smpl_joints(local, betas, transl)
    placed = np.full((4, 55, 3), np.nan)
    placed[:, :22] = joints[:, :22]
    flat = replace(
        p,
        left_hand_pose=0 * p.left_hand_pose,
        right_hand_pose=0 * p.right_hand_pose,
        betas=p.betas[:, :10],
    )
    estimated = Bodies(
        flat, "smpl", None, placed, Mesh("smpl", vertices, smpl.faces, smpl.template)
    )
    found = convert_bodies(estimated, embedded)
    assert found.surface_m.max() < 6e-3
    # Which vertex of the embedded body each vertex of the other is, is known.
    by_joints = convert_bodies(replace(estimated, mesh=None), embedded)
    for one, most in ((found, 6), (by_joints, 35)):
        own_vertices = posed(embedded, one.bodies.parameters)[0]
        assert mm(np.stack([smaller.from_embedded @ v for v in own_vertices]), vertices) < most


def test_bare_joints_make_bodies(own, embedded):
    """Rotations that mean nothing are not looked at."""
    vertices, joints = posed(embedded, own.parameters)
    wild = replace(
        own.parameters, body_pose=own.parameters.body_pose + 1, betas=np.zeros((4, 45), np.float32)
    )
    found = convert_bodies(Bodies(wild, "other", None, joints), embedded)
    assert mm(posed(embedded, found.bodies.parameters)[0], vertices) < 9


def test_people_without_known_joints_are_nan(own, embedded):
    joints = posed(embedded, own.parameters)[1]
    joints[1] = np.nan
    estimated = replace(own, body_model="smpl", joints=joints)
    estimated.parameters.body_pose.setflags(write=False)
    found = convert_bodies(estimated, embedded)
    assert np.isnan(found.bodies.parameters.transl).all(1).tolist() == [False, True, False, False]
    assert np.isnan(found.joints_m).tolist() == [False, True, False, False]
    alone = convert_bodies(
        replace(estimated, parameters=estimated.parameters[2:], joints=joints[2:], observed=None),
        embedded,
    )
    assert_allclose(found.bodies.parameters.transl[2:], alone.bodies.parameters.transl, atol=1e-6)


def test_parameters_alone_of_a_model_that_is_not_there_are_refused(own, embedded):
    estimated = replace(own, body_model="smplx")
    assert not can_convert(estimated, embedded)
    with pytest.raises(BodyModelError, match="'smplx' cannot be converted to 'embedded'"):
        convert_bodies(estimated, embedded)
