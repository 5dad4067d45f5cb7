"""The rows of the ablation table, and a trial beside them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from physic_core.configuration.faults import closest
from physic_core.errors import ConfigError
from physic_core.files.strict_json import to_json

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings

__all__ = ["FULL", "START", "TRIAL", "Row", "ablation_rows", "pick"]

START, FULL, TRIAL = "start", "full", "trial"


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Attributes:
        key: short name, for ``--rows``.
        label: as printed.
        settings: of the engine; None for the estimators' own bodies.
    """

    key: str
    label: str
    settings: EngineSettings | None

    @property
    def digest(self) -> str:
        """Names the settings, whatever the row is called."""
        settings = None if self.settings is None else to_json(asdict(self.settings), digits=7)
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
"""The engine's names of the rows -> what one types; in the order of the table."""


def ablation_rows(preset: str) -> tuple[Row, ...]:
    """All rows on top of a preset of the engine, in the paper's order; the start before them.

    Raises:
        ConfigError: the engine has no such preset.
    """
    from physic_core.engine.presets.ablation import rows

    settings = rows(preset)
    return (Row(START, "start (the estimators' own)", None), *(Row(_KEYS[n], n, settings[n]) for n in _KEYS))


def pick(preset: str, keys: Sequence[str]) -> tuple[Row, ...]:
    """The rows that are named, in the order of the table, and after them other presets of the engine by their names.

    Args:
        preset: of the engine, that the table is about.
        keys: of rows, or names of presets; all rows and no other preset where none is named.

    Raises:
        ConfigError: there is no such row or preset.
    """
    from physic_core.engine.presets import PRESETS

    rows = ablation_rows(preset)
    others = tuple(Row(name, f"preset {name}", found) for name, found in PRESETS.items() if name not in _KEYS.values())
    known = [row.key for row in (*rows, *others)]
    for key in keys:
        if key not in known:
            raise ConfigError(f"no row named '{key}'; there are: {', '.join(known)}{closest(key, known)}")
    return tuple(row for row in (*rows, *others) if row.key in keys) if keys else rows
