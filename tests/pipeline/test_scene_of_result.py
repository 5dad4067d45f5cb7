"""The inpainted scene of a result lies inside no body."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.geometry.visibility import move_out_of_bodies
from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

pytestmark = [pytest.mark.kernels, pytest.mark.usefixtures("few_steps")]

SIZE = (160, 120)


def test_inpainted_scene_lies_in_no_body_and_visible_scene_stays():
    world = load_world("sit_on_sofa", SIZE)
    plain = run(world.image, "engine.scene.carve_m=0")
    result = run(world.image)
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    body = load_body("embedded")
    bodies = torch.from_numpy(np.stack([p.vertices for p in result.people]))

    def inside(scene_of):
        valid = scene_of.scene.valid
        flags = np.zeros(valid.shape, bool)
        points = torch.from_numpy(scene_of.scene.points[valid])
        masks = torch.from_numpy(np.stack([p.mask[valid] for p in result.people]))
        flags[valid] = move_out_of_bodies(points, bodies, body.faces, masks, 0.4)[1].numpy()
        return flags

    moved = (result.scene.points != plain.scene.points).any(-1)
    assert inside(plain).sum() > 100
    assert not (inside(result) & moved).any()
    assert inside(result).sum() < 0.2 * inside(plain).sum()
    people = np.logical_or.reduce([p.mask for p in result.people])
    assert moved.sum() < 1.3 * people.sum()
    assert (moved & ~people).sum() < 0.1 * people.sum() + 200
    farther = np.linalg.norm(result.scene.points, axis=-1) - np.linalg.norm(
        plain.scene.points, axis=-1
    )
    assert farther[moved].min() > 0
