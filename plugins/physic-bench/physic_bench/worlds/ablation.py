"""Ablations: rows of the paper's Table 3, static contacts and PROX, as overrides of a preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from physic_core import engine_preset
from physic_core.engine.settings import EngineSettings, with_overrides

Overrides = Mapping[str, Any]
"""Changed settings: stage -> field -> value, or stage -> term -> field -> value."""


@dataclass(frozen=True)
class AblationRow:
    """One row of the ablation table.

    Attributes:
        name: in the paper's notation.
        overrides: settings that differ from the full model.
        preset: base of the overrides, instead of the full model.
    """

    name: str
    overrides: Overrides
    preset: str | None = None

    def settings(self, full: EngineSettings) -> EngineSettings:
        """Return the settings of this row, given those of the full model."""
        base = full if self.preset is None else engine_preset(self.preset)
        return with_overrides(base, self.overrides)


def rows(base_preset: str = "default") -> dict[str, EngineSettings]:
    """Return the settings of each row by name, in the paper's order; ``base_preset`` is the full model.

    Raises:
        ConfigError: unknown preset.
    """
    full = engine_preset(base_preset)
    return {row.name: row.settings(full) for row in ABLATION}


def _without(*parts: Overrides) -> dict[str, dict[str, Any]]:
    """Merge several sets of overrides."""
    merged: dict[str, dict[str, Any]] = {}
    for part in parts:
        for stage, changed in part.items():
            merged.setdefault(stage, {}).update(changed)
    return merged


_CONTACT: Overrides = {"joint": {"contact": {"weight": 0.0}}}
_PENETRATION: Overrides = {
    "scene": {"carve_m": 0.0},
    "joint": {"penetration": {"weight": 0.0}},
}
# The paper's MPJPE halves with the depth term, so this row has no depth in stage 2 either.
_DEPTH: Overrides = {"placement": {"chamfer_weight": 0.0}, "joint": {"depth": {"weight": 0.0}}}
_OCCLUSION: Overrides = {"joint": {"visibility": {"occlusion_aware": False}}}
_FLOOR: Overrides = {
    "scene": {"floor": "off"},
    "placement": {"floor_weight": 0.0},
}

ABLATION: tuple[AblationRow, ...] = (
    AblationRow("L_reg + L_j2d", _without(_CONTACT, _PENETRATION, _DEPTH, _OCCLUSION, _FLOOR)),
    AblationRow("+ L_c", _without(_PENETRATION, _DEPTH, _OCCLUSION, _FLOOR)),
    AblationRow("+ L_i", _without(_DEPTH, _OCCLUSION, _FLOOR)),
    AblationRow("+ L_d", _without(_OCCLUSION, _FLOOR)),
    AblationRow("+ occ. aware L_i", _without(_FLOOR)),
    AblationRow("+ floor (full model)", {}),
    AblationRow("static contacts", {"joint": {"contact": {"source": "static"}}}),
    AblationRow("PROX", {}, preset="prox"),
)
"""Rows of the ablation table; each row up to the full model adds one term to the previous one."""
