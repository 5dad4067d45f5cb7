"""Engine settings: presets, and what is told of every field."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest

from physic_core.engine import settings as module
from physic_core.engine.presets import PRESETS
from physic_core.engine.settings import EngineSettings, PlacementSettings, SceneSettings


def test_presets_hold_ours_and_the_papers() -> None:
    assert PRESETS["default"] == EngineSettings()
    paper = PRESETS["paper"]
    assert (paper.placement.reprojection_weight, paper.placement.chamfer_weight) == (5000.0, 0.6)
    assert (paper.placement.method, paper.scene.floor, paper.scene.align_residual) == ("paper", "metric", "metric")


@pytest.mark.parametrize("settings", [SceneSettings, PlacementSettings, module.JointSettings, module.ContactSettings])
def test_every_field_is_told_in_the_docstring(settings: type) -> None:
    assert is_dataclass(settings)
    told = set(re.findall(r"^\s{8}(\w+): ", settings.__doc__ or "", flags=re.MULTILINE))
    assert {f.name for f in fields(settings)} == told


def test_settings_cannot_be_edited_in_place() -> None:
    with pytest.raises(FrozenInstanceError):
        PRESETS["default"].scene.far_m = 3.0  # type: ignore[misc]
