"""Engine settings: presets, and what is told of every field."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest

from physic_core.engine.presets import PRESETS
from physic_core.engine.presets.default import DefaultOptimisation
from physic_core.engine.settings import PRESET_NAMES, EngineSettings, PlacementSettings


def test_presets_hold_ours_and_the_papers() -> None:
    placement = PlacementSettings(detect_lifted_feet=True)
    assert PRESETS["default"] == EngineSettings(placement=placement, joint=DefaultOptimisation())
    assert [name for name, preset in PRESETS.items() if preset.placement.detect_lifted_feet] == ["default"]
    paper = PRESETS["paper"]
    assert (paper.placement.reprojection_weight, paper.placement.chamfer_weight) == (5000.0, 0.6)
    assert (paper.placement.method, paper.scene.floor, paper.scene.align_residual) == ("paper", "metric", "metric")


def settings_of(presets: Iterable[object]) -> list[type]:
    """The classes of all settings, those inside others too."""
    found: dict[type, None] = {}
    for one in presets:
        inner = [getattr(one, f.name) for f in fields(one)]  # type: ignore[arg-type]
        found |= dict.fromkeys([type(one), *settings_of([value for value in inner if is_dataclass(value)])])
    found.pop(EngineSettings, None)
    return list(found)


@pytest.mark.parametrize("settings", settings_of(PRESETS.values()), ids=lambda kind: kind.__name__)
def test_every_field_is_in_the_docstring(settings: type) -> None:
    assert is_dataclass(settings)
    told = set(re.findall(r"^\s{8}(\w+): ", settings.__doc__ or "", flags=re.MULTILINE))
    assert {f.name for f in fields(settings)} == told


def test_settings_cannot_be_edited_in_place() -> None:
    with pytest.raises(FrozenInstanceError):
        PRESETS["default"].scene.far_m = 3.0  # type: ignore[misc]


def test_the_names_of_the_presets_are_known_without_their_energies():
    assert tuple(PRESETS) == PRESET_NAMES
