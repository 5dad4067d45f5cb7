"""The hand-written derivative of posing equals autograd's, with bind rotations and with pose
correctives.
"""

from __future__ import annotations

import pytest
import torch

from physic_core.body.posing import JointTree, Kinematics, Skin, pose_vertices
from physic_core.geometry.rotvecs import rotvec_to_rotmat

pytestmark = pytest.mark.quick

J = 8
V = 6
D = 3
PARENTS = (-1, 0, 0, 1, 2, 3, 3, 6)


def small_body(*, bind, correctives):
    g = torch.Generator().manual_seed(3)

    def normal(*shape):
        return torch.randn(*shape, generator=g, dtype=torch.float64)

    bind_rot = rotvec_to_rotmat(normal(J, 3)) if bind else None
    kinematics = Kinematics.build(normal(J, 3), normal(D, J, 3), bind_rot, PARENTS)
    rows = D + 9 * (J - 1) if correctives else D
    weights = torch.softmax(normal(J, V), 0)
    # three joints a vertex
    weights = torch.where(weights >= weights.topk(3, dim=0).values[-1], weights, 0.0)
    return kinematics, Skin(normal(3, V), 0.1 * normal(rows, 3, V), weights / weights.sum(0))


def pose(batch=2):
    g = torch.Generator().manual_seed(4)
    turns = torch.randn(batch, J, 3, generator=g, dtype=torch.float64)
    shape = torch.randn(batch, D, generator=g, dtype=torch.float64)
    return turns, shape, torch.randn(batch, 3, generator=g, dtype=torch.float64)


def by_autograd(
    kinematics,
    skin,
    rotations,
    betas,
    transl,
):
    """Vertices and joints by the functions of which a body model consists."""
    world, skinning = kinematics.transforms(rotations, kinematics.rest_joints(betas))
    correctives = (rotations[:, 1:] - torch.eye(3, dtype=rotations.dtype)).flatten(1)
    coefficients = torch.cat([betas, correctives], 1)[:, : len(skin.directions)]
    return skin.pose(coefficients, skinning) + transl[:, None], world[..., 3] + transl[:, None]


@pytest.mark.parametrize("bind", [False, True])
@pytest.mark.parametrize("correctives", [False, True])
@pytest.mark.parametrize("blocks", [False, True])
def test_value_and_slope_are_those_of_the_whole_model(bind, correctives, blocks):
    kinematics, skin = small_body(bind=bind, correctives=correctives)
    turns, shape, transl = pose()
    inputs = [
        rotvec_to_rotmat(turns).requires_grad_(),
        shape.requires_grad_(),
        transl.requires_grad_(),
    ]
    vertices, joints = pose_vertices(
        JointTree(kinematics), skin.in_blocks() if blocks else skin, *inputs
    )
    plain_vertices, plain_joints = by_autograd(kinematics, skin, *inputs)
    torch.testing.assert_close(vertices, plain_vertices)
    torch.testing.assert_close(joints, plain_joints)
    weights = (
        torch.randn(vertices.shape, dtype=torch.float64),
        torch.randn(joints.shape, dtype=torch.float64),
    )

    def slopes(v, j):
        return torch.autograd.grad((v * weights[0]).sum() + (j * weights[1]).sum(), inputs)

    for got, want in zip(
        slopes(vertices, joints), slopes(plain_vertices, plain_joints), strict=True
    ):
        torch.testing.assert_close(got, want)
