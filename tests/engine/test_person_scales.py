"""Scale of a relative scene by soles and torsos, and whether feet stand on the floor."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.sizes import scales_by_soles, scales_by_torsos, standing_scores
from physic_core.geometry.rays import RayCaster
from physic_core.types import Plane, Pointmap

UNIT = 3.7
"""Metres in one unit of the relative scene."""
CAMERA_HEIGHT = 1.4
K = np.array([[150.0, 0, 79.5], [0, 150.0, 99.5], [0, 0, 1]])
FLOOR = Plane(np.array([0.0, -1.0, 0.0]), CAMERA_HEIGHT / UNIT)
SEEN = np.ones((1, 55), bool)


@pytest.fixture(scope="module")
def model():
    return load_body("embedded")


def standing(model, lifted: float = 0.0) -> np.ndarray:
    """Vertices (1, V, 3) of a person 3 m away, whose soles are ``lifted`` metres over the floor."""
    rotations, betas, _ = model.zero_pose()
    rotations[:, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    still = model(rotations, betas, torch.zeros(1, 3)).vertices
    transl = torch.tensor([[0.0, CAMERA_HEIGHT - float(still[..., 1].max()) - lifted, 3.0]])
    return model(rotations, betas, transl).vertices.double().numpy()


def photo_of(
    vertices: np.ndarray, model, farther: float = 0.0, people_farther=(0.0, 0.1)
) -> tuple[Pointmap, np.ndarray]:
    """Point map and mask (1, H, W) of a person, ``farther`` in log depth than they are."""
    rows, columns = np.mgrid[0:200, 0:160]
    rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones_like(rows)], -1)
    hits = RayCaster(vertices[0], model.faces.numpy()).first(np.zeros(3), rays.reshape(-1, 3))
    mask = (hits.face >= 0).reshape(200, 160)
    depth = np.where(mask, hits.distance.reshape(200, 160) * np.exp(farther), 8.0) / UNIT
    points = (rays * depth[..., None]).astype(np.float32)
    return Pointmap(points, np.ones_like(mask), "scale", people_farther=people_farther), mask[None]


def test_soles_on_the_floor_and_the_depth_of_the_torso_give_the_scale(model):
    vertices = standing(model)
    photo, mask = photo_of(vertices, model)
    assert scales_by_soles(vertices, model, SEEN, FLOOR) == pytest.approx(np.full((1, 2), UNIT), rel=0.01)
    assert scales_by_torsos(vertices, model, mask, photo, K) == pytest.approx([UNIT], rel=0.01)


@pytest.mark.parametrize(("lifted", "expected"), [(0.0, 0.0), (0.35, np.log(0.75) / 0.1), (-0.35, np.log(1.25) / 0.1)])
def test_the_score_is_the_height_of_the_feet_over_the_floor_as_a_share_of_the_cameras(model, lifted, expected):
    vertices = standing(model, lifted)
    photo, mask = photo_of(vertices, model, farther=0.13, people_farther=(0.13, 0.1))
    soles = scales_by_soles(vertices, model, SEEN, FLOOR)
    torsos = scales_by_torsos(vertices, model, mask, photo, K)
    assert standing_scores(soles, torsos, photo) == pytest.approx([expected], abs=0.15)


def test_a_foot_that_is_not_visible_gives_no_scale(model):
    vertices, seen = standing(model), SEEN.copy()
    seen[0, JOINT_INDEX["left_foot"]] = False
    left, right = scales_by_soles(vertices, model, seen, FLOOR)[0]
    assert np.isnan(left)
    assert right == pytest.approx(UNIT, rel=0.01)


def test_a_map_that_states_no_bias_decides_nothing(model):
    vertices = standing(model)
    photo, mask = photo_of(vertices, model, people_farther=None)
    scores = standing_scores(np.ones((1, 2)), scales_by_torsos(vertices, model, mask, photo, K), photo)
    assert np.isnan(scores).all()


def test_a_torso_that_is_not_visible_and_a_body_that_is_not_finite_give_no_scale(model):
    vertices = standing(model)
    photo, mask = photo_of(vertices, model)
    assert np.isnan(scales_by_torsos(vertices, model, mask & False, photo, K)).all()
    assert np.isnan(scales_by_torsos(vertices * np.nan, model, mask, photo, K)).all()


def test_a_torso_at_infinity_in_the_point_map_gives_no_scale(model):
    vertices = standing(model)
    photo, mask = photo_of(vertices, model, farther=np.inf)
    assert np.isnan(scales_by_torsos(vertices, model, mask, photo, K)).all()
