"""A reconstruction as one flat dictionary of its grade and numbers, as a row of a table."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from physic_core.types.contacts import PARTNER_KINDS

if TYPE_CHECKING:
    from physic_core.types.records import CheckResult
    from physic_core.types.results import Reconstruction

_Value = float | int | str | None


def _depths_m(result: Reconstruction) -> list[float]:
    """Return the depth of the pelvis of each person with a body."""
    joints = (person.joints for person in result.people)
    return [float(one[0, 2]) for one in joints if len(one) and all(map(math.isfinite, one[0].tolist()))]


def _touched(result: Reconstruction, kinds: Sequence[str] = PARTNER_KINDS) -> int | None:
    """Return how many pairs of a body part and a partner of these kinds touch; None without partners."""
    if any(person.contact_partner is None for person in result.people):
        return None
    return sum(contact.partner.kind in kinds for person in result.people for contact in person.contacts)


_VALUES: dict[str, Callable[[Reconstruction], _Value]] = {
    "grade": lambda result: None if result.grade is None else str(result.grade),
    "people": lambda result: len(result.people),
    "bodies": lambda result: len(_depths_m(result)),
    "width_px": lambda result: result.intrinsics.width,
    "height_px": lambda result: result.intrinsics.height,
    "focal_px": lambda result: result.intrinsics.fy,
    "focal_known": lambda result: int(result.intrinsics.known),
    "floor_found": lambda result: int(result.scene.floor is not None),
    "scene_valid_share": lambda result: float(result.scene.valid.mean()),
    "scene_scale": lambda result: result.scene.scale,
    "scale_sigma": lambda result: result.scene.scale_sigma,
    "distance_sigma": lambda result: result.distance_sigma,
    "nearest_person_m": lambda result: min(_depths_m(result), default=None),
    "farthest_person_m": lambda result: max(_depths_m(result), default=None),
    "contact_vertices": lambda result: sum(int(person.contact.sum()) for person in result.people),
    "contact_parts": _touched,
    **{f"contact_{kind}": partial(_touched, kinds=(kind,)) for kind in PARTNER_KINDS},
    "failed_checks": lambda result: sum(check.failed for check in result.checks),
    "unknown_checks": lambda result: sum(not (check.ok or check.failed) for check in result.checks),
    "warnings": lambda result: len(result.warnings),
    "seconds": lambda result: sum(stage.seconds for stage in result.stages),
    "load_seconds": lambda result: sum(stage.load_seconds for stage in result.stages),
}

SUMMARY_KEYS = tuple(_VALUES)
"""Keys of every summary; that of a result also has ``check_NAME`` for each self-check."""


def summarize(result: Reconstruction) -> dict[str, _Value]:
    """Return grade and numbers, as :meth:`physic_core.types.Reconstruction.summary`."""
    values = {name: value(result) for name, value in _VALUES.items()}
    by_name: dict[str, list[CheckResult]] = defaultdict(list)
    for check in result.checks:
        by_name[check.name].append(check)
    return values | {f"check_{name}": _worst(group) for name, group in by_name.items()}


def metres_text(metres: float, log_sigma: float | None, digits: int = 2) -> str:
    """Return a length with its standard deviation: "4.20 ± 0.71 m"; without one: "4.20 m".

    Args:
        metres: the length.
        log_sigma: standard deviation of its logarithm, or None.
        digits: after the point.
    """
    spread = "" if log_sigma is None else f" ± {log_sigma * abs(metres):.{digits}f}"
    return f"{round(metres, digits) + 0.0:.{digits}f}{spread} m"  # no "-0.00"


def _worst(checks: list[CheckResult]) -> float | None:
    """Return the worst value of one check of several people; None if nothing was measured."""
    values = [check.value for check in checks if check.value is not None]
    worst = max if checks[0].direction == "at most" else min
    return worst(values, default=None)
