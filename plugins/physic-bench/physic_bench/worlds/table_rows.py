"""Rows of the ablation table: settings of the engine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

from physic_core.errors import ConfigError
from physic_core.files.text import to_json

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings

START, FULL, TRIAL = "start", "full", "trial"


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
        """Hash of the settings and of their types, which select the energy; independent of the label."""
        settings: Any = None
        if self.settings is not None:
            types = [type(getattr(self.settings, stage.name)).__name__ for stage in fields(self.settings)]
            settings = [types, to_json(asdict(self.settings), digits=7)]
        return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


_KEYS = {
    "L_reg + L_j2d": "reprojection",
    "+ L_c": "contact",
    "+ L_i": "penetration",
    "+ L_d": "depth",
    "+ occ. aware L_i": "occlusion",
    "+ floor (full model)": FULL,
    "PROX": "prox",
    "static contacts": "static",
}
"""Label of each row in the engine -> key for ``--rows``, in table order."""


def ablation_rows(preset: str) -> tuple[TableRow, ...]:
    """Return the start row and all ablation rows of an engine preset, in the paper's order.

    Raises:
        ConfigError: the engine has no such preset.
    """
    from physic_bench.worlds.ablation import rows

    settings = rows(preset)
    return (TableRow(START, "start (the estimators' own)", None), *(TableRow(_KEYS[n], n, settings[n]) for n in _KEYS))


def select_rows(preset: str, keys: Sequence[str]) -> tuple[TableRow, ...]:
    """Select rows of the ablation table by key. The name of an engine preset is also a key.

    Args:
        preset: engine preset of the table.
        keys: keys of rows or names of presets; if empty, all rows and no other preset.

    Raises:
        ConfigError: no row or preset has this key.
    """
    from physic_core import engine_preset, engine_preset_names

    rows = ablation_rows(preset)
    names = [name for name in engine_preset_names() if name not in _KEYS.values()]
    others = tuple(TableRow(name, f"preset {name}", engine_preset(name)) for name in names)
    known = [row.key for row in (*rows, *others)]
    for key in keys:
        if key not in known:
            raise ConfigError(f"no row named '{key}'; there are: {', '.join(known)}")
    return tuple(row for row in (*rows, *others) if row.key in keys) if keys else rows
