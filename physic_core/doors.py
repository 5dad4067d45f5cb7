"""What methods of a result call in packages above it: the root of the package names it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

DOORS: dict[str, Callable[[], Callable[..., Any]]] = {}
"""Name of a door -> returns the function behind it, which is imported then."""
