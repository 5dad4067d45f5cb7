"""Linear blend skinning: conventions, symmetries, gradients, and a slow twin."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest
import torch
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core.body import JOINT_INDEX, JOINT_NAMES, PARENTS, load_body
from physic_core.errors import BodyModelError
from physic_core.geometry.rotvecs import rotvec_to_rotmat

pytestmark = pytest.mark.quick


def turned(joint, rotvec, model):
    """Rotations (1, 55, 3, 3) of the T-pose with one joint turned."""
    rotations = model.zero_pose()[0]
    rotations[0, JOINT_INDEX[joint]] = rotvec_to_rotmat(torch.tensor(rotvec, dtype=rotations.dtype))
    return rotations


def test_joint_names_are_a_tree_in_smplx_order():
    assert len(JOINT_NAMES) == len(PARENTS) == len(set(JOINT_NAMES)) == 55
    assert all(parent < joint for joint, parent in enumerate(PARENTS))
    known = {
        "pelvis": 0,
        "left_wrist": 20,
        "jaw": 22,
        "left_index1": 25,
        "left_thumb3": 39,
        "right_thumb3": 54,
    }
    assert known.items() <= JOINT_INDEX.items()


def test_zero_pose_is_a_t_pose(embedded):
    joints = dict(zip(JOINT_NAMES, embedded(*embedded.zero_pose()).joints[0], strict=True))
    assert joints["pelvis"].abs().max() < 1e-6
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = ("shoulder", "elbow", "wrist", "middle1", "middle2", "middle3")
        for near, far in pairwise(joints[f"{side}_{name}"] for name in arm):
            assert normalize(far - near, dim=0)[0] * sign > 0.97, f"{side} arm"
        leg = normalize(joints[f"{side}_ankle"] - joints[f"{side}_hip"], dim=0)
        assert leg[1] < -0.99
        toes = joints[f"{side}_foot"] - joints[f"{side}_ankle"]
        assert toes[2] > 0.05
        assert abs(float(toes[0])) < 1e-3
    assert joints["head"][1] > joints["neck"][1] > joints["spine3"][1] > 0
    assert joints["left_eye"][2] > joints["head"][2]


@pytest.mark.parametrize(
    ("joint", "rotvec", "moved", "axis", "sign"),
    [
        ("left_shoulder", (0.0, 0.0, -1.2), "left_wrist", 1, -1),  # arm down
        ("right_shoulder", (0.0, 0.0, 1.2), "right_wrist", 1, -1),
        ("left_elbow", (0.0, -1.2, 0.0), "left_wrist", 2, 1),  # forearm forwards
        ("right_elbow", (0.0, 1.2, 0.0), "right_wrist", 2, 1),
        ("left_hip", (-1.2, 0.0, 0.0), "left_knee", 2, 1),  # thigh forwards
        ("left_knee", (1.2, 0.0, 0.0), "left_ankle", 2, -1),  # heel to the seat
        ("left_ankle", (0.5, 0.0, 0.0), "left_foot", 1, -1),  # toes down
        ("spine1", (0.5, 0.0, 0.0), "head", 2, 1),  # bow
        ("left_index1", (0.0, 0.0, -1.2), "left_index3", 1, -1),  # finger curls to the palm
        ("right_index1", (0.0, 0.0, 1.2), "right_index3", 1, -1),
    ],
)
def test_rotations_mean_what_they_mean_in_smplx(
    embedded,
    joint,
    rotvec,
    moved,
    axis,
    sign,
):
    _, betas, transl = embedded.zero_pose()
    rest = embedded(*embedded.zero_pose()).joints[0, JOINT_INDEX[moved]]
    posed = embedded(turned(joint, rotvec, embedded), betas, transl).joints[0, JOINT_INDEX[moved]]
    assert sign * (posed - rest)[axis] > 0.01


def test_joints_only_gives_the_same_joints_with_the_pelvis_at_the_translation(
    embedded, random_pose
):
    alone = embedded(**random_pose, joints_only=True)
    whole = embedded(**random_pose)
    assert torch.equal(alone.joints, whole.joints)
    assert torch.equal(alone.world, whole.world)
    assert alone.vertices.shape == (3, 0, 3)
    assert torch.allclose(alone.joints[:, 0], random_pose["transl"], atol=1e-6)


@pytest.fixture(scope="module", params=["embedded", "smplx"])
def model64(request, embedded64):
    """With bind rotations, and with pose correctives."""
    if request.param == "embedded":
        return embedded64
    return load_body(request.getfixturevalue("smplx_v10")).to(dtype=torch.float64)


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_the_small_model_has_values_of_the_whole_and_slopes_of_finite_differences(model64, size):
    """At rest (size 0) too: that is where fits start."""
    torch.manual_seed(0)
    ids = torch.randint(0, model64.num_vertices, (5,))
    small = model64.landmarks_only((), ids)
    inputs = (
        size * torch.randn(2, 55, 3, dtype=torch.float64),
        size * torch.randn(2, model64.num_betas, dtype=torch.float64),
        torch.randn(2, 3, dtype=torch.float64),
    )

    def vertices_and_joints(turns, betas, transl):
        points = small(rotvec_to_rotmat(turns), betas, transl)
        return points["vertices"], points["joints"][:, ::9]

    whole = model64(rotvec_to_rotmat(inputs[0]), *inputs[1:], vertex_ids=ids)
    assert_close(vertices_and_joints(*inputs), (whole.vertices, whole.joints[:, ::9]))
    moving = [one.requires_grad_() for one in inputs]
    assert torch.autograd.gradcheck(vertices_and_joints, moving, fast_mode=True)


@pytest.mark.parametrize(
    ("name", "shape", "wanted"),
    [
        ("rotations", (1, 24, 3, 3), "(1, 55, 3, 3)"),
        ("betas", (2, 16), "(1, 16)"),
        ("expression", (1, 10), "(1, 0)"),
    ],
)
def test_inputs_of_wrong_shape_are_refused(embedded, name, shape, wanted):
    arguments = dict(zip(("rotations", "betas", "transl"), embedded.zero_pose(), strict=True))
    message = re.escape(
        f"{name} must be {wanted} for the embedded body, got {shape}: give one row per person"
    )
    with pytest.raises(BodyModelError, match=message):
        embedded(**{**arguments, name: torch.zeros(shape)})
