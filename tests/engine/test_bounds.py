from __future__ import annotations

from dataclasses import fields

import pytest

from physic_core.engine.bounds import range_fault
from physic_core.engine.settings import PRESETS


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_is_within_the_bounds(preset):
    stages = [getattr(PRESETS[preset], stage.name) for stage in fields(PRESETS[preset])]
    assert {
        f.name: fault for s in stages for f in fields(s) if (fault := range_fault(f.name, getattr(s, f.name)))
    } == {}


@pytest.mark.parametrize("name", ["depth_offset_sigma", "steps", "vertex_spacing_m", "contact_weight", "max_points"])
def test_zero_is_a_word_of_its_own_for_some(name):
    assert range_fault(name, 0) == ""
    assert range_fault(name, -1) == "should be >= 0 (got -1)"


@pytest.mark.parametrize("name", ["align_hypotheses", "depth_sigma", "refresh_steps", "reach_m", "robust_px_share"])
def test_what_is_divided_by_is_not_zero(name):
    assert range_fault(name, 0) == "should be > 0 (got 0)"


@pytest.mark.parametrize("name", ["edge_ratio", "far_m", "robust_m", "outlier_sigma"])
def test_infinity_switches_some_off(name):
    assert range_fault(name, float("inf")) == ""


def test_what_is_no_number_has_no_range():
    assert [range_fault("floor", "off"), range_fault("frozen", ("pose",)), range_fault("facing", False)] == ["", "", ""]
