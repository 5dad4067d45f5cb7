"""Posing in a fixed order against the body model, and its gradient against autograd."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import roma
import torch

from physic_core.body import load_body
from physic_core.body.model import BodyModel
from physic_core.body.skinning import Skin
from physic_testing.worlds.reproducible_math import rotation_matrix
from physic_testing.worlds.skinning import Skinner


@cache
def _model() -> BodyModel:
    return load_body("embedded").to(dtype=torch.float64)


def _draw() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    return rng.normal(0, 0.4, (55, 3)), rng.normal(size=_model().num_betas), rng.normal(size=3)


def test_the_skinner_gives_the_vertices_and_joints_of_the_body_model() -> None:
    pose, betas, transl = _draw()
    wanted = _model()(
        roma.rotvec_to_rotmat(torch.tensor(pose)[None]), torch.tensor(betas)[None], torch.tensor(transl)[None]
    )
    ids = np.arange(0, _model().num_vertices, 7)
    for chosen in (None, ids):
        vertices, joints = Skinner(_model(), betas, chosen)(rotation_matrix(pose), transl)
        np.testing.assert_allclose(vertices, wanted.vertices[0].numpy()[:: 7 if chosen is ids else 1], atol=1e-13)
        np.testing.assert_allclose(joints, wanted.joints[0].numpy(), atol=1e-13)


def test_the_gradient_is_that_of_autograd() -> None:
    pose, betas, transl = _draw()
    rng, ids = np.random.default_rng(5), np.arange(0, _model().num_vertices, 31)
    by_vertices, by_joints = rng.normal(size=(len(ids), 3)), rng.normal(size=(55, 3))
    by_vertices[::2] = 0
    rotations = torch.tensor(rotation_matrix(pose)).requires_grad_()
    place = torch.tensor(transl).requires_grad_()
    output = _model()(rotations[None], torch.tensor(betas)[None], place[None])
    energy = (output.vertices[0, ids] * torch.tensor(by_vertices)).sum()
    wanted = torch.autograd.grad(energy + (output.joints[0] * torch.tensor(by_joints)).sum(), (rotations, place))
    poser = Skinner(_model(), betas, ids)
    poser(rotation_matrix(pose), transl)
    for found, right in zip(poser.gradient(by_vertices, by_joints), wanted, strict=True):
        np.testing.assert_allclose(found, right.numpy(), atol=1e-10)


def test_a_body_with_pose_correctives_is_refused() -> None:
    from dataclasses import replace

    skin = _model().skin
    more = Skin(skin.template, torch.cat([skin.directions, skin.directions[:1]]), skin.weights)
    with pytest.raises(ValueError, match=r"without pose correctives: the embedded body has some\.$"):
        Skinner(replace(_model(), skin=more), np.zeros(_model().num_betas))
