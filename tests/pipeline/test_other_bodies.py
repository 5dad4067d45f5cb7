"""Bodies of other models, hands with wrists, contact on other meshes: at the border, in the cache,
in the pipeline.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import load_body, rest_mesh_of_model
from physic_core.body.bones import rotations_from_parameters
from physic_core.errors import BodyModelError, PackageMissingError
from physic_core.types import Bodies, ContactProbability, Mesh, RestMesh
from physic_mock import backends
from physic_networks.bodies import parameters_from_rotvecs
from tests.pipeline.mocks import changed, run

pytestmark = pytest.mark.usefixtures("few_steps")

FACES = np.array([[0, 1, 2], [1, 2, 3]], np.int32)


def bodies():
    """Two bodies of MHR, of four vertices and 22 joints."""
    joints = np.zeros((2, 55, 3), np.float32)
    parameters = parameters_from_rotvecs(joints, np.zeros((2, 10)), joints[:, 0])
    joints[:, 22:] = np.nan
    mesh = Mesh("mhr", np.zeros((2, 4, 3), np.float32), FACES, np.zeros((4, 3), np.float32))
    return Bodies(parameters, "mhr", None, joints, mesh)


def joints_of(estimated):
    model = load_body("embedded")
    p = estimated.parameters
    with torch.no_grad():
        given = (torch.from_numpy(value) for value in (p.betas, p.transl))
        return model(rotations_from_parameters(p), *given, joints_only=True).joints.numpy()


def of_smpl(estimated, *_):
    """The mock's bodies, estimated as SMPL's."""
    return Bodies(estimated.parameters, "smpl", estimated.observed, joints_of(estimated))


def without_hips(estimated, *_):
    found = of_smpl(estimated)
    found.joints[:, 1] = np.nan
    return found


def on_another_mesh(estimated, *_):
    """The mock's contact, on a mesh that has another name and another order of vertices."""
    rest = rest_mesh_of_model(load_body("embedded"))
    order = np.random.default_rng(0).permutation(len(rest.vertices))
    mesh = RestMesh("shuffled", rest.vertices[order], np.argsort(order)[rest.faces])
    return ContactProbability(estimated.probability[:, order], "shuffled", mesh)


@pytest.fixture(scope="module")
def plain(few_steps, world):
    """The result with the mock's own backends."""
    return run(world.image)


def test_bodies_of_smpl_are_carried_over(world):
    # In so small a photo a bent point map leaves the left foot two places, 6 cm apart, that explain
    # it alike.
    sure = "relative_pointmap.options.noise=0"
    plain = run(world.image, sure)
    result = run(world.image, sure, backends=changed(backends.MockBodyEstimator, of_smpl))
    assert result.body_model == "embedded"
    assert (
        "bodies converted from 'smpl' to 'embedded', joints within 1 mm on average" in result.notes
    )
    apart = np.linalg.norm(result.people[0].joints[:22] - plain.people[0].joints[:22], axis=1)
    assert apart.max() < 0.03


def test_bodies_with_too_few_joints_are_refused(world):
    with pytest.raises(
        BodyModelError, match="the body model 'smpl' with too few joints to convert them"
    ):
        run(world.image, backends=changed(backends.MockBodyEstimator, without_hips))


def test_without_the_plugin_that_converts_bodies_its_distribution_is_named(world, monkeypatch):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-testing,metricbody-visual")
    with pytest.raises(PackageMissingError, match="metricbody-embedded"):
        run(world.image, backends=changed(backends.MockBodyEstimator, of_smpl))


def test_contact_on_another_mesh_is_carried_over(world, plain):
    result = run(world.image, backends=changed(backends.MockContactPrior, on_another_mesh))
    assert "contact transferred from the mesh 'shuffled' to 'physic-embedded-1'" in result.notes
    was = plain.people[0].contact
    found = result.people[0].contact
    assert 2 * (was & found).sum() >= 0.95 * (was.sum() + found.sum())


def test_hands_that_say_how_they_lie_are_put_onto_the_arms(world, plain):
    body = Rotation.from_rotvec(plain.people[0].parameters.global_orient[0])
    lowered = [body * Rotation.from_rotvec([0, 0, angle]) for angle in (-0.7, 0.7)]
    wrists = np.array([[turn.as_rotvec() for turn in lowered]])

    def with_wrists(hands, *_):
        return replace(hands, confidence=np.full_like(hands.confidence, 0.9), wrists=wrists)

    result = run(world.image, backends=changed(backends.MockHandEstimator, with_wrists))
    after, before = (one.people[0].parameters for one in (result, plain))
    turned = np.linalg.norm((after.body_pose - before.body_pose).reshape(21, 3), axis=1)
    assert turned[[19, 20]].min() > 0.2  # both wrists
    np.testing.assert_allclose(after.left_hand_pose, before.left_hand_pose, atol=0.05)
