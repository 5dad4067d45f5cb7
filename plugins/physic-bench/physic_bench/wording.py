"""Numbers with their noun."""

from __future__ import annotations


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return "1 frame" or "2 frames"; ``plural`` is the plural if it does not end in s."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"
