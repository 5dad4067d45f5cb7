"""Ablations: the rows of the paper's Table 3, static contacts, and PROX, as overrides of a preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from physic_core.engine.presets import PRESETS
from physic_core.engine.settings import EngineSettings, with_overrides
from physic_core.errors import ConfigError

__all__ = ["ABLATION", "Row", "rows"]

Overrides = Mapping[str, Any]
"""Stage -> field -> value, or -> term -> field -> value."""


@dataclass(frozen=True)
class Row:
    """One row of the ablation table.

    Attributes:
        name: in the paper's notation.
        overrides: settings that differ from the full model.
        preset: the row is this preset instead, whatever the full model is.
    """

    name: str
    overrides: Overrides
    preset: str | None = None

    def settings(self, full: EngineSettings) -> EngineSettings:
        """The row of a full model."""
        base = full if self.preset is None else PRESETS[self.preset]
        return with_overrides(base, self.overrides)


def rows(base_preset: str = "default") -> dict[str, EngineSettings]:
    """Name -> settings of each row, in the paper's order.

    Args:
        base_preset: preset of the full model.

    Raises:
        ConfigError: no such preset.
    """
    if base_preset not in PRESETS:
        raise ConfigError(f"no engine preset named '{base_preset}'; there are: {', '.join(sorted(PRESETS))}")
    return {row.name: row.settings(PRESETS[base_preset]) for row in ABLATION}


def _without(*parts: Overrides) -> dict[str, dict[str, Any]]:
    """Several sets of overrides as one."""
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
# The paper's MPJPE halves with the depth term: without it stage 2 does not use depth either.
_DEPTH: Overrides = {"placement": {"chamfer_weight": 0.0}, "joint": {"depth": {"weight": 0.0}}}
_OCCLUSION: Overrides = {"joint": {"visibility": {"occlusion_aware": False}}}
_FLOOR: Overrides = {
    "scene": {"floor": "off", "floor_under_people": False},
    "placement": {"floor_weight": 0.0},
}

ABLATION: tuple[Row, ...] = (
    Row("L_reg + L_j2d", _without(_CONTACT, _PENETRATION, _DEPTH, _OCCLUSION, _FLOOR)),
    Row("+ L_c", _without(_PENETRATION, _DEPTH, _OCCLUSION, _FLOOR)),
    Row("+ L_i", _without(_DEPTH, _OCCLUSION, _FLOOR)),
    Row("+ L_d", _without(_OCCLUSION, _FLOOR)),
    Row("+ occ. aware L_i", _without(_FLOOR)),
    Row("+ floor (full model)", {}),
    Row("static contacts", {"joint": {"contact": {"source": "static"}}}),
    Row("PROX", {}, preset="prox"),
)
"""Each row up to the full model adds one term to the row before."""
