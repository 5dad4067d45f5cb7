"""The JSON Schema of ``reconstruction.json``, which is shipped beside this module."""

from __future__ import annotations

from pathlib import Path

__all__ = ["schema_file"]


def schema_file() -> Path:
    """Return the path of the JSON Schema (draft 2020-12) of ``reconstruction.json`` as it is written now."""
    return Path(__file__).with_name("reconstruction.schema.json")
