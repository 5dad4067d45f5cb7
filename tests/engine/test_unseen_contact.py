"""Contact of limbs that the photo does not show: with the floor if it is more likely than not."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.body.joints import joint_pair
from physic_core.engine.contact.scene_parts import ClassifiedPoints
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS
from physic_core.pipeline.contacts import measure_contacts

DEFAULT = PRESETS["default"]


@pytest.mark.parametrize(("shown", "least"), [(True, 0.35), (False, 0.5)])
def test_feet_touch_the_floor_from_a_probability_on_that_is_higher_where_no_foot_is_shown(make_stage, shown, least):
    problem = make_stage([({}, (0.0, 0.0, 3.5))]).problem
    observed = problem.observed.clone()
    observed[:, joint_pair("ankle")] = shown
    problem = replace(problem, observed=observed)
    result = optimize(problem, DEFAULT.joint)
    points = len(problem.scene_points)
    nothing = ClassifiedPoints(("unknown",), torch.zeros(points, dtype=torch.int64), torch.ones(points).bool())
    found = measure_contacts(problem, result, DEFAULT, nothing, torch.zeros(0, *problem.masks.shape[1:]).bool())
    feet = torch.tensor([name.endswith("foot") for name in problem.model.part_names])[problem.model.part_of_vertex]
    assert found.probability is not None
    likely, touches = found.probability[0, feet], found.contact[0, feet]
    torch.testing.assert_close(touches, likely >= least)
    assert touches.float().mean() > 0.2
    assert not touches.all()
