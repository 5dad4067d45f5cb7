"""A leg that no photo shows does not pass through the floor."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.body import JOINT_INDEX
from physic_core.engine.joint.hidden_legs import fold_hidden_legs

from .adjusted import heights, with_result, with_scene

LEGS = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
FOLDED = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("hip", "knee")]


def standing(make_stage, above_floor, observed):
    """A person whose soles are at a height over the floor, metres."""
    stage = make_stage([({}, (0.0, 0.0, 4.0))])
    state = replace(with_result(stage.state, stage), observed=observed)
    return with_scene(state, floor_offset=state.scene.floor.offset + above_floor)


@pytest.mark.parametrize("under", [0.1, 0.24, 0.57])
def test_hidden_legs_fold_until_the_feet_are_hardly_under_the_floor(make_stage, under):
    observed = torch.ones(1, 55, dtype=torch.bool)
    observed[:, LEGS] = False
    state = standing(make_stage, -under, observed)
    assert float(heights(state).min()) == pytest.approx(-under, abs=0.002)
    found = fold_hidden_legs(state)
    assert float(heights(found).min()) == pytest.approx(-0.05, abs=0.01)
    kept = [j for j in range(22) if j not in {*LEGS, *FOLDED}]
    assert torch.equal(found.rotations[:, kept], state.rotations[:, kept])
    knee, ankle, hip = (
        found.joints[0, JOINT_INDEX[f"left_{name}"]] for name in ("knee", "ankle", "hip")
    )
    up = state.scene.floor.normal.to(knee)
    assert float((ankle - hip - (ankle - hip) @ up * up).norm()) < 0.12
    assert float(knee[2]) < float(hip[2]) - 0.02  # towards the camera, which the person faces


def test_seen_legs_and_legs_near_the_floor_stay(make_stage):
    seen = torch.ones(1, 55, dtype=torch.bool)
    hidden = seen.clone()
    hidden[:, LEGS] = False
    for under, observed in ((0.3, seen), (-0.3, hidden), (0.04, hidden)):
        state = standing(make_stage, -under, observed)
        assert fold_hidden_legs(state) is state
