"""Lengths with their standard deviation, as text."""

from __future__ import annotations


def metres_text(metres: float, log_sigma: float | None, digits: int = 2) -> str:
    """Return a length with its standard deviation: "4.20 ± 0.71 m"; without one: "4.20 m".

    Args:
        metres: the length.
        log_sigma: standard deviation of its logarithm, or None.
        digits: after the point.
    """
    spread = "" if log_sigma is None else f" ± {log_sigma * abs(metres):.{digits}f}"
    return f"{round(metres, digits) + 0.0:.{digits}f}{spread} m"  # no "-0.00"
