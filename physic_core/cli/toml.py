"""Format Python values as TOML."""

from __future__ import annotations

import json
import math
from typing import Any


def toml_value(value: Any) -> str:
    """Format a bool, number, text, list or dictionary as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    text = json.dumps(value, ensure_ascii=False)
    # A path that is not UTF-8 has surrogates, which TOML cannot express and a terminal cannot print.
    return text.encode(errors="backslashreplace").decode()
