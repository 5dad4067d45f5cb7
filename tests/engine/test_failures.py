"""A person whose evidence is broken loses themself at most: the others end where they would have ended alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.state import PARAMETER_GROUPS

from .adjusted import adjusted

# The scene's one scale is all that joins people who stand apart: held, each must end as alone.
DEFAULT = adjusted(engine_preset("default").joint, optimiser__steps=30, optimiser__refresh_steps=15, frozen=("scale",))
NAN, INF = float("nan"), float("inf")


@pytest.fixture(scope="module")
def two(make_stage):
    return make_stage([({}, (-0.7, 0.0, 3.5)), ({}, (0.7, 0.0, 4.0))])


@pytest.mark.parametrize("free", [(), ("scale",)])
def test_held_people_stay_where_they_were_placed(two, free):
    held = adjusted(DEFAULT, frozen=tuple(group for group in PARAMETER_GROUPS if group not in free))
    result = optimize(two.problem, held)
    assert result.failures == ("", "")
    assert torch.equal(result.transl, two.problem.transl0)
    assert (result.scene_scale == 1.0) == (free == ())


@pytest.fixture(scope="module")
def start(two):
    return replace(two.problem, transl0=two.problem.transl0 + torch.tensor([0.02, -0.05, 0.1]))


@pytest.fixture(scope="module")
def alone(start):
    """Where the second person ends alone."""
    return optimize(start.select_people(torch.tensor([1])), DEFAULT)


def broken(problem, what):
    """The problem with something wrong with its first person."""
    changed = {}
    if what == "empty mask":
        changed["masks"] = problem.masks.clone()
        changed["masks"][0] = False
    elif what == "depth unknown":
        changed["human_depth"] = torch.where(problem.masks[0], NAN, problem.human_depth)
    elif what == "depth infinite":
        changed["human_depth"] = torch.where(problem.masks[0], INF, problem.human_depth)
    elif what == "nobody observed":
        changed["observed"] = problem.observed.clone()
        changed["observed"][0] = False
    else:
        field, value = what.split(" = ")
        changed[field] = getattr(problem, field).clone()
        changed[field][0] = float(value)
    return replace(problem, **changed)


FAULTS = [
    "empty mask",
    "depth unknown",
    "depth infinite",
    "nobody observed",
    "keypoints = nan",
    "keypoints = inf",
    "keypoints = -1e30",
    "keypoint_confidence = nan",
    "contact_probability = nan",
    "betas0 = nan",
    "betas0 = 1e30",
    "rotations0 = nan",
    "transl0 = inf",
    "transl0 = -3.0",
]


@pytest.mark.parametrize("what", FAULTS)
def test_the_other_person_ends_as_if_alone(start, alone, what):
    both = optimize(broken(start, what), DEFAULT)
    apart = 1e3 * (both.vertices[1] - alone.vertices[0]).norm(dim=-1).mean().item()
    assert both.failures[1] == ""
    assert apart < 8
    assert torch.isfinite(both.vertices[1]).all()
    assert both.reprojection_share[1].isfinite()
