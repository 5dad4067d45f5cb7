"""Engine settings: presets, and what is told of every field."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest

from physic_core import engine_preset
from physic_core.cli.template import texts_of_fields
from physic_core.engine.presets.default import DefaultOptimisation
from physic_core.engine.settings import EngineSettings, PlacementSettings

NAMES = ("default", "paper", "prox", "release")


def test_presets_hold_ours_and_the_papers() -> None:
    placement = PlacementSettings(detect_lifted_feet=True)
    assert engine_preset("default") == EngineSettings(placement=placement, joint=DefaultOptimisation())
    assert [name for name in NAMES if engine_preset(name).placement.detect_lifted_feet] == ["default"]
    paper = engine_preset("paper")
    assert (paper.placement.reprojection_weight, paper.placement.chamfer_weight) == (5000.0, 0.6)
    assert paper.scene.floor == "metric"
    assert paper.scene.method().alignment.residual == "metric"


def settings_of(presets: Iterable[object]) -> list[type]:
    """The classes of all settings, those inside others too."""
    found: dict[type, None] = {}
    for one in presets:
        inner = [getattr(one, f.name) for f in fields(one)]  # type: ignore[arg-type]
        found |= dict.fromkeys([type(one), *settings_of([value for value in inner if is_dataclass(value)])])
    found.pop(EngineSettings, None)
    return list(found)


@pytest.mark.parametrize("settings", settings_of(map(engine_preset, NAMES)), ids=lambda kind: kind.__name__)
def test_every_field_has_a_text_in_its_class_or_in_a_base(settings: type) -> None:
    assert is_dataclass(settings)
    assert {f.name for f in fields(settings)} == set(texts_of_fields(settings))


def test_settings_cannot_be_edited_in_place() -> None:
    with pytest.raises(FrozenInstanceError):
        engine_preset("default").scene.far_m = 3.0  # type: ignore[misc]
