"""Engine settings: presets, overrides, and what is refused."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest

from physic_core.engine import settings as module
from physic_core.engine.settings import PRESETS, EngineSettings, HumanSettings, SceneSettings, with_overrides
from physic_core.errors import ConfigError


def test_presets_hold_ours_and_the_papers() -> None:
    assert PRESETS["default"] == EngineSettings()
    paper = PRESETS["paper"]
    assert (paper.human.reprojection_weight, paper.human.chamfer_weight) == (5000.0, 0.6)
    assert (paper.human.iterations, paper.human.learning_rate, paper.human.lbfgs_steps) == (30, 1e-2, 2)
    assert paper.human.facing_deg == 70.0
    assert (paper.scene.floor, paper.scene.floor_tolerance_m) == ("metric", 0.01)


@pytest.mark.parametrize("settings", [SceneSettings, HumanSettings, module.JointSettings, module.ContactSettings])
def test_every_field_is_told_in_the_docstring(settings: type) -> None:
    assert is_dataclass(settings)
    told = set(re.findall(r"^\s{8}(\w+): ", settings.__doc__ or "", flags=re.MULTILINE))
    assert {f.name for f in fields(settings)} == told


def test_settings_cannot_be_edited_in_place() -> None:
    with pytest.raises(FrozenInstanceError):
        PRESETS["default"].scene.far_m = 3.0  # type: ignore[misc]


def test_overrides_reach_nested_fields_and_leave_the_rest() -> None:
    changed = with_overrides(EngineSettings(), {"scene": {"floor": "off", "far_m": 30}, "human": {"facing_deg": 80.0}})
    assert changed.scene == SceneSettings(floor="off", far_m=30.0)
    assert isinstance(changed.scene.far_m, float)
    assert changed.human == HumanSettings(facing_deg=80.0)
    assert changed.joint == EngineSettings().joint


def test_infinity_can_be_written_as_text() -> None:
    assert with_overrides(SceneSettings(), {"edge_ratio": "inf"}).edge_ratio == float("inf")


def test_overrides_name_every_fault_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        with_overrides(
            EngineSettings(), {"scene": {"floor": "flat", "far_m": True, "seed": 1.5}, "human": 3, "contact": {"x": 1}}
        )
    known = ", ".join(sorted(f.name for f in fields(module.ContactSettings)))
    assert str(caught.value) == (
        "engine settings: scene.floor must be one of 'disparity', 'metric', 'off', got 'flat'; "
        "scene.far_m must be a number, got True; scene.seed must be a whole number, got 1.5; "
        f"human is a table of settings, got 3; contact.x does not exist, known here: {known}"
    )
