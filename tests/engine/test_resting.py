"""Raised feet and knees that rest on a surface under them, judged together with the pose."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.resting import find_raised_limbs
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.resting import RestingLimbs, RestingTerm, resting_energy
from physic_core.engine.presets import PRESETS
from physic_core.geometry.robust import robust_loss

DEFAULT = PRESETS["default"].joint
ON_ONE_LEG = {"left_hip": (-1.0, 0, 0), "left_knee": (1.0, 0, 0)}
STEPPING = {"pelvis": (-0.2, 0, 0), "left_hip": (-0.8, 0, 0), "left_knee": (1.0, 0, 0)}
KNEELING = {"left_knee": (1.6, 0, 0), "right_knee": (1.6, 0, 0)}
LEFT_LEG = ("left_knee", "left_ankle", "left_foot", "left_heel", "left_toe")
PLACE = (0.0, 0.0, 3.0)


def without_left_leg(problem):
    """The problem without keypoints of the left leg below the hip."""
    confidence = problem.keypoint_confidence.clone()
    for j, name in enumerate(problem.skeleton.names):
        if name.startswith(LEFT_LEG):
            confidence[:, j] = 0.0
    return replace(problem, keypoint_confidence=confidence, human_depth=None)


def raised(problem):
    """Limbs of the problem's start that are in the air: left foot, right foot, left knee, right knee."""
    return find_raised_limbs(JointEnergy(problem, DEFAULT.without("depth")))


def left_sole(problem, result):
    sole = problem.model.contact_sets["left_sole"]
    offset = torch.tensor(problem.floor_offset * result.scene_scale)
    return float(plane_height(result.vertices[0, sole], problem.floor_normal, offset).amin())


@pytest.fixture(scope="module")
def stepping(make_stage):
    """A person who leans back on the heel of the right foot, with the left one in the air."""
    return make_stage([(STEPPING, PLACE)]).problem


def test_energy_is_quadratic_near_the_surface_and_grows_far_from_it():
    gap, resting = torch.tensor([[0.0, 0.03], [0.3, 0.3]]).double(), torch.tensor([[True, True], [True, False]])
    one, far = (4.0 * robust_loss("cauchy", torch.tensor([g]).double(), 2.0).item() for g in (1.0, 100.0))
    assert resting_energy(gap, resting).tolist() == pytest.approx([one, far])


def test_gradient_of_the_energy_is_exact():
    gap = torch.tensor([[-0.2, 0.01], [0.04, 0.3]], dtype=torch.float64, requires_grad=True)
    resting = torch.tensor([[True, False], [True, True]])
    assert torch.autograd.gradcheck(lambda g: resting_energy(g, resting), gap)


def test_the_term_measures_heights_in_the_unit_of_the_scene(stepping):
    energy = JointEnergy(stepping, DEFAULT)
    limbs = raised(stepping)
    (value,) = RestingTerm(energy.context, limbs)(energy._posed_bodies()).values()
    expected = resting_energy(limbs.gaps(energy.contacts.height), limbs.resting)
    assert value.tolist() == pytest.approx(expected.tolist(), rel=1e-4)
    assert value.item() > 0


def test_a_raised_foot_that_is_expected_to_touch_is_found(stepping):
    limbs = raised(stepping)
    assert limbs.resting.tolist() == [[True, False, False, False]]
    assert limbs.target.tolist() == [[0.0, 0.0, 0.0, 0.0]]


def test_nothing_is_found_without_floor_sight_or_expected_contact_or_with_lifted_feet(stepping):
    unseen = stepping.observed.clone()
    unseen[:, [JOINT_INDEX["left_ankle"], JOINT_INDEX["left_foot"]]] = False
    for changed in (
        replace(stepping, floor_normal=None),
        replace(stepping, observed=unseen),
        replace(stepping, contact_probability=torch.zeros_like(stepping.contact_probability)),
        replace(stepping, lifted_feet=torch.tensor([[True, False]])),
    ):
        assert not raised(changed).resting.any()


def test_a_foot_over_a_step_rests_on_the_step(make_stage, stepping):
    stage = make_stage([(STEPPING, PLACE)])
    lowest = stage.vertices[0, stepping.model.contact_sets["left_sole"]]
    x, y, z = lowest[lowest[:, 1].argmax()].tolist()
    low, high = (x - 0.1, y + 0.05, z - 0.3), (x + 0.3, 1.3, z + 0.3)
    points = torch.cartesian_prod(*(torch.linspace(low[k], high[k], 15) for k in (0, 2)))
    top = torch.stack([points[:, 0], torch.full_like(points[:, 0], low[1]), points[:, 1]], 1)
    problem = replace(
        stage.problem,
        scene_points=torch.cat([stage.problem.scene_points, top]),
        scene_normals=torch.cat([stage.problem.scene_normals, torch.tensor([[0.0, -1.0, 0.0]]).expand(len(top), 3)]),
    )
    limbs = raised(problem)
    assert bool(limbs.resting[0, 0])
    assert float(limbs.target[0, 0]) == pytest.approx(1.3 - low[1], abs=0.005)
    inside = replace(problem, scene_points=problem.scene_points - torch.tensor([0.0, 0.14, 0.0]))
    assert not raised(inside).resting[0, 0]


def test_a_foot_that_nothing_holds_in_the_air_rests(stepping):
    problem, settings = without_left_leg(stepping), DEFAULT.without("depth")
    result = optimize(problem, settings)
    assert left_sole(stepping, result) < 0.03


def test_who_stands_on_one_leg_keeps_the_other_in_the_air(make_stage):
    problem = make_stage([(ON_ONE_LEG, PLACE)]).problem
    assert not raised(problem).resting.any()
    assert left_sole(problem, optimize(problem, DEFAULT)) > 0.1


def test_knees_of_who_kneels_are_found_over_the_floor(make_stage):
    problem = make_stage([(KNEELING, PLACE)]).problem
    assert raised(problem).resting.tolist() == [[False, False, True, True]]
    lifted = replace(problem, lifted_feet=torch.tensor([[True, False]]))
    assert raised(lifted).resting.tolist() == [[False, False, False, True]]
    sitting = {"left_hip": (-1.5, 0, 0), "right_hip": (-1.5, 0, 0), **KNEELING}
    assert not raised(make_stage([(sitting, PLACE)]).problem).resting[:, 2:].any()


def test_a_limb_without_vertices_never_rests():
    limbs = RestingLimbs((), torch.zeros(2, 0), torch.zeros(2, 0, dtype=torch.bool))
    assert resting_energy(limbs.target, limbs.resting).tolist() == [0.0, 0.0]
