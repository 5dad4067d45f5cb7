"""Distances to the scene in the scene's own unit: shrinking people and scene together gains nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS

# Contact that is never let go of, so that it is always worth something to be nearer.
STUBBORN = replace(PRESETS["default"].joint, depth_weight=0.0, starts=1, contact_weight=20.0, contact_scale=30.0)


@pytest.fixture(scope="module")
def torn(make_stage):
    """One who stands between two walls that the hands are said to touch, and cannot."""
    walls = [((-0.6, 0.0, 2.0), (-0.36, 1.3, 4.5)), ((0.36, 0.0, 2.0), (0.6, 1.3, 4.5))]
    return make_stage([({}, (0.0, 0.0, 3.2))], walls).problem


def test_what_cannot_be_touched_makes_nobody_smaller(torn):
    metres, scene = (optimize(torn, replace(STUBBORN, scene_unit=unit)) for unit in ("metres", "scene"))
    nearer, stays = (float((r.transl[0, 2] / torn.transl0[0, 2]).log()) for r in (metres, scene))
    print(f"scale {metres.scene_scale:.4f} and {scene.scene_scale:.4f}, distance {nearer:+.4f} and {stays:+.4f}")
    assert metres.scene_scale < 0.992
    assert scene.scene_scale == pytest.approx(1.0, abs=0.007)
    assert abs(stays) < 0.5 * abs(nearer)


def test_nothing_else_changes_at_the_scale_of_the_last_look(torn):
    ends = [optimize(torn, replace(STUBBORN, scene_unit=unit, frozen=("scale",))) for unit in ("metres", "scene")]
    assert torch.equal(ends[0].vertices, ends[1].vertices)
    assert ends[0].losses == ends[1].losses
