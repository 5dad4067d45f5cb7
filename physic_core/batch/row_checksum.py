"""Checksum of a row of the journal, stored in the row itself: the SHA-256 of the row without it, with sorted keys."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

_KEY = "checksum"


def with_checksum(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with its checksum as the last key."""
    return {**row, _KEY: _checksum(row)}


def has_checksum(row: Mapping[str, Any]) -> bool:
    """Whether a row is as it was written."""
    try:
        return row.get(_KEY) == _checksum(row)
    except RecursionError:  # nested deeper than anything that is written
        return False


def _checksum(row: Mapping[str, Any]) -> str:
    content = {key: value for key, value in row.items() if key != _KEY}
    text = json.dumps(content, ensure_ascii=True, sort_keys=True, separators=(",", ":"))
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
