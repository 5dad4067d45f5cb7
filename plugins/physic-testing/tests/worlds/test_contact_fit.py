"""Settling: known placements are found again, depths are measured exactly, nothing is drawn at random."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh

from physic_testing.worlds.contact_fit import (
    ContactFit,
    ContactTarget,
    OtherPerson,
    PosePlan,
    fit_contacts,
    largest_penetration,
    pose_body,
)
from physic_testing.worlds.skin_patches import contact_skin, vertex_normals
from physic_testing.worlds.solids import LEVEL_GROUND, Block, Ground, signed_distance
from physic_testing.worlds.solo_actions import draw_person, stand

from .float64_model import float64_model

if TYPE_CHECKING:
    from physic_core.types import FloatArray

pytestmark = pytest.mark.kernels


@lru_cache(maxsize=1)
def _standing() -> tuple[PosePlan, ContactFit]:
    rng = np.random.default_rng(4)
    plan = stand(draw_person(float64_model(), rng), rng)
    return plan, fit_contacts(float64_model(), plan)


def _vertices(plan: PosePlan, settled: ContactFit) -> FloatArray:
    return pose_body(float64_model(), settled.pose, plan.betas, settled.transl)[0]


def test_a_standing_person_is_on_both_soles_and_in_nothing() -> None:
    plan, settled = _standing()
    vertices = _vertices(plan, settled)
    height = vertices[contact_skin(float64_model()).outer, 1]
    assert settled.depth == pytest.approx(max(0.0, -height.min()), abs=1e-12)
    assert settled.depth < 0.003
    assert settled.gap < 0.005
    for side in ("left", "right"):
        sole = vertices[float64_model().contact_sets[f"{side}_sole"].numpy(), 1]
        assert np.mean(np.abs(sole) < 0.02) > 0.9
    assert settled.residual == max(settled.depth, settled.gap)


def test_a_converged_person_who_is_lifted_converges_again() -> None:
    plan, settled = _standing()
    _, joints = pose_body(float64_model(), settled.pose, plan.betas, settled.transl)
    x, y, z = (float(c) for c in joints[0])
    again = fit_contacts(float64_model(), replace(plan, pose=settled.pose, pelvis=(x, y + 0.06, z)))
    off = np.abs(_vertices(plan, again) - _vertices(plan, settled)).mean(0)
    print(f"off by {1000 * off[1]:.2f} mm in height, {1000 * max(off[0], off[2]):.2f} mm along the floor")
    assert off[1] < 0.006
    assert max(off[0], off[2]) < 0.012  # nothing but the plan says where on a floor somebody stands


def test_settling_uses_no_random_numbers() -> None:
    plan, settled = _standing()
    again = fit_contacts(float64_model(), plan)
    assert np.array_equal(again.pose, settled.pose)
    assert np.array_equal(again.transl, settled.transl)


def test_soles_find_a_slope_and_a_block() -> None:
    plan, _ = _standing()
    ground = Ground((0.0, float(np.cos(0.12)), float(np.sin(0.12))))
    step = Block((0.15, 0.05, 0.05), (0.14, 0.05, 0.25))
    lifted = (plan.pelvis[0], plan.pelvis[1] + 0.11, plan.pelvis[2])
    touches = (ContactTarget("left_sole", 0.5, blocks=(0,)), ContactTarget("right_sole", 0.5, blocks=()))
    settled = fit_contacts(
        float64_model(), replace(plan, blocks=(step,), touches=touches, pelvis=lifted), ground=ground
    )
    vertices = _vertices(plan, settled)
    skin = contact_skin(float64_model())
    assert -signed_distance(vertices[skin.outer], (step,), ground).min() == pytest.approx(settled.depth, abs=1e-12)
    assert settled.residual < 0.006
    assert np.median(vertices[skin.patches["left_sole"], 1]) == pytest.approx(0.1, abs=0.01)


def test_a_neighbour_is_not_entered() -> None:
    plan, settled = _standing()
    other = _vertices(plan, settled)
    skin = contact_skin(float64_model())
    aside = replace(plan, pelvis=(plan.pelvis[0] + 0.48, plan.pelvis[1], plan.pelvis[2]), drift=0.15)
    _, joints = pose_body(float64_model(), aside.pose, aside.betas, np.zeros(3))
    before = pose_body(float64_model(), aside.pose, aside.betas, np.array(aside.pelvis) - joints[0])[0]
    assert largest_penetration(before[skin.outer], other, skin.faces) > 0.005
    apart = fit_contacts(float64_model(), aside, neighbours=(OtherPerson(other),))
    inside = largest_penetration(_vertices(aside, apart)[skin.outer], other, skin.faces)
    assert inside < 0.004
    assert apart.depth == pytest.approx(max(inside, apart.depth))


def test_depth_inside_a_sphere_is_known() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    points = np.array([[0.0, 0.28, 0.0], [0.2, 0.2, 0.2], [0.0, 0.0, 0.31]])
    assert largest_penetration(points, sphere.vertices, sphere.faces) == pytest.approx(0.02, abs=1e-3)
    assert largest_penetration(points[1:], sphere.vertices, sphere.faces) == 0.0


def test_patches_lie_on_the_outer_skin_and_face_their_way() -> None:
    skin = contact_skin(float64_model())
    normals = vertex_normals(skin.rest, skin.faces)
    outer = set(skin.outer.tolist())
    for name, ids in skin.patches.items():
        assert len(ids) >= 8, name
        assert set(ids.tolist()) <= outer, name
    assert normals[skin.patches["left_shin"], 2].min() > 0.5
    assert normals[skin.patches["back"], 2].max() < -0.3
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert (
        signed_distance(skin.rest[skin.patches["left_sole"]] - [0, skin.rest[:, 1].min(), 0], (), LEVEL_GROUND).max()
        < 0.03
    )
