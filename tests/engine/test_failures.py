"""A person whose evidence is broken loses themself at most: the others end where they would have
ended alone.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.variables import PARAMETER_GROUPS

from .adjusted import adjusted, shifted

# The scene's one scale is all that joins people who stand apart: held, each must end as alone.
DEFAULT = adjusted(
    engine_preset("default").joint,
    optimiser__steps=16,
    optimiser__refresh_steps=8,
    frozen=("scale",),
)
NAN = float("nan")
INF = float("inf")


@pytest.mark.parametrize("free", [(), ("scale",)])
def test_held_people_stay_where_they_were_placed(two, free):
    held = adjusted(DEFAULT, frozen=tuple(group for group in PARAMETER_GROUPS if group not in free))
    result = optimize(two.state, held)
    assert result.joint.failures == ("", "")
    assert torch.equal(result.transl, two.state.transl)
    assert (result.unapplied_scene_scale == 1.0) == (free == ())


@pytest.fixture(scope="module")
def start(two):
    feet = {"stand_probability": torch.full((2, 2), 0.9), "lean_sigma": torch.full((2,), 0.05)}
    return replace(shifted(two.state, 0.02, -0.05, 0.1), **feet)


@pytest.fixture(scope="module")
def alone(start):
    """Where the second person ends alone."""
    return optimize(start.select_people(torch.tensor([1])), DEFAULT)


FAULTS = [
    ("masks", False),
    ("observed", False),
    ("photo_depth", NAN),
    ("photo_depth", INF),
    ("keypoints", NAN),
    ("keypoints", INF),
    ("keypoints", -1e30),
    ("keypoint_confidence", NAN),
    ("contact_prior", NAN),
    ("betas", NAN),
    ("rotations", NAN),
    ("transl", INF),
    ("transl", -3.0),
]


@pytest.mark.parametrize(("field", "value"), FAULTS)
def test_the_other_person_ends_as_if_alone(start, alone, field, value):
    broken = getattr(start, field).clone()
    broken[start.masks[0] if field == "photo_depth" else 0] = value
    both = optimize(replace(start, **{field: broken}), DEFAULT)
    apart = 1e3 * (both.vertices[1] - alone.vertices[0]).norm(dim=-1).mean().item()
    assert both.joint.failures[1] == ""
    assert apart < 8
    assert torch.isfinite(both.vertices[1]).all()
