"""The evaluator: the truth is perfect, a known fault is measured and nothing else, and nobody is
dropped in silence.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_bench.worlds.evaluation import Evaluator, WorldEstimate
from physic_core.body import load_body
from physic_core.errors import PhysicError
from physic_core.types import Scene
from physic_testing.worlds import load_world

pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def skin():
    return Evaluator.body_graph(load_body("embedded"))


@pytest.fixture(scope="module")
def world():
    return load_world("hug")


def truth_of(world):
    points = world.points(people=False)
    valid = np.isfinite(points).all(-1)
    scene = Scene(
        points,
        world.empty_normals,
        world.empty_image,
        valid,
        world.floor,
        np.zeros((0, 3), np.float32),
    )
    return WorldEstimate(
        world.vertices,
        world.joints,
        world.contact,
        scene,
        world.intrinsics,
        ("",) * len(world.masks),
    )


@pytest.fixture
def truth(world):
    return truth_of(world)


def test_the_truth_is_perfect(world, truth, skin):
    evaluator = Evaluator(world, world.masks, skin)
    people = evaluator.person_records(truth)
    assert len(people) == len(world.masks) == 2
    for person, facts in zip(people, evaluator.truth_records(), strict=True):
        assert (person["found"], person["why"]) == (True, "")
        assert person["mpjpe_mm"] == person["mpvpe_mm"] == person["depth_error_mm"] == 0
        assert person["pa_mpjpe_mm"] < 1e-6
        assert (person["false_alarms"], person["misses"]) == (0, 0)
        assert person["geodesic_fp_cm"] == person["geodesic_fn_cm"] == 0
        assert person["penetration_max_mm"] < 25
        assert person["floating_mm"] < 20
        assert person["true_penetration_mm"] < 11
        assert person["true_floating_mm"] < 20
        for name in ("penetration_mm", "floating_mm", "true_penetration_mm", "true_floating_mm"):
            assert person[name] == pytest.approx(facts["measured"][name], abs=1e-3)
    scene = evaluator.scene_record(truth)
    assert scene["scene_point_mm"] == scene["scene_scale_percent"] == scene["floor_height_mm"] == 0


def test_a_known_fault_is_measured(world, truth, skin):
    up = np.asarray(world.floor.normal, np.float32)
    moved = replace(truth, vertices=world.vertices + 0.1 * up, joints=world.joints + 0.1 * up)
    evaluator = Evaluator(world, world.masks, skin)
    for person, before in zip(
        evaluator.person_records(moved), evaluator.person_records(truth), strict=True
    ):
        assert person["mpjpe_mm"] == pytest.approx(100, rel=1e-4)
        assert person["mpvpe_mm"] == pytest.approx(100, rel=1e-4)
        assert person["pa_mpjpe_mm"] < 1e-3
        assert person["misses"] == 0
        assert before["floating_mm"] < person["floating_mm"] <= 150
    larger = replace(truth, scene=replace(truth.scene, points=1.1 * truth.scene.points))
    assert evaluator.scene_record(larger)["scene_scale_percent"] == pytest.approx(10, rel=1e-3)
    assert evaluator.scene_record(larger)["scene_depth_percent"] == pytest.approx(10, rel=1e-3)
    assert (
        evaluator.scene_record(replace(truth, scene=replace(truth.scene, floor=None)))[
            "floor_found"
        ]
        is False
    )


def test_a_body_sunk_into_the_floor_penetrates_by_as_much(skin):
    world = load_world("stand")
    sunk = (-0.03 * np.asarray(world.floor.normal)).astype(np.float32)
    estimate = replace(truth_of(world), vertices=world.vertices + sunk, joints=world.joints + sunk)
    (person,) = Evaluator(world, world.masks, skin).person_records(estimate)
    assert person["penetration_max_mm"] == pytest.approx(30, abs=1.5)
    assert 5 < person["penetration_mm"] < 30
    assert person["floating_mm"] < 3
    assert 5 < person["true_penetration_mm"] < 35
    assert person["true_floating_mm"] < 3


def test_the_true_scene_is_compared_after_the_scale_of_the_reconstructed_one(world, truth, skin):
    evaluator = Evaluator(world, world.masks, skin)
    scene = replace(truth.scene, points=1.1 * truth.scene.points, floor=None)
    larger = replace(truth, scene=scene, vertices=1.1 * truth.vertices, joints=1.1 * truth.joints)
    for person, facts in zip(
        evaluator.person_records(larger), evaluator.truth_records(), strict=True
    ):
        for name in ("true_penetration_mm", "true_floating_mm"):
            assert person[name] == pytest.approx(facts["measured"][name], abs=0.1)


def test_people_are_matched_to_the_truth_in_any_order(world, truth, skin):
    order = [1, 0]
    turned = WorldEstimate(
        truth.vertices[order],
        truth.joints[order],
        truth.contact[order],
        truth.scene,
        truth.intrinsics,
        ("no step", ""),
    )
    people = Evaluator(world, world.masks[order], skin).person_records(turned)
    assert [person["mpjpe_mm"] for person in people] == [0, 0]
    assert [person["why"] for person in people] == ["", "no step"]


def test_a_person_who_is_not_found_scores_zero(world, truth, skin):
    evaluator = Evaluator(world, world.masks[:1], skin)
    only = WorldEstimate(
        truth.vertices[:1],
        truth.joints[:1],
        truth.contact[:1],
        truth.scene,
        truth.intrinsics,
        ("",),
    )
    first, second = evaluator.person_records(only)
    assert first["found"]
    assert (second["found"], second["why"]) == (False, "no person was found there")
    assert (second["hits"], second["false_alarms"]) == (0, 0)
    assert second["misses"] == world.contact[1].sum()
    assert "people_misses" not in second
    broken = replace(
        truth, vertices=truth.vertices * np.array([1, np.nan], np.float32)[:, None, None]
    )
    reasons = [p["why"] for p in Evaluator(world, world.masks, skin).person_records(broken)]
    assert reasons == ["", "the body is not finite"]
    assert [p["why"] for p in evaluator.missed_records("OutOfMemory")] == ["OutOfMemory"] * 2
    nobody = np.zeros_like(world.masks[:1])
    nobody[0, :3, :3] = True
    assert len(Evaluator(world, nobody, skin).matching.false_alarms) == 1


def test_bodies_of_another_mesh_are_refused(world, truth, skin):
    with pytest.raises(PhysicError, match="have 5 vertices"):
        Evaluator(world, world.masks, skin).person_records(
            replace(truth, vertices=truth.vertices[:, :5])
        )
