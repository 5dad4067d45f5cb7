"""Every numeric setting has a least and a greatest value; ``tools/attacks/extremes.py`` runs them all."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from pydantic import BaseModel

from extremes import extremes
from physic_core import engine_preset_names
from physic_core.configuration.model import PhotoSettings, RunSettings, stage_models
from physic_core.discovery.plugins import discover

INFINITE = {"far_m", "robust_px_share", "robust_m"}
"""Settings whose documentation gives infinity a meaning."""


def models() -> list[Any]:
    found: dict[str, type[BaseModel]] = {"photo": PhotoSettings, "run": RunSettings}
    for preset in engine_preset_names():
        found |= {f"{preset} {stage}": model for stage, model in stage_models(preset).items()}
    registry = discover()
    for offer in registry:
        if offer.origin.distribution.startswith("physic-"):
            found[f"{offer.record.interface} {offer.record.name}"] = registry.load_class(offer).Options
    return [pytest.param(model, id=name) for name, model in found.items()]


def numbers(value: Any) -> list[float]:
    return [n for item in value for n in numbers(item)] if isinstance(value, list) else [value]


@pytest.mark.parametrize("model", models())
def test_every_setting_is_bounded(model: type[BaseModel]):
    for path, value in extremes(model):
        assert path[-1] in INFINITE or all(isinstance(n, str) or math.isfinite(n) for n in numbers(value)), path
        if model is PhotoSettings:  # its settings need each other
            continue
        table: Any = value
        for key in reversed(path[1:]):
            table = {key: table}
        try:
            model.model_validate({path[0]: table})
        except ValueError as error:
            pytest.fail(f"{'.'.join(path)} = {json.dumps(value)[:100]}: {error}")
