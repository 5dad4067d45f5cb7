"""Where BlazePose draws its points on a body."""

from __future__ import annotations

import torch

from physic_core.body import JOINT_INDEX, load_body
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON


def test_points_lie_by_their_shares_beside_the_points_of_the_body() -> None:
    model = load_body("embedded")
    seed = torch.Generator().manual_seed(0)
    rotations = rotvec_to_rotmat(0.4 * torch.randn(3, 55, 3, generator=seed))
    output = model(rotations, torch.randn(3, model.num_betas, generator=seed), torch.randn(3, 3, generator=seed))
    marks = dict(zip(BLAZEPOSE_SKELETON.names, model.landmarks(output, BLAZEPOSE_SKELETON).unbind(1), strict=True))
    mesh = output.vertices
    for side, other in (("left", "right"), ("right", "left")):
        hip, over, knee, ankle = (
            output.joints[:, JOINT_INDEX[name]]
            for name in (f"{side}_hip", f"{other}_hip", f"{side}_knee", f"{side}_ankle")
        )
        heel, tip = (mesh[:, model.surface_points[f"{side}_{n}"]].mean(1) for n in ("heel", "foot_tip"))
        assert torch.allclose(marks[f"{side}_hip"], hip + 0.06 * (knee - hip) + 0.08 * (over - hip), atol=1e-5)
        assert torch.allclose(marks[f"{side}_ankle"], ankle + 0.10 * (knee - ankle), atol=1e-5)
        assert torch.allclose(marks[f"{side}_foot_tip"], tip + 0.085 * (heel - tip) + 0.26 * (ankle - tip), atol=1e-5)
        assert torch.equal(marks[f"{side}_knee"], knee)


def test_hips_count_half() -> None:
    assert BLAZEPOSE_SKELETON.weights == {"left_hip": 0.5, "right_hip": 0.5}
