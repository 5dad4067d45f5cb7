"""Rows of the ablation table: those of the paper's Table 3, static contacts and PROX, as overrides
of a preset.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from physic_core import engine_preset, engine_preset_names
from physic_core.engine.settings import EngineSettings, with_overrides
from physic_core.errors import ConfigError
from physic_core.files.text import to_json

START = "start"
FULL = "full"
TRIAL = "trial"

Overrides = Mapping[str, Any]
"""Changed settings: stage -> field -> value, or stage -> term -> field -> value."""


@dataclass(frozen=True)
class TableRow:
    """One row of the ablation table.

    Attributes:
        key: short name, for ``--rows``.
        label: printed label.
        settings: engine settings; None for the estimators' own bodies.
    """

    key: str
    label: str
    settings: EngineSettings | None

    @property
    def digest(self) -> str:
        """Hash of the settings and of their types, which select the energy; independent of the
        label.
        """
        settings: Any = None
        if self.settings is not None:
            types = [
                type(getattr(self.settings, stage.name)).__name__ for stage in fields(self.settings)
            ]
            settings = [types, to_json(asdict(self.settings), digits=7)]
        return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


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

_ROWS: tuple[tuple[str, str, Overrides], ...] = (
    (
        "reprojection",
        "L_reg + L_j2d",
        _without(_CONTACT, _PENETRATION, _DEPTH, _OCCLUSION, _FLOOR),
    ),
    ("contact", "+ L_c", _without(_PENETRATION, _DEPTH, _OCCLUSION, _FLOOR)),
    ("penetration", "+ L_i", _without(_DEPTH, _OCCLUSION, _FLOOR)),
    ("depth", "+ L_d", _without(_OCCLUSION, _FLOOR)),
    ("occlusion", "+ occ. aware L_i", _FLOOR),
    (FULL, "+ floor (full model)", {}),
)
"""Key, name in the paper's notation, and what each row changes of the full model: each adds one
term to the previous one.
"""


def ablation_rows(preset: str) -> tuple[TableRow, ...]:
    """Return the start row and all ablation rows of an engine preset, which is the full model, in
    the paper's order.

    Raises:
        ConfigError: the engine has no such preset.
    """
    full = engine_preset(preset)
    static = with_overrides(full, {"joint": {"contact": {"source": "static"}}})
    return (
        TableRow(START, "start (the estimators' own)", None),
        *(TableRow(key, name, with_overrides(full, changed)) for key, name, changed in _ROWS),
        TableRow("prox", "PROX", engine_preset("prox")),
        TableRow("static", "static contacts", static),
    )


def select_rows(preset: str, keys: Sequence[str]) -> tuple[TableRow, ...]:
    """Select rows of the ablation table by key. The name of an engine preset is also a key.

    Args:
        preset: engine preset of the table.
        keys: keys of rows or names of presets; if empty, all rows and no other preset.

    Raises:
        ConfigError: no row or preset has this key.
    """
    rows = ablation_rows(preset)
    names = [name for name in engine_preset_names() if name not in {row.key for row in rows}]
    others = tuple(TableRow(name, f"preset {name}", engine_preset(name)) for name in names)
    known = [row.key for row in (*rows, *others)]
    for key in keys:
        if key not in known:
            raise ConfigError(f"no row named '{key}'; there are: {', '.join(known)}")
    return tuple(row for row in (*rows, *others) if row.key in keys) if keys else rows
