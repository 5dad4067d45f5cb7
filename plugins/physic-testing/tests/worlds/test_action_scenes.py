"""Posed scenes of the file: whose they are, and that mirroring and turning keep contacts and joint
limits.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import roma
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.terms.body import hinge_angles
from physic_testing import worlds
from physic_testing.worlds import (
    CHILD_WORLDS,
    CONTACT_WORLDS,
    OTHER_BODIES,
    RAISED_FEET_WORLDS,
    WORLDS,
)
from physic_testing.worlds.action_scenes import POOLS, ActionScene, load_action
from physic_testing.worlds.posing import pose_body
from physic_testing.worlds.solids import signed_distance

from .float64_model import float64_model

_FILE = Path(worlds.__file__).with_name("action_scenes.npz")
_ADULTS = (*WORLDS, *CONTACT_WORLDS, *RAISED_FEET_WORLDS)
_NAMES = (*_ADULTS, *(name + OTHER_BODIES for name in _ADULTS), *CHILD_WORLDS)


def _load(name: str, seed: int, pool: str = "development") -> ActionScene:
    return load_action(name, float64_model(), pool, np.random.default_rng(seed))


def _posed(scene: ActionScene) -> list[np.ndarray]:
    return [
        pose_body(scene.model, actor.pose, actor.betas, actor.transl)[0] for actor in scene.actors
    ]


def test_the_file_is_below_1_mb() -> None:
    assert _FILE.stat().st_size < 1_000_000


def test_every_world_has_scenes_in_each_pool_and_no_scene_is_in_two() -> None:
    with np.load(_FILE) as file:
        scenes = file["scenes"]
        people = file["people"]
    held = {
        (str(name), str(pool)) for name, pool in zip(scenes["name"], scenes["pool"], strict=True)
    }
    assert held == {(name, pool) for name in _NAMES for pool in POOLS}
    of_pool = [
        {row.tobytes() for row in people["pose"][scenes["pool"][people["scene"]] == pool]}
        for pool in POOLS
    ]
    assert all(not one & other for one, other in combinations(of_pool, 2))


@pytest.mark.parametrize(
    "name", ["stand", "lie", "sit_on_chair+other", "slope", "sit_high", "child_sits"]
)
@pytest.mark.parametrize("seed", range(3))
def test_people_touch_the_scene_and_enter_nothing(name: str, seed: int) -> None:
    scene = _load(name, seed)
    outer = scene.model.outer.numpy()
    for actor, vertices in zip(scene.actors, _posed(scene), strict=True):
        distance = signed_distance(vertices[outer], scene.blocks, scene.ground)
        assert distance.min() > -0.009
        assert (distance <= 0.02).sum() > 150
        hinges = hinge_angles(roma.rotvec_to_rotmat(torch.as_tensor(actor.pose)[None]))
        assert hinges.min() > -0.12
        assert hinges.max() < 2.8


def test_a_seed_mirrors_and_turns_a_scene() -> None:
    scenes = [_load("lean_on_wall", seed) for seed in range(24)]
    left = JOINT_INDEX["left_elbow"]
    right = JOINT_INDEX["right_elbow"]
    found = set()
    for one, other in combinations(scenes, 2):
        if np.array_equal(one.actors[0].betas, other.actors[0].betas):
            a = one.actors[0].pose
            b = other.actors[0].pose
            same = np.allclose(a[left], b[left])
            mirrored = np.allclose(a[left], b[right] * (1, -1, -1))
            assert same != mirrored
            found.add(mirrored)
            a, b = (np.sort(_posed(scene)[0][:, 1]) for scene in (one, other))
            assert np.abs(a - b).max() < 0.001  # the mesh is symmetric to a tenth of this
    assert found == {True, False}
    assert np.ptp([scene.azimuth[0] for scene in scenes]) > 180
    assert all(scene.azimuth[1] - scene.azimuth[0] == pytest.approx(140) for scene in scenes)


def test_the_same_numbers_give_the_same_scene() -> None:
    one = _load("hug", 3)
    other = _load("hug", 3)
    assert one.blocks == other.blocks
    assert all(
        np.array_equal(a.pose, b.pose) for a, b in zip(one.actors, other.actors, strict=True)
    )
