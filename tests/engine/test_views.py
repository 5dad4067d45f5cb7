"""Other cameras show what the photo hides: their keypoints and visible joints are part of one
problem.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.term import PosedBodies
from physic_core.engine.state import OtherView
from physic_core.errors import PhysicError
from physic_core.geometry.camera import project
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_testing.worlds import BLAZEPOSE

from .adjusted import adjusted, shifted, without_joints
from .conftest import CAMERA
from .seen import seen

SETTINGS = engine_preset("default").joint
PLACE = (0.0, 0.0, 3.5)
RAISED = {"left_shoulder": (0.0, -0.6, -0.6), "left_elbow": (0.0, -0.9, 0.0)}
ARM = [JOINT_INDEX[f"left_{name}"] for name in ("elbow", "wrist")]


def view_of(stage, turn_deg):
    """A camera at the same distance and height, turned about the first person."""
    state = stage.state
    middle = torch.tensor([0.0, 0.0, PLACE[2]])
    rotation = rotvec_to_rotmat(torch.tensor([0.0, math.radians(turn_deg), 0.0]))
    translation = middle - rotation @ middle
    vertices = stage.vertices @ rotation.T + translation
    body = state.model(state.rotations, state.betas, state.transl)
    landmarks = state.model.landmarks(body, BLAZEPOSE) @ rotation.T + translation
    depths = [seen(v, state.model.faces, CAMERA)[0] for v in vertices]
    return OtherView(
        rotation=rotation,
        translation=translation,
        K=state.K,
        keypoints=project(landmarks, state.K),
        keypoint_confidence=torch.ones(landmarks.shape[:2]),
        masks=torch.stack([torch.from_numpy(depth < math.inf) for depth in depths]),
        observed=torch.ones(len(state), 55, dtype=torch.bool),
    )


def blank(view):
    """The view of a camera that shows no person."""
    shown = ("keypoint_confidence", "masks", "observed")
    return replace(view, **{name: torch.zeros_like(getattr(view, name)) for name in shown})


def hide_left_arm(state):
    """The problem of a photo that guesses the left arm down: one of three photos, whose mean the
    start is.
    """
    state = without_joints(state, "elbow", "wrist", sides=("left",))
    confidence = state.keypoint_confidence.clone()
    for j, name in enumerate(state.skeleton.names):
        if name.startswith("left_") and name.endswith(
            ("elbow", "wrist", "pinky", "index", "thumb")
        ):
            confidence[:, j] = 0.0
    rotations = state.rotations.clone()
    for name, guess in (("left_shoulder", (0.0, 0.0, -1.2)), ("left_elbow", (0.0, 0.0, 0.0))):
        mean = (2 * torch.tensor(RAISED[name]) + torch.tensor(guess)) / 3
        rotations[:, JOINT_INDEX[name]] = rotvec_to_rotmat(mean)
    return replace(state, keypoint_confidence=confidence, rotations=rotations)


@pytest.fixture(scope="module")
def raised(make_stage):
    return make_stage([(RAISED, PLACE)])


def posed(energy):
    """The bodies of the energy's state, as its terms get them."""
    state = energy.state
    estimate = energy.variables.unpack()
    body = state.model(estimate.rotations, estimate.betas, estimate.transl)
    keypoints = state.model.landmarks(body, state.skeleton)
    vertices = body.vertices[:, energy.sampling.ids]
    return PosedBodies(vertices, body.joints, keypoints, estimate, *energy.variables.deviation())


def arm_error_m(result, stage):
    return float((result.joints[0, ARM] - stage.joints[0, ARM]).norm(dim=-1).amax())


def test_a_limb_that_the_photo_hides_is_found_by_other_cameras(raised):
    state = replace(hide_left_arm(raised.state), scale_sigma=0.01)
    assert arm_error_m(optimize(state, SETTINGS), raised) > 0.03
    views = (view_of(raised, 40.0), view_of(raised, -50.0))
    longer = adjusted(SETTINGS, optimiser__tolerance=1e-6)
    assert arm_error_m(optimize(replace(state, views=views), longer), raised) < 0.01


def test_a_camera_that_shows_nobody_changes_no_bit(two):
    start = shifted(two.state, 0.0, 0.0, 0.1)
    short = adjusted(SETTINGS, optimiser__steps=20)
    alone, with_view = (
        optimize(replace(start, views=v), short) for v in ((), (blank(view_of(two, 40.0)),))
    )
    assert torch.equal(alone.vertices, with_view.vertices)
    assert alone.unapplied_scene_scale == with_view.unapplied_scene_scale


def test_an_energy_without_other_cameras_refuses_them(two):
    state = replace(two.state, views=(view_of(two, 40.0),))
    with pytest.raises(PhysicError, match=r"^only the engine preset 'default' uses other cameras"):
        optimize(state, engine_preset("prox").joint)
