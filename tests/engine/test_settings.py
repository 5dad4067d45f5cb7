"""Engine settings: presets, and the description of every field."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import pytest

from physic_core import engine_preset


def test_settings_cannot_be_edited_in_place() -> None:
    with pytest.raises(FrozenInstanceError):
        engine_preset("default").scene.far_m = 3.0  # type: ignore[misc]
