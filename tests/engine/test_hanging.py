"""People who hang from their hands: feet in the air if the photo objects to feet on the floor."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS

DEFAULT = PRESETS["default"].joint
OF_KNOWN_SCALE = replace(DEFAULT, frozen=("scale", "offset"))
RAISED = {"left_shoulder": (0, 0, 1.3), "right_shoulder": (0, 0, -1.3)}
FLOOR_Y = 1.4
HEIGHT_M = 0.35


def with_feet_on_floor(stage):
    """The problem with the first person farther away on the same rays, where the feet are on the floor."""
    problem = stage.problem
    away = problem.floor_offset / float(stage.vertices[0, :, 1].max()) - 1
    transl = problem.transl0.clone()
    transl[0] += away * stage.joints[0, 0]
    return replace(problem, transl0=transl)


def sole_heights(problem, result):
    model = problem.model
    soles = torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]])
    offset = torch.tensor(problem.floor_offset * result.scene_scale)
    return plane_height(result.vertices[:, soles], problem.floor_normal, offset).amin(1)


def feet_alone(problem):
    """The problem with a contact prior that expects soles on something, and nothing else."""
    prior = torch.zeros_like(problem.contact_probability)
    for side in ("left", "right"):
        prior[:, problem.model.contact_sets[f"{side}_sole"]] = 0.9
    return replace(problem, contact_probability=prior)


@pytest.fixture(scope="module")
def hangs(make_stage):
    stage = make_stage([(RAISED, (0.0, 0.0, 3.0))], stands_at=FLOOR_Y - HEIGHT_M)
    problem = feet_alone(with_feet_on_floor(stage))
    return problem, optimize(problem, OF_KNOWN_SCALE)


def test_feet_of_who_hangs_stay_in_the_air(hangs):
    problem, result = hangs
    assert result.hanging.tolist() == [True]
    assert float(sole_heights(problem, result)[0]) > HEIGHT_M / 2


def test_who_stands_with_raised_arms_does_not_hang(make_stage):
    stage = make_stage([(RAISED, (0.0, 0.0, 3.0))])
    result = optimize(feet_alone(stage.problem), OF_KNOWN_SCALE)
    assert result.hanging.tolist() == [False]
    assert abs(float(sole_heights(stage.problem, result)[0])) < 0.03


def test_nobody_is_tried_with_known_feet_without_a_floor_or_with_unseen_hands(hangs, monkeypatch):
    from physic_core.engine.joint import hanging

    problem, _ = hangs
    unseen = torch.zeros_like(problem.observed)
    for changed in (
        replace(problem, lifted_feet=torch.zeros(1, 2, dtype=torch.bool)),
        replace(problem, floor_normal=None),
        replace(problem, observed=unseen),
    ):
        assert not hanging._candidates(JointEnergy(changed, DEFAULT)).any()
    assert hanging._candidates(JointEnergy(problem, DEFAULT)).all()


def test_published_presets_do_not_try_it():
    assert [name for name, preset in PRESETS.items() if preset.joint.judges_supports] == ["default"]


def test_lifted_feet_are_added_to_known_ones(hangs):
    problem = replace(hangs[0], lifted_feet=torch.tensor([[True, False]]), grounded=torch.tensor([True]))
    same = problem.lift_feet(torch.tensor([False]))
    assert (same.lifted_feet.tolist(), same.grounded.tolist()) == ([[True, False]], [True])
    lifted = problem.lift_feet(torch.tensor([True]))
    assert (lifted.lifted_feet.tolist(), lifted.grounded.tolist()) == ([[True, True]], [False])
