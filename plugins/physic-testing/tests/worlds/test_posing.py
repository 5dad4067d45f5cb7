"""Posing in a fixed order against the body model."""

from __future__ import annotations

import numpy as np
import roma
import torch

from physic_testing.worlds.posing import pose_body

from .float64_model import float64_model


def test_vertices_and_joints_are_those_of_the_body_model() -> None:
    model = float64_model()
    rng = np.random.default_rng(4)
    pose = rng.normal(0, 0.4, (55, 3))
    betas = rng.normal(size=model.num_betas)
    transl = rng.normal(size=3)
    wanted = model(
        roma.rotvec_to_rotmat(torch.tensor(pose)[None]),
        torch.tensor(betas)[None],
        torch.tensor(transl)[None],
    )
    vertices, joints = pose_body(model, pose, betas, transl)
    np.testing.assert_allclose(vertices, wanted.vertices[0].numpy(), atol=1e-13)
    np.testing.assert_allclose(joints, wanted.joints[0].numpy(), atol=1e-13)
