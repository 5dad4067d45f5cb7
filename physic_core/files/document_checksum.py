"""Checksum of a JSON document, stored in the document itself under "checksum".

It is the SHA-256 of the document without this key, as JSON in ASCII without blanks and with sorted keys, so that a
program may indent the file differently. The text "edited" in its place marks a document that a user has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from enum import Enum
from typing import Any

__all__ = ["EDITED", "ChecksumState", "checksum_state", "with_checksum"]

EDITED = "edited"
"""What a user writes in place of the checksum of a document that they changed."""

_KEY = "checksum"


class ChecksumState(Enum):
    """Whether a document is as it was written."""

    RIGHT = "right"
    WRONG = "wrong"
    MISSING = "missing"
    EDITED = "edited"


def with_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document with its checksum as the last key; one that is marked as edited stays so."""
    content = {key: value for key, value in document.items() if key != _KEY}
    return {**content, _KEY: EDITED if document.get(_KEY) == EDITED else _checksum(content)}


def checksum_state(document: Mapping[str, Any]) -> ChecksumState:
    """Compare a document with the checksum in it."""
    if _KEY not in document:
        return ChecksumState.MISSING
    if document[_KEY] == EDITED:
        return ChecksumState.EDITED
    content = {key: value for key, value in document.items() if key != _KEY}
    try:
        return ChecksumState.RIGHT if document[_KEY] == _checksum(content) else ChecksumState.WRONG
    except RecursionError:  # nested deeper than anything that is written
        return ChecksumState.WRONG


def _checksum(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, ensure_ascii=True, sort_keys=True, separators=(",", ":"))
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
