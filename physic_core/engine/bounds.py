"""Which numbers the engine's settings may hold."""

from __future__ import annotations

import math
import re
from typing import Any

__all__ = ["range_fault"]

_POSITIVE = re.compile(
    r".*(_hypotheses|_max_pixels|_sigma|_sigma_m|_scale|_neighbors|reach_m|far_m|robust_m|robust_px_share)"
    r"|(align|floor)_tolerance(_m)?|(floor_spacing_m|floor_lower_share|facing_deg|learning_rate|iterations)"
    r"|(refresh|lbfgs)_steps|lbfgs_inner"
)
"""Names that the engine divides by, draws or counts."""

_ZERO_SAYS = ("depth_offset_sigma",)
"""Would be positive by its name, but 0 means something."""

_SHARE = re.compile(
    r".*(min_share|_lower_share|occlusion_share|confidence|_probability)|floor_max_below|floor_hole_weight"
)
"""Parts of a whole."""

_ENDLESS = re.compile(r".*(edge_ratio|far_m|robust_m|robust_px_share|outlier_sigma)")
"""Infinity switches these off."""


def range_fault(name: str, value: Any) -> str:
    """What is wrong with a number of the engine's settings, "" where nothing is.

    Args:
        name: of the field, in any class of :mod:`physic_core.engine.settings`.
        value: of the right kind already; what is no number has no range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    for holds, words in _limits(name, value):
        if not holds:
            return f"should be {words} (got {value!r})"
    return ""


def _limits(name: str, value: float) -> list[tuple[bool, str]]:
    limits = [(not math.isnan(value), "a number")]
    if not _ENDLESS.fullmatch(name):
        limits.append((math.isfinite(value), "a finite number"))
    if name == "edge_ratio":
        return [*limits, (value > 1, "> 1")]
    if _POSITIVE.fullmatch(name) and name not in _ZERO_SAYS:
        limits.append((value > 0, "> 0"))
    limits.append((value >= 0, ">= 0"))
    if _SHARE.fullmatch(name):
        limits.append((value <= 1, "<= 1"))
    if name.endswith("_deg"):
        limits.append((value <= 180, "<= 180"))
    return limits
